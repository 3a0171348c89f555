/**
 * @file chiplog_firmware.h
 * @brief Dead reckoning in integers: wheel counters and a gyro's codes in, a pose out.
 *
 * The C99 twin of Chiplog's kernel: the same inputs leave every field of the state equal, bit for
 * bit, to those of `firmware_model.Kernel`. No floating point, no heap, no division, no library
 * call but the copying of a struct. One state per robot; functions touch nothing else, so
 * several robots may run side by side and an interrupt may run one of them.
 *
 * Fraction bits: a name with `_q` is an integer in units of 2^-n of the unit before it. n follows
 * from the configuration: position P, step S, heading F, turn step K, sine and cosine T, gyro
 * offset O. All widths below are proved by `build_config` for every configuration it makes; that x
 * and y stay within their word, by `chiplog export-c` for the mission that stands in
 * chiplog_config.h, whatever way the robot turns; its way is that of the wheels, to and fro.
 * What `--force` wrote, or what was filled in by hand, is unproved.
 */
#ifndef CHIPLOG_FIRMWARE_H
#define CHIPLOG_FIRMWARE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** @name Validity of an input; any other number counts as INVALID. @{ */
#define CHIPLOG_FRESH 0   /**< A sample of this tick, checked and believed. */
#define CHIPLOG_STALE 1   /**< No new sample has arrived; the value is not looked at. */
#define CHIPLOG_INVALID 2 /**< The sender has no value, or a check failed; not looked at. */
/** @} */

/** @name Bits of the status word; DEGRADED, OVERFLOW and LOSS stay until the next start. @{ */
#define CHIPLOG_STATUS_INITIALISED UINT32_C(0x0001)
#define CHIPLOG_STATUS_STANDSTILL UINT32_C(0x0002)
#define CHIPLOG_STATUS_OFFSET_VALID UINT32_C(0x0004)
#define CHIPLOG_STATUS_GYRO_STALE UINT32_C(0x0008)
#define CHIPLOG_STATUS_GYRO_INVALID UINT32_C(0x0010)
#define CHIPLOG_STATUS_GYRO_SATURATED UINT32_C(0x0020)
#define CHIPLOG_STATUS_GYRO_STUCK UINT32_C(0x0040)
#define CHIPLOG_STATUS_ENCODER_STALE UINT32_C(0x0080)
#define CHIPLOG_STATUS_ENCODER_INVALID UINT32_C(0x0100)
#define CHIPLOG_STATUS_ENCODER_JUMP UINT32_C(0x0200)
#define CHIPLOG_STATUS_WHEEL_FALLBACK UINT32_C(0x0400)
#define CHIPLOG_STATUS_POSITION_HELD UINT32_C(0x0800)
#define CHIPLOG_STATUS_POSITION_DEGRADED UINT32_C(0x1000)
#define CHIPLOG_STATUS_OVERFLOW UINT32_C(0x2000)
#define CHIPLOG_STATUS_ENCODER_LOSS UINT32_C(0x4000)
/** @} */

/** @name Rounding where bits are dropped, and what happens beyond a word. @{ */
#define CHIPLOG_FLOOR 0       /**< Toward minus infinity. */
#define CHIPLOG_HALF_UP 1     /**< To nearest, ties toward plus infinity. */
#define CHIPLOG_HALF_EVEN 2   /**< To nearest, ties to the even neighbour. */
#define CHIPLOG_TOWARD_ZERO 3 /**< The magnitude's fraction is dropped. */
#define CHIPLOG_WRAP 0        /**< Modulo the word's span. */
#define CHIPLOG_SATURATE 1    /**< Stay at the word's limit. */
/** @} */

/** @name Choices of the configuration. @{ */
#define CHIPLOG_MODE_WHEEL 0   /**< Heading from the wheels. */
#define CHIPLOG_MODE_GYRO 1    /**< Heading from the gyro. */
#define CHIPLOG_MODE_BLEND 2   /**< Wheels plus weight times (gyro minus wheels). */
#define CHIPLOG_EULER_BEFORE 0 /**< A step is taken along the heading before its tick. */
#define CHIPLOG_MIDPOINT 1     /**< ... halfway through its tick. */
#define CHIPLOG_EULER_AFTER 2  /**< ... after its tick. */
#define CHIPLOG_TRIG_TABLE 0   /**< Sine by a quarter-wave table. */
#define CHIPLOG_TRIG_CORDIC 1  /**< Sine by shift-and-add rotations. */
/** @} */

/** @name What became of an encoder sample, and what moved the heading. @{ */
#define CHIPLOG_NOT_USED 0
#define CHIPLOG_ACCEPTED 1
#define CHIPLOG_REBASED 2
#define CHIPLOG_HELD 0
#define CHIPLOG_WHEELS 1
#define CHIPLOG_GYRO 2
#define CHIPLOG_BLEND 3
/** @} */

