/**
 * @file jobs.c
 * @brief Runs the kernel over streams of readings, on any machine that can read and write bytes.
 *
 * A job is a header, a configuration, its tables and its readings, each as the struct lies in
 * memory; pointers in the configuration are not looked at. The answer of a job is one record a tick
 * and the final state; of one that is measured, one `job_cost`.
 */
#include "jobs.h"

#include <stddef.h>

#include "chiplog_firmware.h"

#define MAX_SINES 65537u
#define MAX_ANGLES 35u
#define BLOCK 512u
#define REPEATS 40u /* one unit of the clock is 40 instructions: repeated so often, exact */
#define CLOCK_MASK UINT32_C(0xFFFFFF)

typedef struct job_header {
    uint32_t config_bytes; /* sizeof(chiplog_config) */
    uint32_t sines;
    uint32_t angles;
    uint32_t ticks;
    uint32_t is_measured;
} job_header;

typedef struct job_record {
    int64_t x_m_q;
    int64_t y_m_q;
    int64_t gyro_offset_q;
    int32_t heading_turn_q;
    int32_t v_m_s_q;
    int32_t w_rad_s_q;
    uint32_t status;
    uint8_t heading_source;
    uint8_t v_is_valid;
    uint8_t w_is_valid;
    uint8_t reserved[5];
} job_record;

typedef struct job_cost {
    uint64_t instructions; /* of all ticks, but for what measuring them takes */
    uint32_t worst;        /* of one tick */
    uint32_t ticks;
} job_cost;

static int32_t sines[MAX_SINES];
static int64_t angles[MAX_ANGLES];
static chiplog_inputs readings[BLOCK];
static job_record records[BLOCK];

/** @brief What the firmware would put on a bus after this tick. */
static void note(const chiplog_state *state, const chiplog_config *config, job_record *record)
{
    uint32_t i;

    record->x_m_q = state->x_m_q;
    record->y_m_q = state->y_m_q;
    record->gyro_offset_q = state->gyro_offset_q;
    record->heading_turn_q = state->heading_turn_q;
    record->v_m_s_q = chiplog_kernel_speed_m_s_q(state, config);
    record->w_rad_s_q = chiplog_kernel_turn_rate_rad_s_q(state, config);
    record->status = state->status;
    record->heading_source = state->heading_source;
    record->v_is_valid = state->v_is_valid;
    record->w_is_valid = state->w_is_valid;
    for (i = 0; i < sizeof(record->reserved); i++) {
        record->reserved[i] = 0;
    }
}

/** @brief The clock's units for REPEATS ticks from this state, each from a copy. */
static uint32_t clock_units(const chiplog_state *state, const chiplog_config *config,
                            const chiplog_inputs *inputs)
{
    static chiplog_state scratch;
    uint32_t start;
    uint32_t i;

    start = machine_clock();
    for (i = 0; i < REPEATS; i++) {
        scratch = *state;
        if (inputs) {
            chiplog_kernel_step(&scratch, config, inputs);
        }
    }
    return (start - machine_clock()) & CLOCK_MASK;
}

static int run_job(const job_header *header, const chiplog_config *config)
{
    static chiplog_state state;
    job_cost cost = {0, 0, 0};
    uint32_t done = 0;
    uint32_t idle;

    chiplog_kernel_start(&state, config);
    idle = clock_units(&state, config, NULL);
    while (done < header->ticks) {
        uint32_t count = header->ticks - done;
        uint32_t i;

        if (count > BLOCK) {
            count = BLOCK;
        }
        if (!machine_read(readings, count * (uint32_t)sizeof(readings[0]))) {
            return 0;
        }
        for (i = 0; i < count; i++) {
            if (header->is_measured) {
                const uint32_t units = clock_units(&state, config, &readings[i]) - idle;
                cost.instructions += units;
                cost.ticks += 1u;
                if (units > cost.worst) {
                    cost.worst = units;
                }
            }
            chiplog_kernel_step(&state, config, &readings[i]);
            note(&state, config, &records[i]);
        }
        if (!header->is_measured &&
            !machine_write(records, count * (uint32_t)sizeof(records[0]))) {
            return 0;
        }
        done += count;
    }
    return header->is_measured ? machine_write(&cost, (uint32_t)sizeof(cost))
                               : machine_write(&state, (uint32_t)sizeof(state));
}

int run_jobs(void)
{
    job_header header;
    chiplog_config config;

    while (machine_read(&header, (uint32_t)sizeof(header))) {
        if (header.config_bytes != sizeof(config) || header.sines > MAX_SINES ||
            header.angles > MAX_ANGLES || !machine_read(&config, (uint32_t)sizeof(config)) ||
            (header.sines > 0u &&
             !machine_read(sines, header.sines * (uint32_t)sizeof(sines[0]))) ||
            (header.angles > 0u &&
             !machine_read(angles, header.angles * (uint32_t)sizeof(angles[0])))) {
            return 1;
        }
        config.sine_table = sines;
        config.cordic_table = angles;
        if (!run_job(&header, &config)) {
            return 1;
        }
    }
    return 0;
}
