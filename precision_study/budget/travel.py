"""How much a drive asks of the arithmetic: all that the guaranteed bound depends on."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
        asked = Asked(config, 1)
        asked.add(left[None], right[None], gyro[None], np.array([len(left)]))
        return asked.most(config, [interruptions])


class Asked:
    """What drives ask for, summed up while they come some ticks at a time."""

    def __init__(self, config: KernelConfig, rows: int) -> None:
        """Begin; of *config* the robot's counters and the code of its gyro at rest count."""
        self._bits = config.counter_bits
        self._zero_rate_code = build_twin_config(config).zero_rate_code
        self._counts: tuple[Ints, Ints] | None = None
        self._ticks = np.zeros(rows, dtype=np.int64)
        self._moving = np.zeros(rows, dtype=np.int64)
        self._way = np.zeros(rows, dtype=np.int64)
        self._bends = np.zeros(rows, dtype=np.int64)
        self._codes = np.zeros(rows)

    def add(self, left: Ints, right: Ints, gyro: Ints, ticks: Ints) -> None:
        """Add the next ticks.

        Args:
            left, right, gyro: int64[rows, n], counters and codes, all fresh.
            ticks: int64[rows], how many of them count.
        """
        before = self._counts or (left[:, :1], right[:, :1])
        left_steps = counter_steps(left, self._bits, before[0])
        right_steps = counter_steps(right, self._bits, before[1])
        self._counts = left[:, -1:].copy(), right[:, -1:].copy()
        counts = np.arange(left.shape[1]) < ticks[:, None]
        self._ticks += ticks
        self._moving += np.count_nonzero(((left_steps != 0) | (right_steps != 0)) & counts, axis=1)
        self._way += (np.abs(left_steps + right_steps) * counts).sum(axis=1)
        self._bends += (np.abs(right_steps - left_steps) * counts).sum(axis=1)
        self._codes += (np.abs(gyro - self._zero_rate_code) * counts).sum(axis=1)

    def most(self, config: KernelConfig, interruptions: Sequence[int]) -> Travel:
        """Return the most that any of the drives asks of a configuration.

        Args:
            config: of the same robot.
            interruptions: of each drive, ticks in which the kernel did not believe an input.
        """
        twin = build_twin_config(config)
        rest = math.ldexp(config.rest_max_rate_q, -config.offset_frac_bits)
        return Travel(
            ticks=int(self._ticks.max()),
            moving_ticks=int(self._moving.max()),
            distance_m=float(self._way.max()) * twin.half_tick_m,
            wheel_turning_rad=float(self._bends.max()) * twin.tick_turn_rad,
            gyro_turning_rad=float((self._codes + self._ticks * rest).max())
            * twin.sensitivity_rad_per_lsb,
            interruptions=max(interruptions),
        )


def counter_steps(counts: Ints, bits: int, before: Ints) -> Ints:
    """Return what wrapping counters gain in each tick.

    Args:
        counts: int64[…, ticks].
        bits: of the counter.
        before: int64[…, 1], what it read a tick before; in the first tick, its baseline, the same.
    """
    half = 1 << (bits - 1)
    steps = np.diff(counts, prepend=before)
    return np.asarray(((steps + half) & (2 * half - 1)) - half)
