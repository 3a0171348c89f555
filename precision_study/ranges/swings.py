"""Drives that carry a coarse position on with hardly any way: a remainder taken and given back,
or a count that trembles.

A count ahead, while the robot faces forward, is a whole unit of the step where the remainder is
next to one; the same count back, while it faces backward, is a unit again. A spin has the time for
it at each half turn. A robot that turns to and fro about the sideways direction has it as often as
it turns back. `firmware_model.reach` has the bound that these come near to.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

from firmware_model import FRESH, KernelConfig
from firmware_model.build_scales import PI
from firmware_model.config import MODE_BLEND, MODE_WHEEL
from firmware_model.integers import shift_round
from firmware_model.reach import is_given_back
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.starts import by_wheels, zero_code
from precision_study.ranges.stretches import Drive, Stretch, gain

_CREEPS: Final = 1 << 16
_FRACTION: Final = 1 << 20
_SWINGS_RAD: Final = (Fraction(1, 2), Fraction(1), Fraction(2))


@dataclass(frozen=True)
class _Turning:
    """A robot that turns on the spot.

    Attributes:
        on: a tick of it, with the lead.
        turn: of the heading in a tick [turn].
        ramp: how it comes to that from rest.
        turned: the heading after that [turn].
        ramp_ticks: how long it takes from rest to that, and back to rest.
    """

    on: Stretch
    turn: Fraction
    ramp: Drive
    turned: Fraction
    ramp_ticks: int


def swings(config: KernelConfig, envelope: Envelope) -> Iterator[Drive]:
    """Yield drives that move x by remainders, or by the counts that tremble."""
    for lead in dict.fromkeys((1, envelope.trembling_ticks, _longest_lead(envelope))):
        for turning in (*_by_wheels(config, envelope, lead), *_by_gyro(config, envelope, lead)):
            if turning.turn > 0:
                for ramp, on in _turned(config, envelope, turning):
                    for straight in (False, True):
                        yield from _whole(config, envelope, ramp, on, straight=straight)


def _longest_lead(envelope: Envelope) -> int:
    """Return how many counts a wheel may well be ahead and back, where there is way for it."""
    if envelope.ramp_ticks:
        return max(math.floor(2 * envelope.rate / envelope.ramp_ticks), 1)
    return max(math.floor(envelope.rate / 4), 1)


def _by_wheels(config: KernelConfig, envelope: Envelope, lead: int) -> Iterator[_Turning]:
    most = math.ceil(envelope.rate) - Fraction(lead, 2)
    rate = min(envelope.rate, envelope.turn_rate / 2, most)
    if rate <= 0:
        return
    right, over = rate.numerator, rate.denominator
    on = by_wheels(config, 0, -right, right, 1, over)
    ticks = envelope.ramp_to(rate)
    ramp = replace(on, ticks=ticks, ramp_ticks=ticks, rest_code=on.gyro_code)
    turned = gain(ramp)[1] * _wheel_turn(config, Fraction(1)) if ticks else Fraction(0)
    on = replace(on, lead_counts=lead)
    yield _Turning(on, _wheel_turn(config, rate), (ramp,) if ticks else (), turned, ticks)


def _by_gyro(config: KernelConfig, envelope: Envelope, lead: int) -> Iterator[_Turning]:
    """Yield a robot that is turned while its wheels rest, as the gyro tells.

    A gyro reads any code that is believed in any tick: a wheel's acceleration is none of its own.
    """
    if config.mode == MODE_WHEEL:
        return
    zero_q, rest_code = config.zero_rate_code_q, zero_code(config)
    rates_q = [
        (envelope.code_high << config.offset_frac_bits) - zero_q,
        zero_q - (envelope.code_low << config.offset_frac_bits),
    ]
    fastest = (envelope.code_high, envelope.code_low)[rates_q.index(max(rates_q))]
    most = abs(_turn_by_code(config, fastest))
    if most == 0:
        return
    word = Fraction(config.turn_high_q, 1 << (config.heading_frac_bits + config.heading_shift))
    limits = min(most, word), min(most, word, Fraction(1, 2))
    for code in dict.fromkeys(
        rest_code + math.trunc((fastest - rest_code) * (one / most)) for one in limits
    ):
        back = min(max(2 * rest_code - code, envelope.code_low), envelope.code_high)
        on = Stretch(0, 0, 0, 1, code, FRESH, lead_counts=lead, rest_code=back)
        yield _Turning(on, abs(_turn_by_code(config, code)), (), Fraction(0), 0)


def _turned(
    config: KernelConfig, envelope: Envelope, turning: _Turning
) -> Iterator[tuple[Drive, Stretch]]:
    """Yield a spin, and swings, each with what comes before; their ticks are yet to be found."""
    on, turn = turning.on, turning.turn
    # A step is taken along the heading before, in the middle of or after its tick.
    angle = Fraction(config.integration, 2) - 1
    if config.stale_heading_ticks:
        angle = -Fraction(config.stale_heading_ticks)
    plain = replace(on, lead_counts=0)
    to_front = math.ceil((-turning.turned % 1) / turn)
    spin = replace(
        on,
        lead_ticks=max(round(_FRACTION / (2 * turn)), 1),
        lead_over=_FRACTION,
        lead_start=round(_FRACTION * (angle + Fraction(1, 2))),
    )
    yield (*turning.ramp, replace(plain, ticks=to_front)), spin
    ramp_ticks = turning.ramp_ticks
    often = math.ceil(Fraction(envelope.mission_ticks * on.lead_counts, envelope.way_ticks))
    lengths = [max(round(swing_rad / (2 * PI) / turn), 1) for swing_rad in _SWINGS_RAD]
    for length in dict.fromkeys((*lengths, often, 1, 2)):
        cruise = max(length, ramp_ticks, 1)  # as far as so many ticks of it turn
        swing = replace(
            on, lead_ticks=cruise + ramp_ticks, lead_start=-1, is_swing=True, ramp_ticks=ramp_ticks
        )
        if on.left_step == on.right_step:
            for middle in _middles(config):
                yield _turned_to(config, envelope, plain, middle - cruise * turn / 2), swing
            continue
        to_start = round(Fraction(1, 4) / turn - Fraction(cruise, 2))
        if to_start < ramp_ticks:
            continue
        ticks = to_start + ramp_ticks
        start = replace(plain, ticks=ticks, lead_ticks=ticks, is_swing=True, ramp_ticks=ramp_ticks)
        yield (start,) if ticks else (), swing


def _middles(config: KernelConfig) -> Iterator[Fraction]:
    """Yield headings about which the cosine changes most: sideways, or next to it [turn]."""
    yield Fraction(1, 4)
    trig = config.description.trig
    if trig.method == "table" and not trig.interpolated:
        yield Fraction(1, 4) - Fraction(1, 8 * trig.entries)  # from one entry to the next


def _turned_to(config: KernelConfig, envelope: Envelope, on: Stretch, heading: Fraction) -> Drive:
    """Return a turn to a heading by codes of the gyro, a few ticks of the fastest and one of less.

    Args:
        config: from `build_config`.
        envelope: what may be asked.
        on: a tick of turning.
        heading: as if *on* turned forward [turn].
    """
    most = abs(_turn_by_code(config, on.gyro_code))
    ticks = math.floor(heading % 1 / most)
    rest_code = zero_code(config)
    less = rest_code + round((on.gyro_code - rest_code) * (heading % 1 - ticks * most) / most)
    less = min(max(less, envelope.code_low), envelope.code_high)
    parts = replace(on, ticks=ticks), replace(on, ticks=1, gyro_code=less)
    return tuple(one for one in parts if one.ticks > 0)


def _whole(
    config: KernelConfig, envelope: Envelope, ramp: Drive, on: Stretch, *, straight: bool
) -> Iterator[Drive]:
    """Yield drives of the whole mission, if asked straight on first as far as turning leaves."""
    ramp = tuple(one for one in ramp if one.ticks > 0)
    ticks = envelope.mission_ticks - sum(one.ticks for one in ramp)
    lead_ticks = Fraction(on.lead_ticks, on.lead_over)
    lead = on.lead_counts if on.lead_counts > envelope.trembling_ticks else 0  # else it is no way
    ahead: Drive = ()
    if straight:
        rate, ramp_ticks = envelope.rate, envelope.ramp_ticks
        a_tick = 2 * rate - lead / lead_ticks
        left_over = envelope.way_ticks - ticks * lead / lead_ticks
        if a_tick <= 0 or left_over <= 0:
            return
        length = math.ceil((left_over + 2 * rate * ramp_ticks) / a_tick)
        right = math.floor((left_over + length * lead / lead_ticks) / 2)
        if not 2 * ramp_ticks <= length < ticks:
            return
        ahead = (
            replace(
                by_wheels(config, length, right, right, 1, length - ramp_ticks),
                ramp_ticks=ramp_ticks,
                rest_code=zero_code(config),
                lead_ticks=length,
                is_swing=True,
            ),
        )
    counts = sum(sum(gain(one)) for one in ahead)
    creep = creep_counts(config, on.lead_counts, counts) if is_given_back(config) else 0
    if creep is None:
        return
    slowly = max(math.floor(envelope.rate / (envelope.ramp_ticks + 1)), 1)
    creep_ticks = -(-creep // slowly)
    start = by_wheels(config, creep_ticks, creep, creep, 1, max(creep_ticks, 1))
    before = (start, *ahead, *ramp)
    ticks -= creep_ticks + sum(one.ticks for one in ahead)
    left = envelope.way_ticks - counts - 2 * creep
    if left < 0:
        return
    for lead_start in (on.lead_start, on.lead_start + on.lead_ticks):  # ahead forward, or backward
        if straight and lead_start != on.lead_start:
            continue
        most = ticks
        if lead:  # changes after the first
            most = ((left // lead - 1) * on.lead_ticks - lead_start) // on.lead_over
        last = replace(on, ticks=min(ticks, most), lead_start=lead_start)
        if last.ticks > 0:
            yield tuple(one for one in (*before, last) if one.ticks > 0)


def _wheel_turn(config: KernelConfig, rate: Fraction) -> Fraction:
    """Return by how much wheels at that rate, one each way, turn the heading in a tick [turn]."""
    counts = math.floor(rate)

    def turn(of_a_wheel: int) -> Fraction:
        product = 2 * of_a_wheel * config.tick_turn_q
        return _heading_turn(config, product, config.wheel_turn_shift)

    return turn(counts) + (rate - counts) * (turn(counts + 1) - turn(counts))


def _turn_by_code(config: KernelConfig, code: int) -> Fraction:
    """Return by how much a code turns the heading, while the wheels rest [turn]."""
    return _gyro_turn(config, (code << config.offset_frac_bits) - config.zero_rate_code_q)


def _gyro_turn(config: KernelConfig, rate_q: int) -> Fraction:
    """Return by how much code − offset turns the heading, while the wheels rest [turn]."""
    turn = _heading_turn(config, rate_q * config.sensitivity_turn_q, config.gyro_turn_shift)
    if config.mode == MODE_BLEND:
        turn *= Fraction(config.blend_weight_q, 1 << config.blend_frac_bits)
    return turn


def _heading_turn(config: KernelConfig, product: int, shift: int) -> Fraction:
    """Return what is left of a turn after it and the heading are rounded [turn]."""
    turn = Fraction(product, 1 << shift)
    if not config.turn_carry:
        turn = Fraction(shift_round(product, shift, config.turn_rounding))
    if not config.heading_carry:
        steps = shift_round(math.floor(turn), config.heading_shift, config.heading_rounding)
        turn = Fraction(steps << config.heading_shift)
    return turn / (1 << (config.heading_frac_bits + config.heading_shift))


def creep_counts(config: KernelConfig, lead: int, counts: int) -> int | None:
    """Return how many counts of each wheel leave a remainder that a lead makes a unit.

    Other counts of the way are added to theirs. None where no such number is near.
    """
    shift, rounding, product = config.step_shift, config.step_rounding, config.half_tick_m_q
    longest = (lead * product >> shift) + 1
    for each in range(_CREEPS):
        total = (counts + 2 * each) * product
        remainder = total - (shift_round(total, shift, rounding) << shift)
        if shift_round(lead * product + remainder, shift, rounding) == longest:
            return each
    return None
