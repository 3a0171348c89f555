"""The expected error by what moves the robot: steps, the position, and the twin's own rounding."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from precision_study.budget.causes import SPREAD, mean_errors
from precision_study.budget.parts import Part
from precision_study.budget.path import Path
from precision_study.budget.sums import Rounding

Floats = NDArray[np.float64]

_EPSILON: Final = 2.0**-53


class Steps:
    """What is dropped where steps are formed, where the position takes them, and by the twin."""

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        self._step_unit = math.ldexp(1.0, -config.description.step.frac_bits)
        self._unit = math.ldexp(1.0, -config.position_frac_bits)
        self._ticks = 0
        self._way_m = self._turned_rad = 0.0
        self._step = Rounding(config.step_rounding, carry=config.step_carry == 1)
        self._waiting_m = np.zeros(2)
        self._last = 0.0
        carries = config.position_carry == 1
        self._axes = [Rounding(config.position_rounding, carry=carries) for _ in range(2)]
        self._below_m = np.zeros(2)
        self._step_mean, self._step_rest, self._mean, self._rest = np.zeros((4, 2))

    def add(self, path: Path, direction: Floats) -> None:
        """Add the next ticks; *direction* is float64[n, 2], the firmware's cosine and sine."""
        config, moves = self._config, path.counts != 0
        self._ticks += len(path.step_m)
        self._way_m += float(np.abs(path.step_m).sum())
        self._turned_rad = max(self._turned_rad, float(np.abs(path.heading_rad).max()))
        unit, bits = self._step_unit, config.step_shift
        step = self._step.add(
            path.counts.astype(np.float64) * math.ldexp(config.half_tick_m_q, -bits)
        )
        if config.step_carry == 1:
            self._waiting_m += np.diff(step.error, prepend=self._last) @ path.along * unit
            self._last = float(step.error[-1])
        else:
            mean = mean_errors(step.values, config.step_rounding, bits) * moves
            self._step_mean += mean @ path.along * unit
            self._step_rest += (step.error - mean) @ path.along * unit
        bits = config.position_shift
        for axis, rounding in enumerate(self._axes):
            way = rounding.add(step.whole * direction[:, axis] * (unit / self._unit))
            if config.position_carry == 1:
                self._below_m[axis] = float(way.error[-1]) * self._unit
            else:
                mean = mean_errors(way.values, config.position_rounding, bits) * moves
                self._mean[axis] += float(mean.sum()) * self._unit
                self._rest[axis] += float((way.error - mean).sum()) * self._unit

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        parts["carried_remainder"].shift_m += self._waiting_m
        parts["position_quantum"].shift_m += self._below_m
        parts["rounding_bias"].shift_m += self._step_mean + self._mean
        parts["rounding_noise"].shift_m += self._step_rest + self._rest
        self._close_twin(parts["float_twin"])

    def _close_twin(self, part: Part) -> None:
        """Add the twin's own rounding: a sum is off by up to half a unit in its last place."""
        turned_rad, ticks, far_m = max(self._turned_rad, 1.0), self._ticks, self._way_m
        part.noise_rad2 += ticks * (SPREAD * _EPSILON * turned_rad) ** 2
        part.noise_m2 += part.noise_rad2 * far_m * far_m / 3.0
        part.noise_m2 += ticks * (SPREAD * _EPSILON * far_m) ** 2
