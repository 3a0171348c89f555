"""Drives that go where a word is longest: on at top speed, turning on the spot, after a gap.

Each is made so that the word asked about is the only one that it can overflow: straight on with
the gyro invalid nothing turns in any mode, turning on the spot nothing moves, and without encoder
frames the gyro alone turns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import FRESH, INVALID, STALE, KernelConfig
from firmware_model.config import MODE_WHEEL
from firmware_model.integers import shift_round
from precision_study.ranges.bounds import Intermediate
from precision_study.ranges.envelope import Envelope, learning_ticks
from precision_study.ranges.reach import largest, longest_step, rhythms

CHUNK_TICKS: Final = 1 << 16
_PREFIXES: Final = 4096
_SETTLING: Final = 64
_TRIED_RHYTHMS: Final = 3


@dataclass(frozen=True)
class Stretch:
    """So many ticks of a drive: what the counters gain in them, and what arrives.

    Attributes:
        ticks: how many.
        left_step, right_step: gain of each counter in each `over_ticks` of them [encoder ticks]; on
            the way there the left one is rounded up and the right one down, so that an odd count
            of both goes to left and right in turn.
        frame_every: in each so manieth tick an encoder frame arrives, else none; 0: never.
        gyro_code: the gyro's code [LSB].
        gyro_validity: FRESH or INVALID.
    """

    ticks: int
    left_step: int
    right_step: int
    frame_every: int
    gyro_code: int
    gyro_validity: int
    over_ticks: int = 1


Drive = tuple[Stretch, ...]
"""From power-on, with counters at zero; before the first stretch comes one tick, the baseline."""


def drive_chunks(drive: Sequence[Stretch]) -> Iterator[NDArray[np.int64]]:
    """Yield the kernel's inputs int64[n, 5], at most CHUNK_TICKS at a time, however long it is."""
    yield np.array([[0, 0, FRESH, drive[0].gyro_code, drive[0].gyro_validity]], dtype=np.int64)
    left = right = 0
    for one in drive:
        for start in range(0, one.ticks, CHUNK_TICKS):
            steps = np.arange(start + 1, min(start + CHUNK_TICKS, one.ticks) + 1, dtype=np.int64)
            part = np.empty((steps.size, 5), dtype=np.int64)
            part[:, 0] = left - (-one.left_step * steps) // one.over_ticks
            part[:, 1] = right + (one.right_step * steps) // one.over_ticks
            part[:, 2] = STALE
            if one.frame_every > 0:
                part[steps % one.frame_every == 0, 2] = FRESH
            part[:, 3], part[:, 4] = one.gyro_code, one.gyro_validity
            yield part
        left -= (-one.left_step * one.ticks) // one.over_ticks
        right += (one.right_step * one.ticks) // one.over_ticks


def until(drive: Drive, ticks: int) -> Drive:
    """Return the first so many ticks of a drive, the baseline not counted."""
    kept: list[Stretch] = []
    for one in drive:
        kept.append(replace(one, ticks=min(one.ticks, ticks)))
        ticks -= one.ticks
        if ticks <= 0:
            break
    return tuple(kept)


def drives(config: KernelConfig, envelope: Envelope, value: Intermediate) -> Iterator[Drive]:
    """Yield drives that may overflow a word, the likeliest first."""
    if value.word == "position":
        yield from _far(config, envelope)
    elif value.word == "step":
        yield from _wheels(config, envelope, forward=True)
    elif value.word == "turn_step":
        if "wheels" in value.name:
            yield from _wheels(config, envelope, forward=False)
        else:
            yield from _gyro(config, envelope, _SETTLING)
    elif value.word == "velocity":
        settle = min(envelope.mission_ticks, _SETTLING << config.velocity_filter_log2)
        speed = envelope.step_ticks
        for sign in (1, -1):
            yield (_by_wheels(config, settle, sign * speed, sign * speed),)
            yield (_by_wheels(config, settle, -sign * speed, sign * speed),)
        if config.mode != MODE_WHEEL:
            yield from _gyro(config, envelope, settle)


def _zero_code(config: KernelConfig) -> int:
    zero = round(config.constants.gyro_zero_rate_code)
    return min(max(zero, config.gyro_min_code + 1), config.gyro_max_code - 1)


