"""How far a rounded product can go, alone and summed over a mission.

What rounding drops is worth less than a unit of the result, but a tick's distance may itself be
less than a unit: bounds here follow each rounding exactly, so that coarse formats have them too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig, reach
from firmware_model.config import TRIG_CORDIC
from firmware_model.counting import require_told_apart
from firmware_model.integers import FLOOR, TOWARD_ZERO, WRAP, limit, shift_round
from firmware_model.tables import CORDIC_GUARD_BITS
from precision_study.ranges.envelope import Envelope

_ENUMERATED_ROTATIONS: Final = 12
_ENUMERATED_COUNTS: Final = 4096
_SEARCHES: Final = 60
_TIGHT: Final = 4
_NEAR: Final = 1e-9
"""Far more than a float is off, of the longest move."""


def extremes(product: int, shift: int, rounding: int, carry: int) -> tuple[int, int]:
    """Return the least and the largest that ±*product* can be after rounding *shift* bits away.

    With carry the remainder of the last value is added first, whatever it may be.
    """
    above, below = _remainders(shift, rounding) if carry else (0, 0)
    return (
        shift_round(-product - below, shift, rounding),
        shift_round(product + above, shift, rounding),
    )


def largest(product: int, shift: int, rounding: int, carry: int) -> int:
    """Return the largest magnitude of ±*product* after rounding *shift* bits away."""
    low, high = extremes(product, shift, rounding, carry)
    return max(high, -low)


def _remainders(shift: int, rounding: int) -> tuple[int, int]:
    """Return the largest remainder and the magnitude of the smallest."""
    unit = 1 << shift
    if rounding == FLOOR:
        return unit - 1, 0
    if rounding == TOWARD_ZERO:
        return unit - 1, unit - 1
    return unit >> 1, unit >> 1


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


def step_bound(config: KernelConfig, envelope: Envelope, every: int) -> int:
    """Return the longest step after a gap of so many ticks, before its word limits it [2^-S m]."""
    product = 2 * envelope.wheel_ticks(every) * config.half_tick_m_q
    return largest(product, config.step_shift, config.step_rounding, config.step_carry)


@dataclass(frozen=True)
class Frame:
    """A kind of encoder frame.

    Attributes:
        every: ticks since the frame before it, at least.
        counts: of both wheels together.
        moved: such a frame moves x or y no farther [2^-P m].
    """

    every: int
    counts: int
    moved: Fraction


@dataclass(frozen=True)
class Reach:
    """How far a mission can go.

    A frame moves x and y by no more than a price for each of its ticks and a price for each of its
    counts; a mission has so many of both. That is the dual of a linear program: it bounds every
    mixture of frames, seldom or often, slow or fast, and is met where one kind is best.

    Attributes:
        low, high: bounds of x and y at the mission's end [2^-P m].
        frames: the kinds whose price is exact: a drive of one may reach the bound.
    """

    low: int
    high: int
    frames: tuple[Frame, ...]


def require_mission_fits(config: KernelConfig, envelope: Envelope, mission: str) -> None:
    """Refuse a position that does not hold a mission, which is called so in the message.

    And a counter that may take one way of a wheel for the other: then no way is known.

    Raises:
        FirmwareError: field, value and what would be right.
    """
    require_told_apart(config, envelope.rate, envelope.noise_ticks, envelope.mission_ticks)
    if reach.position_reach(config, demand(config, envelope)) > config.position_high_q:
        found = position_reach(config, envelope)
        reach.require_position_holds(config, max(found.high, -found.low - 1), mission)


def largest_rate_q(config: KernelConfig, envelope: Envelope) -> int:
    """Return the largest magnitude of code − offset, 0 where all of it is taken for rest."""
    shift = config.offset_frac_bits
    rate_q = max(
        (envelope.code_high << shift) - envelope.offset_low_q,
        envelope.offset_high_q - (envelope.code_low << shift),
        0,
    )
    return 0 if rate_q < config.auto_zero_rate_q else rate_q


def demand(config: KernelConfig, envelope: Envelope) -> reach.Demand:
    """Return what a mission asks of the kernel at most.

    After a stretch without frames that is too long to be bridged the next one is a baseline, and
    another has to come before the next such loss. A frame that noise makes too long is refused; in
    so many ticks as make a new baseline, it fits. Where it does not, each of those may be one.
    """
    confirm = min(config.jump_confirm_samples, config.gap_limit_ticks)
    longest = math.ceil(envelope.rate * confirm + envelope.noise_ticks)
    is_kept = longest <= config.max_step_ticks * confirm
    between_ticks = config.gap_limit_ticks + 2
    if not is_kept:
        between_ticks = min(between_ticks, confirm)
    return reach.Demand(
        ticks=envelope.mission_ticks,
        counts=envelope.way_ticks,
        frame_counts=2 * envelope.wheel_ticks(envelope.gap_ticks),
        turn_counts=min(2 * envelope.rate, envelope.turn_rate),
        rate_q=largest_rate_q(config, envelope),
        jitter=envelope.jitter,
        baselines=-(-envelope.mission_ticks // between_ticks),
        tick_counts=2 * envelope.rate,
    )


@lru_cache(maxsize=4)
def position_reach(config: KernelConfig, envelope: Envelope) -> Reach:
    """Return the bounds of x and y at the mission's end."""
    ticks, per_count = envelope.mission_ticks, _per_count(config)
    mission = demand(config, envelope)
    counts = min(mission.counted, Fraction(2 * envelope.wheel_ticks(1) * ticks))
    kinds = _kinds(config, replace(envelope, mission_ticks=0, way_ticks=0))
    every_kind = (*kinds, *_seldom(config, envelope, len(kinds) + 1))
    moved = np.array([float(one.moved) for one in every_kind])
    asked = np.array([float(one.counts) for one in every_kind])
    every = np.array([float(one.every) for one in every_kind])

    def loads(share: float) -> NDArray[np.float64]:
        per_tick: NDArray[np.float64] = (moved - share * float(per_count) * asked) / every
        return per_tick

    def total(share: float) -> float:
        per_tick = max(float(loads(share).max()), 0.0)
        return per_tick * ticks + share * float(per_count) * float(counts)

    # A count may be worth more than its way, where rounding always lengthens it.
    dearest = 1.0  # of a constant that is zero no count goes any way
    if per_count > 0:
        dearest = max(dearest, float((moved / asked).max()) / float(per_count))
    low, high = 0.0, dearest
    for _ in range(_SEARCHES):  # the total is convex in the price
        first, second = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, second) if total(first) <= total(second) else (first, high)
    share = min((0.0, low, high, 1.0, dearest), key=total)
    # Any price gives a bound; from here on in exact numbers, but for what cannot be the largest.
    approximate = loads(share)
    near = np.argsort(-approximate, kind="stable")
    largest_load = approximate[near[0]]
    close = near[approximate[near] >= largest_load - _NEAR * moved.max()]
    per_count *= Fraction(share)
    exact = [every_kind[i].moved - per_count * every_kind[i].counts for i in close.tolist()]
    per_tick = max(
        Fraction(0),
        *(one / every_kind[i].every for i, one in zip(close.tolist(), exact, strict=True)),
    )
    best = tuple(kinds[place] for place in near[:_TIGHT].tolist() if place < len(kinds))
    bound = per_tick * ticks + per_count * counts
    summed = reach.moved(config, mission, largest_direction(config))
    return Reach(*_limits(config, min(bound, summed)), best)


