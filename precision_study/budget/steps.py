"""The expected error by what moves the robot: steps, the position, and the twin's own rounding."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from precision_study.budget.causes import SPREAD, Drops
from precision_study.budget.parts import Part
from precision_study.budget.path import Path
from precision_study.budget.sums import MeanLeftOver

Floats = NDArray[np.float64]

_EPSILON: Final = 2.0**-53


class Steps:
    """What is dropped where steps are formed, where the position takes them, and by the twin."""

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        self._step_unit = math.ldexp(1.0, -config.description.step.frac_bits)
        self._unit = math.ldexp(1.0, -config.position_frac_bits)
        self._ticks = self._moving = 0
        self._way_m = self._turned_rad = 0.0
        self._waiting = MeanLeftOver(config.step_rounding, config.step_shift)
        self._last = 0.0
        self._waiting_m = np.zeros(2)
        self._below = [
            MeanLeftOver(config.position_rounding, config.position_shift) for _ in range(2)
        ]
        self._below_m = np.zeros(2)
        self._step_mean, self._step_rest, self._mean, self._rest = np.zeros((4, 2))

    def add(self, path: Path) -> None:
        """Add the next ticks."""
        config, moves = self._config, path.counts != 0
        self._ticks += len(path.step_m)
        self._moving += int(np.count_nonzero(moves))
        self._way_m += float(np.abs(path.step_m).sum())
        self._turned_rad = max(self._turned_rad, float(np.abs(path.heading_rad).max()))
        unit = self._step_unit
        if config.step_shift > 0 and config.step_carry == 1:
            error = self._waiting.add(path.step_m / unit)
            self._waiting_m += np.diff(error, prepend=self._last) @ path.along * unit
            self._last = float(error[-1])
        elif config.step_shift > 0:
            values = path.counts * math.ldexp(config.half_tick_m_q, -config.step_shift)
            drops = Drops.of(values, config.step_rounding, config.step_shift, unit * moves)
            self._step_mean += drops.mean @ path.along
            self._step_rest += (drops.whole - drops.mean) @ path.along
        unit = self._unit
        if config.position_shift > 0 and config.position_carry == 1:
            for axis, below in enumerate(self._below):
                error = below.add(path.step_m * path.along[:, axis] / unit)
                self._below_m[axis] = float(error[-1]) * unit
        elif config.position_shift > 0:
            values = path.step_m[:, None] * path.along / unit
            units = unit * moves[:, None]
            drops = Drops.of(values, config.position_rounding, config.position_shift, units)
            mean = drops.mean.sum(axis=0)
            self._mean += mean
            self._rest += drops.whole.sum(axis=0) - mean

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        config = self._config
        bias, noise = parts["rounding_bias"], parts["rounding_noise"]
        if config.step_shift > 0 and config.step_carry == 1:
            waiting = parts["carried_remainder"]
            waiting.shift_m += self._waiting_m
            waiting.noise_m2 += (SPREAD * self._step_unit) ** 2
        elif config.step_shift > 0:
            bias.shift_m += self._step_mean
            noise.add_sum(self._step_rest, SPREAD * self._step_unit * math.sqrt(self._moving))
        if config.position_shift > 0 and config.position_carry == 1:
            quantum = parts["position_quantum"]
            quantum.shift_m += self._below_m
            quantum.noise_m2 += 2.0 * (SPREAD * self._unit) ** 2
        elif config.position_shift > 0:
            bias.shift_m += self._mean
            noise.add_sum(self._rest, math.sqrt(2.0 * self._moving) * SPREAD * self._unit)
        self._close_twin(parts["float_twin"])

    def _close_twin(self, part: Part) -> None:
        """Add the twin's own rounding: a sum is off by up to half a unit in its last place."""
        turned_rad, ticks, far_m = max(self._turned_rad, 1.0), self._ticks, self._way_m
        part.noise_rad2 += ticks * (SPREAD * _EPSILON * turned_rad) ** 2
        part.noise_m2 += part.noise_rad2 * far_m * far_m / 3.0
        part.noise_m2 += ticks * (SPREAD * _EPSILON * far_m) ** 2
