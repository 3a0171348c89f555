"""Standstill, and the gyro's zero-rate offset learnt in it.

The robot rests when for `still_ticks` ticks both counters have stayed within the tolerance of
where they were and the gyro reads less than `rest_max_rate` from its nominal zero (a robot that
is carried or turned by hand has still wheels but a moving gyro). In a standstill the heading is
held, and the offset is estimated:

* the first `settle_ticks` samples are left out: the body still rocks;
* from then on samples are summed. When their number reaches 2^block_log2, 2^(block_log2 + 1), …
  2^max_log2, sum / number is a new estimate: a shift, never a division, and a longer standstill
  gives a better one. Beyond 2^max_log2 samples the sum starts afresh and follows the drift;
* an estimate is taken into use only after the standstill has gone on for another `settle_ticks`:
  the samples in which the robot has begun to move before its counters show it are never in it.

In motion the offset is frozen.
"""

from __future__ import annotations

from typing import Final

from firmware_model._source import kernel_function, rare_kernel_function
from firmware_model.config import KernelConfig
from firmware_model.encoder import ACCEPTED
from firmware_model.integers import shift_round
from firmware_model.state import State, StatusBit

_STANDSTILL: Final = int(StatusBit.STANDSTILL)


@kernel_function
def watch_standstill(state: State, config: KernelConfig, gyro_is_usable: int) -> int:
    """Return 1 in a standstill, else 0; learn the offset when the gyro is usable.

    Scaling and overflow: the still counter stops at its threshold; excursions stay within
    tolerance + one increment, below 2^33; the code's distance from zero is below 2^33.
    """
    if state.encoder_decision != ACCEPTED:
        stop_resting(state)
        return 0
    state.still_left_ticks = state.still_left_ticks + state.left_step_ticks
    state.still_right_ticks = state.still_right_ticks + state.right_step_ticks
    tolerance = config.still_tolerance_ticks
    if not (
        -tolerance <= state.still_left_ticks <= tolerance
        and -tolerance <= state.still_right_ticks <= tolerance
    ):
        stop_resting(state)
        return 0
    if gyro_is_usable == 1:
        rate_q = state.gyro_code * (1 << config.offset_frac_bits) - config.zero_rate_code_q
        if not -config.rest_max_rate_q <= rate_q <= config.rest_max_rate_q:
            stop_resting(state)
            return 0
    if state.still_ticks < config.still_ticks:
        state.still_ticks = state.still_ticks + 1
    if state.still_ticks < config.still_ticks:
        return 0
    state.status |= _STANDSTILL
    learn_offset(state, config, gyro_is_usable)
    return 1


@kernel_function
def stop_resting(state: State) -> None:
    """Forget the standstill and every sum that was not yet taken into use."""
    state.still_ticks = 0
    state.still_left_ticks = 0
    state.still_right_ticks = 0
    state.rest_ticks = 0
    state.rest_samples = 0
    state.rest_sum = 0
    state.rest_next_log2 = 0
    state.pending_ticks = 0


@rare_kernel_function
def learn_offset(state: State, config: KernelConfig, gyro_is_usable: int) -> None:
    """Add this tick's code to the sum; prepare an estimate, or take one into use.

    Scaling and overflow: at most 2^16 codes of 16 bits are summed: below 2^32, and below 2^48
    with the offset's fraction bits.
    """
    if state.pending_ticks > 0:
        state.pending_ticks = state.pending_ticks - 1
        if state.pending_ticks == 0:
            use_estimate(state, config)
    if state.rest_ticks < config.settle_ticks:
        state.rest_ticks = state.rest_ticks + 1
        return
    if gyro_is_usable == 0:
        return
    state.rest_next_log2 = max(state.rest_next_log2, config.offset_block_log2)
    state.rest_sum = state.rest_sum + state.gyro_code
    state.rest_samples = state.rest_samples + 1
    if state.rest_samples != 1 << state.rest_next_log2:
        return
    if state.pending_ticks == 0:  # an estimate that already waits for its turn goes first
        state.pending_sum = state.rest_sum
        state.pending_samples_log2 = state.rest_next_log2
        state.pending_ticks = config.settle_ticks
        if config.settle_ticks == 0:
            use_estimate(state, config)
    if state.rest_next_log2 < config.offset_max_log2:
        state.rest_next_log2 = state.rest_next_log2 + 1
    else:
        state.rest_sum = 0
        state.rest_samples = 0


@rare_kernel_function
def use_estimate(state: State, config: KernelConfig) -> None:
    """Make the pending mean the offset in use.

    Scaling and overflow: the sum is below 2^32, with 16 more fraction bits below 2^48.
    """
    state.offset_sum = state.pending_sum
    state.offset_samples_log2 = state.pending_samples_log2
    state.offset_is_valid = 1
    state.gyro_offset_q = shift_round(
        state.pending_sum * (1 << config.offset_frac_bits),
        state.pending_samples_log2,
        config.offset_rounding,
    )
