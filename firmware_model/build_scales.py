"""The robot's constants as integers: fraction bits, and what their products are narrowed by.

Each product is proved to stay below 2^61, so that it and a carried remainder stay below 2^62.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Final

from firmware_model.constants import FirmwareConstants
from firmware_model.description import FirmwareDescription
from firmware_model.errors import FirmwareError
from firmware_model.integers import INTERMEDIATE_LIMIT
from firmware_model.tables import pi_scaled

PI: Final = Fraction(pi_scaled(160), 1 << 160)
_MAX_CONSTANT_FRAC_BITS: Final = 60


class Exact:
    """The robot's constants as exact fractions, each worked out once."""

    def __init__(self, known: FirmwareConstants) -> None:
        """Take what the firmware is told about its robot."""
        self._known = known

    @cached_property
    def half_tick_m(self) -> Fraction:
        """Half the distance of an encoder tick [m]."""
        return PI * Fraction(self._known.wheel_radius_m) / self._known.ticks_per_rev

    @cached_property
    def tick_turn(self) -> Fraction:
        """Rotation of the robot by one encoder tick of one wheel [turn]."""
        known = self._known
        wheelbase = Fraction(known.wheelbase_m)
        return Fraction(known.wheel_radius_m) / (known.ticks_per_rev * wheelbase)

    @cached_property
    def sensitivity_rad_s(self) -> Fraction:
        """Rate per code of the gyro [rad/s]."""
        return Fraction(self._known.gyro_sensitivity_rad_s_per_lsb)

    @cached_property
    def sensitivity_turn(self) -> Fraction:
        """Rotation per code of the gyro in one tick [turn]."""
        return self.sensitivity_rad_s * Fraction(self._known.tick_period_s) / (2 * PI)

    @cached_property
    def two_lsb_ticks(self) -> Fraction:
        """Right minus left count that turns as far as two codes of the gyro [encoder ticks]."""
        return 2 * self.sensitivity_turn / self.tick_turn

    @cached_property
    def fastest_ticks(self) -> Fraction:
        """Increment of the described wheel at its fastest in one tick [encoder ticks]."""
        known = self._known
        turns = Fraction(known.max_wheel_rate_rad_s) * Fraction(known.tick_period_s) / (2 * PI)
        return turns * known.ticks_per_rev

    @cached_property
    def tick_rate_hz(self) -> Fraction:
        """Ticks per second [Hz]."""
        return 1 / Fraction(self._known.tick_period_s)

    @cached_property
    def tick_rate_rad(self) -> Fraction:
        """Rate of a robot that turns once a tick [rad/s]."""
        return 2 * PI * self.tick_rate_hz


@lru_cache(maxsize=256)
def exact(known: FirmwareConstants) -> Exact:
    """Return the exact constants of a robot; its many configurations share them."""
    return Exact(known)


@dataclass(frozen=True)
class Asked:
    """What a configuration is built from.

    Attributes:
        description: the table [firmware] of `robot.toml`.
        constants: the described robot.
        allow_overflow: words that normal use overflows are accepted, constants that are zero, and
            what C cannot hold.
        beyond_c: what C cannot hold, found so far.
    """

    description: FirmwareDescription
    constants: FirmwareConstants
    allow_overflow: bool
    beyond_c: list[str] = field(default_factory=list)

    def refuse_in_c(self, line: str) -> None:
        """Note that C cannot hold this. Raises FirmwareError where only C's formats are taken."""
        line = f"{line}; only --kernel python holds more, by --force"
        if not self.allow_overflow:
            raise FirmwareError(line)
        self.beyond_c.append(line)

    @cached_property
    def exact(self) -> Exact:
        """The constants as exact fractions."""
        return exact(self.constants)


@dataclass(frozen=True, slots=True)
class Scale:
    """A constant as an integer and how many bits its products are narrowed by.

    It is positive, or zero where that is allowed.
    """

    value_q: int
    shift: int

    def bound(self, factor: int) -> int:
        """Return a bound of |shift_round(value_q · n + remainder, shift)| for |n| ≤ factor."""
        return ((self.value_q * factor + (1 << self.shift)) >> self.shift) + 1

    def largest_factor(self, bound: int) -> int:
        """Return the largest factor whose `bound` is at most *bound*."""
        return max(((bound - 1) << self.shift) - 1, 0) // self.value_q


def word(bits: int) -> tuple[int, int]:
    """Return the limits of a two's complement word."""
    return -(1 << (bits - 1)), (1 << (bits - 1)) - 1


def rounded(value: Fraction, frac_bits: int) -> int:
    """Return value · 2^frac_bits to the nearest integer, ties to even."""
    over, under = value.numerator, value.denominator
    whole, rest = divmod(over << max(frac_bits, 0), under << max(-frac_bits, 0))
    excess = 2 * rest - (under << max(-frac_bits, 0))
    return whole + int(excess > 0 or (excess == 0 and whole % 2 == 1))


def max_step_ticks(asked: Asked) -> int:
    """Return the largest increment of a wheel that is believed in one tick [encoder ticks].

    The kernel's margin over the described speed is part of it.
    """
    rules = asked.description.plausibility
    fastest = asked.exact.fastest_ticks * Fraction(rules.rate_margin)
    return math.ceil(fastest) + rules.extra_ticks


