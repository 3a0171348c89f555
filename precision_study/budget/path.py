"""The float twin's path of one drive: what the expected error is worked out along."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import MODE_BLEND, MODE_GYRO
from firmware_model.twin import build_twin_config
from precision_study.budget.travel import counter_steps
from precision_study.streaming import stream

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Path:
    """One drive as the float twin sees it; each array has an entry per tick.

    Attributes:
        counts: int64[n], left + right increments.
        turn_counts: int64[n], right − left increments.
        step_m: the step of the tick.
        turn_rad: by how much the heading turns in the tick.
        gyro_turn_rad: the part of it that the gyro gave, whatever its weight.
        offset_lsb: the gyro's offset that the twin has used; meaningless where nothing turns.
        heading_rad: heading after the tick, not wrapped.
        angle_rad: direction of the step.
        along, across: float64[n, 2], unit vectors along the step and to its left.
        lever_m: float64[n, 2], what a position error a turn of this tick makes by the end, per
            radian: the way from here to the end, turned left by a quarter.
        end_m: float64[2], where the drive ends.
    """

    counts: Ints
    turn_counts: Ints
    step_m: Floats
    turn_rad: Floats
    gyro_turn_rad: Floats
    offset_lsb: Floats
    heading_rad: Floats
    angle_rad: Floats
    along: Floats
    across: Floats
    lever_m: Floats
    end_m: Floats


def trace(config: KernelConfig, left: Ints, right: Ints, gyro: Ints) -> Path:
    """Return the float twin's path over one drive.

    Args:
        config: whose mode, integration rule and robot the twin shares.
        left, right, gyro: int64[ticks], counters and codes, all fresh.
    """
    heading = np.empty(len(left))
    for part in stream(config, left[None], right[None], gyro[None], chunk_ticks=65536):
        size = part.twin_pose.shape[1]
        heading[part.start : part.start + size] = part.twin_pose[0, :, 2]
    twin = build_twin_config(config)
    turn = np.diff(heading, prepend=0.0)
    before = heading - turn
    angle = before + config.integration / 2.0 * turn
    old = config.stale_heading_ticks
    if old > 0:
        angle = np.concatenate([np.zeros(old - 1), before])[: len(before)]
    left_steps, right_steps = (counter_steps(one, config.counter_bits) for one in (left, right))
    counts = left_steps + right_steps
    step = counts.astype(np.float64) * twin.half_tick_m
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    position = np.cumsum(step[:, None] * along, axis=0)
    ahead = position[-1] - position
    turn_counts = right_steps - left_steps
    gyro_turn = np.zeros_like(turn)
    if config.mode == MODE_GYRO:
        gyro_turn = turn
    elif config.mode == MODE_BLEND and twin.blend_weight > 0.0:
        by_wheels = turn_counts * twin.tick_turn_rad
        blended = (turn - (1.0 - twin.blend_weight) * by_wheels) / twin.blend_weight
        gyro_turn = np.where(turn != 0.0, blended, 0.0)
    return Path(
        counts=counts,
        turn_counts=turn_counts,
        step_m=step,
        turn_rad=turn,
        gyro_turn_rad=gyro_turn,
        offset_lsb=_offsets(config, gyro, gyro_turn / twin.sensitivity_rad_per_lsb),
        heading_rad=heading,
        angle_rad=angle,
        along=along,
        across=np.stack([-along[:, 1], along[:, 0]], axis=1),
        lever_m=np.stack([-ahead[:, 1], ahead[:, 0]], axis=1),
        end_m=position[-1],
    )


def _offsets(config: KernelConfig, gyro: Ints, turn_lsb: Floats) -> Floats:
    """Return the offset that the twin has used in each tick [LSB].

    A learnt one is a sum over a power of two: the nearest such undoes the rounding of the heading.
    """
    known = float(config.constants.gyro_zero_rate_code)
    fine = math.ldexp(1.0, config.offset_max_log2)
    used = np.rint((gyro - turn_lsb) * fine) / fine
    return np.where(np.abs(gyro - turn_lsb - known) < 1e-6, known, used)


def wrapped(angle_rad: Floats) -> Floats:
    """Return angles brought into [−π, π]."""
    turn = 2.0 * math.pi
    return np.asarray(angle_rad - turn * np.rint(angle_rad / turn))