def _every_step_fits(config: KernelConfig, envelope: Envelope) -> bool:
    return step_bound(config, envelope, envelope.gap_ticks) <= config.step_high_q


def _limits(config: KernelConfig, bound: Fraction) -> tuple[int, int]:
    """Return the least and the largest whole x, given a bound of what has been moved in all."""
    whole = math.floor(bound)
    if not config.position_carry:
        return -whole, whole
    if config.position_rounding == FLOOR:  # the remainder is what floor left behind
        return -math.ceil(bound), whole
    if config.position_rounding == TOWARD_ZERO:
        return -math.ceil(bound), math.ceil(bound)
    nearest = math.floor(bound + Fraction(1, 2))
    return -nearest, nearest


def _per_count(config: KernelConfig) -> Fraction:
    """Return how far a count of one wheel goes, before any rounding [2^-P m]."""
    product = config.half_tick_m_q * largest_direction(config)
    return Fraction(product, 1 << (config.step_shift + config.position_shift))


@lru_cache(maxsize=4)
def _kinds(config: KernelConfig, envelope: Envelope) -> tuple[Frame, ...]:
    """Return the frames of 1, 2, … counts, each after as few ticks as it takes: the same in every
    mission."""
    direction = largest_direction(config)
    most = min(2 * envelope.wheel_ticks(envelope.gap_ticks), _ENUMERATED_COUNTS)
    fits = _every_step_fits(config, envelope)
    return tuple(
        Frame(
            every=_least_ticks(envelope, counts),
            counts=counts,
            moved=_moved(config, _longest_step(config, counts, fits), direction),
        )
        for counts in range(1, most + 1)
    )


