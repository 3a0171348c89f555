/**
 * @file chiplog_firmware.c
 * @brief Chiplog's dead-reckoning kernel in C99; chiplog_firmware.h says what it is.
 *
 * The order of the functions is that of `firmware_model`: integers, encoder, gyro, standstill,
 * trigonometry, pose, velocity, step. Each says its Q formats, and why nothing leaves its type.
 */
#include "chiplog_firmware.h"

#include <stddef.h>

/*
 * Two things that C99 leaves to the implementation (6.5.7 and 6.3.1.3) and this file relies on,
 * each in one function below: a right shift of a negative number rounds toward minus infinity, and
 * an unsigned number beyond int64_t converts modulo 2^64. An array of -1 elements stops a compiler
 * that does otherwise.
 */
typedef char chiplog_right_shift_is_arithmetic[((-INT64_C(3) >> 1) == -INT64_C(2)) ? 1 : -1];
typedef char chiplog_conversion_is_modular[((int64_t)UINT64_MAX == -INT64_C(1)) ? 1 : -1];

#define STICKY                                                                                   \
    (CHIPLOG_STATUS_POSITION_DEGRADED | CHIPLOG_STATUS_OVERFLOW | CHIPLOG_STATUS_ENCODER_LOSS)
#define LOSS (CHIPLOG_STATUS_ENCODER_LOSS | CHIPLOG_STATUS_POSITION_DEGRADED)

#define QUARTER_TURN (UINT32_C(1) << 30) /* in 2^-32 turn */
#define CORDIC_ANGLE_SCALE INT64_C(256)  /* 2^-32 turn in 2^-40 turn */
#define CORDIC_GUARD_BITS 4u

/* Integers ---------------------------------------------------------------------------------- */

/**
 * @brief The floor of value / 2^bits: the one right shift of a signed number.
 *
 * Scaling and overflow: drops bits (0 to 62) fraction bits; the result is no larger than value.
 */
static inline int64_t floor_shift(int64_t value, unsigned bits)
{
    return value >> bits;
}

/**
 * @brief The number whose two's complement pattern is given: the one conversion out of range.
 *
 * Scaling and overflow: every pattern of 64 bits is a number of int64_t.
 */
static inline int64_t as_signed(uint64_t pattern)
{
    return (int64_t)pattern;
}

/**
 * @brief 2^bits, for scaling up by a product: a left shift of a negative number is undefined.
 *
 * Scaling and overflow: bits is 0 to 62.
 */
static inline int64_t power_of_two(unsigned bits)
{
    return INT64_C(1) << bits;
}

/**
 * @brief value / 2^bits, rounded.
 *
 * Scaling and overflow: drops bits (0 to 61) fraction bits. |value| is at most 2^62; what is added
 * is below a quantum (2^61), so the sum stays inside 64 bits.
 */
static inline int64_t shift_round(int64_t value, unsigned bits, unsigned rounding)
{
    uint64_t added;

    if (rounding <= CHIPLOG_HALF_UP) {
        /* FLOOR is 0 and HALF_UP is 1: nothing or half a quantum, for 0 bits too. */
        added = ((uint64_t)rounding << bits) >> 1;
    } else {
        const uint64_t mask = (UINT64_C(1) << bits) - 1u;

        if (rounding == CHIPLOG_HALF_EVEN) {
            /* Half a quantum to an odd quotient, one unit less than that to an even one. */
            added = (mask + (((uint64_t)value >> bits) & 1u)) >> 1;
        } else {
            added = value < 0 ? mask : 0u;
        }
    }
    return floor_shift(value + as_signed(added), bits);
}

/**
 * @brief value modulo 2^bits, in [-2^(bits-1), 2^(bits-1)).
 *
 * Scaling and overflow: bits is 1 to 62. The sum is unsigned and wraps; the masked value is
 * below 2^62.
 */
static inline int64_t wrap_signed(int64_t value, unsigned bits)
{
    const uint64_t half = UINT64_C(1) << (bits - 1u);

    return as_signed(((uint64_t)value + half) & ((half << 1) - 1u)) - as_signed(half);
}

/**
 * @brief value brought into a two's complement word [low, high].
 *
 * Scaling and overflow: low is -high - 1 and |value| is at most 2^62. The difference and the mask
 * are unsigned; a masked value is at most high - low, so its sum with low is inside the word. A
 * word of 64 bits contains every value and never comes this far.
 */
static int64_t limit(int64_t value, int64_t low, int64_t high, unsigned overflow)
{
    if (value >= low && value <= high) {
        return value;
    }
    if (overflow == CHIPLOG_SATURATE) {
        return value < low ? low : high;
    }
    return as_signed((((uint64_t)value - (uint64_t)low) & ((uint64_t)high - (uint64_t)low)) +
                     (uint64_t)low);
}

