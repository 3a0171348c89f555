"""The float twin's path of one drive: what the expected error is worked out along."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import MODE_BLEND, MODE_GYRO
from firmware_model.twin import build_twin_config
from precision_study.budget.sums import Delay
from precision_study.budget.travel import counter_steps
from precision_study.streaming import Streams

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Path:
    """Some ticks of a drive as the float twin sees it; each array has an entry per tick.

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
        reach: float64[n, 3], one, x_m and y_m at the end of the tick: what sums over turns are
            weighed with, see `levered_m`.
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
    reach: Floats


class Tracer:
    """The float twin over one drive that comes some ticks at a time."""

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive; the twin has the mode, integration rule and robot of *config*."""
        self._config = config
        self._twin = build_twin_config(config)
        self._streams = Streams(config, 1)
        self._counts: tuple[Ints, Ints] | None = None
        self._heading_rad = 0.0
        self._stale = Delay(max(config.stale_heading_ticks - 1, 0))
        self._position_m = np.zeros((1, 2))

    def add(self, left: Ints, right: Ints, gyro: Ints) -> Path:
        """Return the path of the next ticks.

        Args:
            left, right, gyro: int64[n], counters and codes, all fresh.
        """
        config, twin = self._config, self._twin
        heading = np.empty(len(left))
        for part in self._streams.over(left[None], right[None], gyro[None]):
            size = part.twin_pose.shape[1]
            heading[part.start : part.start + size] = part.twin_pose[0, :, 2]
        turn = np.diff(heading, prepend=self._heading_rad)
        self._heading_rad = float(heading[-1])
        before = heading - turn
        angle = before + config.integration / 2.0 * turn
        if config.stale_heading_ticks > 0:
            angle = self._stale.through(before)
        baseline = self._counts or (left[:1], right[:1])
        left_steps = counter_steps(left, config.counter_bits, baseline[0])
        right_steps = counter_steps(right, config.counter_bits, baseline[1])
        self._counts = left[-1:].copy(), right[-1:].copy()
        counts = left_steps + right_steps
        step = counts.astype(np.float64) * twin.half_tick_m
        along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        moved = np.concatenate([self._position_m, step[:, None] * along])
        position = np.cumsum(moved, axis=0)[1:]
        self._position_m = position[-1:].copy()
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
            reach=np.concatenate([np.ones((len(step), 1)), position], axis=1),
        )


def trace(config: KernelConfig, left: Ints, right: Ints, gyro: Ints) -> Path:
    """Return the float twin's path over one whole drive; arguments as of `Tracer`."""
    return Tracer(config).add(left, right, gyro)


def levered_m(turns: Floats, end_m: Floats) -> Floats:
    """Return how far off turns move the end of a drive, float64[2].

    A turn that is off by δ moves the end by δ times the way from there to it, turned left by a
    quarter.

    Args:
        turns: float64[3], Σ δ · `Path.reach` over all ticks [rad, rad m, rad m].
        end_m: float64[2], where the drive ends.
    """
    ahead = turns[0] * end_m - turns[1:]
    return np.array([-ahead[1], ahead[0]])


def _offsets(config: KernelConfig, gyro: Ints, turn_lsb: Floats) -> Floats:
    """Return the offset that the twin has used in each tick [LSB].

    A learnt one is a sum over a power of two: the nearest such undoes the rounding of the heading.
    """
    known = float(config.constants.gyro_zero_rate_code)
    fine = math.ldexp(1.0, config.offset_max_log2)
    used = np.rint((gyro - turn_lsb) * fine) / fine
    return np.where(np.abs(gyro - turn_lsb - known) < 1e-6, known, used)
