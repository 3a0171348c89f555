"""Which gyro samples are believed.

A sample counts when it is fresh, inside the sensor's range, and the sensor is not stuck. Stuck
means: the code has not changed for `stuck_ticks` fresh samples although the wheels' turning has.
The wheels' turning is the sum of right − left increments over blocks of 2^n ticks (in a sum the
counter's quantisation stays one tick however long the block); it must have varied by more than
`stuck_span_ticks`, which is more than two LSB of the gyro. A drive at constant rate, however
quiet the gyro, therefore never trips it. It clears when the code changes.
"""

from __future__ import annotations

from typing import Final

from firmware_model._source import kernel_function, rare_kernel_function
from firmware_model.config import KernelConfig
from firmware_model.encoder import ACCEPTED
from firmware_model.state import FRESH, STALE, State, StatusBit

_STALE: Final = int(StatusBit.GYRO_STALE)
_INVALID: Final = int(StatusBit.GYRO_INVALID)
_SATURATED: Final = int(StatusBit.GYRO_SATURATED)
_STUCK: Final = int(StatusBit.GYRO_STUCK)


@kernel_function
def take_gyro(state: State, config: KernelConfig, code: int, validity: int) -> int:
    """Return 1 when this tick's gyro sample is believed, else 0; keep its code in the state.

    Scaling and overflow: a code that is used lies strictly between the two limits, so within
    16 bits, whatever was handed in.
    """
    if validity != FRESH:
        state.status |= _STALE if validity == STALE else _INVALID
        return 0
    is_usable = 1
    if code <= config.gyro_min_code:
        state.gyro_code = config.gyro_min_code
        state.status |= _SATURATED
        is_usable = 0
    elif code >= config.gyro_max_code:
        state.gyro_code = config.gyro_max_code
        state.status |= _SATURATED
        is_usable = 0
    else:
        state.gyro_code = code
    if watch_for_stuck_code(state, config) == 1:
        state.status |= _STUCK
        is_usable = 0
    return is_usable


@kernel_function
def watch_for_stuck_code(state: State, config: KernelConfig) -> int:
    """Return 1 when the gyro's code stands still although the wheels' turning does not.

    Scaling and overflow: a block of at most 2^12 ticks of at most 2^16 counts; the repeat
    counter stops at its threshold.
    """
    if state.gyro_code != state.repeated_code:
        state.repeated_code = state.gyro_code
        state.repeated_ticks = 0
        state.turn_blocks = 0
        state.turn_block_ticks = 0
        state.turn_block_sum = 0
        return 0
    if state.repeated_ticks < config.stuck_ticks:
        state.repeated_ticks = state.repeated_ticks + 1
    if state.encoder_decision == ACCEPTED and state.gap_ticks == 1:
        state.turn_block_sum = state.turn_block_sum + state.right_step_ticks - state.left_step_ticks
        state.turn_block_ticks = state.turn_block_ticks + 1
        if state.turn_block_ticks == config.stuck_block_ticks:
            close_block(state)
    else:  # a block with a gap in it would be compared with whole ones
        state.turn_block_ticks = 0
        state.turn_block_sum = 0
    if state.repeated_ticks < config.stuck_ticks or state.turn_blocks == 0:
        return 0
    if state.turn_block_high - state.turn_block_low > config.stuck_span_ticks:
        return 1
    return 0


@rare_kernel_function
def close_block(state: State) -> None:
    """Add a full block to the range of the wheels' turning and start the next."""
    if state.turn_blocks == 0:
        state.turn_blocks = 1
        state.turn_block_low = state.turn_block_sum
        state.turn_block_high = state.turn_block_sum
    else:
        state.turn_block_low = min(state.turn_block_low, state.turn_block_sum)
        state.turn_block_high = max(state.turn_block_high, state.turn_block_sum)
    state.turn_block_ticks = 0
    state.turn_block_sum = 0
