"""Proofs about the integers that a configuration has: each function states one product or sum.

What cannot be shown to stay inside 64 bits, or inside a word, is refused with the field, its value
and what would be right; by force it runs, what leaves 64 bits on the kernel in Python alone.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_model.build_scales import Asked, Scale
from firmware_model.errors import FirmwareError
from firmware_model.integers import INTERMEDIATE_LIMIT

TICK_RATE_FRAC_BITS: Final = 16
_MAX_BLEND_FRAC_BITS: Final = 30
_MIN_BLEND_FRAC_BITS: Final = 8

_C_BITS: Final = (
    ("position", "word_bits", 64),
    ("step", "word_bits", 32),
    ("turn_step", "word_bits", 64),
    ("trig", "frac_bits", 30),
)


def require_widths_of_c(asked: Asked) -> None:
    """Hold each width against that of its integer in C."""
    for table, field, most in _C_BITS:
        bits = getattr(getattr(asked.description, table), field)
        if bits > most:
            asked.refuse_in_c(
                f"firmware.{table}.{field} = {bits}: expected at most {most}, as many as there are "
                "in C"
            )


def largest_turn(tick_turn: Scale, counts: int, sensitivity: Scale, rate_q: int) -> int:
    """Return a bound of the turn of a frame by wheels of so many counts each, or by the gyro."""
    return max(tick_turn.bound(2 * counts), sensitivity.bound(rate_q))


def require_turns_fit(asked: Asked, largest: int, turn_high: int) -> None:
    """Prove that the largest turn fits its word, and that the heading is no finer than it."""
    turn, heading = asked.description.turn_step, asked.description.heading
    if turn.frac_bits < heading.frac_bits:
        raise FirmwareError(
            f"firmware.turn_step.frac_bits = {turn.frac_bits}: expected at least "
            f"{heading.frac_bits}, those of firmware.heading.frac_bits"
        )
    if largest > turn_high and not asked.allow_overflow:
        raise FirmwareError(
            f"firmware.turn_step.word_bits = {turn.word_bits}: the largest turn, "
            f"{largest / (1 << turn.frac_bits):.4g} turn, does not fit: expected at least "
            f"{largest.bit_length() + 1}, or fewer frac_bits"
        )


def gap_limit_ticks(asked: Asked, gyro_turn: int, turn: int) -> int:
    """Return the longest gap whose gyro turn leaves pose.move's angle below 2^62.

    The angle is 2 · (heading − gap) + 2 · (gap + turn); the gap's turn is gyro_turn a tick. What
    leaves 64 bits in any gap is the kernel's in Python, which bears all that counters tell.
    """
    bits = asked.description.turn_step.frac_bits
    room = (INTERMEDIATE_LIMIT >> 1) - (1 << bits) - turn - 1
    limit = room // (2 * gyro_turn) - 1
    if limit < 1:
        excess = (2 * ((1 << bits) + 4 * gyro_turn + turn)).bit_length() - 62
        asked.refuse_in_c(
            f"firmware.turn_step.frac_bits = {bits}: the largest turn, "
            f"{max(gyro_turn, turn) / (1 << bits):.4g} turn, leaves 64 bits: "
            f"expected at most {bits - excess}"
        )
        return INTERMEDIATE_LIMIT
    return limit


def blend_frac_bits(asked: Asked, one_tick_turn: int) -> int:
    """Return how many fraction bits the weight may have: difference · weight below 2^62."""
    bits = min(_MAX_BLEND_FRAC_BITS, 62 - (2 * one_tick_turn).bit_length())
    missing = _MIN_BLEND_FRAC_BITS - bits
    if asked.description.mode == "blend" and missing > 0:
        fraction_bits = asked.description.turn_step.frac_bits
        asked.refuse_in_c(
            f"firmware.turn_step.frac_bits = {fraction_bits}: the blend of two turns leaves "
            f"64 bits: expected at most {fraction_bits - missing}"
        )
        return _MAX_BLEND_FRAC_BITS
    return max(bits, 0)


def position_shift(asked: Asked) -> int:
    """Return how many bits a step times a cosine is narrowed by."""
    one = asked.description
    shift = one.step.frac_bits + one.trig.frac_bits - one.position.frac_bits
    if shift < 0:
        raise FirmwareError(
            f"firmware.position.frac_bits = {one.position.frac_bits}: expected at most "
            f"{one.step.frac_bits + one.trig.frac_bits}, what step.frac_bits and "
            "trig.frac_bits give together"
        )
    if shift > 61:
        asked.refuse_in_c(
            f"firmware.position.frac_bits = {one.position.frac_bits}: expected at least "
            f"{one.position.frac_bits + shift - 61}, given step.frac_bits and trig.frac_bits"
        )
    return shift


def position_count_limit(
    asked: Asked, half_tick: Scale, max_step_ticks: int, shift: int, position_high: int
) -> int:
    """Return the largest increment of both wheels whose step the position's word holds.

    A longer gap is not bridged, but where by force not even the step of a tick fits. How far many
    steps go is for `firmware_model.reach` to say.
    """
    if half_tick.value_q == 0:  # no step is too long
        return INTERMEDIATE_LIMIT
    # step · cosine ≤ 2^31 · 2^30; the carried remainder is at most 2^shift ≤ 2^61.
    frac_bits = asked.description.trig.frac_bits
    limit = half_tick.largest_factor((position_high << shift) - 1 >> frac_bits) // 2
    if limit < max_step_ticks:
        if asked.allow_overflow:
            return INTERMEDIATE_LIMIT
        one = asked.description
        step = half_tick.bound(2 * max_step_ticks)
        least = ((step << frac_bits >> shift) + 1).bit_length() + 1
        raise FirmwareError(
            f"firmware.position.word_bits = {one.position.word_bits}: the longest step of a tick, "
            f"{float(2 * max_step_ticks * asked.exact.half_tick_m):.4g} m, does not fit: expected "
            f"at least {least}, or fewer frac_bits"
        )
    return limit


def require_v_fits(asked: Asked, step_bound: int, rate_q: int, shift: int) -> None:
    """Prove that a step times the tick rate stays below 2^62."""
    one = asked.description
    if shift < 0:
        raise FirmwareError(
            f"firmware.velocity.frac_bits = {one.velocity.frac_bits}: expected at most "
            f"{one.step.frac_bits + TICK_RATE_FRAC_BITS}, given step.frac_bits"
        )
    if step_bound * rate_q >= INTERMEDIATE_LIMIT:
        asked.refuse_in_c(
            f"tick_period_s = {asked.constants.tick_period_s:g}: step times tick rate leaves "
            "64 bits: expected a longer tick"
        )


def require_w_fits(asked: Asked, shift: int, one_tick_turn: int) -> None:
    """Prove that the turn's filter, 2^n times its largest input, stays below 2^62."""
    one = asked.description
    most = 61 - (one_tick_turn + 2).bit_length()
    if one.velocity.filter_log2 > most:
        asked.refuse_in_c(
            f"firmware.velocity.filter_log2 = {one.velocity.filter_log2}: the filter of the "
            f"largest turn leaves 64 bits: expected at most {most}, or fewer "
            "turn_step.frac_bits"
        )
    if shift < 0:
        raise FirmwareError(
            f"firmware.velocity.frac_bits = {one.velocity.frac_bits}: expected at most "
            f"{one.velocity.frac_bits + shift}, given turn_step.frac_bits"
        )


