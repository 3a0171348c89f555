"""Systematic and random parts with their intervals, and tolerances derived from them.

Every statistical check of a law accepts a band that a correct implementation leaves with a stated
probability (the false-alarm rate), computed from the predicted distribution and the number of
runs: a wrong implementation cannot widen its own band by being noisy.

Intervals are Student's t for means and chi-square for variances of normal samples (Barfoot,
"State Estimation for Robotics", 2017, chapter 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

FloatArray = NDArray[np.float64]

FALSE_ALARM: Final = 1e-4
"""Probability that one statistical check fails although the implementation is correct."""

INTERVAL_LEVEL: Final = 0.95
"""Confidence of the intervals that are shown beside measured values."""

NORMAL_KURTOSIS: Final = 3.0


@dataclass(frozen=True)
class Interval:
    """A confidence interval: *low* to *high* at confidence *level*."""

    low: float
    high: float
    level: float = INTERVAL_LEVEL

    def __post_init__(self) -> None:
        """Refuse an interval that ends before it begins."""
        if not self.low <= self.high:
            raise ValueError(f"interval from {self.low} to {self.high}: expected low <= high")

    def __contains__(self, value: float) -> bool:
        """Tell whether *value* lies inside, borders included."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Split:
    """An error over several runs: its systematic part (mean) and its random part (spread).

    Attributes:
        quantity: what was measured, with its conditions.
        unit: of all four numbers below.
        runs: number of runs, each with its own seed.
        systematic: mean over the runs, with Student's t interval.
        random: standard deviation over the runs, with chi-square interval.
    """

    quantity: str
    unit: str
    runs: int
    systematic: float
    systematic_interval: Interval
    random: float
    random_interval: Interval


def split_error(samples: FloatArray, quantity: str, unit: str) -> Split:
    """Split *samples*, one error per run, shape (runs,), into systematic and random part."""
    return Split(
        quantity=quantity,
        unit=unit,
        runs=len(samples),
        systematic=float(np.mean(samples)),
        systematic_interval=mean_interval(samples),
        random=float(np.std(samples, ddof=1)),
        random_interval=_square_root(variance_interval(samples)),
    )


def mean_interval(samples: FloatArray, level: float = INTERVAL_LEVEL) -> Interval:
    """Student's t interval of the mean of *samples*, shape (runs,), at least two runs."""
    runs = _require_runs(samples)
    half = stats.t.ppf((1 + level) / 2, runs - 1) * np.std(samples, ddof=1) / math.sqrt(runs)
    mean = float(np.mean(samples))
    return Interval(mean - float(half), mean + float(half), level)


def variance_interval(samples: FloatArray, level: float = INTERVAL_LEVEL) -> Interval:
    """Chi-square interval of the variance of normal *samples*, shape (runs,)."""
    freedom = _require_runs(samples) - 1
    squares = float(np.var(samples, ddof=1)) * freedom
    low, high = stats.chi2.ppf([(1 + level) / 2, (1 - level) / 2], freedom)
    return Interval(squares / float(low), squares / float(high), level)


def mean_tolerance(sd: float, runs: int, false_alarm: float = FALSE_ALARM) -> float:
    """Return how far the mean of *runs* normal values of deviation *sd* strays.

    It is exceeded with probability *false_alarm*; *sd* is the predicted one.
    """
    return float(stats.norm.isf(false_alarm / 2)) * sd / math.sqrt(runs)


def variance_tolerance(variance: float, freedom: float, false_alarm: float = FALSE_ALARM) -> float:
    """Return how far a sample variance of a normal quantity strays from *variance*.

    The chi-square distribution with *freedom* degrees is skewed; the tolerance is the symmetric
    one that is exceeded, on both sides together, with probability *false_alarm*. It also serves
    a mean of squared normalised errors, whose expectation is *variance*.
    """

    def excess(relative: float) -> float:
        above = stats.chi2.sf((1 + relative) * freedom, freedom)
        below = stats.chi2.cdf(max(1 - relative, 0.0) * freedom, freedom)
        return float(above + below) - false_alarm

    widest = 2 * float(stats.chi2.isf(false_alarm / 2, freedom)) / freedom
    return variance * float(optimize.brentq(excess, 1e-12, widest))


def variance_tolerance_of(
    kurtosis: float, variance: float, runs: int, false_alarm: float = FALSE_ALARM
) -> float:
    """Return the same for a quantity of known *kurtosis* (9/5 for a uniform one).

    Large samples: var(s²) = σ⁴·(κ − (n − 3)/(n − 1))/n.
    """
    relative_variance = (kurtosis - (runs - 3) / (runs - 1)) / runs
    return variance * float(stats.norm.isf(false_alarm / 2)) * math.sqrt(relative_variance)


def growth(errors: FloatArray, blocks: int) -> float:
    """Return the variance of whole runs over that of their blocks (a variance ratio).

    It is *blocks* for a random walk, blocks² for a drift that differs from run to run, and about 1
    for an error that does not accumulate.

    Args:
        errors: shape (runs, ticks), zero at the first tick.
        blocks: number of blocks of equal length; must divide the steps.
    """
    length, rest = divmod(errors.shape[1] - 1, blocks)
    if rest:
        raise ValueError(f"{errors.shape[1] - 1} steps: expected a multiple of {blocks} blocks")
    gained = np.diff(errors[:, ::length], axis=1)
    return float(np.var(errors[:, -1], ddof=1) / np.var(gained, ddof=1))


def growth_tolerance(
    ratio: float, runs: int, blocks: int, false_alarm: float = FALSE_ALARM
) -> float:
    """Return how far `growth` strays from *ratio* for independent normal steps.

    By the F distribution of two independent variances with runs − 1 and blocks·runs − 1 degrees.
    The blocks are parts of the runs, which makes the quotient vary less: the tolerance is on the
    safe side.
    """
    freedom = (runs - 1, blocks * runs - 1)

    def excess(relative: float) -> float:
        above = stats.f.sf(1 + relative, *freedom)
        below = stats.f.cdf(max(1 - relative, 0.0), *freedom)
        return float(above + below) - false_alarm

    widest = float(stats.f.isf(false_alarm / 2, *freedom))
    return ratio * float(optimize.brentq(excess, 1e-12, widest))


def _square_root(interval: Interval) -> Interval:
    return Interval(math.sqrt(interval.low), math.sqrt(interval.high), interval.level)


def _require_runs(samples: FloatArray) -> int:
    if samples.ndim != 1 or len(samples) < 2:
        raise ValueError(
            f"samples of shape {samples.shape}: expected one value per run, two or more"
        )
    return len(samples)