/**
 * @brief 1 when accumulator + increment lies outside [low, high], else 0.
 *
 * Scaling and overflow: the accumulator is inside the word and |increment| at most 2^62. The
 * accumulator is compared with limit - increment, which fits even for a word of 64 bits.
 */
static inline int sum_exceeds(int64_t accumulator, int64_t increment, int64_t low, int64_t high)
{
    if (increment > 0) {
        return accumulator > high - increment;
    }
    return accumulator < low - increment;
}

/**
 * @brief accumulator + increment, known to lie outside the word [low, high], brought into it.
 *
 * Scaling and overflow: words of up to 64 bits. Wrapped, the sum, the difference from low and the
 * mask are unsigned, all modulo 2^64, of which the word's span is a divisor.
 */
static int64_t overflowed_sum(int64_t accumulator, int64_t increment, int64_t low, int64_t high,
                              unsigned overflow)
{
    const uint64_t sum = (uint64_t)accumulator + (uint64_t)increment;

    if (overflow == CHIPLOG_SATURATE) {
        return increment > 0 ? high : low;
    }
    return as_signed(((sum - (uint64_t)low) & ((uint64_t)high - (uint64_t)low)) + (uint64_t)low);
}

/* Encoder ----------------------------------------------------------------------------------- */

/**
 * @brief The increment from one counter reading to another, modulo the counter's width.
 *
 * Scaling and overflow: ticks. The difference is unsigned and wraps at 2^32, of which the
 * counter's range (4 to 32 bits) is a divisor; the result fits 32 bits.
 */
static inline int32_t increment(uint32_t now, uint32_t before, unsigned counter_bits)
{
    return (int32_t)wrap_signed((int64_t)(uint32_t)(now - before), counter_bits);
}

/**
 * @brief 1 when both wheels can have gone so far in the given ticks, else 0.
 *
 * Scaling and overflow: ticks. max_step_ticks is below 2^31 and a gap is at most 2^31, so the
 * product is below 2^62.
 */
static inline int is_believed(const chiplog_config *config, uint32_t ticks, int32_t left_step,
                              int32_t right_step)
{
    const int64_t believed = (int64_t)config->max_step_ticks * (int64_t)ticks;

    return -believed <= left_step && left_step <= believed && -believed <= right_step &&
           right_step <= believed;
}

/**
 * @brief Take the counts as the new baseline; nothing moves.
 *
 * Scaling and overflow: ticks, unchanged.
 */
static void rebase(chiplog_state *state, uint32_t left_count, uint32_t right_count)
{
    state->encoder_decision = CHIPLOG_REBASED;
    state->left_count = left_count;
    state->right_count = right_count;
    state->candidate_samples = 0;
}

/**
 * @brief Count refused readings that agree with each other; re-base when there are enough.
 *
 * Scaling and overflow: as take_encoder; the count ends at jump_confirm_samples, 16 bits.
 */
static void consider_new_baseline(chiplog_state *state, const chiplog_config *config,
                                  uint32_t left_count, uint32_t right_count)
{
    const int32_t left_step =
        increment(left_count, state->candidate_left_count, config->counter_bits);
    const int32_t right_step =
        increment(right_count, state->candidate_right_count, config->counter_bits);

    if (state->candidate_samples > 0u &&
        is_believed(config, state->candidate_age_ticks, left_step, right_step)) {
        state->candidate_samples = (uint16_t)(state->candidate_samples + 1u);
    } else {
        state->candidate_samples = 1;
    }
    state->candidate_left_count = left_count;
    state->candidate_right_count = right_count;
    state->candidate_age_ticks = 0;
    if (state->candidate_samples >= config->jump_confirm_samples) {
        state->status |= LOSS;
        rebase(state, left_count, right_count);
    }
}

/**
 * @brief Decide on this tick's encoder reading; set the decision and both increments.
 *
 * Scaling and overflow: counts are reduced to the counter's width first. Gaps stop counting one
 * tick beyond the limit, at most 2^31.
 */
