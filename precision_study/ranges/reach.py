"""How far a rounded product can go, alone and summed over a mission.

What rounding drops is worth less than a unit of the result, but a tick's distance may itself be
less than a unit: bounds here follow each rounding exactly, so that coarse formats have them too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Final

from firmware_model import KernelConfig
from firmware_model.config import TRIG_CORDIC
from firmware_model.integers import FLOOR, TOWARD_ZERO, WRAP, limit, shift_round
from firmware_model.tables import CORDIC_GUARD_BITS
from precision_study.ranges.envelope import Envelope

_ENUMERATED_GAPS: Final = 1 << 10
_ENUMERATED_WRAPPED_GAPS: Final = 64
_ENUMERATED_ROTATIONS: Final = 12
_ENUMERATED_COUNTS: Final = 2048


def largest(product: int, shift: int, rounding: int, carry: int) -> int:
    """Return the largest magnitude of ±*product* after rounding *shift* bits away.

    With carry the remainder of the last value is added first, whatever it may be.
    """
    above, below = _remainders(shift, rounding) if carry else (0, 0)
    high = shift_round(product + above, shift, rounding)
    return max(high, -shift_round(-product - below, shift, rounding))


def _remainders(shift: int, rounding: int) -> tuple[int, int]:
    """Return the largest remainder and the magnitude of the smallest."""
    unit = 1 << shift
    if rounding == FLOOR:
        return unit - 1, 0
    if rounding == TOWARD_ZERO:
        return unit - 1, unit - 1
    return unit >> 1, unit >> 1


def _gain(shift: int, rounding: int, carry: int) -> Fraction:
    """Return by how much rounding can lengthen a value on average [units of the result]."""
    if carry or shift == 0 or rounding == TOWARD_ZERO:
        return Fraction(0)
    return Fraction(1) if rounding == FLOOR else Fraction(1, 2)


def largest_direction(config: KernelConfig) -> int:
    """Return the largest magnitude of sine and cosine [2^-T]; CORDIC of few rotations is short."""
    one = 1 << config.trig_frac_bits
    if config.trig_method != TRIG_CORDIC or config.cordic_iterations > _ENUMERATED_ROTATIONS:
        return one
    start, *angles = config.table
    longest = 0
    quarter = 1 << 38  # in 2^-40 turn
    pending = [(0, start, 0, 0, quarter)]
    while pending:  # each piece of the quarter turn, whose angles take the same rotations
        i, x, y, low, high = pending.pop()
        if i == config.cordic_iterations:
            longest = max(longest, abs(x), abs(y))
            continue
        if high >= 0:
            piece = max(low, 0) - angles[i], high - angles[i]
            pending.append((i + 1, x - (y >> i), y + (x >> i), *piece))
        if low < 0:
            piece = low + angles[i], min(high, -1) + angles[i]
            pending.append((i + 1, x + (y >> i), y - (x >> i), *piece))
    return min(largest(longest, CORDIC_GUARD_BITS, config.trig_rounding, 0), one)


@dataclass(frozen=True)
class Rhythm:
    """Frames that arrive in every so many ticks, and how far such a drive can go on average.

    Attributes:
        every: of so many ticks one has an encoder frame.
        per_tick: at most [2^-P m].
    """

    every: int
    per_tick: Fraction


@lru_cache(maxsize=4)
def rhythms(config: KernelConfig, envelope: Envelope) -> tuple[Rhythm, ...]:
    """Return rhythms, the farthest first.

    Where rounding is not carried, frames that come seldom lose or gain less by it. Those beyond
    the enumerated ones are covered by the last, whose bound holds for all of them.
    """
    wraps = _wraps(config, step_bound(config, envelope, envelope.gap_ticks))
    enumerated = _ENUMERATED_WRAPPED_GAPS if wraps else _ENUMERATED_GAPS
    found = [
        Rhythm(every, _per_frame(config, envelope, every) / every)
        for every in range(1, min(envelope.gap_ticks, enumerated) + 1)
    ]
    if envelope.gap_ticks > enumerated:
        seldom = enumerated + 1
        step = _gain(config.step_shift, config.step_rounding, config.step_carry) / seldom
        step = min(step + _step_rate(config, envelope), Fraction(-config.step_low_q, seldom))
        moved = step * largest_direction(config) / (1 << config.position_shift)
        gain = _gain(config.position_shift, config.position_rounding, config.position_carry)
        found.append(Rhythm(envelope.gap_ticks, moved + gain / seldom))
    return tuple(sorted(found, key=lambda one: one.per_tick, reverse=True))


def position_reach(config: KernelConfig, envelope: Envelope) -> int:
    """Return a bound of x and y at the mission's end [2^-P m]."""
    total = envelope.mission_ticks * rhythms(config, envelope)[0].per_tick
    if config.step_carry:  # one unit of the step that a remainder may add
        total += Fraction(largest_direction(config), 1 << config.position_shift)
    return math.floor(total) + config.position_carry


