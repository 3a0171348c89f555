"""The laws of scoring: shares with intervals, calibration, ranking, ranks.

Sources: Wilson, *Probable inference, the law of succession, and statistical inference* (JASA 22,
1927); Brier, *Verification of forecasts expressed in terms of probability* (Monthly Weather Review
78, 1950); Naeini, Cooper and Hauskrecht, *Obtaining well calibrated probabilities using Bayesian
binning* (AAAI 2015); Hanley and McNeil, *The meaning and use of the area under a receiver operating
characteristic curve* (Radiology 143, 1982); Talts et al., *Validating Bayesian inference algorithms
with simulation-based calibration* (2018); Efron, *Bootstrap methods: another look at the jackknife*
(Annals of Statistics 7, 1979).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2, norm

Floats = NDArray[np.float64]

_Z: Final = 1.959963984540054
_RATIO_DRAWS: Final = 2000
BINS: Final = 15
RANK_EDGES: Final = (0.0, 0.025, 0.1, 0.25, 0.75, 0.9, 0.975, 1.0)
"""Ranks of a true value among its posterior, as far as the three intervals tell them."""


@dataclass(frozen=True)
class Share:
    """A share with its 95 % interval; of nothing it is None."""

    value: float | None
    low: float | None
    high: float | None
    count: int


def share(hits: Sequence[bool]) -> Share:
    """Return the share of true ones with Wilson's interval."""
    count = len(hits)
    if count == 0:
        return Share(None, None, None, 0)
    p = sum(hits) / count
    middle = (p + _Z**2 / (2 * count)) / (1 + _Z**2 / count)
    half = _Z / (1 + _Z**2 / count) * math.sqrt(p * (1 - p) / count + _Z**2 / (4 * count**2))
    return Share(p, max(0.0, middle - half), min(1.0, middle + half), count)


def mean(values: Sequence[float], within: tuple[float, float] = (-math.inf, math.inf)) -> Share:
    """Return a mean with its normal 95 % interval, cut to what a value can be."""
    count = len(values)
    if count == 0:
        return Share(None, None, None, 0)
    centre = math.fsum(values) / count
    if count == 1:
        return Share(centre, None, None, 1)
    half = _Z * float(np.std(values, ddof=1)) / math.sqrt(count)
    return Share(centre, max(within[0], centre - half), min(within[1], centre + half), count)


def ratio(upper: Sequence[float], lower: Sequence[float]) -> Share:
    """Return the sum of *upper* over that of *lower*, a pair of each case; *lower* is positive.

    The 95 % interval is of the same ratio over cases drawn anew, both numbers of a case together.
    """
    count = len(upper)
    if count == 0:
        return Share(None, None, None, 0)
    value = math.fsum(upper) / math.fsum(lower)
    if count == 1:
        return Share(value, None, None, 1)
    above, below = np.asarray(upper, dtype=np.float64), np.asarray(lower, dtype=np.float64)
    draw = np.random.default_rng(3)
    ratios = []
    for _ in range(_RATIO_DRAWS):
        rows = draw.integers(count, size=count)
        ratios.append(above[rows].sum() / below[rows].sum())
    low, high = np.quantile(ratios, [0.025, 0.975])
    return Share(value, float(low), float(high), count)


@dataclass(frozen=True)
class CalibrationBin:
    """Cases of like probability: what was said, and how often it was so."""

    said: float
    true: float
    count: int


def calibration(
    probability: Sequence[float], correct: Sequence[bool], bins: int = BINS
) -> tuple[float | None, tuple[CalibrationBin, ...]]:
    """Return the expected calibration error over bins of equal mass, and the bins."""
    if not probability:
        return None, ()
    said = np.asarray(probability, dtype=np.float64)
    true = np.asarray(correct, dtype=np.float64)
    order = np.argsort(said, kind="stable")
    parts = [part for part in np.array_split(order, min(bins, len(order))) if len(part)]
    found = tuple(
        CalibrationBin(float(said[part].mean()), float(true[part].mean()), len(part))
        for part in parts
    )
    total = math.fsum(one.count * abs(one.said - one.true) for one in found)
    return total / len(said), found


