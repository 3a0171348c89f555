"""The expected firmware − float at the end of a drive, split by cause.

Every cause acts alone, along the path of the float twin; what they make together is their sum to
first order. A cause has a part that every drive of this kind repeats (a scale, a mean of what is
dropped, a chord below the curve): those add as vectors. The rest is noise with the variance that
evenly spread fractions have, 1/12 of a squared unit: those add in squares.

A turn that is off by δ moves the end of the drive by δ times the way that is left, across it: the
lever of the tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import MODE_BLEND, MODE_GYRO, MODE_WHEEL, TRIG_TABLE
from firmware_model.twin import build_twin_config
from precision_study.budget.bound import direction_bits, relative_errors
from precision_study.budget.causes import (
    CAUSES,
    SPREAD,
    Drops,
    Share,
    left_over,
    mean_left_over,
    rounding_error,
)
from precision_study.budget.direction import (
    direction_by_wheels,
    direction_errors,
    turns_by_wheels,
)
from precision_study.budget.path import Path, wrapped

Floats = NDArray[np.float64]

_TURN: Final = 2.0 * math.pi
_EPSILON: Final = 2.0**-53
_IS_REPEATED: Final = 3.0
"""A sum beyond so many standard deviations of noise is one that every such drive makes."""


@dataclass
class _Part:
    """What one cause makes: position as vector and noise, heading as value and noise."""

    shift_m: Floats = field(default_factory=lambda: np.zeros(2))
    noise_m2: float = 0.0
    turn_rad: float = 0.0
    noise_rad2: float = 0.0

    @property
    def share(self) -> Share:
        return Share(
            math.hypot(float(np.hypot(*self.shift_m)), math.sqrt(self.noise_m2)),
            math.hypot(self.turn_rad, math.sqrt(self.noise_rad2)),
        )


@dataclass(frozen=True)
class Expected:
    """The expected error: each cause alone, and all together (root of the mean square)."""

    shares: dict[str, Share]
    together: Share


def expected_error(config: KernelConfig, paths: Sequence[Path]) -> Expected:
    """Return the expected error of a configuration at the end of drives like *paths*.

    Args:
        config: of the firmware.
        paths: some drives of the kind, from `trace` with the same mode and integration rule; what
            depends on where exactly a robot goes is averaged over them, in squares.
    """
    each = [_along(config, path) for path in paths]
    shares = {name: _mean([one.shares[name] for one in each]) for name in CAUSES}
    return Expected(shares, _mean([one.together for one in each]))


def _mean(shares: Sequence[Share]) -> Share:
    """Return the root of the mean of the squares."""
    count = len(shares)
    return Share(
        math.sqrt(math.fsum(one.position_m**2 for one in shares) / count),
        math.sqrt(math.fsum(one.heading_rad**2 for one in shares) / count),
    )


def _along(config: KernelConfig, path: Path) -> Expected:
    parts = {name: _Part() for name in CAUSES}
    _add_constants(parts["constants"], config, path)
    _add_direction(parts, config, path)
    _add_turns(parts, config, path)
    _add_steps(parts, config, path)
    _add_twin(parts["float_twin"], path)
    shift = np.sum([one.shift_m for one in parts.values()], axis=0)
    noise = sum(one.noise_m2 for one in parts.values())
    turn = sum(one.turn_rad for one in parts.values())
    turn_noise = sum(one.noise_rad2 for one in parts.values())
    return Expected(
        {name: one.share for name, one in parts.items()},
        Share(math.hypot(*shift, math.sqrt(noise)), math.hypot(turn, math.sqrt(turn_noise))),
    )


def _add_constants(part: _Part, config: KernelConfig, path: Path) -> None:
    """Add scales and offsets: what they make off is known, so that none of it is noise."""
    step_off, wheel_off, gyro_off = relative_errors(config)
    twin = build_twin_config(config)
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
    part.shift_m += step_off * path.end_m + off @ path.lever_m
    part.turn_rad += float(off.sum())


def _add_direction(parts: dict[str, _Part], config: KernelConfig, path: Path) -> None:
    """Add the heading's quantum, sine and cosine."""
    one = config.description
    unit = _TURN * math.ldexp(1.0, -config.heading_frac_bits)
    spread_m = float(np.sqrt(path.step_m @ path.step_m))
    bits = direction_bits(config)
    values = wrapped(path.angle_rad) / unit
    if config.heading_carry == 0:
        # Without remainders the heading itself lies on whole units.
        values = np.rint(values) + config.integration / 2.0 * path.turn_rad / unit
        if bits == 0:
            values = np.rint(values)
    fine = math.ldexp(1.0, bits)
    values = np.rint(values * fine) / fine if bits < 20 else values
    error = rounding_error(values, config.heading_rounding) * (bits > 0)
    if config.stale_heading_ticks > 0 and config.heading_carry == 1 and bits > 0:
        old = left_over(path.turn_rad / unit, config.heading_rounding)
        error = np.concatenate([np.zeros(config.stale_heading_ticks), old])[: len(values)]
    quantum = parts["heading_quantum"]
    shift = (path.step_m * error * unit) @ path.across
    _add_sum(quantum, shift, SPREAD * unit * spread_m * (bits > 0))
    if config.heading_carry == 1:
        turns, rounding, bits = path.turn_rad / unit, config.heading_rounding, config.heading_shift
        if config.mode == MODE_WHEEL:
            turns = np.ldexp(turns_by_wheels(config, path), -bits)
            quantum.turn_rad += float(left_over(turns, rounding)[-1]) * unit
        else:
            quantum.turn_rad += float(mean_left_over(turns, rounding, bits)[-1]) * unit
            quantum.noise_rad2 += (SPREAD * unit * (bits > 0)) ** 2

    if config.mode == MODE_WHEEL:
        whole = direction_by_wheels(config, path)
    else:
        whole = np.rint(values + error).astype(np.int64)
    phase = (whole & ((1 << config.heading_frac_bits) - 1)) << (32 - config.heading_frac_bits)
    table, chord = direction_errors(config, phase)
    trig_unit = math.ldexp(1.0, -one.trig.frac_bits)
    least = math.sqrt(2.0) * SPREAD * trig_unit * spread_m
    _add_sum(parts["table_error"], path.step_m @ table, least)
    interpolates = config.trig_method == TRIG_TABLE and config.trig_interpolated == 1
    _add_sum(
        parts["interpolation"],
        path.step_m @ chord,
        least if interpolates and bool(np.any(chord)) else 0.0,
    )