def half_tick(asked: Asked, max_step_ticks: int) -> tuple[Scale, int]:
    """Return half a tick's distance and the largest increment ever accepted [encoder ticks].

    The increment stays within half the counter's range, and so small that a step of both wheels
    fits its word. Where by force not even that of a tick does, any increment is accepted.
    """
    known, step = asked.constants, asked.description.step
    half_range = (1 << (known.counter_bits - 1)) - 1
    if max_step_ticks > half_range:
        raise FirmwareError(
            f"max_wheel_rate_rad_s = {known.max_wheel_rate_rad_s:g}: {max_step_ticks} encoder "
            f"ticks in one tick of {known.tick_period_s:g} s, but a counter of "
            f"{known.counter_bits} bits tells at most {half_range} apart: expected a wider "
            "counter, fewer ticks_per_rev, a shorter tick or a slower wheel"
        )
    _, high = word(step.word_bits)
    half_tick_m = asked.exact.half_tick_m
    tick_q = 2 * half_tick_m.numerator << step.frac_bits
    longest = -(-high * half_tick_m.denominator // tick_q)
    is_short = asked.allow_overflow and longest < max_step_ticks
    roughly = half_range if is_short else min(half_range, longest)
    found = to_scale(
        asked,
        "firmware.step.constant_frac_bits",
        asked.exact.half_tick_m,
        "m",
        step.constant_frac_bits,
        kept=("firmware.step.frac_bits", step.frac_bits),
        factor=2 * max(roughly, max_step_ticks),
    )
    if found.value_q == 0:  # no step is too long
        return found, half_range
    capacity = found.largest_factor(high) // 2
    if capacity < max_step_ticks:
        if asked.allow_overflow:
            return found, half_range
        farthest_m = 2 * max_step_ticks * asked.exact.half_tick_m
        bits = math.floor(math.log2(max(high - 2, 1) / farthest_m))
        right = f"at most {bits}" if bits >= 0 else "a wider step.word_bits"
        raise FirmwareError(
            f"firmware.step.frac_bits = {step.frac_bits}: the longest step of a tick, "
            f"{float(farthest_m):.4g} m, does not fit {step.word_bits} bits: expected {right}"
        )
    return found, min(half_range, capacity)


def tick_turn(asked: Asked, count_limit: int) -> Scale:
    """Return the rotation by an encoder tick, for increments up to *count_limit*."""
    turn = asked.description.turn_step
    return to_scale(
        asked,
        "firmware.turn_step.constant_frac_bits",
        asked.exact.tick_turn,
        "turn",
        turn.constant_frac_bits,
        kept=("firmware.turn_step.frac_bits", turn.frac_bits),
        factor=2 * count_limit,
    )


def sensitivity(asked: Asked, rate_bound_q: int) -> Scale:
    """Return the rotation by a code in a tick, for code − offset up to *rate_bound_q*."""
    gyro, turn = asked.description.gyro, asked.description.turn_step
    return to_scale(
        asked,
        "firmware.gyro.sensitivity_frac_bits",
        asked.exact.sensitivity_turn,
        "turn",
        gyro.sensitivity_frac_bits,
        kept=("firmware.turn_step.frac_bits", turn.frac_bits - gyro.offset_frac_bits),
        factor=rate_bound_q,
    )


def rate_bound_q(asked: Asked) -> int:
    """Return a bound of |code − offset|: both lie within the gyro's codes."""
    return (asked.constants.gyro_max_code + 1) << asked.description.gyro.offset_frac_bits


def to_scale(
    asked: Asked,
    name: str,
    value: Fraction,
    unit: str,
    chosen: int | None,
    *,
    kept: tuple[str, int],
    factor: int,
) -> Scale:
    """Return *value* as an integer whose product with *factor* stays below 2^61.

    The product is narrowed to the kept fraction bits by at most 60 bits, so that the carried
    remainder (at most 2^60) and the product together stay below 2^62. Where no product is, only
    the kernel in Python bears it, with as many bits as a constant may have.
    """
    kept_name, kept_bits = kept
    least = max(kept_bits, 0)
    most = finest = min(_MAX_CONSTANT_FRAC_BITS, kept_bits + 60)
    limit = INTERMEDIATE_LIMIT // 2
    while most >= least and (product := rounded(value, most) * factor) >= limit:
        most -= max(product.bit_length() - limit.bit_length(), 1)
    if least > most:
        excess = 1
        while rounded(value, least - excess) * factor >= INTERMEDIATE_LIMIT // 2:
            excess += 1
        fraction_bits = asked.description.turn_step.frac_bits
        if kept_name == "firmware.step.frac_bits":
            fraction_bits = asked.description.step.frac_bits
        asked.refuse_in_c(
            f"{kept_name} = {fraction_bits}: a step of {float(value * factor):.4g} {unit} "
            f"leaves 64 bits: expected at most {fraction_bits - excess}"
        )
        most = finest
    bits = most if chosen is None else chosen
    range_said = (
        f"{name} = {bits}: expected {least} to {most}: no fewer than {kept_name} keeps, "
        "no more than a product of 64 bits bears"
    )
    if bits < least:
        raise FirmwareError(range_said)
    if bits > most:
        asked.refuse_in_c(range_said)
    value_q = rounded(value, bits)
    if value_q == 0 and not asked.allow_overflow:
        raise FirmwareError(
            f"{name} = {bits}: the constant {float(value):.4g} {unit} rounds to zero: "
            f"expected at least {math.ceil(-math.log2(value))}"
        )
    return Scale(value_q, bits - kept_bits)