def perfect_share(one: CalibrationBin) -> tuple[float, float]:
    """Return between which shares a perfect forecaster is right in a bin 19 times in 20."""
    low, high = binom.ppf([0.025, 0.975], one.count, min(one.said, 1.0)) / one.count
    return float(low), float(high)


_DRAWS: Final = 400


def calibration_interval(
    probability: Sequence[float], correct: Sequence[bool], bins: int = BINS
) -> tuple[float, float] | None:
    """Return the 95 % interval of the calibration error, cases drawn anew; None of few cases."""
    if len(probability) < 2 * bins:
        return None
    draw = np.random.default_rng(1)
    said, true = np.asarray(probability), np.asarray(correct)
    errors = []
    for _ in range(_DRAWS):
        rows = draw.integers(len(said), size=len(said))
        errors.append(calibration(said[rows].tolist(), true[rows].tolist(), bins)[0] or 0.0)
    low, high = np.quantile(errors, [0.025, 0.975])
    return float(low), float(high)


def perfect_calibration(
    probability: Sequence[float], bins: int = BINS
) -> tuple[float, float, float] | None:
    """Return what error a perfect forecaster of these probabilities shows by chance alone.

    Its mean, and between which ends it lies 19 times in 20.
    """
    if not probability:
        return None
    draw = np.random.default_rng(2)
    said = np.asarray(probability)
    errors = [
        calibration(probability, (draw.random(len(said)) < said).tolist(), bins)[0] or 0.0
        for _ in range(_DRAWS)
    ]
    low, high = np.quantile(errors, [0.025, 0.975])
    return float(np.mean(errors)), float(low), float(high)


def best_miss(over_limit: float) -> float:
    """Return how often the best of all tests misses an effect of a size over its detection limit.

    The Neyman-Pearson test of one known direction at 1 % false alarms shared over 60 candidates,
    two-sided: separation is 29 at the limit and grows with the square of the size.
    """
    least = float(norm.isf(0.005 / 60))
    return float(norm.cdf(least - math.sqrt(29.0) * over_limit))


def brier(probabilities: Sequence[float], truth: float) -> float:
    """Return the squared error of a forecast: *truth* is what the true answer was given,
    *probabilities* those of all other answers. 0 is perfect, 2 the worst."""
    return (1.0 - truth) ** 2 + math.fsum(p**2 for p in probabilities)


def auroc(positives: Sequence[float], negatives: Sequence[float]) -> Share:
    """Return the chance that a positive scores above a negative, ties counting half.

    The interval is Hanley and McNeil's.
    """
    if not positives or not negatives:
        return Share(None, None, None, 0)
    up = np.asarray(positives, dtype=np.float64)[:, np.newaxis]
    down = np.asarray(negatives, dtype=np.float64)[np.newaxis, :]
    area = float(np.mean((up > down) + 0.5 * (up == down)))
    one, two = area / (2 - area), 2 * area**2 / (1 + area)
    m, n = len(positives), len(negatives)
    spread = area * (1 - area) + (m - 1) * (one - area**2) + (n - 1) * (two - area**2)
    half = _Z * math.sqrt(max(spread, 0.0) / (m * n))
    return Share(area, max(0.0, area - half), min(1.0, area + half), m + n)


def rank_bin(value: float, intervals: Sequence[tuple[float, float]]) -> int:
    """Return into which of the seven ranks a true value falls.

    *intervals* are the 95, 80 and 50 % ones, from wide to narrow.
    """
    edges = [low for low, _ in intervals] + [high for _, high in reversed(intervals)]
    return int(np.searchsorted(np.asarray(edges), value, side="right"))


def rank_test(bins: Sequence[int]) -> tuple[list[int], float | None]:
    """Return how many values fell into each rank, and the chance of a worse fit (Pearson's χ²)."""
    weights = np.diff(RANK_EDGES)
    counts = np.bincount(np.asarray(bins, dtype=np.int64), minlength=len(weights))
    if not len(bins):
        return counts.tolist(), None
    expected = weights * len(bins)
    statistic = float(((counts - expected) ** 2 / expected).sum())
    return counts.tolist(), float(chi2.sf(statistic, len(weights) - 1))