/** @brief Everything the kernel needs besides its inputs; written by `chiplog export-c`. */
typedef struct chiplog_config {
    const int32_t *sine_table;    /**< 2^table_index_bits + 1 sines of a quarter turn, T bits. */
    const int64_t *cordic_table;  /**< Start length (T + 4 bits), then angles in 2^-40 turn. */
    int64_t half_tick_m_q;        /**< Half a tick's distance, S + step_shift bits [m]. */
    int64_t tick_turn_q;          /**< Turn of one tick, K + wheel_turn_shift bits [turn]. */
    int64_t sensitivity_turn_q;   /**< Turn per code, K + gyro_turn_shift - O bits [turn/LSB]. */
    int64_t turn_low_q;           /**< Word of the turn step, K bits [turn]. */
    int64_t turn_high_q;          /**< Its upper limit. */
    int64_t position_low_q;       /**< Word of x and y, P bits [m]. */
    int64_t position_high_q;      /**< Its upper limit. */
    int64_t zero_rate_code_q;     /**< Nominal code at rest, O bits [LSB]. */
    int64_t auto_zero_rate_q;     /**< Slower turns count as none, O bits [LSB]. */
    int64_t rest_max_rate_q;      /**< A gyro beyond this says the robot moves, O bits [LSB]. */
    int64_t stuck_span_ticks;     /**< Turning of a block that a live gyro cannot miss [ticks]. */
    int64_t tick_rate_hz_q;       /**< Ticks per second, 16 bits [Hz]. */
    int64_t tick_rate_rad_q;      /**< 2 pi times that, 16 bits [rad/turn * Hz]. */
    int32_t blend_weight_q;       /**< The gyro's weight, blend_frac_bits. */
    int32_t max_step_ticks;       /**< Largest believed increment of one tick [ticks]. */
    int32_t step_low_q;           /**< Word of the step, S bits [m]. */
    int32_t step_high_q;          /**< Its upper limit. */
    int32_t velocity_low_q;       /**< Word of both velocities, velocity_frac_bits. */
    int32_t velocity_high_q;      /**< Its upper limit. */
    uint32_t gap_limit_ticks;     /**< Longest gap that is bridged [ticks]. */
    int32_t gyro_min_code;        /**< This code and those below are out of range [LSB]. */
    int32_t gyro_max_code;        /**< This code and those above are out of range [LSB]. */
    int32_t still_tolerance_ticks; /**< Wheel movement that counts as rest [ticks]. */
    uint32_t stuck_ticks;         /**< A code repeated this long is suspect [ticks]. */
    uint16_t stuck_block_ticks;   /**< Length of a block [ticks]. */
    uint16_t jump_confirm_samples; /**< Agreeing refused samples that make a new baseline. */
    uint16_t still_ticks;         /**< Rest this long is a standstill [ticks]. */
    uint16_t settle_ticks;        /**< Gyro samples left out at either end of it [ticks]. */
    uint8_t mode;                 /**< CHIPLOG_MODE_... */
    uint8_t integration;          /**< CHIPLOG_EULER_BEFORE, CHIPLOG_MIDPOINT, ... */
    uint8_t stale_heading_ticks;  /**< 0, or the position's heading is this old [ticks], to 4. */
    uint8_t blend_frac_bits;      /**< Fraction bits of blend_weight_q, to 30. */
    uint8_t counter_bits;         /**< Width of the encoder counters, 4 to 32. */
    uint8_t step_shift;           /**< Bits dropped on the way to the step, to 60. */
    uint8_t step_rounding;        /**< CHIPLOG_FLOOR, ... */
    uint8_t step_overflow;        /**< CHIPLOG_WRAP or CHIPLOG_SATURATE. */
    uint8_t step_carry;           /**< 1: what rounding drops is added to the next value. */
    uint8_t wheel_turn_shift;     /**< Bits dropped on the way to a turn by the wheels, to 60. */
    uint8_t gyro_turn_shift;      /**< Bits dropped on the way to a turn by the gyro, to 60. */
    uint8_t turn_rounding;        /**< CHIPLOG_FLOOR, ... */
    uint8_t turn_overflow;        /**< CHIPLOG_WRAP or CHIPLOG_SATURATE. */
    uint8_t turn_carry;           /**< As step_carry. */
    uint8_t heading_frac_bits;    /**< F, 4 to 32. */
    uint8_t heading_shift;        /**< K - F, to 48. */
    uint8_t heading_rounding;     /**< CHIPLOG_FLOOR, ... */
    uint8_t heading_carry;        /**< As step_carry. */
    uint8_t trig_method;          /**< CHIPLOG_TRIG_TABLE or CHIPLOG_TRIG_CORDIC. */
    uint8_t trig_frac_bits;       /**< T, 2 to 30. */
    uint8_t trig_rounding;        /**< CHIPLOG_FLOOR, ... */
    uint8_t trig_interpolated;    /**< 1: straight lines between entries; 0: nearest entry. */
    uint8_t table_index_bits;     /**< log2 of the table's steps, to 16. */
    uint8_t cordic_iterations;    /**< Rotations, 1 to 34. */
    uint8_t position_shift;       /**< S + T - P, to 61. */
    uint8_t position_rounding;    /**< CHIPLOG_FLOOR, ... */
    uint8_t position_overflow;    /**< CHIPLOG_WRAP or CHIPLOG_SATURATE. */
    uint8_t position_carry;       /**< As step_carry. */
    uint8_t position_frac_bits;   /**< P; for whoever reads the pose. */
    uint8_t offset_frac_bits;     /**< O, to 16. */
    uint8_t offset_rounding;      /**< CHIPLOG_FLOOR, ... */
    uint8_t offset_block_log2;    /**< The first estimate averages 2^this samples, to 16. */
    uint8_t offset_max_log2;      /**< The longest averages 2^this samples, to 16. */
    uint8_t v_shift;              /**< Bits dropped on the way to the speed, to 56. */
    uint8_t w_pre_shift;          /**< Bits of the turn dropped before it meets the tick rate. */
    uint8_t w_shift;              /**< Bits dropped on the way to the turn rate, to 60. */
    uint8_t velocity_frac_bits;   /**< Of both velocities, to 24. */
    uint8_t velocity_filter_log2; /**< Low-pass over about 2^this ticks, to 8. */
} chiplog_config;

