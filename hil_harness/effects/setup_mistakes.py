"""Mistakes of whoever connected things: sides swapped, a sign, a unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim_plant import PlantDescription, SensorCounts

SignSignal = Literal[
    "left_ticks",
    "right_ticks",
    "gyro",
    "command_turn",
    "reference_position",
    "reference_heading",
    "reference",
]
UnitSignal = Literal[
    "left_ticks",
    "right_ticks",
    "ticks",
    "gyro",
    "command_speed",
    "command_turn",
    "reference_position",
    "reference_heading",
]
SIGN_SIGNALS: Final[tuple[SignSignal, ...]] = get_args(SignSignal)
UNIT_SIGNALS: Final[tuple[UnitSignal, ...]] = get_args(UnitSignal)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class SetupMistakes:
    """What is connected wrongly; all neutral by default.

    Attributes:
        wheels_swapped: 1 where left and right counts are exchanged.
        flipped: the signal whose sign is wrong, "" for none; reference: in mirrored axes;
            reference_position: positions alone are.
        unit_signal, unit_factor: this signal reads so many times what it should.
    """

    wheels_swapped: int = 0
    flipped: SignSignal | Literal[""] = ""
    unit_signal: UnitSignal = "left_ticks"
    unit_factor: float = 1.0

    def factor(self, signal: UnitSignal) -> float:
        """Return by what a signal is multiplied; 1 where it is right."""
        factor = -1.0 if self.flipped == signal else 1.0
        of_both = self.unit_signal == "ticks" and signal in ("left_ticks", "right_ticks")
        return factor * self.unit_factor if signal == self.unit_signal or of_both else factor

    @property
    def touches_reference(self) -> bool:
        """Tell whether the reference file is wrong."""
        return self._reference_factors != (1.0, 1.0, 1.0)

    def commands(self, commands: Floats) -> Floats:
        """Return commands float64[n, 2] (v_m_s, w_rad_s) as they are recorded."""
        factors = np.array([self.factor("command_speed"), self.factor("command_turn")])
        return commands if (factors == 1.0).all() else commands * factors

    def reference(self, poses: Floats) -> Floats:
        """Return poses float64[n, 3] as the reference file has them."""
        return poses * np.array(self._reference_factors) if self.touches_reference else poses

    @property
    def _reference_factors(self) -> tuple[float, float, float]:
        """By what x, y and heading are multiplied."""
        far = self.unit_factor if self.unit_signal == "reference_position" else 1.0
        y = -far if self.flipped in ("reference", "reference_position") else far
        turned = self.factor("reference_heading")
        return far, y, -turned if self.flipped == "reference" else turned


class SensorMistakes:
    """The mistakes that sit between sensors and frames, followed tick by tick."""

    def __init__(self, mistakes: SetupMistakes, plant: PlantDescription) -> None:
        """Start before the first tick."""
        self._swapped = mistakes.wheels_swapped == 1
        self._gyro = mistakes.factor("gyro")
        self._zero_code = plant.gyro.zero_rate_code
        self._top_code = plant.adc.max_code
        self._period = 1 << plant.encoder.counter_bits
        self._wheels = [
            _Wheel(mistakes.factor("left_ticks"), self._period),
            _Wheel(mistakes.factor("right_ticks"), self._period),
        ]
        self.is_neutral = (
            not self._swapped and self._gyro == 1.0 and all(w.factor == 1.0 for w in self._wheels)
        )

    def apply(self, counts: SensorCounts) -> SensorCounts:
        """Return what goes into the frames; to be called with every tick's reading."""
        if self.is_neutral:
            return counts
        left, right = counts.left_count, counts.right_count
        if self._swapped:
            left, right = right, left
        left, right = self._wheels[0].read(left), self._wheels[1].read(right)
        return counts._replace(
            left_count=left, right_count=right, gyro_code=self._code(counts.gyro_code)
        )

    def apply_columns(self, left: Ints, right: Ints, gyro_code: Ints) -> tuple[Ints, Ints, Ints]:
        """Do the same to a whole run at once: each int64[ticks]."""
        if self.is_neutral:
            return left, right, gyro_code
        if self._swapped:
            left, right = right, left
        left, right = self._wheels[0].read_all(left), self._wheels[1].read_all(right)
        if self._gyro != 1.0:
            codes, which = np.unique(gyro_code, return_inverse=True)
            gyro_code = np.array([self._code(code) for code in codes.tolist()])[which]
        return left, right, gyro_code

    def _code(self, code: int) -> int:
        if self._gyro == 1.0:
            return code
        wrong = round(self._zero_code + (code - self._zero_code) * self._gyro)
        return min(max(wrong, 0), self._top_code)


class _Wheel:
    """A counter whose reading is multiplied."""

    def __init__(self, factor: float, period: int) -> None:
        self.factor = factor
        self._period = period
        self._last: int | None = None
        self._total = 0

    def read(self, count: int) -> int:
        if self.factor == 1.0:
            return count
        if self._last is None:
            self._total = count
        else:
            half = self._period >> 1
            self._total += (count - self._last + half) % self._period - half
        self._last = count
        return round(self._total * self.factor) % self._period

    def read_all(self, counts: Ints) -> Ints:
        if self.factor == 1.0:
            return counts
        half = self._period >> 1
        steps = (np.diff(counts) + half) % self._period - half
        totals = counts[:1] + np.concatenate(([0], np.cumsum(steps)))
        scaled: Ints = np.rint(totals * self.factor).astype(np.int64) % self._period
        return scaled