static void take_encoder(chiplog_state *state, const chiplog_config *config,
                         const chiplog_inputs *inputs)
{
    const uint32_t mask = UINT32_MAX >> (32u - config->counter_bits);
    const uint32_t left_count = inputs->left_count & mask;
    const uint32_t right_count = inputs->right_count & mask;
    int32_t left_step;
    int32_t right_step;

    state->encoder_decision = CHIPLOG_NOT_USED;
    state->left_step_ticks = 0;
    state->right_step_ticks = 0;
    if (state->gap_ticks <= config->gap_limit_ticks) {
        state->gap_ticks += 1u;
    }
    if (state->candidate_samples > 0u) {
        state->candidate_age_ticks += 1u;
        if (state->candidate_age_ticks > config->gap_limit_ticks) {
            state->candidate_samples = 0;
        }
    }
    if (inputs->encoder_validity != CHIPLOG_FRESH) {
        state->status |= inputs->encoder_validity == CHIPLOG_STALE ? CHIPLOG_STATUS_ENCODER_STALE
                                                                   : CHIPLOG_STATUS_ENCODER_INVALID;
        return;
    }
    if (state->is_initialised == 0u) {
        state->is_initialised = 1;
        rebase(state, left_count, right_count);
        return;
    }
    if (state->gap_ticks > config->gap_limit_ticks) {
        state->status |= LOSS;
        rebase(state, left_count, right_count);
        return;
    }
    left_step = increment(left_count, state->left_count, config->counter_bits);
    right_step = increment(right_count, state->right_count, config->counter_bits);
    if (is_believed(config, state->gap_ticks, left_step, right_step)) {
        state->encoder_decision = CHIPLOG_ACCEPTED;
        state->left_step_ticks = left_step;
        state->right_step_ticks = right_step;
        state->left_count = left_count;
        state->right_count = right_count;
        state->candidate_samples = 0;
        return;
    }
    state->status |= CHIPLOG_STATUS_ENCODER_JUMP;
    consider_new_baseline(state, config, left_count, right_count);
}

/* Gyro -------------------------------------------------------------------------------------- */

/**
 * @brief Add a full block to the range of the wheels' turning and start the next.
 *
 * Scaling and overflow: ticks; sums of at most 2^12 differences below 2^32.
 */
static void close_block(chiplog_state *state)
{
    if (state->turn_blocks == 0u) {
        state->turn_blocks = 1;
        state->turn_block_low = state->turn_block_sum;
        state->turn_block_high = state->turn_block_sum;
    } else if (state->turn_block_sum < state->turn_block_low) {
        state->turn_block_low = state->turn_block_sum;
    } else if (state->turn_block_sum > state->turn_block_high) {
        state->turn_block_high = state->turn_block_sum;
    }
    state->turn_block_ticks = 0;
    state->turn_block_sum = 0;
}

/**
 * @brief 1 when the gyro's code stands still although the wheels' turning does not, else 0.
 *
 * Scaling and overflow: block sums are below 2^45; the repeat counter stops at its threshold.
 */
static int gyro_is_stuck(chiplog_state *state, const chiplog_config *config)
{
    if (state->gyro_code != state->repeated_code) {
        state->repeated_code = state->gyro_code;
        state->repeated_ticks = 0;
        state->turn_blocks = 0;
        state->turn_block_ticks = 0;
        state->turn_block_sum = 0;
        return 0;
    }
    if (state->repeated_ticks < config->stuck_ticks) {
        state->repeated_ticks += 1u;
    }
    if (state->encoder_decision == CHIPLOG_ACCEPTED && state->gap_ticks == 1u) {
        state->turn_block_sum += (int64_t)state->right_step_ticks - state->left_step_ticks;
        state->turn_block_ticks = (uint16_t)(state->turn_block_ticks + 1u);
        if (state->turn_block_ticks == config->stuck_block_ticks) {
            close_block(state);
        }
    } else { /* a block with a gap in it would be compared with whole ones */
        state->turn_block_ticks = 0;
        state->turn_block_sum = 0;
    }
    if (state->repeated_ticks < config->stuck_ticks || state->turn_blocks == 0u) {
        return 0;
    }
    return state->turn_block_high - state->turn_block_low > config->stuck_span_ticks;
}

/**
 * @brief 1 when this tick's gyro code is believed, else 0; its code is kept in the state.
 *
 * Scaling and overflow: LSB. A code that is used lies between the two limits, so within 16 bits,
 * whatever was handed in.
 */
static int take_gyro(chiplog_state *state, const chiplog_config *config,
                     const chiplog_inputs *inputs)
{
    int is_usable = 1;

    if (inputs->gyro_validity != CHIPLOG_FRESH) {
        state->status |= inputs->gyro_validity == CHIPLOG_STALE ? CHIPLOG_STATUS_GYRO_STALE
                                                                : CHIPLOG_STATUS_GYRO_INVALID;
        return 0;
    }
    if (inputs->gyro_code <= config->gyro_min_code) {
        state->gyro_code = config->gyro_min_code;
        state->status |= CHIPLOG_STATUS_GYRO_SATURATED;
        is_usable = 0;
    } else if (inputs->gyro_code >= config->gyro_max_code) {
        state->gyro_code = config->gyro_max_code;
        state->status |= CHIPLOG_STATUS_GYRO_SATURATED;
        is_usable = 0;
    } else {
        state->gyro_code = inputs->gyro_code;
    }
    if (gyro_is_stuck(state, config)) {
        state->status |= CHIPLOG_STATUS_GYRO_STUCK;
        is_usable = 0;
    }
    return is_usable;
}