def _step_rate(config: KernelConfig, envelope: Envelope) -> Fraction:
    """Return the distance of a tick at top speed, unrounded [2^-S m]."""
    return Fraction(2 * envelope.step_ticks * config.half_tick_m_q, 1 << config.step_shift)


def step_bound(config: KernelConfig, envelope: Envelope, every: int) -> int:
    """Return the longest step after a gap of so many ticks, before its word limits it [2^-S m]."""
    product = 2 * envelope.step_ticks * every * config.half_tick_m_q
    return largest(product, config.step_shift, config.step_rounding, config.step_carry)


@dataclass(frozen=True)
class LongestStep:
    """The longest step in its word.

    Attributes:
        bound: no step is longer [2^-S m].
        counts: of both wheels together in a frame, with their sign, that come nearest to it.
    """

    bound: int
    counts: tuple[int, ...]


def longest_step(config: KernelConfig, envelope: Envelope, every: int) -> LongestStep:
    """Return the longest step in its word of a frame that tells of so many ticks.

    A word that wraps may hold less at top speed than at a lower one.
    """
    fastest = 2 * envelope.step_ticks * every
    bound = step_bound(config, envelope, every)
    if not _wraps(config, bound):
        return LongestStep(min(bound, -config.step_low_q), (fastest, -fastest))
    shift, rounding = config.step_shift, config.step_rounding

    def length(count: int) -> int:
        step = shift_round(count * config.half_tick_m_q, shift, rounding)
        return abs(limit(step, config.step_low_q, config.step_high_q, WRAP))

    most = min(fastest, _ENUMERATED_COUNTS)
    counts = sorted((*range(-most, 0), *range(1, most + 1)), key=length, reverse=True)
    longest = length(counts[0]) + config.step_carry
    if fastest > _ENUMERATED_COUNTS:
        longest = -config.step_low_q
    even = [count for count in counts if count % 2 == 0]
    tried = (*counts[:2], *even[:2], fastest, -fastest)
    return LongestStep(min(longest, -config.step_low_q), tuple(dict.fromkeys(tried)))


def _wraps(config: KernelConfig, bound: int) -> bool:
    return bound > config.step_high_q and config.step_overflow == WRAP


def _per_frame(config: KernelConfig, envelope: Envelope, every: int) -> Fraction:
    """Return how far a frame moves x or y on average, when it tells of so many ticks [2^-P m]."""
    longest = longest_step(config, envelope, every).bound
    step = Fraction(longest)
    if config.step_carry:
        step = min(step, every * _step_rate(config, envelope))
    direction = largest_direction(config)
    moved = step * direction / (1 << config.position_shift)
    if config.position_carry:
        return moved
    rounding = config.position_rounding
    at_once = largest(longest * direction, config.position_shift, rounding, 0)
    return min(Fraction(at_once), moved + _gain(config.position_shift, rounding, 0))
