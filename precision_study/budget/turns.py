"""The expected error by what turns the robot: constants, the heading's quantum, sine, turns."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import MODE_GYRO, MODE_WHEEL
from firmware_model.twin import build_twin_config
from precision_study.budget.bound import relative_errors
from precision_study.budget.causes import mean_errors, rounding_error
from precision_study.budget.direction import direction_errors
from precision_study.budget.heading import Headings
from precision_study.budget.parts import Part, TurnDrops
from precision_study.budget.path import Path, levered_m
from precision_study.budget.sums import Narrowed

Floats = NDArray[np.float64]

_TURN: Final = 2.0 * math.pi


class Constants:
    """Scales and offsets: what they make off is known, so that none of it is noise."""

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        self._off = np.zeros(3)

    def add(self, path: Path) -> None:
        """Add the next ticks."""
        config, twin = self._config, build_twin_config(self._config)
        _, wheel_off, gyro_off = relative_errors(config)
        by_wheels = path.turn_counts * twin.tick_turn_rad
        unit = math.ldexp(1.0, -config.offset_frac_bits)
        used = path.offset_lsb / unit
        known = path.offset_lsb == config.constants.gyro_zero_rate_code
        offset_off = rounding_error(used, config.offset_rounding) * unit
        nominal = config.zero_rate_code_q * unit - config.constants.gyro_zero_rate_code
        offset_off = np.where(known, nominal, offset_off)
        by_offset = -offset_off * twin.sensitivity_rad_per_lsb * (path.gyro_turn_rad != 0.0)
        gyro = gyro_off * path.gyro_turn_rad + by_offset
        if config.mode == MODE_WHEEL:
            off = wheel_off * by_wheels
        elif config.mode == MODE_GYRO:
            off = gyro
        else:
            weight = math.ldexp(config.blend_weight_q, -config.blend_frac_bits)
            off = (1.0 - weight) * wheel_off * by_wheels + weight * gyro
            off += (weight - twin.blend_weight) * (path.gyro_turn_rad - by_wheels)
            off *= path.turn_rad != 0.0
        self._off += off @ path.reach

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        step_off, *_ = relative_errors(self._config)
        parts["constants"].shift_m += step_off * end_m + levered_m(self._off, end_m)
        parts["constants"].turn_rad += float(self._off[0])


class Direction:
    """The direction of each step: the heading's quantum, sine and cosine.

    Attributes:
        off_m: float64[2], how far off the twin's steps have come along the firmware's directions,
            whatever the cause.
    """

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self.off_m = np.zeros(2)
        self._config = config
        self._unit = _TURN * math.ldexp(1.0, -config.heading_frac_bits)
        self._quantum, self._table, self._chord = np.zeros((3, 2))
        self._reported_rad = 0.0

    def add(self, path: Path, headings: Headings) -> Floats:
        """Add the next ticks; return float64[n, 2], cosine and sine as the firmware has them."""
        config, unit = self._config, self._unit
        self._quantum += (path.step_m * headings.angle_error * unit) @ path.across
        if config.heading_carry == 1:
            self._reported_rad = float(headings.taken.error[-1]) * unit
        bits = config.heading_frac_bits
        phase = (headings.angle_units & ((1 << bits) - 1)) << (32 - bits)
        table, chord = direction_errors(config, phase)
        self._table += path.step_m @ table
        self._chord += path.step_m @ chord
        angle_rad = phase * math.ldexp(_TURN, -32)
        direction = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1) + table + chord
        fine = math.ldexp(1.0, config.trig_frac_bits)
        direction = np.asarray(np.rint(direction * fine) / fine)
        self.off_m += path.step_m @ (direction - path.along)
        return direction

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what it makes by the end."""
        quantum = parts["heading_quantum"]
        quantum.shift_m += self._quantum
        quantum.turn_rad += self._reported_rad
        parts["table_error"].shift_m += self._table
        parts["interpolation"].shift_m += self._chord


class Turns:
    """What is dropped where turns are formed and where the heading takes them."""

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        weight = {MODE_WHEEL: 0.0, MODE_GYRO: 1.0}.get(
            config.mode, build_twin_config(config).blend_weight
        )
        self._shares = 1.0 - weight, weight
        self._waiting_m = np.zeros(2)
        self._waiting_rad = [0.0, 0.0]
        self._lost = TurnDrops()

    def add(self, path: Path, headings: Headings) -> None:
        """Add the next ticks."""
        config, turned = self._config, path.turn_rad != 0.0
        unit_rad = _TURN * math.ldexp(1.0, -config.description.turn_step.frac_bits)
        shifts = config.wheel_turn_shift, config.gyro_turn_shift
        for place, formed in enumerate((headings.wheels, headings.gyro)):
            if formed is None:
                continue
            unit = unit_rad * self._shares[place]
            if config.turn_carry == 1:
                # The remainder of a turn waits: the heading is off by it at every tick.
                error_rad = formed.error * unit
                self._waiting_m += (path.step_m * error_rad) @ path.across
                self._waiting_rad[place] = float(error_rad[-1])
            else:
                self._lose(formed, config.turn_rounding, shifts[place], unit * turned, path)
        if headings.blend is not None:
            self._lose(
                headings.blend,
                config.turn_rounding,
                config.blend_frac_bits,
                unit_rad * turned,
                path,
            )
        if config.heading_carry == 0:
            units_rad = turned * _TURN * math.ldexp(1.0, -config.heading_frac_bits)
            bits = config.heading_shift
            self._lose(headings.taken, config.heading_rounding, bits, units_rad, path)

    def _lose(
        self, narrowed: Narrowed, rounding: int, bits: int, units_rad: Floats, path: Path
    ) -> None:
        if bits > 0:
            mean = mean_errors(narrowed.values, rounding, bits)
            self._lost.add(narrowed.error * units_rad, mean * units_rad, path)

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        waiting = parts["carried_remainder"]
        waiting.shift_m += self._waiting_m
        waiting.turn_rad += sum(self._waiting_rad)
        self._lost.close(parts, end_m)
