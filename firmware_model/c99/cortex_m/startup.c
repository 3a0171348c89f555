/**
 * @file startup.c
 * @brief The job runner on a bare Arm Cortex-M3: vectors, semihosting, SysTick.
 *
 * For QEMU's machine mps2-an385: vectors at 0, RAM at 0x20000000. Files are read and written through
 * semihosting (Arm IHI 0068): jobs.bin and answers.bin in QEMU's working directory.
 */
#include <stddef.h>
#include <stdint.h>

#include "jobs.h"

#define SYS_OPEN 0x01u
#define SYS_WRITE 0x05u
#define SYS_READ 0x06u
#define SYS_EXIT_EXTENDED 0x20u
#define MODE_READ_BINARY 1u
#define MODE_WRITE_BINARY 5u
#define APPLICATION_EXIT 0x20026u

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)
#define SYSTICK_ON_CORE_CLOCK 5u

extern uint32_t stack_top[];
void reset(void);
static void fault(void);
void *memcpy(void *restrict to, const void *restrict from, size_t count);
void *memset(void *to, int value, size_t count);

typedef union vector {
    const uint32_t *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    {.stack = stack_top}, {.handler = reset}, {.handler = fault}, {.handler = fault},
    {.handler = fault},   {.handler = fault}, {.handler = fault},
};

static uint32_t jobs_file;
static uint32_t answers_file;

/** @brief Ask the emulator: operation in r0, arguments in r1, answer in r0. */
static uint32_t semihosting(uint32_t operation, const void *arguments)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;

    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void leave(uint32_t status)
{
    const uint32_t arguments[2] = {APPLICATION_EXIT, status};

    for (;;) {
        (void)semihosting(SYS_EXIT_EXTENDED, arguments);
    }
}

static void fault(void)
{
    leave(3);
}

static uint32_t open_file(const char *name, uint32_t length, uint32_t mode)
{
    const uint32_t arguments[3] = {(uint32_t)(uintptr_t)name, mode, length};

    return semihosting(SYS_OPEN, arguments);
}

int machine_read(void *bytes, uint32_t count)
{
    const uint32_t arguments[3] = {jobs_file, (uint32_t)(uintptr_t)bytes, count};

    return semihosting(SYS_READ, arguments) == 0u; /* the answer is what was not read */
}

int machine_write(const void *bytes, uint32_t count)
{
    const uint32_t arguments[3] = {answers_file, (uint32_t)(uintptr_t)bytes, count};

    return semihosting(SYS_WRITE, arguments) == 0u;
}

uint32_t machine_clock(void)
{
    return SYSTICK_VALUE;
}

void reset(void)
{
    SYSTICK_RELOAD = 0xFFFFFFu;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = SYSTICK_ON_CORE_CLOCK;
    jobs_file = open_file("jobs.bin", 8, MODE_READ_BINARY);
    answers_file = open_file("answers.bin", 11, MODE_WRITE_BINARY);
    if (jobs_file == UINT32_MAX || answers_file == UINT32_MAX) {
        leave(2);
    }
    leave((uint32_t)run_jobs());
}

/* What the compiler may call for a struct; there is no C library here. */

void *memcpy(void *restrict to, const void *restrict from, size_t count)
{
    uint8_t *out = to;
    const uint8_t *in = from;

    while (count-- > 0u) {
        *out++ = *in++;
    }
    return to;
}

void *memset(void *to, int value, size_t count)
{
    uint8_t *out = to;

    while (count-- > 0u) {
        *out++ = (uint8_t)value;
    }
    return to;
}