/* Standstill -------------------------------------------------------------------------------- */

/**
 * @brief Forget the standstill and every sum that was not yet taken into use.
 *
 * Scaling and overflow: zeros.
 */
static void stop_resting(chiplog_state *state)
{
    state->still_ticks = 0;
    state->still_left_ticks = 0;
    state->still_right_ticks = 0;
    state->rest_ticks = 0;
    state->rest_samples = 0;
    state->rest_sum = 0;
    state->rest_next_log2 = 0;
    state->pending_ticks = 0;
}

/**
 * @brief Make the pending mean the gyro's offset in use.
 *
 * Scaling and overflow: the sum is below 2^32, with O more fraction bits below 2^48; the mean has
 * O fraction bits.
 */
static void use_estimate(chiplog_state *state, const chiplog_config *config)
{
    state->offset_sum = state->pending_sum;
    state->offset_samples_log2 = state->pending_samples_log2;
    state->offset_is_valid = 1;
    state->gyro_offset_q =
        shift_round((int64_t)state->pending_sum * power_of_two(config->offset_frac_bits),
                    state->pending_samples_log2, config->offset_rounding);
}

/**
 * @brief Add this tick's code to the sum; prepare an estimate, or take one into use.
 *
 * Scaling and overflow: LSB. At most 2^16 codes of 16 bits are summed, below 2^32; their number
 * is at most 2^16.
 */
static void learn_offset(chiplog_state *state, const chiplog_config *config, int gyro_is_usable)
{
    if (state->pending_ticks > 0u) {
        state->pending_ticks = (uint16_t)(state->pending_ticks - 1u);
        if (state->pending_ticks == 0u) {
            use_estimate(state, config);
        }
    }
    if (state->rest_ticks < config->settle_ticks) {
        state->rest_ticks = (uint16_t)(state->rest_ticks + 1u);
        return;
    }
    if (!gyro_is_usable) {
        return;
    }
    if (state->rest_next_log2 < config->offset_block_log2) {
        state->rest_next_log2 = config->offset_block_log2;
    }
    state->rest_sum += (uint32_t)state->gyro_code;
    state->rest_samples += 1u;
    if (state->rest_samples != UINT32_C(1) << state->rest_next_log2) {
        return;
    }
    if (state->pending_ticks == 0u) { /* an estimate that already waits for its turn goes first */
        state->pending_sum = state->rest_sum;
        state->pending_samples_log2 = state->rest_next_log2;
        state->pending_ticks = config->settle_ticks;
        if (config->settle_ticks == 0u) {
            use_estimate(state, config);
        }
    }
    if (state->rest_next_log2 < config->offset_max_log2) {
        state->rest_next_log2 = (uint8_t)(state->rest_next_log2 + 1u);
    } else {
        state->rest_sum = 0;
        state->rest_samples = 0;
    }
}

/**
 * @brief 1 in a standstill, else 0; the offset is learnt in it when the gyro is usable.
 *
 * Scaling and overflow: excursions are formed in 64 bits and kept only within the tolerance (at
 * most 100 ticks). The code's distance from its nominal zero has O bits and is below 2^33. The
 * counter stops at its threshold.
 */
static int is_standstill(chiplog_state *state, const chiplog_config *config, int gyro_is_usable)
{
    const int64_t tolerance = config->still_tolerance_ticks;
    const int64_t left = (int64_t)state->still_left_ticks + state->left_step_ticks;
    const int64_t right = (int64_t)state->still_right_ticks + state->right_step_ticks;

    if (state->encoder_decision != CHIPLOG_ACCEPTED || left < -tolerance || left > tolerance ||
        right < -tolerance || right > tolerance) {
        stop_resting(state);
        return 0;
    }
    state->still_left_ticks = (int32_t)left;
    state->still_right_ticks = (int32_t)right;
    if (gyro_is_usable) {
        const int64_t rate_q = state->gyro_code * power_of_two(config->offset_frac_bits) -
                               config->zero_rate_code_q;
        if (rate_q < -config->rest_max_rate_q || rate_q > config->rest_max_rate_q) {
            stop_resting(state);
            return 0;
        }
    }
    if (state->still_ticks < config->still_ticks) {
        state->still_ticks = (uint16_t)(state->still_ticks + 1u);
    }
    if (state->still_ticks < config->still_ticks) {
        return 0;
    }
    state->status |= CHIPLOG_STATUS_STANDSTILL;
    learn_offset(state, config, gyro_is_usable);
    return 1;
}

/* Trigonometry ------------------------------------------------------------------------------ */

