"""From believed increments to the pose: turn, step, position, heading.

Where the heading's turn comes from in a tick:

========  ==================================  =========================================
mode      gyro believed                       gyro not believed
========  ==================================  =========================================
wheel     the wheels, for the whole gap; held while the encoder is not accepted
gyro      the gyro; held in a standstill      the wheels, for the whole gap since the last
                                              accepted sample (WHEEL_FALLBACK); held while
                                              the encoder is not accepted either
blend     wheels + weight · (gyro − wheels);  as mode gyro
          the gyro alone while the encoder
          is not accepted or just returns;
          held in a standstill
========  ==================================  =========================================

When the encoder returns after a gap in which any gyro sample was missing, the gap's heading is
the wheels' heading: the turn that the gyro gave in the gap is taken back. The distance of a gap
is laid along the heading of the gap by the same rule (before, middle, after) as that of a tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from firmware_model._source import kernel_function, rare_kernel_function
from firmware_model.config import MODE_BLEND, MODE_WHEEL, KernelConfig
from firmware_model.encoder import ACCEPTED
from firmware_model.integers import (
    add_limited,
    exceeds,
    limit,
    shift_round,
    sum_exceeds,
    wrap_signed,
)
from firmware_model.state import HeadingSource, State, StatusBit
from firmware_model.trigonometry import find_direction

HELD: Final = int(HeadingSource.HELD)
WHEELS: Final = int(HeadingSource.WHEELS)
GYRO: Final = int(HeadingSource.GYRO)
BLEND: Final = int(HeadingSource.BLEND)

_WHEEL_FALLBACK: Final = int(StatusBit.WHEEL_FALLBACK)
_OVERFLOW: Final = int(StatusBit.OVERFLOW)


@kernel_function
def note_overflow(state: State) -> None:
    """Count an overflow, and let the status word say so for good."""
    state.overflow_count = state.overflow_count + 1
    state.status |= _OVERFLOW


@kernel_function
def choose_source(state: State, config: KernelConfig, gyro_is_usable: int, is_at_rest: int) -> int:
    """Return where the heading's turn of this tick comes from (the table above)."""
    encoder_is_accepted = state.encoder_decision == ACCEPTED
    if config.mode == MODE_WHEEL:
        if encoder_is_accepted:
            return WHEELS
        return HELD
    if gyro_is_usable == 0 or (encoder_is_accepted and state.gap_misses_gyro == 1):
        if encoder_is_accepted:
            state.status |= _WHEEL_FALLBACK
            return WHEELS
        if gyro_is_usable == 0:
            state.gap_misses_gyro = 1
            return HELD
    if is_at_rest == 1:
        return HELD
    if config.mode == MODE_BLEND and encoder_is_accepted and state.gap_ticks == 1:
        return BLEND
    return GYRO


@kernel_function
def limit_turn(state: State, config: KernelConfig, turn_q: int) -> int:
    """Return a turn in the word of the turn step.

    Scaling and overflow: K fraction bits in and out; wraps or saturates as configured.
    """
    if exceeds(turn_q, config.turn_low_q, config.turn_high_q) == 0:
        return turn_q
    note_overflow(state)
    return limit(turn_q, config.turn_low_q, config.turn_high_q, config.turn_overflow)


@kernel_function
def wheel_turn(state: State, config: KernelConfig) -> int:
    """Return the turn of the accepted increments, in 2^−K turn.

    Scaling and overflow: (right − left) · tick_turn_q plus the carried remainder is below 2^62;
    wheel_turn_shift fraction bits are rounded away, then the word is limited.
    """
    total = (state.right_step_ticks - state.left_step_ticks) * config.tick_turn_q
    total = total + state.wheel_turn_remainder_q
    turn = shift_round(total, config.wheel_turn_shift, config.turn_rounding)
    dropped = total - turn * (1 << config.wheel_turn_shift)
    state.wheel_turn_remainder_q = dropped * config.turn_carry
    return limit_turn(state, config, turn)


@kernel_function
def gyro_turn(state: State, config: KernelConfig) -> int:
    """Return the turn that the gyro gives for this tick, in 2^−K turn.

    Scaling and overflow: (code − offset) is below 2^33 with the offset's fraction bits; its
    product with the sensitivity plus the carried remainder is below 2^62.
    """
    rate_q = state.gyro_code * (1 << config.offset_frac_bits) - state.gyro_offset_q
    state.gyro_is_zeroed = 0
    if -config.auto_zero_rate_q < rate_q < config.auto_zero_rate_q:
        state.gyro_is_zeroed = 1
        rate_q = 0
    total = rate_q * config.sensitivity_turn_q + state.gyro_turn_remainder_q
    turn = shift_round(total, config.gyro_turn_shift, config.turn_rounding)
    dropped = total - turn * (1 << config.gyro_turn_shift)
    state.gyro_turn_remainder_q = dropped * config.turn_carry
    return limit_turn(state, config, turn)


@kernel_function
def turn_of_tick(state: State, config: KernelConfig) -> int:
    """Return by how much the heading turns in this tick, in 2^−K turn.

    Scaling and overflow: the blend's difference is that of one tick (no gap), and below 2^62
    with the weight's fraction bits.
    """
    source = state.heading_source
    if source == WHEELS:
        return wheel_turn(state, config) - state.gap_turn_q
    if source == GYRO:
        return gyro_turn(state, config)
    if source == BLEND:
        by_wheels = wheel_turn(state, config)
        difference = gyro_turn(state, config) - by_wheels
        return by_wheels + shift_round(
            difference * config.blend_weight_q, config.blend_frac_bits, config.turn_rounding
        )
    return 0


