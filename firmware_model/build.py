"""From description and constants to the kernel's integers, with every bound proved on the way.

Nothing that the kernel computes may leave 64 bits, and no word may overflow in normal use; a
configuration for which that cannot be shown is refused, with the field, its value and what would
be right. The proof is this module read top to bottom: each `_Bounds.require` states one product
or sum of the kernel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from firmware_model.config import (
    EULER_AFTER,
    EULER_BEFORE,
    MIDPOINT,
    MODE_BLEND,
    MODE_GYRO,
    MODE_WHEEL,
    TRIG_CORDIC,
    TRIG_TABLE,
    KernelConfig,
)
from firmware_model.constants import FirmwareConstants
from firmware_model.description import FirmwareDescription
from firmware_model.errors import FirmwareError
from firmware_model.integers import (
    FLOOR,
    HALF_EVEN,
    HALF_UP,
    INTERMEDIATE_LIMIT,
    SATURATE,
    TOWARD_ZERO,
    WRAP,
)
from firmware_model.tables import cordic_table, pi_scaled, quarter_sine_table

_MODES: Final = {"wheel": MODE_WHEEL, "gyro": MODE_GYRO, "blend": MODE_BLEND}
_RULES: Final = {"euler_before": EULER_BEFORE, "midpoint": MIDPOINT, "euler_after": EULER_AFTER}
_ROUNDINGS: Final = {
    "floor": FLOOR,
    "half_up": HALF_UP,
    "half_even": HALF_EVEN,
    "toward_zero": TOWARD_ZERO,
}
_OVERFLOWS: Final = {"wrap": WRAP, "saturate": SATURATE}

_MAX_BLEND_FRAC_BITS: Final = 30
_MIN_BLEND_FRAC_BITS: Final = 8
_TICK_RATE_FRAC_BITS: Final = 16
_MAX_CONSTANT_FRAC_BITS: Final = 60
_VELOCITY_WORD_BITS: Final = 32

_PI: Final = Fraction(pi_scaled(160), 1 << 160)


def build_config(
    description: FirmwareDescription,
    constants: FirmwareConstants,
    *,
    allow_overflow: bool = False,
) -> KernelConfig:
    """Return the kernel's integer configuration.

    Args:
        description: the table [firmware] of `robot.toml`.
        constants: the described robot.
        allow_overflow: accept words that normal use overflows; the kernel then wraps or
            saturates as configured and counts. 64-bit intermediates stay proved.

    Raises:
        FirmwareError: a scale that rounds to zero, a format whose step does not fit, or an
            intermediate that could leave 64 bits; one line with field, value and what is right.
    """
    return _Builder(description, constants, allow_overflow).build()


@dataclass(frozen=True, slots=True)
class _Scale:
    """A positive constant as an integer, and how many bits its products are narrowed by."""

    value_q: int
    shift: int

    def bound(self, factor: int) -> int:
        """Return a bound of |shift_round(value_q · n + remainder, shift)| for |n| ≤ factor."""
        return ((self.value_q * factor + (1 << self.shift)) >> self.shift) + 1

    def largest_factor(self, bound: int) -> int:
        """Return the largest factor whose `bound` is at most *bound*."""
        return max(((bound - 1) << self.shift) - 1, 0) // self.value_q


def _word(bits: int) -> tuple[int, int]:
    return -(1 << (bits - 1)), (1 << (bits - 1)) - 1


class _Builder:
    def __init__(
        self,
        description: FirmwareDescription,
        constants: FirmwareConstants,
        allow_overflow: bool,
    ) -> None:
        self.description = description
        self.constants = constants
        self.allow_overflow = allow_overflow
        radius = Fraction(constants.wheel_radius_m)
        period = Fraction(constants.tick_period_s)
        self.half_tick_m = _PI * radius / constants.ticks_per_rev
        self.tick_turn = radius / (constants.ticks_per_rev * Fraction(constants.wheelbase_m))
        self.sensitivity_turn = (
            Fraction(constants.gyro_sensitivity_rad_s_per_lsb) * period / (2 * _PI)
        )
        self.tick_rate_hz = 1 / period

    def build(self) -> KernelConfig:
        one = self.description
        known = self.constants
        max_step_ticks = self._max_step_ticks()
        half_tick, count_limit = self._half_tick(max_step_ticks)

        step_low, step_high = _word(one.step.word_bits)
        step_bound = min(half_tick.bound(2 * count_limit), -step_low)

        turn_low, turn_high = _word(one.turn_step.word_bits)
        tick_turn = self._tick_turn(count_limit)
        rate_bound_q = self._rate_bound_q()
        sensitivity = self._sensitivity(rate_bound_q)
        self._require_turns_fit(
            max(tick_turn.bound(2 * count_limit), sensitivity.bound(rate_bound_q)), turn_high
        )
        wheel_turn = min(tick_turn.bound(2 * count_limit), -turn_low)
        gyro_turn = min(sensitivity.bound(rate_bound_q), -turn_low)
        one_tick_turn = 1 + max(min(tick_turn.bound(2 * max_step_ticks), -turn_low), gyro_turn)
        gap_limit_ticks = min(
            count_limit // max_step_ticks,
            self._gap_limit_ticks(gyro_turn, max(wheel_turn, one_tick_turn)),
        )
        blend_frac_bits = self._blend_frac_bits(one_tick_turn)

        position_low, position_high = _word(one.position.word_bits)
        position_shift = self._position_shift(step_bound, position_high)
        table, index_bits = self._table()
        v_rate = _round(self.tick_rate_hz, _TICK_RATE_FRAC_BITS)
        v_shift = one.step.frac_bits + _TICK_RATE_FRAC_BITS - one.velocity.frac_bits
        self._require_v_fits(step_bound, v_rate, v_shift)
        w_rate = _round(2 * _PI * self.tick_rate_hz, _TICK_RATE_FRAC_BITS)
        w_narrowing = one.turn_step.frac_bits + _TICK_RATE_FRAC_BITS - one.velocity.frac_bits
        w_pre_shift = max((one_tick_turn * w_rate).bit_length() - 61, w_narrowing - 60, 0)
        w_shift = w_narrowing - w_pre_shift
        self._require_w_fits(w_shift, one_tick_turn)
        velocity_low, velocity_high = _word(_VELOCITY_WORD_BITS)

        return KernelConfig(
            mode=_MODES[one.mode],
            integration=_RULES[one.integration],
            blend_weight_q=_round(Fraction(one.blend_weight), blend_frac_bits),
            blend_frac_bits=blend_frac_bits,
            stale_heading_ticks=one.stale_heading_ticks,
            counter_bits=known.counter_bits,
            max_step_ticks=max_step_ticks,
            gap_limit_ticks=gap_limit_ticks,
            jump_confirm_samples=one.plausibility.jump_confirm_samples,
            half_tick_m_q=half_tick.value_q,
            step_shift=half_tick.shift,
            step_rounding=_ROUNDINGS[one.step.rounding],
            step_low_q=step_low,
            step_high_q=step_high,
            step_overflow=_OVERFLOWS[one.step.overflow],
            step_carry=int(one.step.carry_remainder),
            tick_turn_q=tick_turn.value_q,
            wheel_turn_shift=tick_turn.shift,
            sensitivity_turn_q=sensitivity.value_q,
            gyro_turn_shift=sensitivity.shift,
            turn_rounding=_ROUNDINGS[one.turn_step.rounding],
            turn_low_q=turn_low,
            turn_high_q=turn_high,
            turn_overflow=_OVERFLOWS[one.turn_step.overflow],
            turn_carry=int(one.turn_step.carry_remainder),
            heading_frac_bits=one.heading.frac_bits,
            heading_shift=one.turn_step.frac_bits - one.heading.frac_bits,
            heading_rounding=_ROUNDINGS[one.heading.rounding],
            heading_carry=int(one.heading.carry_remainder),
            trig_method=TRIG_CORDIC if one.trig.method == "cordic" else TRIG_TABLE,
            trig_frac_bits=one.trig.frac_bits,
            trig_rounding=_ROUNDINGS[one.trig.rounding],
            trig_interpolated=int(one.trig.interpolated),
            table_start=0,
            table_index_bits=index_bits,
            cordic_iterations=one.trig.iterations,
            position_shift=position_shift,
            position_rounding=_ROUNDINGS[one.position.rounding],
            position_low_q=position_low,
            position_high_q=position_high,
            position_overflow=_OVERFLOWS[one.position.overflow],
            position_carry=int(one.position.carry_remainder),
            position_frac_bits=one.position.frac_bits,
            gyro_min_code=known.gyro_min_code,
            gyro_max_code=known.gyro_max_code,
            zero_rate_code_q=_round(Fraction(known.gyro_zero_rate_code), one.gyro.offset_frac_bits),
            offset_frac_bits=one.gyro.offset_frac_bits,
            offset_rounding=_ROUNDINGS[one.gyro.rounding],
            auto_zero_rate_q=self._rate_q(one.gyro.auto_zero_rad_s),
            stuck_ticks=one.stuck.ticks,
            stuck_block_ticks=1 << one.stuck.block_log2,
            stuck_span_ticks=self._stuck_span_ticks(),
            still_ticks=one.standstill.ticks,
            still_tolerance_ticks=one.standstill.tolerance_ticks,
            rest_max_rate_q=self._rate_q(one.standstill.max_rate_rad_s),
            settle_ticks=one.standstill.settle_ticks,
            offset_block_log2=one.standstill.block_log2,
            offset_max_log2=self._offset_max_log2(),
            tick_rate_hz_q=v_rate,
            v_shift=v_shift,
            tick_rate_rad_q=w_rate,
            w_pre_shift=w_pre_shift,
            w_shift=w_shift,
            velocity_low_q=velocity_low,
            velocity_high_q=velocity_high,
            velocity_frac_bits=one.velocity.frac_bits,
            velocity_filter_log2=one.velocity.filter_log2,
            table=table,
            description=one,
            constants=known,
        )

    # Encoder ------------------------------------------------------------------------------

    def _max_step_ticks(self) -> int:
        known, rules = self.constants, self.description.plausibility
        turns_per_tick = (
            Fraction(known.max_wheel_rate_rad_s) * Fraction(known.tick_period_s) / (2 * _PI)
        )
        fastest = turns_per_tick * known.ticks_per_rev * Fraction(rules.rate_margin)
        return math.ceil(fastest) + rules.extra_ticks

    def _half_tick(self, max_step_ticks: int) -> tuple[_Scale, int]:
        """Return half a tick's distance and the largest increment ever accepted [encoder ticks].

        The increment stays within half the counter's range, and so small that a step of both
        wheels fits its word.
        """
        known, step = self.constants, self.description.step
        half_range = (1 << (known.counter_bits - 1)) - 1
        if max_step_ticks > half_range:
            raise FirmwareError(
                f"max_wheel_rate_rad_s = {known.max_wheel_rate_rad_s:g}: {max_step_ticks} encoder "
                f"ticks in one tick of {known.tick_period_s:g} s, but a counter of "
                f"{known.counter_bits} bits tells at most {half_range} apart: expected a wider "
                "counter, fewer ticks_per_rev, a shorter tick or a slower wheel"
            )
        _, high = _word(step.word_bits)
        longest = math.ceil(high / (2 * self.half_tick_m * (1 << step.frac_bits)))
        roughly = half_range if self.allow_overflow else min(half_range, longest)
        scale = self._scale(
            "firmware.step.constant_frac_bits",
            self.half_tick_m,
            "m",
            step.constant_frac_bits,
            kept=("firmware.step.frac_bits", step.frac_bits),
            factor=2 * max(roughly, max_step_ticks),
        )
        if self.allow_overflow:
            return scale, half_range
        capacity = scale.largest_factor(high) // 2
        if capacity < max_step_ticks:
            farthest_m = 2 * max_step_ticks * self.half_tick_m
            bits = math.floor(math.log2(max(high - 2, 1) / farthest_m))
            right = f"at most {bits}" if bits >= 0 else "a wider step.word_bits"
            raise FirmwareError(
                f"firmware.step.frac_bits = {step.frac_bits}: the longest step of a tick, "
                f"{float(farthest_m):.4g} m, does not fit {step.word_bits} bits: expected {right}"
            )
        return scale, min(half_range, capacity)

    # Scales -------------------------------------------------------------------------------

    def _tick_turn(self, count_limit: int) -> _Scale:
        turn = self.description.turn_step
        return self._scale(
            "firmware.turn_step.constant_frac_bits",
            self.tick_turn,
            "turn",
            turn.constant_frac_bits,
            kept=("firmware.turn_step.frac_bits", turn.frac_bits),
            factor=2 * count_limit,
        )

    def _sensitivity(self, rate_bound_q: int) -> _Scale:
        gyro, turn = self.description.gyro, self.description.turn_step
        return self._scale(
            "firmware.gyro.sensitivity_frac_bits",
            self.sensitivity_turn,
            "turn",
            gyro.sensitivity_frac_bits,
            kept=("firmware.turn_step.frac_bits", turn.frac_bits - gyro.offset_frac_bits),
            factor=rate_bound_q,
        )

    def _rate_bound_q(self) -> int:
        """Return a bound of |code − offset|: both lie within the gyro's codes."""
        return (self.constants.gyro_max_code + 1) << self.description.gyro.offset_frac_bits

    def _scale(
        self,
        name: str,
        value: Fraction,
        unit: str,
        asked: int | None,
        *,
        kept: tuple[str, int],
        factor: int,
    ) -> _Scale:
        """Return *value* as an integer whose product with *factor* stays below 2^61.

        The product is narrowed to the kept fraction bits by at most 60 bits, so that the carried
        remainder (at most 2^60) and the product together stay below 2^62.
        """
        kept_name, kept_bits = kept
        least = max(kept_bits, 0)
        most = min(_MAX_CONSTANT_FRAC_BITS, kept_bits + 60)
        while most >= least and _round(value, most) * factor >= INTERMEDIATE_LIMIT // 2:
            most -= 1
        if least > most:
            excess = 1
            while _round(value, least - excess) * factor >= INTERMEDIATE_LIMIT // 2:
                excess += 1
            fraction_bits = self.description.turn_step.frac_bits
            if kept_name == "firmware.step.frac_bits":
                fraction_bits = self.description.step.frac_bits
            raise FirmwareError(
                f"{kept_name} = {fraction_bits}: a step of {float(value * factor):.4g} {unit} "
                f"leaves 64 bits: expected at most {fraction_bits - excess}"
            )
        bits = most if asked is None else asked
        if not least <= bits <= most:
            raise FirmwareError(
                f"{name} = {bits}: expected {least} to {most}: no fewer than {kept_name} keeps, "
                "no more than a product of 64 bits bears"
            )
        value_q = _round(value, bits)
        if value_q == 0:
            raise FirmwareError(
                f"{name} = {bits}: the constant {float(value):.4g} {unit} rounds to zero: "
                f"expected at least {math.ceil(-math.log2(value))}"
            )
        return _Scale(value_q, bits - kept_bits)

    # Turn, heading, blend -----------------------------------------------------------------

    def _require_turns_fit(self, largest: int, turn_high: int) -> None:
        turn, heading = self.description.turn_step, self.description.heading
        if turn.frac_bits < heading.frac_bits:
            raise FirmwareError(
                f"firmware.turn_step.frac_bits = {turn.frac_bits}: expected at least "
                f"{heading.frac_bits}, those of firmware.heading.frac_bits"
            )
        if largest > turn_high and not self.allow_overflow:
            raise FirmwareError(
                f"firmware.turn_step.word_bits = {turn.word_bits}: the largest turn, "
                f"{largest / (1 << turn.frac_bits):.4g} turn, does not fit: expected at least "
                f"{largest.bit_length() + 1}, or fewer frac_bits"
            )

    def _gap_limit_ticks(self, gyro_turn: int, turn: int) -> int:
        """Return the longest gap whose gyro turn leaves pose.move's angle below 2^62.

        The angle is 2 · (heading − gap) + 2 · (gap + turn); the gap's turn is gyro_turn a tick.
        """
        bits = self.description.turn_step.frac_bits
        room = (INTERMEDIATE_LIMIT >> 1) - (1 << bits) - turn - 1
        limit = room // (2 * gyro_turn) - 1
        if limit < 1:
            excess = (2 * ((1 << bits) + 4 * gyro_turn + turn)).bit_length() - 62
            raise FirmwareError(
                f"firmware.turn_step.frac_bits = {bits}: the largest turn, "
                f"{max(gyro_turn, turn) / (1 << bits):.4g} turn, leaves 64 bits: "
                f"expected at most {bits - excess}"
            )
        return limit

    def _blend_frac_bits(self, one_tick_turn: int) -> int:
        """Return how many fraction bits the weight may have: difference · weight below 2^62."""
        bits = min(_MAX_BLEND_FRAC_BITS, 62 - (2 * one_tick_turn).bit_length())
        missing = _MIN_BLEND_FRAC_BITS - bits
        if self.description.mode == "blend" and missing > 0:
            fraction_bits = self.description.turn_step.frac_bits
            raise FirmwareError(
                f"firmware.turn_step.frac_bits = {fraction_bits}: the blend of two turns leaves "
                f"64 bits: expected at most {fraction_bits - missing}"
            )
        return max(bits, 0)

    # Position -----------------------------------------------------------------------------

    def _position_shift(self, step_bound: int, position_high: int) -> int:
        one = self.description
        shift = one.step.frac_bits + one.trig.frac_bits - one.position.frac_bits
        if shift < 0:
            raise FirmwareError(
                f"firmware.position.frac_bits = {one.position.frac_bits}: expected at most "
                f"{one.step.frac_bits + one.trig.frac_bits}, what step.frac_bits and "
                "trig.frac_bits give together"
            )
        if shift > 61:
            raise FirmwareError(
                f"firmware.position.frac_bits = {one.position.frac_bits}: expected at least "
                f"{one.position.frac_bits + shift - 61}, given step.frac_bits and trig.frac_bits"
            )
        # step · cosine ≤ 2^31 · 2^30; the carried remainder is at most 2^shift ≤ 2^61.
        reach = (step_bound << one.trig.frac_bits >> shift) + 1
        if reach > position_high and not self.allow_overflow:
            raise FirmwareError(
                f"firmware.position.word_bits = {one.position.word_bits}: the longest step, "
                f"{step_bound / (1 << one.step.frac_bits):.4g} m, does not fit: expected at least "
                f"{reach.bit_length() + 1}, or fewer frac_bits"
            )
        return shift

    def _table(self) -> tuple[tuple[int, ...], int]:
        trig = self.description.trig
        if trig.method == "cordic":
            return cordic_table(trig.iterations, trig.frac_bits), 0
        return quarter_sine_table(trig.entries, trig.frac_bits), trig.entries.bit_length() - 1

    # Velocity -----------------------------------------------------------------------------

    def _require_v_fits(self, step_bound: int, rate_q: int, shift: int) -> None:
        one = self.description
        if shift < 0:
            raise FirmwareError(
                f"firmware.velocity.frac_bits = {one.velocity.frac_bits}: expected at most "
                f"{one.step.frac_bits + _TICK_RATE_FRAC_BITS}, given step.frac_bits"
            )
        if step_bound * rate_q >= INTERMEDIATE_LIMIT:
            raise FirmwareError(
                f"tick_period_s = {self.constants.tick_period_s:g}: step times tick rate leaves "
                "64 bits: expected a longer tick"
            )

    def _require_w_fits(self, shift: int, one_tick_turn: int) -> None:
        """Prove that the turn's filter, 2^n times its largest input, stays below 2^62."""
        one = self.description
        most = 61 - (one_tick_turn + 2).bit_length()
        if one.velocity.filter_log2 > most:
            raise FirmwareError(
                f"firmware.velocity.filter_log2 = {one.velocity.filter_log2}: the filter of the "
                f"largest turn leaves 64 bits: expected at most {most}, or fewer "
                "turn_step.frac_bits"
            )
        if shift < 0:
            raise FirmwareError(
                f"firmware.velocity.frac_bits = {one.velocity.frac_bits}: expected at most "
                f"{one.velocity.frac_bits + shift}, given turn_step.frac_bits"
            )

    # Stuck gyro, standstill ---------------------------------------------------------------

    def _stuck_span_ticks(self) -> int:
        """Return the span of block sums that a live gyro could not have missed.

        Block sums are below 2^45, so a span held to 2^62 is never reached, as the exact one.
        """
        stuck = self.description.stuck
        two_lsb = 2 * self.sensitivity_turn * (1 << stuck.block_log2) / self.tick_turn
        return min(stuck.span_ticks + math.ceil(two_lsb), INTERMEDIATE_LIMIT)

    def _rate_q(self, rate_rad_s: float) -> int:
        """Return a rate in codes with the offset's fraction bits, rounded up."""
        sensitivity = Fraction(self.constants.gyro_sensitivity_rad_s_per_lsb)
        scale = 1 << self.description.gyro.offset_frac_bits
        return min(math.ceil(Fraction(rate_rad_s) / sensitivity * scale), INTERMEDIATE_LIMIT)

    def _offset_max_log2(self) -> int:
        rest = self.description.standstill
        if rest.max_log2 < rest.block_log2:
            raise FirmwareError(
                f"firmware.standstill.max_log2 = {rest.max_log2}: expected at least "
                f"{rest.block_log2}, that of firmware.standstill.block_log2"
            )
        return rest.max_log2


def _round(value: Fraction, frac_bits: int) -> int:
    """Return value · 2^frac_bits to the nearest integer, ties to even."""
    return round(value * (1 << frac_bits))
