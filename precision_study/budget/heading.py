"""The heading of the firmware along a path: counts and codes tell it to the bit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import MODE_BLEND, MODE_GYRO, MODE_WHEEL
from firmware_model.twin import build_twin_config
from precision_study.budget.causes import rounding_error
from precision_study.budget.path import Path
from precision_study.budget.sums import Delay, Narrowed, Rounding, Sum

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Headings:
    """How the firmware turns in some ticks.

    Attributes:
        wheels, gyro, blend: what is rounded where a turn is formed [2^-K turn]; None: nothing is.
        taken: what is rounded where the heading takes the turn [2^-F turn].
        angle_units: int64[n], the direction of the step [2^-F turn].
        angle_error: rounded − exact of that direction [2^-F turn].
    """

    wheels: Narrowed | None
    gyro: Narrowed | None
    blend: Narrowed | None
    taken: Narrowed
    angle_units: Ints
    angle_error: Floats


class FirmwareHeading:
    """Turns and heading, rounded as the firmware rounds them, along the inputs of a path.

    What a rounding drops depends on the value it is given. Where that hardly changes from tick to
    tick, or stays below a unit, what is dropped follows from it and is no noise.
    """

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        self._sensitivity_rad = build_twin_config(config).sensitivity_rad_per_lsb
        carries = config.turn_carry == 1
        self._wheels = Rounding(config.turn_rounding, carry=carries)
        self._gyro = Rounding(config.turn_rounding, carry=carries)
        self._blend = Rounding(config.turn_rounding, carry=False)
        self._taken = Rounding(config.heading_rounding, carry=config.heading_carry == 1)
        self._heading, self._exact = Sum(), Sum()
        self._before = Delay(1)
        self._stale, self._stale_error = (Delay(config.stale_heading_ticks) for _ in range(2))

    def add(self, path: Path) -> Headings:
        """Go on over the next ticks."""
        config, wheels, gyro, blend = self._config, None, None, None
        turned = path.turn_rad != 0.0
        if config.mode != MODE_GYRO:
            scale = math.ldexp(config.tick_turn_q, -config.wheel_turn_shift)
            accepted = turned if config.mode == MODE_BLEND else True
            wheels = self._wheels.add(path.turn_counts * accepted * scale)
        if config.mode != MODE_WHEEL:
            bits = config.gyro_turn_shift - config.offset_frac_bits
            scale = math.ldexp(config.sensitivity_turn_q, -bits)
            gyro = self._gyro.add(self._rate_lsb(path) * scale)
        if wheels is not None and gyro is not None:
            weight = math.ldexp(config.blend_weight_q, -config.blend_frac_bits)
            blend = self._blend.add((gyro.whole - wheels.whole) * weight)
        formed = [one.whole for one in ((wheels, blend) if blend else (wheels, gyro)) if one]
        taken = self._taken.add(np.ldexp(np.sum(formed, axis=0), -config.heading_shift))
        angle, angle_error = self._angle(taken)
        return Headings(wheels, gyro, blend, taken, angle, angle_error)

    def _rate_lsb(self, path: Path) -> Floats:
        """Return code − offset as the firmware has it; 0 where it does not take the gyro."""
        config = self._config
        code = np.rint(path.gyro_turn_rad / self._sensitivity_rad + path.offset_lsb)
        fine = math.ldexp(1.0, config.offset_frac_bits)
        offset = path.offset_lsb * fine
        learnt = offset + rounding_error(offset, config.offset_rounding)
        assumed = path.offset_lsb == config.constants.gyro_zero_rate_code
        return np.asarray(code - np.where(assumed, config.zero_rate_code_q, learnt) / fine)

    def _angle(self, taken: Narrowed) -> tuple[Ints, Floats]:
        """Return the direction of each step and how far rounding has moved it [2^-F turn]."""
        config, carries = self._config, self._config.heading_carry == 1
        heading = self._heading.add(taken.whole)
        if config.stale_heading_ticks > 0:
            angle = self._stale.through(heading)
            error = self._stale_error.through(taken.error * carries)
            return np.rint(angle).astype(np.int64), error
        exact = self._exact.add(taken.values) if carries else heading
        half = 1 << (config.heading_frac_bits - 1)
        wrapped = (heading + half) % (2.0 * half) - half  # the remainder is not
        start = self._before.through(wrapped + (exact - heading))
        angle = start + config.integration / 2.0 * taken.values
        error = rounding_error(angle, config.heading_rounding)
        return np.rint(angle + error).astype(np.int64), error