def _seldom(config: KernelConfig, envelope: Envelope, counts: int) -> list[Frame]:
    """Return what no frame of so many counts or more surpasses, at any price of a count.

    Up to `_per_count` the most of its time is the worst, beyond it the fewest.
    """
    if counts > 2 * envelope.wheel_ticks(envelope.gap_ticks):
        return []
    every = _least_ticks(envelope, counts)
    direction = largest_direction(config)
    widest = _moved(config, Fraction(-config.step_low_q), direction)
    if widest < counts * _per_count(config):  # the step's word holds less than that
        return [Frame(every, counts, widest)]
    step_gain = reach.rounding_gain(config.step_shift, config.step_rounding, config.step_carry)
    gain = (step_gain + reach.is_given_back(config)) * Fraction(
        direction, 1 << config.position_shift
    )
    gain += reach.rounding_gain(
        config.position_shift, config.position_rounding, config.position_carry
    )
    at_most = math.ceil(2 * (envelope.rate * every + envelope.noise_ticks)) + 2
    return [Frame(every, one, one * _per_count(config) + gain) for one in (counts, at_most)]


def _least_ticks(envelope: Envelope, counts: int) -> int:
    """Return in how many ticks so many counts of both wheels together fit."""
    beyond = (counts + 1) // 2 - 1 - envelope.noise_ticks
    return max(math.floor(beyond / envelope.rate) + 1, 1)


def _longest_step(config: KernelConfig, counts: int, every_step_fits: bool) -> Fraction:
    """Return the longest step of so many counts forward or backward, in its word [2^-S m].

    A remainder that is carried may be taken off one way and given back another, after a turn: each
    step may have all of it. One that is never given back adds nothing to their sum.
    """
    product, shift = counts * config.half_tick_m_q, config.step_shift
    low, high = config.step_low_q, config.step_high_q
    is_exact = config.step_carry and config.position_carry and every_step_fits
    if is_exact and not reach.is_given_back(config):
        return Fraction(product, 1 << shift)
    longest = largest(product, shift, config.step_rounding, config.step_carry)
    if longest <= high:
        return Fraction(longest)
    if config.step_overflow != WRAP:
        return Fraction(min(longest, -low))
    steps = (shift_round(sign * product, shift, config.step_rounding) for sign in (1, -1))
    wrapped = max(abs(limit(step, low, high, WRAP)) for step in steps)
    return Fraction(min(wrapped + config.step_carry, -low))


def _moved(config: KernelConfig, step: Fraction, direction: int) -> Fraction:
    """Return how far a step goes along an axis at most [2^-P m]."""
    if config.position_carry:
        return step * direction / (1 << config.position_shift)
    rounding = config.position_rounding
    return Fraction(largest(math.ceil(step) * direction, config.position_shift, rounding, 0))
