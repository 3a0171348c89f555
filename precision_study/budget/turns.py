"""The expected error by what turns the robot: constants, the heading's quantum, sine, turns."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import MODE_BLEND, MODE_GYRO, MODE_WHEEL, TRIG_TABLE
from firmware_model.twin import build_twin_config
from precision_study.budget.bound import direction_bits, relative_errors
from precision_study.budget.causes import SPREAD, Drops, rounding_error
from precision_study.budget.direction import WheelHeading, direction_errors
from precision_study.budget.parts import Part, TurnDrops
from precision_study.budget.path import Path, levered_m, wrapped
from precision_study.budget.sums import Delay, MeanLeftOver, RoundedSum

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
    """The direction of each step: the heading's quantum, sine and cosine."""

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        self._unit = _TURN * math.ldexp(1.0, -config.heading_frac_bits)
        self._bits = direction_bits(config)
        self._wheels = WheelHeading(config) if config.mode == MODE_WHEEL else None
        self._carries = config.heading_carry == 1
        self._is_old = config.stale_heading_ticks > 0 and self._carries and self._bits > 0
        self._old = RoundedSum(config.heading_rounding)
        self._stale = Delay(config.stale_heading_ticks)
        self._known = RoundedSum(config.heading_rounding)
        self._mean = MeanLeftOver(config.heading_rounding, config.heading_shift)
        self._steps_m2 = 0.0
        self._quantum, self._table, self._chord = np.zeros((3, 2))
        self._has_chord = False
        self._reported_rad = 0.0

    def add(self, path: Path) -> None:
        """Add the next ticks."""
        config, unit, bits = self._config, self._unit, self._bits
        values = wrapped(path.angle_rad) / unit
        if not self._carries:
            # Without remainders the heading itself lies on whole units.
            values = np.rint(values) + config.integration / 2.0 * path.turn_rad / unit
            if bits == 0:
                values = np.rint(values)
        fine = math.ldexp(1.0, bits)
        values = np.rint(values * fine) / fine if bits < 20 else values
        error = rounding_error(values, config.heading_rounding) * (bits > 0)
        if self._is_old:
            error = self._stale.through(self._old.left_over(path.turn_rad / unit))
        self._steps_m2 += float(path.step_m @ path.step_m)
        self._quantum += (path.step_m * error * unit) @ path.across
        if self._wheels is not None:
            turns, whole = self._wheels.add(path)
            left_over = self._known.left_over(turns) if self._carries else None
        else:
            whole = np.rint(values + error).astype(np.int64)
            left_over = self._mean.add(path.turn_rad / unit) if self._carries else None
        if left_over is not None:
            self._reported_rad = float(left_over[-1]) * unit
        phase = (whole & ((1 << config.heading_frac_bits) - 1)) << (32 - config.heading_frac_bits)
        table, chord = direction_errors(config, phase)
        self._table += path.step_m @ table
        self._chord += path.step_m @ chord
        self._has_chord |= bool(np.any(chord))

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what it makes by the end."""
        config, spread_m = self._config, math.sqrt(self._steps_m2)
        rounds = self._bits > 0
        quantum = parts["heading_quantum"]
        quantum.add_sum(self._quantum, SPREAD * self._unit * spread_m * rounds)
        quantum.turn_rad += self._reported_rad
        if self._carries and self._wheels is None:
            quantum.noise_rad2 += (SPREAD * self._unit * (config.heading_shift > 0)) ** 2
        trig_unit = math.ldexp(1.0, -config.trig_frac_bits)
        least = math.sqrt(2.0) * SPREAD * trig_unit * spread_m
        parts["table_error"].add_sum(self._table, least)
        interpolates = config.trig_method == TRIG_TABLE and config.trig_interpolated == 1
        noise_m = least if interpolates and self._has_chord else 0.0
        parts["interpolation"].add_sum(self._chord, noise_m)


class Turns:
    """What is dropped where turns are formed and where the heading takes them.

    By the wheels alone a turn is a whole number of ticks: what it drops is known, and no noise.
    """

    def __init__(self, config: KernelConfig) -> None:
        """Begin a drive."""
        self._config = config
        twin = build_twin_config(config)
        self._unit = _TURN * math.ldexp(1.0, -config.description.turn_step.frac_bits)
        is_known = config.mode == MODE_WHEEL
        weight = {MODE_WHEEL: 0.0, MODE_GYRO: 1.0}.get(config.mode, twin.blend_weight)
        self._shares = 1.0 - weight, weight
        self._bits = config.wheel_turn_shift, config.gyro_turn_shift
        self._waiting = [MeanLeftOver(config.turn_rounding, bits) for bits in self._bits]
        self._waiting_m = np.zeros(2)
        self._waiting_rad = [0.0, 0.0]
        self._steps_m2 = 0.0
        self._formed = [TurnDrops(is_known=is_known) for _ in self._bits]
        self._blended = TurnDrops(is_known=False)
        self._taken = TurnDrops(is_known=is_known)

    def add(self, path: Path) -> None:
        """Add the next ticks."""
        config, unit = self._config, self._unit
        self._steps_m2 += float(path.step_m @ path.step_m)
        by_wheels = path.turn_counts * math.ldexp(config.tick_turn_q, -config.wheel_turn_shift)
        by_gyro = path.gyro_turn_rad / unit
        turned = path.turn_rad != 0.0
        turns = path.turn_rad / unit
        for place, values in enumerate((by_wheels, by_gyro)):
            share, bits = self._shares[place], self._bits[place]
            if share == 0.0 or bits == 0:
                continue
            if config.turn_carry == 1:
                error_rad = self._waiting[place].add(values) * share * unit
                self._waiting_m += (path.step_m * error_rad) @ path.across
                self._waiting_rad[place] = float(error_rad[-1])
            else:
                drops = Drops.of(values, config.turn_rounding, bits, unit * share * turned)
                self._formed[place].add(drops, path)
                if config.mode == MODE_WHEEL:
                    turns = np.rint(values + rounding_error(values, config.turn_rounding))
        if config.mode == MODE_BLEND:
            difference = self._shares[1] * (by_gyro - by_wheels)
            bits = config.blend_frac_bits
            drops = Drops.of(difference, config.turn_rounding, bits, unit * turned)
            self._blended.add(drops, path)
        if config.heading_carry == 0 and config.heading_shift > 0:
            bits = config.heading_shift
            whole = _TURN * math.ldexp(1.0, -config.heading_frac_bits)
            turns = np.ldexp(turns, -bits)
            drops = Drops.of(turns, config.heading_rounding, bits, whole * turned)
            self._taken.add(drops, path)

    def close(self, parts: dict[str, Part], end_m: Floats) -> None:
        """Add what they make by the end."""
        waiting = parts["carried_remainder"]
        waiting.shift_m += self._waiting_m
        for share, bits, reported_rad in zip(
            self._shares, self._bits, self._waiting_rad, strict=True
        ):
            # The remainder of a turn waits: the heading is off by it at every tick.
            if self._config.turn_carry == 1 and share != 0.0 and bits != 0:
                spread_rad = SPREAD * share * self._unit
                waiting.noise_m2 += spread_rad * spread_rad * self._steps_m2
                waiting.turn_rad += reported_rad
                waiting.noise_rad2 += spread_rad * spread_rad
        for drops in (*self._formed, self._blended, self._taken):
            drops.close(parts, end_m)
