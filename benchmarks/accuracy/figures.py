"""Figures from results: errors over bounds, steps, coverage, ranks."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2, chisquare

from accuracy.fits import Result, is_edge
from accuracy.sizes import STEPPED

LEVELS: Final = (0.5, 0.8, 0.95)
_MOST_BINS: Final = 10
_LEAST_IN_A_BIN: Final = 5

Key = tuple[str, str]
"""Effect and parameter."""


@dataclass(frozen=True)
class Ratio:
    """Root mean square of error over bound, with a 95 % interval for it."""

    count: int
    rms: float
    low: float
    high: float
    bias: float
    stated: float


def ratios(results: Iterable[Result], study: str) -> dict[Key, Ratio]:
    """Return errors over bounds of a study, by effect and parameter."""
    pairs: dict[Key, list[tuple[float, float]]] = defaultdict(list)
    for one in results:
        if one["study"] != study or one["truth"] is None:
            continue
        for name, bound in one["bound"].items():
            found = one["found"][name]
            if found is not None and bound > 0:
                pairs[one["effect"], name].append((found["error"] / bound, found["sd"] / bound))
    return {key: _ratio(np.array(values)) for key, values in sorted(pairs.items())}


def _ratio(values: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> Ratio:
    errors, stated = values[:, 0], values[:, 1]
    count = len(errors)
    rms = float(np.sqrt(np.mean(errors**2)))
    low, high = (math.sqrt(count / chi2.ppf(q, count)) * rms for q in (0.975, 0.025))
    return Ratio(count, rms, low, high, float(errors.mean()), float(np.median(stated)))


@dataclass(frozen=True)
class Steps:
    """How often a threshold, whole number or window was right.

    Attributes:
        count: of cases.
        exact: share that was right, or within the finest step of the search.
        near: share within one step of the coarse grid, or one whole number.
        inside: share whose 95 % interval holds the truth; NaN for a choice.
        missed: share in which the effect was not seen at all.
    """

    count: int
    exact: float
    near: float
    inside: float
    missed: float


_STEPS: Final = {"start_s": (0.1, 2.5), "stop_s": (0.1, 2.5), "threshold": (0.2, 1.2),
                 "limit": (0.01, 0.1)}  # fmt: skip
"""Finest and coarse step of the search for edges [s, rad/s]."""


def steps(results: Iterable[Result], study: str) -> dict[Key, Steps]:
    """Return how often what moves in steps was right."""
    rows: dict[Key, list[tuple[float, float, float, float]]] = defaultdict(list)
    for one in results:
        if one["study"] != study or one["truth"] is None:
            continue
        for name, truth in one["truth"].items():
            found = one["found"][name]
            if found is None:
                if one["effect"] in STEPPED:
                    rows[one["effect"], name].append((0.0, 0.0, math.nan, 1.0))
            elif "right" in found:
                same = float(str(found["value"]) == str(truth))
                near = same
                if isinstance(truth, int):
                    near = float(abs(int(found["value"]) - truth) <= 1)
                rows[one["effect"], name].append((same, near, math.nan, 0.0))
            elif is_edge(name):
                fine, coarse = _STEPS[name]
                off = abs(found["error"])
                held = float(0.025 < found["rank"] < 0.975)
                rows[one["effect"], name].append(
                    (float(off <= fine), float(off <= coarse), held, 0.0)
                )
    return {
        key: Steps(
            len(values),
            *(
                float(np.nanmean(column)) if np.isfinite(column).any() else math.nan
                for column in np.array(values).T
            ),
        )
        for key, values in sorted(rows.items())
    }


def ranks(results: Iterable[Result], study: str) -> dict[Key, list[float]]:
    """Return where the truth stands among the posterior's samples, by effect and parameter."""
    found: dict[Key, list[float]] = defaultdict(list)
    for one in results:
        if one["study"] != study or one["truth"] is None:
            continue
        for name, estimate in one["found"].items():
            if estimate is not None and "rank" in estimate:
                found[one["effect"], name].append(float(estimate["rank"]))
    return dict(sorted(found.items()))


def coverage(some: Sequence[float], level: float) -> float:
    """Return the share of central intervals of a level that hold the truth."""
    return float(np.mean(np.abs(np.array(some) - 0.5) < 0.5 * level))


def uniformity(some: Sequence[float]) -> float:
    """Return the p-value of a chi-square test that ranks are uniform (Talts et al. 2018)."""
    if len(some) < 2 * _LEAST_IN_A_BIN:
        return 1.0  # too few to say anything
    bins = max(2, min(_MOST_BINS, len(some) // _LEAST_IN_A_BIN))
    counts, _ = np.histogram(some, bins=bins, range=(0.0, 1.0))
    return float(chisquare(counts).pvalue)
