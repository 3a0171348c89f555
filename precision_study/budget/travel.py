"""How much a drive asks of the arithmetic: all that the guaranteed bound depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.twin import build_twin_config

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Travel:
    """A drive, or the most that a set of drives asks for.

    Attributes:
        ticks: how many.
        moving_ticks: those in which a counter has moved.
        distance_m: Σ|step| as the counters tell it [m].
        wheel_turning_rad: Σ|turn| by the counters [rad].
        gyro_turning_rad: Σ|turn| by the gyro, for any offset that can be learnt [rad].
        interruptions: ticks in which an input was not believed.
    """

    ticks: int
    moving_ticks: int
    distance_m: float
    wheel_turning_rad: float
    gyro_turning_rad: float
    interruptions: int = 0

    @classmethod
    def of_mission(cls, config: KernelConfig, *, distance_m: float, duration_s: float) -> Travel:
        """Return the most that any drive of this length asks for, every input believed."""
        known, twin = config.constants, build_twin_config(config)
        ticks = math.ceil(duration_s / known.tick_period_s)
        codes = config.gyro_max_code - config.gyro_min_code
        return cls(
            ticks=ticks,
            moving_ticks=ticks,
            distance_m=distance_m,
            wheel_turning_rad=ticks * 2.0 * config.max_step_ticks * twin.tick_turn_rad,
            gyro_turning_rad=ticks * codes * twin.sensitivity_rad_per_lsb,
        )

    @classmethod
    def of_drive(
        cls, config: KernelConfig, left: Ints, right: Ints, gyro: Ints, interruptions: int = 0
    ) -> Travel:
        """Return that of one drive.

        Args:
            config: the configuration, for the robot's constants.
            left, right, gyro: int64[ticks], counters and codes, all fresh.
            interruptions: ticks in which the kernel did not believe one of them.
        """
        twin = build_twin_config(config)
        left_steps, right_steps = (counter_steps(one, config.counter_bits) for one in (left, right))
        rest = math.ldexp(config.rest_max_rate_q, -config.offset_frac_bits)
        codes = np.abs(gyro - twin.zero_rate_code) + rest
        return cls(
            ticks=len(left),
            moving_ticks=int(np.count_nonzero((left_steps != 0) | (right_steps != 0))),
            distance_m=float(np.abs(left_steps + right_steps).sum()) * twin.half_tick_m,
            wheel_turning_rad=float(np.abs(right_steps - left_steps).sum()) * twin.tick_turn_rad,
            gyro_turning_rad=float(codes.sum()) * twin.sensitivity_rad_per_lsb,
            interruptions=interruptions,
        )

    def joined(self, other: Travel) -> Travel:
        """Return the most that either asks for."""
        return Travel(
            max(self.ticks, other.ticks),
            max(self.moving_ticks, other.moving_ticks),
            max(self.distance_m, other.distance_m),
            max(self.wheel_turning_rad, other.wheel_turning_rad),
            max(self.gyro_turning_rad, other.gyro_turning_rad),
            max(self.interruptions, other.interruptions),
        )


def counter_steps(counts: Ints, bits: int) -> Ints:
    """Return what a wrapping counter gains in each tick; nothing in the first, its baseline."""
    half = 1 << (bits - 1)
    steps = np.diff(counts, prepend=counts[:1])
    return np.asarray(((steps + half) & (2 * half - 1)) - half)
