"""The float64 twin: the same algorithm on the same accepted inputs, without the arithmetic.

It takes every decision from the kernel (which samples count, where the heading comes from, when
the robot stands), so that firmware − twin is arithmetic and nothing else. Its heading does not
wrap. Its constants are the described ones in double precision.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from firmware_model._source import kernel_function
from firmware_model.config import KernelConfig
from firmware_model.encoder import ACCEPTED, NOT_USED
from firmware_model.pose import BLEND, GYRO, WHEELS
from firmware_model.state import State


@dataclass(slots=True)
class Twin:
    """State of the float twin: pose in metres and radians, heading unwrapped."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    gap_turn_rad: float = 0.0
    past_1_rad: float = 0.0
    past_2_rad: float = 0.0
    past_3_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinConfig:
    """The described constants in double precision; made by `build_twin_config`."""

    half_tick_m: float
    tick_turn_rad: float
    sensitivity_rad_per_lsb: float
    zero_rate_code: float
    blend_weight: float
    integration: float
    stale_heading_ticks: float


TWIN_DTYPE: Final = np.dtype([(one.name, np.float64) for one in fields(Twin)])
"""The twin's state as a NumPy record."""

TWIN_CONFIG_DTYPE: Final = np.dtype([(one.name, np.float64) for one in fields(TwinConfig)])
"""The twin's constants as a NumPy record."""


def build_twin_config(config: KernelConfig) -> TwinConfig:
    """Return the twin's constants for the robot and rules of *config*."""
    known = config.constants
    tick_m = 2.0 * math.pi * known.wheel_radius_m / known.ticks_per_rev
    return TwinConfig(
        half_tick_m=tick_m / 2.0,
        tick_turn_rad=tick_m / known.wheelbase_m,
        sensitivity_rad_per_lsb=known.gyro_sensitivity_rad_s_per_lsb * known.tick_period_s,
        zero_rate_code=float(known.gyro_zero_rate_code),
        blend_weight=config.description.blend_weight,
        integration=config.integration / 2.0,
        stale_heading_ticks=float(config.stale_heading_ticks),
    )


@kernel_function
def gyro_turn_rad(twin_config: TwinConfig, state: State) -> float:
    """Return the turn that the gyro gives for this tick [rad]."""
    if state.gyro_is_zeroed == 1:
        return 0.0
    offset = twin_config.zero_rate_code
    if state.offset_is_valid == 1:
        offset = state.offset_sum / (1 << state.offset_samples_log2)
    return (state.gyro_code - offset) * twin_config.sensitivity_rad_per_lsb


@kernel_function
def step_twin(twin: Twin, twin_config: TwinConfig, state: State) -> None:
    """Advance the twin by the tick that the kernel has just decided on.

    The gap's heading and its correction follow the same rules as in `firmware_model.pose`.
    """
    turn_rad = 0.0
    by_wheels_rad = (state.right_step_ticks - state.left_step_ticks) * twin_config.tick_turn_rad
    if state.heading_source == WHEELS:
        turn_rad = by_wheels_rad - twin.gap_turn_rad
    elif state.heading_source == GYRO:
        turn_rad = gyro_turn_rad(twin_config, state)
    elif state.heading_source == BLEND:
        by_gyro_rad = gyro_turn_rad(twin_config, state)
        turn_rad = by_wheels_rad + twin_config.blend_weight * (by_gyro_rad - by_wheels_rad)

    if state.encoder_decision == ACCEPTED:
        step_m = (state.left_step_ticks + state.right_step_ticks) * twin_config.half_tick_m
        start_rad = twin.heading_rad - twin.gap_turn_rad
        angle_rad = start_rad + twin_config.integration * (twin.gap_turn_rad + turn_rad)
        if twin_config.stale_heading_ticks == 1.0:
            angle_rad = twin.heading_rad
        elif twin_config.stale_heading_ticks == 2.0:
            angle_rad = twin.past_1_rad
        elif twin_config.stale_heading_ticks == 3.0:
            angle_rad = twin.past_2_rad
        elif twin_config.stale_heading_ticks == 4.0:
            angle_rad = twin.past_3_rad
        twin.x_m = twin.x_m + step_m * math.cos(angle_rad)
        twin.y_m = twin.y_m + step_m * math.sin(angle_rad)
    if state.encoder_decision == NOT_USED:
        twin.gap_turn_rad = twin.gap_turn_rad + turn_rad
    else:
        twin.gap_turn_rad = 0.0
    if twin_config.stale_heading_ticks > 0.0:
        twin.past_3_rad = twin.past_2_rad
        twin.past_2_rad = twin.past_1_rad
        twin.past_1_rad = twin.heading_rad
    twin.heading_rad = twin.heading_rad + turn_rad