/**
 * @brief The sine of 0 to 2^30 (both included) in 2^-32 turn, by table.
 *
 * Scaling and overflow: T fraction bits, at most 2^30. The top bits of the angle index the table,
 * the lower ones interpolate: table steps are at most 2^30 and the fraction at most 30 bits, so the
 * product is below 2^60.
 */
static int32_t quarter_sine(const chiplog_config *config, uint32_t angle_turn_q32)
{
    const unsigned fraction_bits = 30u - config->table_index_bits;
    const int32_t *entry;
    uint32_t fraction;

    if (config->trig_interpolated == 0u) {
        if (fraction_bits > 0u) {
            angle_turn_q32 += UINT32_C(1) << (fraction_bits - 1u); /* the nearest entry */
        }
        return config->sine_table[angle_turn_q32 >> fraction_bits];
    }
    entry = &config->sine_table[angle_turn_q32 >> fraction_bits];
    fraction = angle_turn_q32 & ((UINT32_C(1) << fraction_bits) - 1u);
    if (fraction == 0u) {
        return entry[0]; /* also the last entry, which has no successor */
    }
    return entry[0] + (int32_t)shift_round((int64_t)(entry[1] - entry[0]) * (int64_t)fraction,
                                           fraction_bits, config->trig_rounding);
}

/**
 * @brief A CORDIC coordinate without its guard bits, held to -2^T to 2^T.
 *
 * Scaling and overflow: T + 4 fraction bits in, T out; CORDIC may end a few units beyond.
 */
static int32_t without_guard_bits(const chiplog_config *config, int64_t coordinate)
{
    const int64_t one = power_of_two(config->trig_frac_bits);
    const int64_t rounded = shift_round(coordinate, CORDIC_GUARD_BITS, config->trig_rounding);

    if (rounded > one) {
        return (int32_t)one;
    }
    return (int32_t)(rounded < -one ? -one : rounded);
}

/**
 * @brief Set sine and cosine of 0 to 2^30 in 2^-32 turn, by CORDIC rotations.
 *
 * Scaling and overflow: the vector has T + 4 fraction bits and stays below 1.65 in length, so
 * below 2^35; the residual angle is below 2^39 in 2^-40 turn.
 */
static void rotate(chiplog_state *state, const chiplog_config *config, uint32_t angle_turn_q32)
{
    const int64_t *const angles = config->cordic_table + 1;
    int64_t x = config->cordic_table[0];
    int64_t y = 0;
    int64_t residual = (int64_t)angle_turn_q32 * CORDIC_ANGLE_SCALE;
    unsigned i;

    for (i = 0; i < config->cordic_iterations; i++) {
        const int64_t x_part = floor_shift(x, i);
        const int64_t y_part = floor_shift(y, i);
        if (residual >= 0) {
            x -= y_part;
            y += x_part;
            residual -= angles[i];
        } else {
            x += y_part;
            y -= x_part;
            residual += angles[i];
        }
    }
    state->cosine_q = without_guard_bits(config, x);
    state->sine_q = without_guard_bits(config, y);
}

/**
 * @brief Set sine and cosine of an angle of a whole turn.
 *
 * Scaling and overflow: the angle has 32 bits of a turn: two for the quadrant, the rest an angle of
 * the first quadrant. Results have T fraction bits and lie in [-2^T, 2^T], T at most 30.
 */
static void find_direction(chiplog_state *state, const chiplog_config *config,
                           uint32_t phase_turn_q32)
{
    const uint32_t quadrant = phase_turn_q32 >> 30;
    const uint32_t angle = phase_turn_q32 & (QUARTER_TURN - 1u);
    int32_t sine;

    if (config->trig_method == CHIPLOG_TRIG_CORDIC) {
        rotate(state, config, angle);
    } else {
        state->sine_q = quarter_sine(config, angle);
        state->cosine_q = quarter_sine(config, QUARTER_TURN - angle);
    }
    /* A quarter turn takes (cos, sin) to (-sin, cos). */
    if (quadrant == 1u) {
        sine = state->cosine_q;
        state->cosine_q = -state->sine_q;
        state->sine_q = sine;
    } else if (quadrant == 2u) {
        state->cosine_q = -state->cosine_q;
        state->sine_q = -state->sine_q;
    } else if (quadrant == 3u) {
        sine = -state->cosine_q;
        state->cosine_q = state->sine_q;
        state->sine_q = sine;
    }
}

/* Pose -------------------------------------------------------------------------------------- */

/**
 * @brief Count an overflow, and let the status word say so until the next start.
 *
 * Scaling and overflow: a count of 63 bits.
 */
static void note_overflow(chiplog_state *state)
{
    state->overflow_count += 1;
    state->status |= CHIPLOG_STATUS_OVERFLOW;
}

