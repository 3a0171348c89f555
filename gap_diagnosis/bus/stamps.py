"""What stamps say: jitter, polling, the delay of one message against the others, the clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from gap_diagnosis.bus import prior
from gap_diagnosis.bus.events import Message

Floats = NDArray[np.float64]

_GRID: Final = 200
_CLIP: Final = 8.0
_STAMP_STEP_S: Final = 1e-6
_MOST_STAMPS: Final = 3000
_ON_LATTICE: Final = 0.98
_SCALES: Final = 6


@dataclass(frozen=True)
class Choice:
    """Evidence for an effect of one message, with its parameter's posterior on a grid."""

    log_evidence: float
    log_ratio: float
    value: Floats
    weight: Floats


def spread_of(message: Message) -> tuple[float, int]:
    """Return the standard deviation of a message's lateness [s], and of how many stamps."""
    late = message.late_s[message.steady()]
    if len(late) < 20:
        return 0.0, 0
    middle = float(np.median(late))
    robust = 1.4826 * float(np.median(np.abs(late - middle)))
    # One step of a log's stamps is the least that a lateness is known to.
    reach = _CLIP * max(robust, 5 * _STAMP_STEP_S)
    clipped = np.clip(late, middle - reach, middle + reach)
    return max(float(np.std(clipped)), _STAMP_STEP_S / 3), len(late)


def jitter(messages: Sequence[Message]) -> Choice:
    """Return the evidence that messages jitter beyond the usual, with a common level."""
    usual: Floats = np.geomspace(*prior.JITTER_USUAL_S, _GRID, dtype=np.float64)
    news: Floats = np.geomspace(*prior.JITTER_PRESENT_S, _GRID, dtype=np.float64)
    log_news, log_usual = np.zeros(_GRID), 0.0
    best = 0.0
    for message in messages:
        sd, count = spread_of(message)
        told = min(count, prior.MOST_INDEPENDENT)
        if told == 0:
            continue
        log_news = log_news + _log_spread(news, sd, told)
        as_usual = _log_spread(usual, sd, told)
        log_usual += float(logsumexp(as_usual)) - math.log(_GRID)
        best -= float(as_usual.max())
    total = float(logsumexp(log_news)) - math.log(_GRID)
    return Choice(total - log_usual, best + float(log_news.max()), news, _weights(log_news))


def _log_spread(sigma: Floats, sd: float, count: int) -> Floats:
    return -count * (np.log(sigma) + 0.5 * (sd / sigma) ** 2)


def polling(message: Message, clock_skew: float) -> Choice:
    """Return the evidence that a message's stamps lie on the lattice of a poll.

    The period is a whole number of tenths of a millisecond, on the log's clock or the ECU's. Only a
    lateness that varies can tell.
    """
    low, high = prior.POLL_PERIOD_S
    periods = np.arange(round(low * 1e4), round(high * 1e4) + 1, dtype=np.float64) * 1e-4
    good = message.steady()
    stamps, late = message.t_s[good], message.late_s[good]
    nothing = Choice(
        -math.log(len(periods)),
        0.0,
        periods,
        np.full(len(periods), 1 / len(periods), dtype=np.float64),
    )
    spread, count = spread_of(message)
    if count < 50 or spread < 20 * _STAMP_STEP_S:
        return nothing
    # Any rows, not every second one: those would lie on lattices of their own.
    chosen = np.random.default_rng(0).integers(0, len(stamps), min(len(stamps), _MOST_STAMPS))
    ecu = 1.0 + (clock_skew if math.isfinite(clock_skew) else 0.0)
    since = stamps[chosen] - stamps[0]
    strength = np.max(
        [
            np.abs(np.exp(2j * math.pi * np.outer(rate / periods, since)).mean(axis=1))
            for rate in (1.0, ecu)
        ],
        axis=0,
    )
    free = np.exp(2j * math.pi * np.outer(1 / periods, late[chosen]))
    chance = np.abs(free.mean(axis=1))
    told = min(len(stamps[chosen]), prior.MOST_INDEPENDENT)
    # Off a lattice the strength is what the lateness alone gives; on it, nearly one.
    on = strength > _ON_LATTICE
    gain = np.where(
        on & (chance < 0.9), 0.5 * told * np.log((1 - chance**2) / (1 - strength**2 + 1e-3)), 0.0
    )
    # Every divisor of the period is a lattice as well; on the coarsest one it is no accident.
    accident = told * np.log(periods / periods[0])
    logs = np.where(gain > 0, gain.max() + accident, -np.inf)
    if not np.isfinite(logs).any():
        return nothing
    return Choice(
        float(gain.max()) - math.log(len(periods)), float(gain.max()), periods, _weights(logs)
    )


def latencies(messages: Sequence[Message]) -> dict[str, Choice]:
    """Return, by message, the evidence that it is later than the other sensor messages."""
    seen = {}
    for message in messages:
        good = message.steady()
        if np.count_nonzero(good) >= 20:
            seen[message.name] = float(np.median(message.late_s[good]))
    found: dict[str, Choice] = {}
    if len(seen) < 2:
        return found
    scales = np.geomspace(prior.LATENCY_TOLERANCE_S, prior.LATENCY_HIGH_S, _SCALES)
    value = np.concatenate(([0.0], np.geomspace(1e-5, 2 * prior.LATENCY_HIGH_S, 4 * _GRID)))
    width = np.gradient(value)
    density = np.mean(
        2 * np.exp(-0.5 * (value[:, np.newaxis] / scales) ** 2) / (scales * math.sqrt(2 * math.pi)),
        axis=1,
    )
    for name, offset in seen.items():
        others = [one for other, one in seen.items() if other != name]
        away = offset - float(np.median(others))
        usual = prior.LATENCY_USUAL_S
        null = -0.5 * (away / usual) ** 2
        logs = -0.5 * ((away - value) / usual) ** 2 + np.log(density * width)
        found[name] = Choice(
            float(logsumexp(logs)) - null,
            max(-null, 0.0) if away > 0 else 0.0,
            value,
            _weights(logs),
        )
    return found


def skew(measured: float, sd: float) -> tuple[float, float, Floats, Floats]:
    """Return log evidence, log ratio, mean and sd of the scales' posteriors: float64[s, 3].

    The clock's rate is usual within half the tolerance; beyond it is news. The last column is the
    scale's weight; the second array the scales.
    """
    scales = np.geomspace(prior.SKEW_TOLERANCE, prior.SKEW_HIGH, _SCALES)
    noise = math.hypot(sd, 2e-6)
    usual = math.hypot(noise, 0.5 * prior.SKEW_TOLERANCE)
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