def require_velocity_fits(asked: Asked, speed: int, turn_rate: int, velocity_high: int) -> None:
    """Refuse a speed or a turn rate that the output's word does not hold.

    Args:
        asked: with the fraction bits.
        speed, turn_rate: of wheels as fast as is believed [2^-velocity_frac_bits m/s and rad/s]. A
            gyro may tell more than its robot can do; that saturates, as `chiplog ranges` says.
        velocity_high: of the word.
    """
    frac_bits = asked.description.velocity.frac_bits
    for name, fastest, unit in (("speed", speed, "m/s"), ("turn", turn_rate, "rad/s")):
        if fastest > velocity_high and not asked.allow_overflow:
            excess = fastest.bit_length() - velocity_high.bit_length()
            raise FirmwareError(
                f"firmware.velocity.frac_bits = {frac_bits}: the fastest {name}, "
                f"{fastest / (1 << frac_bits):.4g} {unit}, does not fit "
                f"{velocity_high.bit_length() + 1} bits: expected at most {frac_bits - excess}"
            )


def stuck_span_ticks(asked: Asked) -> int:
    """Return the span of block sums that a live gyro could not have missed.

    Block sums are below 2^45, so a span held to 2^62 is never reached, as the exact one.
    """
    stuck = asked.description.stuck
    two_lsb = asked.exact.two_lsb_ticks * (1 << stuck.block_log2)
    return min(stuck.span_ticks + math.ceil(two_lsb), INTERMEDIATE_LIMIT)


def rate_q(asked: Asked, rate_rad_s: float) -> int:
    """Return a rate in codes with the offset's fraction bits, rounded up."""
    over, under = rate_rad_s.as_integer_ratio()
    sensitivity = asked.exact.sensitivity_rad_s
    over *= sensitivity.denominator << asked.description.gyro.offset_frac_bits
    codes = -(-over // (under * sensitivity.numerator))
    return min(codes, INTERMEDIATE_LIMIT)


def offset_max_log2(asked: Asked) -> int:
    """Return how many samples the longest average has, as a power of two."""
    rest = asked.description.standstill
    if rest.max_log2 < rest.block_log2:
        raise FirmwareError(
            f"firmware.standstill.max_log2 = {rest.max_log2}: expected at least "
            f"{rest.block_log2}, that of firmware.standstill.block_log2"
        )
    return rest.max_log2