/** @brief Everything the kernel remembers. */
typedef struct chiplog_state {
    int64_t x_m_q;                  /**< Position, P bits [m]. */
    int64_t y_m_q;                  /**< Position, P bits [m]. */
    int64_t x_remainder_q;          /**< Carried remainder, S + T bits [m]. */
    int64_t y_remainder_q;          /**< Carried remainder, S + T bits [m]. */
    int64_t heading_remainder_q;    /**< Carried remainder, K bits [turn]. */
    int64_t step_remainder_q;       /**< Carried remainder, S + step_shift bits [m]. */
    int64_t wheel_turn_remainder_q; /**< Carried remainder, K + wheel_turn_shift bits [turn]. */
    int64_t gyro_turn_remainder_q;  /**< Carried remainder, K + gyro_turn_shift bits [turn]. */
    int64_t v_filter_q;             /**< 2^velocity_filter_log2 times the step, S bits [m]. */
    int64_t w_filter_q;             /**< 2^velocity_filter_log2 times the turn, K bits [turn]. */
    int64_t gap_turn_q;             /**< Turn since the last accepted counts, K bits [turn]. */
    int64_t gyro_offset_q;          /**< Zero-rate code in use, O bits [LSB]. */
    int64_t turn_block_sum;         /**< Right minus left count of the running block [ticks]. */
    int64_t turn_block_low;         /**< Smallest sum of a block [ticks]. */
    int64_t turn_block_high;        /**< Largest sum of a block [ticks]. */
    int64_t overflow_count;         /**< How often a step, a turn, x or y left its word. */
    int64_t tick;                   /**< Ticks since the start. */
    int32_t heading_turn_q;         /**< Heading in [-1/2, 1/2), F bits [turn]. */
    int32_t past_1_turn_q;          /**< Heading of one tick ago, F bits [turn]. */
    int32_t past_2_turn_q;          /**< Heading of two ticks ago, F bits [turn]. */
    int32_t past_3_turn_q;          /**< Heading of three ticks ago, F bits [turn]. */
    int32_t left_step_ticks;        /**< Accepted increment of this tick [ticks]. */
    int32_t right_step_ticks;       /**< Accepted increment of this tick [ticks]. */
    int32_t cosine_q;               /**< Of the latest step's heading, T bits. */
    int32_t sine_q;                 /**< Of the latest step's heading, T bits. */
    int32_t gyro_code;              /**< Latest code, held to the gyro's range [LSB]. */
    int32_t repeated_code;          /**< The code watched for repetition; -1: none [LSB]. */
    int32_t still_left_ticks;       /**< Excursion from where the rest began [ticks]. */
    int32_t still_right_ticks;      /**< Excursion from where the rest began [ticks]. */
    uint32_t left_count;            /**< Last accepted counter reading [ticks]. */
    uint32_t right_count;           /**< Last accepted counter reading [ticks]. */
    uint32_t gap_ticks;             /**< Ticks since the last accepted reading. */
    uint32_t candidate_left_count;  /**< Possible new baseline [ticks]. */
    uint32_t candidate_right_count; /**< Possible new baseline [ticks]. */
    uint32_t candidate_age_ticks;   /**< Ticks since the last reading that agreed with it. */
    uint32_t offset_sum;            /**< Sum of codes that the offset in use came from [LSB]. */
    uint32_t rest_sum;              /**< Sum of codes of this standstill [LSB]. */
    uint32_t pending_sum;           /**< Sum of codes of the estimate that waits [LSB]. */
    uint32_t rest_samples;          /**< Codes in rest_sum, to 2^16. */
    uint32_t repeated_ticks;        /**< Repetitions of repeated_code, to stuck_ticks. */
    uint32_t status;                /**< CHIPLOG_STATUS_... */
    uint16_t turn_block_ticks;      /**< Ticks in the running block. */
    uint16_t still_ticks;           /**< Ticks of rest, to the threshold. */
    uint16_t rest_ticks;            /**< Ticks of standstill, to settle_ticks. */
    uint16_t pending_ticks;         /**< Ticks until the waiting estimate is taken into use. */
    uint16_t candidate_samples;     /**< Refused readings that agree. */
    uint8_t v_is_valid;             /**< 1: this tick told a speed. */
    uint8_t w_is_valid;             /**< 1: this tick told a turn rate. */
    uint8_t encoder_decision;       /**< CHIPLOG_NOT_USED, CHIPLOG_ACCEPTED, CHIPLOG_REBASED. */
    uint8_t heading_source;         /**< CHIPLOG_HELD, CHIPLOG_WHEELS, ... */
    uint8_t gyro_is_zeroed;         /**< 1: this tick's rate was taken for rest. */
    uint8_t is_initialised;         /**< 1: the counters have a baseline. */
    uint8_t gap_misses_gyro;        /**< 1: a gyro sample was missing in the gap. */
    uint8_t offset_is_valid;        /**< 1: the offset in use was estimated. */
    uint8_t offset_samples_log2;    /**< log2 of the codes in offset_sum. */
    uint8_t turn_blocks;            /**< 1: a block has been closed. */
    uint8_t rest_next_log2;         /**< log2 of the codes of the next estimate. */
    uint8_t pending_samples_log2;   /**< log2 of the codes in pending_sum. */
} chiplog_state;