/**
 * @brief A sum without its lower bits; what is dropped is kept for the next time if so configured.
 *
 * Scaling and overflow: |total| is below 2^62 and shift at most 61. The remainder is at most one
 * quantum of the result, 2^shift, and has the fraction bits of the total.
 */
static inline int64_t narrow(int64_t total, unsigned shift, unsigned rounding, unsigned carry,
                             int64_t *remainder_q)
{
    const int64_t rounded = shift_round(total, shift, rounding);

    *remainder_q = carry != 0u ? total - rounded * power_of_two(shift) : 0;
    return rounded;
}

/**
 * @brief Where the heading's turn of this tick comes from.
 *
 * Mode wheel: the wheels, held while the encoder is not accepted. Mode gyro: the gyro, held in a
 * standstill; the wheels while the gyro is not believed. Mode blend: both, the gyro alone while the
 * encoder is not accepted or just returns; else as mode gyro.
 *
 * Scaling and overflow: a choice.
 */
static uint8_t choose_source(chiplog_state *state, const chiplog_config *config,
                             int gyro_is_usable, int is_at_rest)
{
    const int encoder_is_accepted = state->encoder_decision == CHIPLOG_ACCEPTED;

    if (config->mode == CHIPLOG_MODE_WHEEL) {
        return encoder_is_accepted ? CHIPLOG_WHEELS : CHIPLOG_HELD;
    }
    if (encoder_is_accepted && (!gyro_is_usable || state->gap_misses_gyro == 1u)) {
        state->status |= CHIPLOG_STATUS_WHEEL_FALLBACK;
        return CHIPLOG_WHEELS;
    }
    if (!gyro_is_usable) {
        state->gap_misses_gyro = 1;
        return CHIPLOG_HELD;
    }
    if (is_at_rest) {
        return CHIPLOG_HELD;
    }
    if (config->mode == CHIPLOG_MODE_BLEND && encoder_is_accepted && state->gap_ticks == 1u) {
        return CHIPLOG_BLEND;
    }
    return CHIPLOG_GYRO;
}

/**
 * @brief A turn in the word of the turn step.
 *
 * Scaling and overflow: K fraction bits in and out; wraps or saturates as configured.
 */
static inline int64_t limit_turn(chiplog_state *state, const chiplog_config *config,
                                 int64_t turn_q)
{
    if (turn_q >= config->turn_low_q && turn_q <= config->turn_high_q) {
        return turn_q;
    }
    note_overflow(state);
    return limit(turn_q, config->turn_low_q, config->turn_high_q, config->turn_overflow);
}

/**
 * @brief The turn of the accepted increments.
 *
 * Scaling and overflow: (right - left) * tick_turn_q plus the carried remainder has
 * K + wheel_turn_shift bits and is below 2^62; the result has K.
 */
static int64_t wheel_turn(chiplog_state *state, const chiplog_config *config)
{
    const int64_t ticks = (int64_t)state->right_step_ticks - state->left_step_ticks;
    const int64_t total = ticks * config->tick_turn_q + state->wheel_turn_remainder_q;

    return limit_turn(state, config,
                      narrow(total, config->wheel_turn_shift, config->turn_rounding,
                             config->turn_carry, &state->wheel_turn_remainder_q));
}

/**
 * @brief The turn that the gyro gives for this tick.
 *
 * Scaling and overflow: code - offset has O bits and is below 2^33; its product with the
 * sensitivity plus the carried remainder has K + gyro_turn_shift bits and is below 2^62; the result
 * has K.
 */
static int64_t gyro_turn(chiplog_state *state, const chiplog_config *config)
{
    int64_t rate_q =
        state->gyro_code * power_of_two(config->offset_frac_bits) - state->gyro_offset_q;
    int64_t total;

    state->gyro_is_zeroed = 0;
    if (-config->auto_zero_rate_q < rate_q && rate_q < config->auto_zero_rate_q) {
        state->gyro_is_zeroed = 1;
        rate_q = 0;
    }
    total = rate_q * config->sensitivity_turn_q + state->gyro_turn_remainder_q;
    return limit_turn(state, config,
                      narrow(total, config->gyro_turn_shift, config->turn_rounding,
                             config->turn_carry, &state->gyro_turn_remainder_q));
}

/**
 * @brief By how much the heading turns in this tick.
 *
 * Scaling and overflow: K bits. The blend's difference is that of one tick (no gap), and below 2^62
 * with the weight's fraction bits.
 */
static int64_t turn_of_tick(chiplog_state *state, const chiplog_config *config)
{
    int64_t by_wheels;
    int64_t difference;

    switch (state->heading_source) {
    case CHIPLOG_WHEELS:
        return wheel_turn(state, config) - state->gap_turn_q;
    case CHIPLOG_GYRO:
        return gyro_turn(state, config);
    case CHIPLOG_BLEND:
        by_wheels = wheel_turn(state, config);
        difference = gyro_turn(state, config) - by_wheels;
        return by_wheels + shift_round(difference * config->blend_weight_q,
                                       config->blend_frac_bits, config->turn_rounding);
    default:
        return 0;
    }
}

