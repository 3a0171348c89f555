/**
 * @file host.c
 * @brief The C99 kernel behind the inputs of `firmware_model`, for a shared library on a PC.
 *
 * Not for a microcontroller: a counter or code of 64 bits is brought to the width that the kernel
 * takes, without changing what the kernel makes of it.
 */
#include "chiplog_firmware.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

EXPORT int64_t chiplog_host_state_bytes(void);
EXPORT int64_t chiplog_host_config_bytes(void);
EXPORT void chiplog_host_start(chiplog_state *state, const chiplog_config *config);
EXPORT void chiplog_host_step(chiplog_state *state, const chiplog_config *config,
                              int64_t left_count, int64_t right_count, int64_t encoder_validity,
                              int64_t gyro_code, int64_t gyro_validity);
EXPORT int32_t chiplog_host_speed(const chiplog_state *state, const chiplog_config *config);
EXPORT int32_t chiplog_host_turn_rate(const chiplog_state *state, const chiplog_config *config);
EXPORT void chiplog_host_run(chiplog_state *state, const chiplog_config *config, int64_t ticks,
                             const int64_t *left_count, const int64_t *right_count,
                             const int8_t *encoder_validity, const int64_t *gyro_code,
                             const int8_t *gyro_validity, int64_t *pose_q, int32_t *status,
                             int8_t *heading_source);

/** @brief The size of a state, by which the loader checks its own layout. */
int64_t chiplog_host_state_bytes(void)
{
    return (int64_t)sizeof(chiplog_state);
}

/** @brief The size of a configuration, by which the loader checks its own layout. */
int64_t chiplog_host_config_bytes(void)
{
    return (int64_t)sizeof(chiplog_config);
}

/** @brief As chiplog_kernel_start. */
void chiplog_host_start(chiplog_state *state, const chiplog_config *config)
{
    chiplog_kernel_start(state, config);
}

/** @brief A validity in 8 bits: any number but FRESH and STALE is INVALID. */
static uint8_t validity(int64_t value)
{
    if (value == CHIPLOG_FRESH) {
        return CHIPLOG_FRESH;
    }
    return value == CHIPLOG_STALE ? CHIPLOG_STALE : CHIPLOG_INVALID;
}

/** @brief A gyro's code in 32 bits: what is beyond them is beyond any gyro's range as well. */
static int32_t code(int64_t value)
{
    if (value > INT32_MAX) {
        return INT32_MAX;
    }
    return value < INT32_MIN ? INT32_MIN : (int32_t)value;
}

/** @brief As chiplog_kernel_step; counters are read modulo 2^32, of which theirs is a divisor. */
void chiplog_host_step(chiplog_state *state, const chiplog_config *config, int64_t left_count,
                       int64_t right_count, int64_t encoder_validity, int64_t gyro_code,
                       int64_t gyro_validity)
{
    const chiplog_inputs inputs = {
        .left_count = (uint32_t)(uint64_t)left_count,
        .right_count = (uint32_t)(uint64_t)right_count,
        .gyro_code = code(gyro_code),
        .encoder_validity = validity(encoder_validity),
        .gyro_validity = validity(gyro_validity),
    };

    chiplog_kernel_step(state, config, &inputs);
}

/** @brief As chiplog_kernel_speed_m_s_q. */
int32_t chiplog_host_speed(const chiplog_state *state, const chiplog_config *config)
{
    return chiplog_kernel_speed_m_s_q(state, config);
}

/** @brief As chiplog_kernel_turn_rate_rad_s_q. */
int32_t chiplog_host_turn_rate(const chiplog_state *state, const chiplog_config *config)
{
    return chiplog_kernel_turn_rate_rad_s_q(state, config);
}

/** @brief Step through arrays of readings; without pose_q no history is kept. */
void chiplog_host_run(chiplog_state *state, const chiplog_config *config, int64_t ticks,
                      const int64_t *left_count, const int64_t *right_count,
                      const int8_t *encoder_validity, const int64_t *gyro_code,
                      const int8_t *gyro_validity, int64_t *pose_q, int32_t *status,
                      int8_t *heading_source)
{
    int64_t tick;

    for (tick = 0; tick < ticks; tick++) {
        chiplog_host_step(state, config, left_count[tick], right_count[tick],
                          encoder_validity[tick], gyro_code[tick], gyro_validity[tick]);
        if (pose_q) {
            pose_q[3 * tick] = state->x_m_q;
            pose_q[3 * tick + 1] = state->y_m_q;
            pose_q[3 * tick + 2] = state->heading_turn_q;
            status[tick] = (int32_t)state->status;
            heading_source[tick] = (int8_t)state->heading_source;
        }
    }
}
