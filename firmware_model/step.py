"""One tick of the firmware."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from firmware_model._source import kernel_function
from firmware_model.config import KernelConfig
from firmware_model.encoder import ACCEPTED, NOT_USED, take_encoder
from firmware_model.gyro import take_gyro
from firmware_model.pose import (
    HELD,
    choose_source,
    move,
    remember_heading,
    step_of_tick,
    turn_heading,
    turn_of_tick,
)
from firmware_model.standstill import watch_standstill
from firmware_model.state import State, StatusBit
from firmware_model.velocity import filter_velocity

_STICKY: Final = int(StatusBit.POSITION_DEGRADED | StatusBit.OVERFLOW | StatusBit.ENCODER_LOSS)
_INITIALISED: Final = int(StatusBit.INITIALISED)
_OFFSET_VALID: Final = int(StatusBit.OFFSET_VALID)
_POSITION_HELD: Final = int(StatusBit.POSITION_HELD)


@kernel_function
def step_kernel(
    state: State,
    config: KernelConfig,
    table: Sequence[int],
    left_count: int,
    right_count: int,
    encoder_validity: int,
    gyro_code: int,
    gyro_validity: int,
) -> None:
    """Take one tick's inputs and advance the state.

    Counts are readings of the wrapping counters; the gyro code is the sample of the tick that
    ends now. A value whose validity is not FRESH is not looked at and never moves the pose.

    Scaling and overflow: stated at each function called; the order is part of the algorithm.
    """
    state.tick = state.tick + 1
    state.status = state.status & _STICKY
    was_initialised = state.is_initialised

    take_encoder(state, config, left_count, right_count, encoder_validity)
    gyro_is_usable = take_gyro(state, config, gyro_code, gyro_validity)
    is_at_rest = watch_standstill(state, config, gyro_is_usable)

    state.heading_source = HELD
    turn_q = 0
    step_q = 0
    if was_initialised == 1:
        state.heading_source = choose_source(state, config, gyro_is_usable, is_at_rest)
        turn_q = turn_of_tick(state, config)
        if state.encoder_decision == ACCEPTED:
            step_q = step_of_tick(state, config)
            move(state, config, table, step_q, turn_q)
        else:
            state.status |= _POSITION_HELD
        if config.stale_heading_ticks > 0:
            remember_heading(state)
        turn_heading(state, config, turn_q)
    filter_velocity(state, config, step_q, turn_q)

    if state.encoder_decision == NOT_USED:
        if state.gap_ticks <= config.gap_limit_ticks:
            state.gap_turn_q = state.gap_turn_q + turn_q
    else:
        state.gap_turn_q = 0
        state.gap_ticks = 0
        state.gap_misses_gyro = 0

    if state.is_initialised == 1:
        state.status |= _INITIALISED
    else:
        state.status |= _POSITION_HELD
    if state.offset_is_valid == 1:
        state.status |= _OFFSET_VALID
