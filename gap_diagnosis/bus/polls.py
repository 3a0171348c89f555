"""Stamps on the lattice of a poll: its period, and how surely they lie on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.bus import prior
from gap_diagnosis.bus.events import Message
from gap_diagnosis.bus.stamps import Choice, log_as_usual, log_usual_spread, spread_of

Floats = NDArray[np.float64]

_STAMP_STEP_S: Final = 1e-6
_PAIRS: Final = 400
_FINER: Final = 8
_PER_TURN: Final = 16
"""Frequencies are tried so closely that over the longest difference a phase turns by 1/16."""
_PROMISING: Final = 0.9
_MOST_CANDIDATES: Final = 40
_ON_LATTICE: Final = 0.98
_VARIES: Final = 0.9
"""A lateness that hardly varies lies on any lattice as coarse as the tick."""
_LONGEST_S: Final = 0.2
_PRICE: Final = math.log(500)
"""Periods are told apart by a tenth of a millisecond at sight."""


def polling(messages: Sequence[Message]) -> Choice:
    """Return the evidence that messages are stamped at multiples of one period.

    Against a lateness as every bus has it: where the frames were due says in which of a lattice's
    places each stamp lies, and how far beside it spreads as lateness usually does. A poll about as
    long as the tick wanders through it so slowly that a bus's own wander looked like it.
    """
    low, high = prior.POLL_PERIOD_S
    nothing = Choice(-_PRICE, 0.0, np.geomspace(low, high, 50), np.full(50, 0.02))
    if any(not _can_tell(one) for one in messages):
        return nothing
    period = poll_period(messages[0])
    if period is None:
        return nothing
    gain = gain_at_best = 0.0
    for one in messages:
        good = one.restless()
        stamps, late = one.t_s[good], one.late_s[good]
        strength = _strength(stamps, period)
        if strength < _ON_LATTICE or _strength(late, period) > _VARIES:
            return nothing
        beside_s = period / (2 * math.pi) * math.sqrt(-2 * math.log(min(strength, 1.0)))
        evidence, at_best = log_as_usual(max(beside_s, _STAMP_STEP_S / 3), len(stamps))
        gain, gain_at_best = gain + evidence, gain_at_best + at_best
    usual, best = log_usual_spread(messages)
    # Logs carry whole microseconds, so that no period is known to less.
    within = period + np.linspace(-0.5, 0.5, 51) * _STAMP_STEP_S
    return Choice(gain - usual - _PRICE, gain_at_best - best, within, np.full(51, 1 / 51))


def _can_tell(message: Message) -> bool:
    spread, count = spread_of(message)
    return count >= 50 and spread >= 20 * _STAMP_STEP_S


def poll_period(message: Message) -> float | None:
    """Return the longest period of which a message's stamps are multiples; None for none.

    Differences of stamps are whole multiples of it: first those of neighbours, which tell it
    roughly, then of stamps ever farther apart, which tell it to the last digit.
    """
    good = message.restless()
    stamps = np.sort(message.t_s[good])
    random = np.random.default_rng(0)
    low, high = prior.POLL_PERIOD_S
    near = np.diff(stamps)
    near = near[(near > 0) & (near < _LONGEST_S)]
    if len(near) < 20:
        return None
    near = random.choice(near, min(len(near), _PAIRS), replace=False)
    step = 1 / (_PER_TURN * float(near.max()))
    tried = np.arange(1 / high, 1 / low, step)
    fits = _agreement(near, tried)
    peaks = np.flatnonzero((fits >= np.roll(fits, 1)) & (fits >= np.roll(fits, -1)))
    peaks = peaks[fits[peaks] > _PROMISING][:_MOST_CANDIDATES]
    late = message.late_s[good]
    for frequency in tried[peaks]:
        exact = _refined(stamps, float(frequency), step, random)
        if _strength(stamps, 1 / exact) > _ON_LATTICE and _strength(late, 1 / exact) < _VARIES:
            return 1 / exact
    return None


def _refined(stamps: Floats, frequency: float, step: float, random: np.random.Generator) -> float:
    """Return a frequency sharpened on differences of stamps ever farther apart."""
    lag = 1
    while lag < len(stamps) // 2:
        lag = min(_FINER * lag, len(stamps) // 2)
        at = random.integers(0, len(stamps) - lag, _PAIRS)
        # Not all of one length: ticks and polls may come round to each other.
        apart = stamps[at + random.integers(1 + lag // 2, lag + 1, _PAIRS)] - stamps[at]
        finer = 1 / (_PER_TURN * float(apart.max()))
        tried = frequency + np.arange(-1.5 * step, 1.5 * step + finer, finer)
        frequency, step = float(tried[int(np.argmax(_agreement(apart, tried)))]), finer
    turned = np.exp(2j * math.pi * frequency * (stamps - stamps[0]))
    beside = np.angle(turned / turned.mean())
    return frequency - float(np.polyfit(stamps - stamps[0], beside, 1)[0]) / (2 * math.pi)


def _agreement(apart: Floats, tried: Floats) -> Floats:
    """Return the mean cosine of differences at frequencies: 1 where all are whole multiples."""
    return np.asarray(np.cos(2 * math.pi * np.outer(tried, apart)).mean(axis=1))


def _strength(values: Floats, period: float) -> float:
    return float(np.abs(np.exp(2j * math.pi * (values - values[0]) / period).mean()))