/**
 * @brief The distance of the accepted increments.
 *
 * Scaling and overflow: (left + right) * half_tick_m_q plus the carried remainder has
 * S + step_shift bits and is below 2^62; the result has S, in a word of at most 32 bits.
 */
static int32_t step_of_tick(chiplog_state *state, const chiplog_config *config)
{
    const int64_t ticks = (int64_t)state->left_step_ticks + state->right_step_ticks;
    const int64_t total = ticks * config->half_tick_m_q + state->step_remainder_q;
    const int64_t step = narrow(total, config->step_shift, config->step_rounding,
                                config->step_carry, &state->step_remainder_q);

    if (step >= config->step_low_q && step <= config->step_high_q) {
        return (int32_t)step;
    }
    note_overflow(state);
    return (int32_t)limit(step, config->step_low_q, config->step_high_q, config->step_overflow);
}

/**
 * @brief The heading of so many ticks ago.
 *
 * Scaling and overflow: F bits, unchanged.
 */
static int32_t past_heading(const chiplog_state *state, const chiplog_config *config)
{
    switch (config->stale_heading_ticks) {
    case 1:
        return state->heading_turn_q;
    case 2:
        return state->past_1_turn_q;
    case 3:
        return state->past_2_turn_q;
    default:
        return state->past_3_turn_q;
    }
}

/**
 * @brief Keep the heading before this tick's turn.
 *
 * Scaling and overflow: F bits, unchanged.
 */
static void remember_heading(chiplog_state *state)
{
    state->past_3_turn_q = state->past_2_turn_q;
    state->past_2_turn_q = state->past_1_turn_q;
    state->past_1_turn_q = state->heading_turn_q;
}

/**
 * @brief A coordinate after a step along it.
 *
 * Scaling and overflow: step * direction has S + T bits and is below 2^62 with the carried
 * remainder; the result has P, in a word of up to 64 bits that wraps or saturates as configured.
 */
static int64_t moved(chiplog_state *state, const chiplog_config *config, int64_t position_q,
                     int32_t step_q, int32_t direction_q, int64_t *remainder_q)
{
    const int64_t total = (int64_t)step_q * direction_q + *remainder_q;
    const int64_t distance_q = narrow(total, config->position_shift, config->position_rounding,
                                      config->position_carry, remainder_q);

    if (!sum_exceeds(position_q, distance_q, config->position_low_q, config->position_high_q)) {
        return position_q + distance_q;
    }
    note_overflow(state);
    return overflowed_sum(position_q, distance_q, config->position_low_q, config->position_high_q,
                          config->position_overflow);
}

/**
 * @brief Advance x and y by a step along the heading that the integration rule names.
 *
 * The whole turn since the last accepted reading is gap_turn_q + turn_q; the rule takes none, half
 * or all of it.
 *
 * Scaling and overflow: the angle is formed in K + 1 bits of a turn, below 2^62, rounded to F as
 * the heading is, and reduced to one turn in 32 bits.
 */
static void move(chiplog_state *state, const chiplog_config *config, int32_t step_q,
                 int64_t turn_q)
{
    const uint32_t one_turn_mask = UINT32_MAX >> (32u - config->heading_frac_bits);
    const int64_t start_q = state->heading_turn_q * power_of_two(config->heading_shift) +
                            state->heading_remainder_q - state->gap_turn_q;
    int64_t angle_q = 2 * start_q + config->integration * (state->gap_turn_q + turn_q);

    angle_q = shift_round(angle_q, config->heading_shift + 1u, config->heading_rounding);
    if (config->stale_heading_ticks > 0u) {
        angle_q = past_heading(state, config);
    }
    find_direction(state, config,
                   ((uint32_t)((uint64_t)angle_q & one_turn_mask))
                       << (32u - config->heading_frac_bits));
    state->x_m_q =
        moved(state, config, state->x_m_q, step_q, state->cosine_q, &state->x_remainder_q);
    state->y_m_q =
        moved(state, config, state->y_m_q, step_q, state->sine_q, &state->y_remainder_q);
}

/**
 * @brief Advance the heading.
 *
 * Scaling and overflow: the turn plus the carried remainder has K bits and is below 2^62; the
 * result has F and wraps at one turn, which is what an angle does.
 */
static void turn_heading(chiplog_state *state, const chiplog_config *config, int64_t turn_q)
{
    const int64_t total = turn_q + state->heading_remainder_q;
    const int64_t steps_q = narrow(total, config->heading_shift, config->heading_rounding,
                                   config->heading_carry, &state->heading_remainder_q);

    state->heading_turn_q =
        (int32_t)wrap_signed(state->heading_turn_q + steps_q, config->heading_frac_bits);
}