def _by_wheels(
    config: KernelConfig, ticks: int, left_step: int, right_step: int, every: int = 1
) -> Stretch:
    """Return a stretch in which the gyro is invalid: every mode takes the turn of the wheels."""
    return Stretch(ticks, left_step, right_step, every, _zero_code(config), INVALID)


def _far(config: KernelConfig, envelope: Envelope) -> Iterator[Drive]:
    """Yield straight drives of the whole mission, in the rhythms that carry farthest.

    An odd count turns by one and back: with a gyro that sees no turn, less of that is believed.
    """
    ticks, zero = envelope.mission_ticks, _zero_code(config)
    for rhythm in rhythms(config, envelope)[:_TRIED_RHYTHMS]:
        for count in longest_step(config, envelope, rhythm.every).counts:
            each = Fraction(count, 2 * rhythm.every)
            gain, over = each.numerator, each.denominator
            drive = Stretch(ticks, gain, gain, rhythm.every, zero, INVALID, over)
            yield (drive,)
            if count % 2 == 1 and config.mode != MODE_WHEEL:
                yield (replace(drive, gyro_validity=FRESH),)


def _wheels(config: KernelConfig, envelope: Envelope, *, forward: bool) -> Iterator[Drive]:
    """Yield drives at top speed, straight on or on the spot, then with frames as seldom as needed.

    A prefix at the slowest speed leaves the remainder that the last bit wants.
    """
    fastest = envelope.step_ticks
    left = 1 if forward else -1
    if forward:
        constant, shift, high = config.half_tick_m_q, config.step_shift, config.step_high_q
        rounding, carry = config.step_rounding, config.step_carry
    else:
        constant, shift, high = config.tick_turn_q, config.wheel_turn_shift, config.turn_high_q
        rounding, carry = config.turn_rounding, config.turn_carry

    def overflows(every: int) -> bool:
        return largest(2 * fastest * every * constant, shift, rounding, carry) > high

    every = _least(overflows, envelope.gap_ticks)
    for gap in dict.fromkeys((every, min(every + 1, envelope.gap_ticks))):
        for sign in (1, -1):
            product = sign * 2 * fastest * gap * constant
            slow = sign * 2 * constant
            for step in (slow, -slow):
                before = _prefix(product, step, shift, rounding, high) if carry else 0
                prefix = 1 if step * sign > 0 else -1
                drive = [_by_wheels(config, before, prefix * sign * left, prefix * sign)]
                drive.append(_by_wheels(config, gap, sign * left * fastest, sign * fastest, gap))
                yield tuple(one for one in drive if one.ticks > 0)


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


def _prefix(product: int, step: int, shift: int, rounding: int, high: int) -> int:
    """Return how many values *step* come before one of *product*, so that it leaves its word."""
    remainder = 0
    for count in range(_PREFIXES):
        rounded = shift_round(product + remainder, shift, rounding)
        if not -high - 1 <= rounded <= high:
            return count
        total = step + remainder
        remainder = total - (shift_round(total, shift, rounding) << shift)
    return 0


def _gyro(config: KernelConfig, envelope: Envelope, ticks: int) -> Iterator[Drive]:
    """Yield drives in which the gyro alone turns: an offset learnt at one end, a code at the other.

    Without encoder frames neither steps nor turns by the wheels are taken.
    """
    shift = config.offset_frac_bits
    zero_q = config.zero_rate_code_q
    for offset_q, code, inner in (
        (envelope.offset_low_q, envelope.code_high, -1),
        (envelope.offset_high_q, envelope.code_low, 1),
    ):
        before: Drive = ()
        if offset_q != zero_q:
            rest = learning_ticks(config)
            before = (Stretch(rest, 0, 0, 1, offset_q >> shift, FRESH),)
        product = ((code << shift) - offset_q) * config.sensitivity_turn_q
        for near in range(1, 5):
            other = min(max(code + inner * near, envelope.code_low), envelope.code_high)
            step = ((other << shift) - offset_q) * config.sensitivity_turn_q
            count = 0
            if config.turn_carry:
                count = _prefix(
                    product, step, config.gyro_turn_shift, config.turn_rounding, config.turn_high_q
                )
            prefix = Stretch(count, 0, 0, 0, other, FRESH)
            last = Stretch(ticks, 0, 0, 0, code, FRESH)
            yield tuple(one for one in (*before, prefix, last) if one.ticks > 0)