@kernel_function
def step_of_tick(state: State, config: KernelConfig) -> int:
    """Return the distance of the accepted increments, in 2^−S m.

    Scaling and overflow: (left + right) · half_tick_m_q plus the carried remainder is below
    2^62; step_shift fraction bits are rounded away, then the word is limited.
    """
    total = (state.left_step_ticks + state.right_step_ticks) * config.half_tick_m_q
    total = total + state.step_remainder_q
    step = shift_round(total, config.step_shift, config.step_rounding)
    state.step_remainder_q = (total - step * (1 << config.step_shift)) * config.step_carry
    if exceeds(step, config.step_low_q, config.step_high_q) == 0:
        return step
    note_overflow(state)
    return limit(step, config.step_low_q, config.step_high_q, config.step_overflow)


@kernel_function
def heading_with_remainder(state: State, config: KernelConfig) -> int:
    """Return the heading in 2^−K turn.

    Scaling and overflow: half a turn is 2^(K−1), K ≤ 52; the remainder is below one unit of F.
    """
    return state.heading_turn_q * (1 << config.heading_shift) + state.heading_remainder_q


@rare_kernel_function
def past_heading(state: State, config: KernelConfig) -> int:
    """Return the heading of so many ticks ago, in 2^−F turn.

    Scaling and overflow: a heading, unchanged.
    """
    if config.stale_heading_ticks == 1:
        return state.heading_turn_q
    if config.stale_heading_ticks == 2:
        return state.past_1_turn_q
    if config.stale_heading_ticks == 3:
        return state.past_2_turn_q
    return state.past_3_turn_q


@rare_kernel_function
def remember_heading(state: State) -> None:
    """Keep the heading before this tick's turn.

    Scaling and overflow: headings, unchanged.
    """
    state.past_3_turn_q = state.past_2_turn_q
    state.past_2_turn_q = state.past_1_turn_q
    state.past_1_turn_q = state.heading_turn_q


@kernel_function
def move(
    state: State, config: KernelConfig, table: Sequence[int], step_q: int, turn_q: int
) -> None:
    """Advance x and y by a step along the heading that the integration rule names.

    The whole turn since the last accepted sample is gap_turn_q + turn_q; the rule takes none,
    half or all of it.

    Scaling and overflow: the angle is formed in 2^−(K+1) turn, below 2^62, rounded to F bits as
    the heading is, wrapped, and brought to 2^−32 turn. step · cosine has S + T fraction bits and
    is below 2^62 with the carried remainder; position_shift of them are rounded away.
    """
    start_q = heading_with_remainder(state, config) - state.gap_turn_q
    angle_q = 2 * start_q + config.integration * (state.gap_turn_q + turn_q)
    angle_q = shift_round(angle_q, config.heading_shift + 1, config.heading_rounding)
    if config.stale_heading_ticks > 0:
        angle_q = past_heading(state, config)
    phase_turn_q32 = (angle_q & ((1 << config.heading_frac_bits) - 1)) * (
        1 << (32 - config.heading_frac_bits)
    )
    find_direction(state, config, table, phase_turn_q32)

    total = step_q * state.cosine_q + state.x_remainder_q
    x_step_q = shift_round(total, config.position_shift, config.position_rounding)
    dropped = total - x_step_q * (1 << config.position_shift)
    state.x_remainder_q = dropped * config.position_carry
    state.x_m_q = add_to_position(state, config, state.x_m_q, x_step_q)
    total = step_q * state.sine_q + state.y_remainder_q
    y_step_q = shift_round(total, config.position_shift, config.position_rounding)
    dropped = total - y_step_q * (1 << config.position_shift)
    state.y_remainder_q = dropped * config.position_carry
    state.y_m_q = add_to_position(state, config, state.y_m_q, y_step_q)


@kernel_function
def add_to_position(state: State, config: KernelConfig, position_q: int, step_q: int) -> int:
    """Return the sum in the position's word.

    Scaling and overflow: P fraction bits; words of up to 64 bits wrap or saturate as configured,
    without a sum that leaves 64 bits.
    """
    if sum_exceeds(position_q, step_q, config.position_low_q, config.position_high_q) == 0:
        return position_q + step_q
    note_overflow(state)
    return add_limited(
        position_q,
        step_q,
        config.position_low_q,
        config.position_high_q,
        config.position_overflow,
    )


@kernel_function
def turn_heading(state: State, config: KernelConfig, turn_q: int) -> None:
    """Advance the heading.

    Scaling and overflow: the turn plus the carried remainder is below 2^62; heading_shift
    fraction bits are rounded away; the sum wraps at one turn, which is what an angle does.
    """
    total = turn_q + state.heading_remainder_q
    steps_q = shift_round(total, config.heading_shift, config.heading_rounding)
    dropped = total - steps_q * (1 << config.heading_shift)
    state.heading_remainder_q = dropped * config.heading_carry
    state.heading_turn_q = wrap_signed(state.heading_turn_q + steps_q, config.heading_frac_bits)