/* Velocity ---------------------------------------------------------------------------------- */

/**
 * @brief Feed both low-pass filters; a tick that tells no velocity leaves its filter.
 *
 * Scaling and overflow: the filters hold 2^n times their output, n at most 8, in the fraction bits
 * of step (S) and turn (K): below 2^39 and 2^61. What leaves is a floor shift.
 */
static void filter_velocity(chiplog_state *state, const chiplog_config *config, int32_t step_q,
                            int64_t turn_q)
{
    const int is_one_tick =
        state->encoder_decision == CHIPLOG_ACCEPTED && state->gap_ticks == 1u;
    const unsigned bits = config->velocity_filter_log2;

    state->v_is_valid = 0;
    if (is_one_tick) {
        state->v_filter_q = state->v_filter_q - floor_shift(state->v_filter_q, bits) + step_q;
        state->v_is_valid = 1;
    }
    state->w_is_valid = 0;
    if (is_one_tick || state->heading_source == CHIPLOG_GYRO ||
        state->heading_source == CHIPLOG_BLEND) {
        state->w_filter_q = state->w_filter_q - floor_shift(state->w_filter_q, bits) + turn_q;
        state->w_is_valid = 1;
    }
}

int32_t chiplog_kernel_speed_m_s_q(const chiplog_state *state, const chiplog_config *config)
{
    const int64_t step_q =
        shift_round(state->v_filter_q, config->velocity_filter_log2, CHIPLOG_HALF_UP);
    const int64_t speed_q =
        shift_round(step_q * config->tick_rate_hz_q, config->v_shift, CHIPLOG_HALF_UP);

    return (int32_t)limit(speed_q, config->velocity_low_q, config->velocity_high_q,
                          CHIPLOG_SATURATE);
}

int32_t chiplog_kernel_turn_rate_rad_s_q(const chiplog_state *state, const chiplog_config *config)
{
    int64_t turn_q = shift_round(state->w_filter_q, config->velocity_filter_log2, CHIPLOG_HALF_UP);
    int64_t rate_q;

    turn_q = shift_round(turn_q, config->w_pre_shift, CHIPLOG_HALF_UP);
    rate_q = shift_round(turn_q * config->tick_rate_rad_q, config->w_shift, CHIPLOG_HALF_UP);
    return (int32_t)limit(rate_q, config->velocity_low_q, config->velocity_high_q,
                          CHIPLOG_SATURATE);
}

/* One tick ---------------------------------------------------------------------------------- */

void chiplog_kernel_start(chiplog_state *state, const chiplog_config *config)
{
    static const chiplog_state power_on = {0};

    *state = power_on;
    state->repeated_code = -1;
    state->gyro_offset_q = config->zero_rate_code_q;
}

void chiplog_kernel_step(chiplog_state *state, const chiplog_config *config,
                         const chiplog_inputs *inputs)
{
    const int was_initialised = state->is_initialised == 1u;
    int gyro_is_usable;
    int is_at_rest;
    int64_t turn_q = 0;
    int32_t step_q = 0;

    state->tick += 1;
    state->status &= STICKY;
    take_encoder(state, config, inputs);
    gyro_is_usable = take_gyro(state, config, inputs);
    is_at_rest = is_standstill(state, config, gyro_is_usable);

    state->heading_source = CHIPLOG_HELD;
    if (was_initialised) {
        state->heading_source = choose_source(state, config, gyro_is_usable, is_at_rest);
        turn_q = turn_of_tick(state, config);
        if (state->encoder_decision == CHIPLOG_ACCEPTED) {
            step_q = step_of_tick(state, config);
            move(state, config, step_q, turn_q);
        } else {
            state->status |= CHIPLOG_STATUS_POSITION_HELD;
        }
        if (config->stale_heading_ticks > 0u) {
            remember_heading(state);
        }
        turn_heading(state, config, turn_q);
    }
    filter_velocity(state, config, step_q, turn_q);

    if (state->encoder_decision != CHIPLOG_NOT_USED) {
        state->gap_turn_q = 0;
        state->gap_ticks = 0;
        state->gap_misses_gyro = 0;
    } else if (state->gap_ticks <= config->gap_limit_ticks) {
        state->gap_turn_q += turn_q;
    }

    if (state->is_initialised == 1u) {
        state->status |= CHIPLOG_STATUS_INITIALISED;
    } else {
        state->status |= CHIPLOG_STATUS_POSITION_HELD;
    }
    if (state->offset_is_valid == 1u) {
        state->status |= CHIPLOG_STATUS_OFFSET_VALID;
    }
}