/** @brief One tick's readings. */
typedef struct chiplog_inputs {
    uint32_t left_count;      /**< Left counter, read modulo its width [ticks]. */
    uint32_t right_count;     /**< Right counter [ticks]. */
    int32_t gyro_code;        /**< Gyro code of the tick that ends now [LSB]. */
    uint8_t encoder_validity; /**< CHIPLOG_FRESH, CHIPLOG_STALE or CHIPLOG_INVALID. */
    uint8_t gyro_validity;    /**< As encoder_validity. */
} chiplog_inputs;

/**
 * @brief Set the state of power-on: all zero, the gyro's offset at its nominal code.
 * @param state  is overwritten
 * @param config as exported
 *
 * Scaling and overflow: the offset has O fraction bits, as the nominal code.
 */
void chiplog_kernel_start(chiplog_state *state, const chiplog_config *config);

/**
 * @brief Take one tick's readings and advance the state.
 * @param state  of one robot
 * @param config the same at each call
 * @param inputs counters and code with their validity
 *
 * Scaling and overflow: stated at each function called; the order is part of the algorithm. The
 * tick count has 63 bits.
 */
void chiplog_kernel_step(chiplog_state *state, const chiplog_config *config,
                         const chiplog_inputs *inputs);

/**
 * @brief The low-passed forward speed; the last one while v_is_valid is 0.
 * @return speed, velocity_frac_bits [m/s]
 *
 * Scaling and overflow: the step has S bits (below 2^31) and the tick rate 16; their product is
 * below 2^62; rounded to nearest into 32 bits that saturate. overflow_count does not count that:
 * no state is made of it.
 */
int32_t chiplog_kernel_speed_m_s_q(const chiplog_state *state, const chiplog_config *config);

/**
 * @brief The low-passed turn rate; the last one while w_is_valid is 0.
 * @return turn rate, velocity_frac_bits [rad/s]
 *
 * Scaling and overflow: the turn has K bits and is narrowed by w_pre_shift so that its product
 * with the tick rate (16 bits) is below 2^62; rounded to nearest into 32 bits that saturate.
 * overflow_count does not count that: no state is made of it.
 */
int32_t chiplog_kernel_turn_rate_rad_s_q(const chiplog_state *state,
                                         const chiplog_config *config);

#ifdef __cplusplus
}
#endif

#endif /* CHIPLOG_FIRMWARE_H */
