"""Drives that go where a word is longest: on at top speed, turning on the spot, after a gap.

A robot can make them: from rest it gains speed no faster than the envelope says. Each is made so
that the word asked about is the only one that it can overflow: straight on with the gyro invalid
nothing turns in any mode, turning on the spot nothing moves, and without encoder frames the gyro
alone turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Final

from firmware_model import FRESH, KernelConfig
from firmware_model.config import MODE_WHEEL
from firmware_model.integers import FLOOR, TOWARD_ZERO, shift_round
from precision_study.ranges.dithers import dithers, losses
from precision_study.ranges.envelope import Envelope, learning_ticks
from precision_study.ranges.intermediate import Intermediate
from precision_study.ranges.reach import extremes, position_reach
from precision_study.ranges.starts import by_wheels, rates_q, turning_up, zero_code
from precision_study.ranges.stretches import Drive, Stretch, gain
from precision_study.ranges.swings import swings

_PREFIXES: Final = 4096
_SETTLING: Final = 64
_LEADS: Final = 8


def drives(config: KernelConfig, envelope: Envelope, value: Intermediate) -> Iterator[Drive]:
    """Yield drives that may overflow a word, the likeliest first."""
    if value.word == "position":
        yield from _far(config, envelope)
        yield from _trembling(config, envelope)
        yield from losses(config, envelope)
        yield from dithers(config, envelope)
        yield from swings(config, envelope)
    elif value.word == "counter":
        yield _mistaken(config, envelope)
    elif value.word == "step":
        yield from _wheels(config, envelope, forward=True)
    elif value.word == "turn_step":
        if "wheels" in value.name:
            yield from _wheels(config, envelope, forward=False)
        else:
            yield from _gyro(config, envelope, _SETTLING)
    elif value.word == "velocity":
        settle = min(envelope.mission_ticks, _SETTLING << config.velocity_filter_log2)
        for forward in (True, False):
            for sign in (1, -1):
                yield _up_to_speed(config, envelope, settle, sign, 1, forward=forward)
        if config.mode != MODE_WHEEL:
            yield from _gyro(config, envelope, settle)


def straight(config: KernelConfig, envelope: Envelope, most_ticks: int) -> Iterator[Drive]:
    """Yield a drive straight on until x is full, half as long again, if that is not too long."""
    a_tick = 2 * envelope.rate * Fraction(config.half_tick_m_q, 1 << config.step_shift)
    a_tick *= Fraction(1 << config.trig_frac_bits, 1 << config.position_shift)
    if 0 < 3 * (config.position_high_q + 1) <= 2 * most_ticks * a_tick:
        ticks = math.ceil(3 * (config.position_high_q + 1) / (2 * a_tick))
        yield _up_to_speed(config, envelope, ticks, 1, 1)


def _up_to_speed(
    config: KernelConfig,
    envelope: Envelope,
    ticks: int,
    sign: int,
    every: int,
    *,
    forward: bool = True,
    rate: Fraction | None = None,
) -> Drive:
    """Return a drive from rest that keeps the fastest rate, or another, for so many ticks."""
    if rate is None:
        rate = envelope.rate if forward else min(envelope.rate, envelope.turn_rate / 2)
    right, over = sign * rate.numerator, rate.denominator
    left = right if forward else -right
    ramp = envelope.ramp_to(rate)
    on = by_wheels(config, ticks, left, right, every, over)
    return (replace(on, ticks=ramp, ramp_ticks=ramp, rest_code=on.gyro_code), on) if ramp else (on,)


def _far(config: KernelConfig, envelope: Envelope) -> Iterator[Drive]:
    """Yield straight drives of the whole mission, of the frames that carry farthest.

    An odd count turns by one and back: with a gyro that sees no turn, less of that is believed.
    """
    kinds = [(1, envelope.rate)]
    for one in position_reach(config, envelope).frames:
        rate = min(Fraction(one.counts, 2 * one.every), envelope.rate)
        kinds += [(one.every, rate), (one.every, envelope.rate)]
        slower = Fraction(math.floor(envelope.rate * one.every), one.every)
        if slower > 0:
            kinds.append((one.every, slower))
    for every, rate in dict.fromkeys(kinds):
        for sign in (1, -1):
            ramp = envelope.ramp_to(rate)
            ticks = envelope.mission_ticks - ramp
            drive = _up_to_speed(config, envelope, ticks, sign, every, rate=rate)
            drive = _within_way(envelope, drive)
            yield drive
            if config.mode != MODE_WHEEL:
                yield tuple(replace(one, gyro_validity=FRESH) for one in drive)


def _trembling(config: KernelConfig, envelope: Envelope) -> Iterator[Drive]:
    """Yield drives that go the way in the whole mission, while wheels on an edge count to and fro.

    Without carry each of those counts may be rounded the same way.
    """
    if config.step_carry and config.position_carry:
        return
    ticks = envelope.mission_ticks
    for lead in range(1, min(envelope.trembling_ticks, _LEADS) + 1):
        spare = envelope.wheel_ticks(1) - (lead + 1) // 2
        if spare < 0:
            return
        rate = min(envelope.rate, Fraction(envelope.way_ticks, 2 * ticks), Fraction(spare))
        for on in dict.fromkeys((Fraction(0), rate)):
            for sign in (1, -1):
                *ramp, last = _up_to_speed(
                    config, envelope, ticks - envelope.ramp_to(on), sign, 1, rate=on
                )
                yield (*ramp, replace(last, lead_counts=lead))


def _within_way(envelope: Envelope, drive: Drive) -> Drive:
    """Return a drive that ends where the mission's way does."""
    *ramp, on = drive
    left = envelope.way_ticks - _way(*ramp)
    if left < 0:
        (one,) = ramp  # of which so many ticks go as far as the mission
        ticks = math.isqrt(one.ticks**2 * envelope.way_ticks // _way(one))
        while _way(one := replace(one, ticks=ticks)) > envelope.way_ticks:
            ticks -= 1
        return (one,)
    ticks = max(min(on.ticks, left * on.over_ticks // (2 * abs(on.right_step))), 0)
    on = replace(on, ticks=ticks)
    rest = (left - _way(on)) // 2
    if ramp or ticks == 0 or rest <= 0 or ticks + on.frame_every > envelope.mission_ticks:
        return (*ramp, on)
    rest *= 1 if on.right_step > 0 else -1
    every = on.frame_every
    return (on, replace(on, ticks=every, left_step=rest, right_step=rest, over_ticks=every))


def _way(*stretches: Stretch) -> int:
    """Return the way of a drive straight on [encoder ticks of both wheels]."""
    return sum(abs(step) for one in stretches for step in gain(one))


def _wheels(config: KernelConfig, envelope: Envelope, *, forward: bool) -> Iterator[Drive]:
    """Yield drives at top speed, straight on or on the spot, then with frames as seldom as needed.

    Before it the wheels creep, a count a tick: that leaves the remainder that the last bit wants.
    """
    if forward:
        constant, shift, high = config.half_tick_m_q, config.step_shift, config.step_high_q
        rounding, carry = config.step_rounding, config.step_carry
    else:
        constant, shift, high = config.tick_turn_q, config.wheel_turn_shift, config.turn_high_q
        rounding, carry = config.turn_rounding, config.turn_carry

    def counts(every: int) -> int:
        return 2 * envelope.wheel_ticks(every) if forward else envelope.turn_ticks(every)

    def overflows(every: int) -> bool:
        least, most = extremes(counts(every) * constant, shift, rounding, carry)
        return most > high or least < -high - 1

    every = _least(overflows, envelope.gap_ticks)
    for gap in dict.fromkeys((every, min(every + 1, envelope.gap_ticks))):
        right = -(-counts(gap) // 2)
        left = counts(gap) - right if forward else right - counts(gap)
        for sign in (1, -1):
            *ramp, _ = _up_to_speed(config, envelope, 1, sign, 1, forward=forward)
            ramped = sum(gain(one)[1] + (1 if forward else -1) * gain(one)[0] for one in ramp)
            for creep in (sign, -sign):
                before = 0
                if carry:
                    before = _prefix(
                        sign * counts(gap) * constant,
                        ramped * constant,
                        2 * creep * constant,
                        *(shift, rounding, high),
                    )
                slow = creep if forward else -creep
                drive = [
                    by_wheels(config, before, slow, creep),
                    *ramp,
                    by_wheels(config, gap, sign * left, sign * right, gap, gap),
                ]
                yield tuple(one for one in drive if one.ticks > 0)


def _mistaken(config: KernelConfig, envelope: Envelope) -> Drive:
    """Return a drive at top speed whose last frame, after the longest gap, has all of the noise."""
    gap = envelope.gap_ticks
    counts = math.ceil(envelope.rate * gap + envelope.noise_ticks)
    forward = envelope.turn_rate < 2 * envelope.rate
    *ramp, _ = _up_to_speed(config, envelope, 1, 1, 1, forward=forward)
    left = counts if forward else -counts
    return (*ramp, by_wheels(config, gap, left, counts, gap, gap))


def _least(holds: Callable[[int], bool], most: int) -> int:
    """Return the least of 1…most for which *holds*; *most* where none does."""
    low, high = 1, most
    while low < high:
        middle = (low + high) // 2
        if holds(middle):
            high = middle
        else:
            low = middle + 1
    return low


def _prefix(last: int, between: int, step: int, shift: int, rounding: int, high: int) -> int:
    """Return how many values *step* come before *between* and *last*, so that it leaves its word.

    What is carried tells only of their sum.
    """
    for count in range(_PREFIXES):
        remainder = _carried(count * step + between, shift, rounding)
        if not -high - 1 <= shift_round(last + remainder, shift, rounding) <= high:
            return count
    return 0


def _carried(total: int, shift: int, rounding: int) -> int:
    """Return the remainder after values of one sign that add up to *total*."""
    unit = 1 << shift
    if rounding == FLOOR:
        return total % unit
    if rounding == TOWARD_ZERO:
        return total % unit if total >= 0 else -(-total % unit)
    return (total + unit // 2) % unit - unit // 2


def _gyro(config: KernelConfig, envelope: Envelope, ticks: int) -> Iterator[Drive]:
    """Yield drives in which the gyro alone turns: an offset learnt at one end, a code at the other.

    Without encoder frames neither steps nor turns by the wheels are taken.
    """
    shift, zero_q = config.offset_frac_bits, config.zero_rate_code_q
    sensitivity = config.sensitivity_turn_q
    for offset_q, code, inner in (
        (envelope.offset_low_q, envelope.code_high, -1),
        (envelope.offset_high_q, envelope.code_low, 1),
    ):
        rest_code = offset_q >> shift if offset_q != zero_q else zero_code(config)
        before: Drive = ()
        if offset_q != zero_q:
            before = (Stretch(learning_ticks(config), 0, 0, 1, rest_code, FRESH),)
        ramp = turning_up(config, envelope, rest_code, code)
        ramped = sum(rates_q(config, one, offset_q) for one in ramp)
        for near in range(1, 5):
            other = min(max(code + inner * near, envelope.code_low), envelope.code_high)
            count = 0
            if config.turn_carry:
                count = _prefix(
                    ((code << shift) - offset_q) * sensitivity,
                    ramped * sensitivity,
                    ((other << shift) - offset_q) * sensitivity,
                    *(config.gyro_turn_shift, config.turn_rounding, config.turn_high_q),
                )
            prefix = Stretch(count, 0, 0, 0, other, FRESH)
            last = Stretch(ticks, 0, 0, 0, code, FRESH)
            yield tuple(one for one in (*before, *ramp, prefix, last) if one.ticks > 0)
