"""Velocity: two low-pass filters fed every tick, scaled only when someone wants the value."""

from __future__ import annotations

from firmware_model._source import kernel_function
from firmware_model.config import KernelConfig
from firmware_model.encoder import ACCEPTED
from firmware_model.integers import HALF_UP, SATURATE, floor_shift, limit, shift_round
from firmware_model.pose import HELD, WHEELS
from firmware_model.state import State


@kernel_function
def filter_velocity(state: State, config: KernelConfig, step_q: int, turn_q: int) -> None:
    """Feed the filters; a tick that tells no velocity marks it invalid and leaves the filter.

    The step of a gap is spread over unknown ticks, so it tells none; nor does a heading that is
    held for want of inputs, or corrected after a gap.

    Scaling and overflow: each filter holds 2^n times its output, n = velocity_filter_log2 ≤ 8,
    in the fraction bits of step and turn: below 2^39 and 2^61. What leaves it is a floor shift,
    which settles within one unit of the input.
    """
    is_one_tick = state.encoder_decision == ACCEPTED and state.gap_ticks == 1
    state.v_is_valid = 0
    if is_one_tick:
        state.v_filter_q = (
            state.v_filter_q - floor_shift(state.v_filter_q, config.velocity_filter_log2) + step_q
        )
        state.v_is_valid = 1
    source = state.heading_source
    state.w_is_valid = 0
    if is_one_tick or source not in (HELD, WHEELS):
        state.w_filter_q = (
            state.w_filter_q - floor_shift(state.w_filter_q, config.velocity_filter_log2) + turn_q
        )
        state.w_is_valid = 1


@kernel_function
def speed_m_s(state: State, config: KernelConfig) -> int:
    """Return the low-passed forward speed, in velocity_frac_bits.

    Scaling and overflow: step (below 2^31) times tick rate is below 2^62; rounded to nearest
    into 32 bits that saturate.
    """
    step_q = shift_round(state.v_filter_q, config.velocity_filter_log2, HALF_UP)
    speed_q = shift_round(step_q * config.tick_rate_hz_q, config.v_shift, HALF_UP)
    return limit(speed_q, config.velocity_low_q, config.velocity_high_q, SATURATE)


@kernel_function
def turn_rate_rad_s(state: State, config: KernelConfig) -> int:
    """Return the low-passed turn rate, in velocity_frac_bits.

    Scaling and overflow: the turn is narrowed by w_pre_shift so that its product with the tick
    rate is below 2^62; rounded to nearest into 32 bits that saturate.
    """
    turn_q = shift_round(state.w_filter_q, config.velocity_filter_log2, HALF_UP)
    turn_q = shift_round(turn_q, config.w_pre_shift, HALF_UP)
    rate_q = shift_round(turn_q * config.tick_rate_rad_q, config.w_shift, HALF_UP)
    return limit(rate_q, config.velocity_low_q, config.velocity_high_q, SATURATE)