def _add_turns(parts: dict[str, _Part], config: KernelConfig, path: Path) -> None:
    """Add what is dropped where turns are formed and where the heading takes them.

    By the wheels alone a turn is a whole number of ticks: what it drops is known, and no noise.
    """
    twin, one = build_twin_config(config), config.description
    unit = _TURN * math.ldexp(1.0, -one.turn_step.frac_bits)
    weight = {MODE_WHEEL: 0.0, MODE_GYRO: 1.0}.get(config.mode, twin.blend_weight)
    sources = [
        (
            1.0 - weight,
            path.turn_counts * math.ldexp(config.tick_turn_q, -config.wheel_turn_shift),
            config.wheel_turn_shift,
        ),
        (weight, path.gyro_turn_rad / unit, config.gyro_turn_shift),
    ]
    turned = path.turn_rad != 0.0
    is_known = config.mode == MODE_WHEEL
    turns = path.turn_rad / unit
    for share, values, bits in sources:
        if share == 0.0 or bits == 0:
            continue
        if config.turn_carry == 1:
            error = mean_left_over(values, config.turn_rounding, bits) * share * unit
            _add_waiting(parts["carried_remainder"], error, path, SPREAD * share * unit)
        else:
            drops = Drops.of(values, config.turn_rounding, bits, unit * share * turned)
            _add_drops(parts, drops, path, is_known=is_known)
            if is_known:
                turns = np.rint(values + rounding_error(values, config.turn_rounding))
    if config.mode == MODE_BLEND:
        difference = twin.blend_weight * (sources[1][1] - sources[0][1])
        bits = config.blend_frac_bits
        _add_drops(
            parts,
            Drops.of(difference, config.turn_rounding, bits, unit * turned),
            path,
            is_known=False,
        )
    if config.heading_carry == 0 and config.heading_shift > 0:
        bits = config.heading_shift
        unit = _TURN * math.ldexp(1.0, -config.heading_frac_bits)
        drops = Drops.of(np.ldexp(turns, -bits), config.heading_rounding, bits, unit * turned)
        _add_drops(parts, drops, path, is_known=is_known)


