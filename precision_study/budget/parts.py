"""What one cause makes at the end of a drive: a part that repeats, and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_study.budget.causes import SPREAD, Drops, Share
from precision_study.budget.path import Path, levered_m

Floats = NDArray[np.float64]

IS_REPEATED: Final = 3.0
"""A sum beyond so many standard deviations of noise is one that every such drive makes."""


@dataclass
class Part:
    """What one cause makes: position as vector and noise, heading as value and noise."""

    shift_m: Floats = field(default_factory=lambda: np.zeros(2))
    noise_m2: float = 0.0
    turn_rad: float = 0.0
    noise_rad2: float = 0.0

    @property
    def share(self) -> Share:
        """Return both together, in magnitude."""
        return Share(
            math.hypot(float(np.hypot(*self.shift_m)), math.sqrt(self.noise_m2)),
            math.hypot(self.turn_rad, math.sqrt(self.noise_rad2)),
        )

    def add_sum(self, shift_m: Floats, noise_m: float) -> None:
        """Add a sum of drops: as it is where noise cannot explain it, as noise otherwise."""
        size = float(np.hypot(*shift_m))
        if size > IS_REPEATED * noise_m:
            self.shift_m += shift_m
        else:
            self.noise_m2 += max(size, noise_m) ** 2


class TurnDrops:
    """Turns that lose something each for good [rad], summed up over a drive."""

    def __init__(self, *, is_known: bool) -> None:
        """Begin; what is dropped of a known turn is no noise."""
        self._is_known = is_known
        self._mean = np.zeros(3)
        self._rest = np.zeros(3)
        self._squares = np.zeros(4)

    def add(self, drops: Drops, path: Path) -> None:
        """Add those of the next ticks."""
        self._mean += drops.mean @ path.reach
        self._rest += (drops.whole - drops.mean) @ path.reach
        squares = drops.unit * drops.unit
        self._squares[:3] += squares @ path.reach
        self._squares[3] += squares @ (path.reach[:, 1] ** 2 + path.reach[:, 2] ** 2)

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        bias, noise = parts["rounding_bias"], parts["rounding_noise"]
        count, *middle, far = self._squares.tolist()
        levers = count * float(end_m @ end_m) - 2.0 * float(end_m @ middle) + far
        noise_m = SPREAD * math.sqrt(max(levers, 0.0))
        bias.shift_m += levered_m(self._mean, end_m)
        noise.add_sum(levered_m(self._rest, end_m), 0.0 if self._is_known else noise_m)
        rest_rad, noise_rad = float(self._rest[0]), SPREAD * math.sqrt(count)
        bias.turn_rad += float(self._mean[0])
        if self._is_known or abs(rest_rad) > IS_REPEATED * noise_rad:
            noise.turn_rad += rest_rad
        else:
            noise.noise_rad2 += max(abs(rest_rad), noise_rad) ** 2
