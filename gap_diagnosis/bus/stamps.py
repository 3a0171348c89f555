"""What stamps say: jitter, polling, the delay of one message against the others, the clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from gap_diagnosis.bus import prior
from gap_diagnosis.bus.events import FEWEST_FRAMES, Message

Floats = NDArray[np.float64]

_GRID: Final = 200
_LEVELS: Final = 2000
_LASTS: Final = 20
_LEAST_FOR_TAILS: Final = 200
_CLIP: Final = 12.0
_STAMP_STEP_S: Final = 1e-6
_SCALES: Final = 6
_REACH: Final = 6.0
"""Standard deviations about a measured delay on which its grid is close."""
MOST_INDEPENDENT: Final = 400
"""Stamps are late together: a log says no more of its jitter than so many stamps on their own."""


@dataclass(frozen=True)
class Choice:
    """Evidence for an effect of one message, with its parameter's posterior on a grid; *windows*
    in which alone it acts."""

    log_evidence: float
    log_ratio: float
    value: Floats
    weight: Floats
    windows: tuple[tuple[float, float], ...] = ()


def spread_of(message: Message) -> tuple[float, int]:
    """Return the standard deviation of a message's lateness [s], and of how many stamps."""
    late = message.late_s[message.unhindered()]
    if len(late) < 20:
        return 0.0, 0
    middle = float(np.median(late))
    robust = 1.4826 * float(np.median(np.abs(late - middle)))
    # One step of a log's stamps is the least that a lateness is known to.
    reach = _CLIP * max(robust, 5 * _STAMP_STEP_S)
    clipped = np.clip(late, middle - reach, middle + reach)
    return max(float(np.std(clipped)), _STAMP_STEP_S / 3), len(late)


def log_usual_spread(messages: Sequence[Message]) -> tuple[float, float]:
    """Return the log evidence of latenesses that are as usual, and the log likelihood at best."""
    each = [
        log_as_usual(*spread_of(message), up_to_s=message.usual_spread_s) for message in messages
    ]
    return math.fsum(evidence for evidence, _ in each), math.fsum(best for _, best in each)


def log_as_usual(sd_s: float, count: int, *, up_to_s: float = 0.0) -> tuple[float, float]:
    """Return the log evidence of so many times that spread by a standard deviation [s] as much as
    latenesses usually do, or *up_to_s*, and the log likelihood at best."""
    low_s, high_s = prior.JITTER_USUAL_S
    usual: Floats = np.geomspace(low_s, max(high_s, up_to_s), _GRID, dtype=np.float64)
    logs = _log_spread(usual, sd_s, min(count, MOST_INDEPENDENT))
    return float(logsumexp(logs)) - math.log(_GRID), float(logs.max())


def jitter(messages: Sequence[Message]) -> Choice:
    """Return the evidence that messages jitter beyond the usual, with a common level."""
    news: Floats = np.geomspace(*prior.JITTER_PRESENT_S, _LEVELS, dtype=np.float64)
    logs, posterior = np.zeros(_LEVELS), np.zeros(_LEVELS)
    for message in messages:
        sd, count = spread_of(message)
        logs = logs + _log_spread(news, sd, min(count, MOST_INDEPENDENT))
        posterior = posterior + _log_spread(news, sd, count / _inflation(message))
    usual, best = log_usual_spread(messages)
    total = float(logsumexp(logs)) - math.log(_LEVELS)
    return Choice(total - usual, float(logs.max()) - best, news, _weights(posterior))


def _inflation(message: Message) -> float:
    """Return how much less a spread is known than that of as many independent normal values.

    By the lateness' tails, and by how long its size lasts from frame to frame.
    """
    late = message.late_s[message.unhindered()]
    if len(late) < _LEAST_FOR_TAILS:
        return 1.0
    square = (late - late.mean()) ** 2
    away = square - square.mean()
    power = float(away @ away) / len(away)
    if power <= 0:
        return 1.0
    lasting = sum(float(away[lag:] @ away[:-lag]) / len(away) for lag in range(1, _LASTS)) / power
    return max(0.5 * power / float(square.mean()) ** 2 * max(1.0 + 2.0 * lasting, 0.5), 1.0)


def _log_spread(sigma: Floats, sd: float, count: float) -> Floats:
    return -count * (np.log(sigma) + 0.5 * (sd / sigma) ** 2)