def _add_waiting(part: _Part, error_rad: Floats, path: Path, spread_rad: float) -> None:
    """Add the remainder of a turn that waits: the heading is off by it at every tick."""
    part.shift_m += (path.step_m * error_rad) @ path.across
    part.noise_m2 += spread_rad * spread_rad * float(path.step_m @ path.step_m)
    part.turn_rad += float(error_rad[-1])
    part.noise_rad2 += spread_rad * spread_rad


def _add_drops(parts: dict[str, _Part], drops: Drops, path: Path, *, is_known: bool) -> None:
    """Add turns that lose something each for good [rad]."""
    bias, noise = parts["rounding_bias"], parts["rounding_noise"]
    mean_m, rest_m = drops.mean @ path.lever_m, (drops.whole - drops.mean) @ path.lever_m
    bias.shift_m += mean_m
    noise_m = SPREAD * float(np.sqrt(((drops.unit[:, None] * path.lever_m) ** 2).sum()))
    _add_sum(noise, rest_m, 0.0 if is_known else noise_m)
    mean_rad = float(drops.mean.sum())
    rest_rad = float(drops.whole.sum()) - mean_rad
    noise_rad = SPREAD * float(np.sqrt(drops.unit @ drops.unit))
    bias.turn_rad += mean_rad
    if is_known or abs(rest_rad) > _IS_REPEATED * noise_rad:
        noise.turn_rad += rest_rad
    else:
        noise.noise_rad2 += max(abs(rest_rad), noise_rad) ** 2


def _add_steps(parts: dict[str, _Part], config: KernelConfig, path: Path) -> None:
    """Add what is dropped where steps are formed and where the position takes them."""
    one = config.description
    unit = math.ldexp(1.0, -one.step.frac_bits)
    moving = float(np.count_nonzero(path.counts))
    if config.step_shift > 0:
        if config.step_carry == 1:
            error = mean_left_over(path.step_m / unit, config.step_rounding, config.step_shift)
            waiting = parts["carried_remainder"]
            waiting.shift_m += np.diff(error, prepend=0.0) @ path.along * unit
            waiting.noise_m2 += (SPREAD * unit) ** 2
        else:
            values = path.counts * math.ldexp(config.half_tick_m_q, -config.step_shift)
            units = unit * (path.counts != 0)
            drops = Drops.of(values, config.step_rounding, config.step_shift, units)
            bias, noise = parts["rounding_bias"], parts["rounding_noise"]
            bias.shift_m += drops.mean @ path.along
            rest_m = (drops.whole - drops.mean) @ path.along
            _add_sum(noise, rest_m, SPREAD * unit * math.sqrt(moving))
    unit = math.ldexp(1.0, -config.position_frac_bits)
    if config.position_shift > 0:
        if config.position_carry == 1:
            quantum, bits = parts["position_quantum"], config.position_shift
            for axis in (0, 1):
                moved_m = path.step_m * path.along[:, axis]
                error = mean_left_over(moved_m / unit, config.position_rounding, bits) * unit
                quantum.shift_m[axis] += float(error[-1])
            quantum.noise_m2 += 2.0 * (SPREAD * unit) ** 2
        else:
            values = path.step_m[:, None] * path.along / unit
            units = unit * (path.counts != 0)[:, None]
            drops = Drops.of(values, config.position_rounding, config.position_shift, units)
            mean_m = drops.mean.sum(axis=0)
            parts["rounding_bias"].shift_m += mean_m
            rest_m = drops.whole.sum(axis=0) - mean_m
            noise_m = math.sqrt(2.0 * moving) * SPREAD * unit
            _add_sum(parts["rounding_noise"], rest_m, noise_m)


def _add_twin(part: _Part, path: Path) -> None:
    """Add the twin's own rounding: each sum is off by up to half a unit in its last place."""
    ticks = len(path.step_m)
    turned = max(float(np.abs(path.heading_rad).max()), 1.0)
    far = float(np.abs(path.step_m).sum())
    part.noise_rad2 += ticks * (SPREAD * _EPSILON * turned) ** 2
    part.noise_m2 += part.noise_rad2 * far * far / 3.0 + ticks * (SPREAD * _EPSILON * far) ** 2


def _add_sum(part: _Part, shift_m: Floats, noise_m: float) -> None:
    """Add a sum of drops: as it is where noise cannot explain it, as noise otherwise."""
    size = float(np.hypot(*shift_m))
    if size > _IS_REPEATED * noise_m:
        part.shift_m += shift_m
    else:
        part.noise_m2 += max(size, noise_m) ** 2
