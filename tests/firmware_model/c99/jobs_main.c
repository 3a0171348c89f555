/**
 * @file jobs_main.c
 * @brief The job runner as a program of a PC: jobs from standard input, answers to its output.
 */
#include <stdio.h>

#include "jobs.h"

int machine_read(void *bytes, uint32_t count)
{
    return fread(bytes, 1, count, stdin) == count;
}

int machine_write(const void *bytes, uint32_t count)
{
    return fwrite(bytes, 1, count, stdout) == count;
}

uint32_t machine_clock(void)
{
    return 0;
}

int main(void)
{
    return run_jobs();
}
