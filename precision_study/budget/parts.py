"""What one cause makes at the end of a drive."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from precision_study.budget.causes import Share
from precision_study.budget.path import Path, levered_m

Floats = NDArray[np.float64]


@dataclass
class Part:
    """What one cause makes: what is known, and noise."""

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


class TurnDrops:
    """Turns that lose something each for good [rad], summed up over a drive.

    Bias is the mean of evenly spread fractions, noise the rest. Where turns stay below a unit their
    fractions are not spread: both are large then, and take each other back.
    """

    def __init__(self) -> None:
        """Begin."""
        self._mean = np.zeros(3)
        self._rest = np.zeros(3)

    def add(self, dropped: Floats, mean: Floats, path: Path) -> None:
        """Add those of the next ticks, and what they are for evenly spread fractions."""
        self._mean += mean @ path.reach
        self._rest += (dropped - mean) @ path.reach

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        for name, turns in (("rounding_bias", self._mean), ("rounding_noise", self._rest)):
            parts[name].shift_m += levered_m(turns, end_m)
            parts[name].turn_rad += float(turns[0])