def latencies(messages: Sequence[Message]) -> dict[str, Choice]:
    """Return, by message, the evidence that it is later than the other sensor messages: all along,
    or between two changes of when messages come."""
    steady = [one for one in messages if np.count_nonzero(one.steady()) >= FEWEST_FRAMES]
    if len(steady) < 2:
        return {}
    price = math.log(max(one.frames for one in steady))
    found: dict[str, Choice] = {}
    for place, message in enumerate(steady):
        best = _later(_apart([one.earliest_s - one.known_late_s for one in steady], place))
        changes_s = message.changes_s
        ends_s = float(message.t_s[0]), *changes_s, float(message.t_s[-1])
        for span in pairwise(ends_s) if changes_s else ():
            offsets = [one.earliest_within_s(*span) - one.known_late_s for one in steady]
            away = _apart(offsets, place)
            if not math.isfinite(away):
                continue
            there = _later(away)
            left = there.log_evidence - price * sum(end in changes_s for end in span)
            if left > best.log_evidence:
                best = replace(there, log_evidence=left, windows=(span,))
        found[message.name] = best
    return found


def later_together(messages: Sequence[Message]) -> Choice | None:
    """Return the evidence that all of these messages are as much later between two changes of when
    they come; None where they are not. Later all along leaves no trace."""
    if len(messages) < 2 or not all(one.changes_s for one in messages):
        return None
    clock = max(messages, key=lambda one: one.frames)
    ends_s = float(clock.t_s[0]), *clock.changes_s, float(clock.t_s[-1])
    found = []
    for span in pairwise(ends_s):
        offsets = np.array([one.earliest_within_s(*span) for one in messages])
        late_s = offsets - np.array([one.earliest_s for one in messages])
        if np.isfinite(late_s).all() and np.ptp(late_s) < prior.LATENCY_USUAL_S:
            there = _later(float(np.median(late_s)))
            price = math.log(clock.frames) * sum(end in clock.changes_s for end in span)
            found.append(replace(there, log_evidence=there.log_evidence - price, windows=(span,)))
    best = max(found, key=lambda one: one.log_evidence, default=None)
    return best if best is not None and best.log_evidence > 0.0 else None


def _apart(offsets: Sequence[float], place: int) -> float:
    """Return by how much one message is later than the others are; NaN where none of these is."""
    others = [one for n, one in enumerate(offsets) if n != place and math.isfinite(one)]
    return offsets[place] - float(np.median(others)) if others else math.nan


def _later(away: float) -> Choice:
    """Return the evidence of a message that is later than others by so much."""
    usual = prior.LATENCY_USUAL_S
    value, weight = _delays(away)
    null = -0.5 * (away / usual) ** 2
    logs = -0.5 * ((away - value) / usual) ** 2 + np.log(weight)
    return Choice(
        float(logsumexp(logs)) - null,
        max(-null, 0.0) if away > 0 else 0.0,
        value,
        _weights(logs),
    )


def _delays(seen_s: float) -> tuple[Floats, Floats]:
    """Return delays on a grid [s], close about the one that was seen, and their prior weights."""
    scales = np.geomspace(prior.LATENCY.tolerance, prior.LATENCY.high, _SCALES)
    reach_s = _REACH * prior.LATENCY_USUAL_S
    far = np.geomspace(1e-5, 2 * prior.LATENCY.high + abs(seen_s), 4 * _GRID)
    near = np.linspace(seen_s - reach_s, seen_s + reach_s, _GRID + 1)
    value = np.unique(np.concatenate(([0.0], far, near[near > 0])))
    density = np.mean(
        2 * np.exp(-0.5 * (value[:, np.newaxis] / scales) ** 2) / (scales * math.sqrt(2 * math.pi)),
        axis=1,
    )
    return value, np.asarray(density * np.gradient(value), dtype=np.float64)


def skew(measured: float, sd: float) -> tuple[float, float, Floats, Floats]:
    """Return log evidence, log ratio, mean and sd of the scales' posteriors: float64[s, 3].

    The clock's rate is usual within half the tolerance; beyond it is news. The last column is the
    scale's weight; the second array the scales.
    """
    scales = np.geomspace(prior.SKEW.tolerance, prior.SKEW.high, _SCALES)
    noise = math.hypot(sd, 2e-6)
    usual = math.hypot(noise, 0.5 * prior.SKEW.tolerance)
    null = -0.5 * (measured / usual) ** 2 - math.log(usual)
    wide = np.hypot(scales, noise)
    logs = -0.5 * (measured / wide) ** 2 - np.log(wide)
    evidence = float(logsumexp(logs)) - math.log(len(scales)) - null
    shrink = scales**2 / wide**2
    mean, deviation = shrink * measured, np.sqrt(shrink) * noise
    ratio = max(-math.log(noise) - null, 0.0)
    return evidence, ratio, np.stack([mean, deviation, _weights(logs)], axis=1), scales


def _weights(logs: Floats) -> Floats:
    weight = np.exp(logs - logs.max())
    return np.asarray(weight / weight.sum(), dtype=np.float64)
