"""Importance weights whose largest are smoothed, and whether their sums can be trusted.

Pareto-smoothed importance sampling (Vehtari, Simpson, Gelman, Yao and Gabry 2024, JMLR 25:72): the
largest weights follow a generalised Pareto distribution; in the place of the drawn ones stand its
expected order statistics, and its shape k says whether means over the draws converge.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats

TRUSTED: Final = 0.7
"""Below this shape means over the draws converge in practice."""
_TAIL_SHARE: Final = 5
_TAIL_ROOTS: Final = 3.0
"""The tail: a fifth of the draws, three square roots of their number at most."""
_LEAST_TAIL: Final = 5
_HALF: Final = 0.5
_WORTH: Final = 10
"""The shape leans towards a half as if so many more weights of the tail had said so."""


def tail_shape(log_weight: Floats) -> float:
    """Return the Pareto shape k of the largest weights, given by logarithms float64[n]."""
    return smoothed(log_weight)[1]


def smoothed(log_weight: Floats) -> tuple[Floats, float]:
    """Return logarithms float64[n] of weights with the largest smoothed, and the tail's shape.

    The shape is 0 where the largest weights do not differ, or are fewer than five.
    """
    count = len(log_weight)
    tail = math.ceil(min(count / _TAIL_SHARE, _TAIL_ROOTS * math.sqrt(count)))
    if tail < _LEAST_TAIL or tail >= count:
        return log_weight, 0.0
    order = np.argsort(log_weight, kind="stable")
    largest = order[-tail:]
    top = float(log_weight[order[-1]])
    weight = np.exp(log_weight - top)
    cutoff = float(weight[order[-tail - 1]])
    excess = weight[largest] - cutoff
    if excess[-1] <= np.finfo(np.float64).eps:
        return log_weight, 0.0
    shape, scale = _generalised_pareto(np.maximum(excess, np.finfo(np.float64).tiny))
    middle = (np.arange(tail) + 0.5) / tail
    with np.errstate(over="ignore"):  # of the heaviest tails: none is above the largest drawn
        long = np.expm1(-shape * np.log1p(-middle)) / shape if shape else -np.log1p(-middle)
    smooth = log_weight.copy()
    smooth[largest] = top + np.minimum(np.log(cutoff + scale * long), 0.0)
    return smooth, shape


def _generalised_pareto(excess: Floats) -> tuple[float, float]:
    """Return shape and scale of ascending excesses float64[n] > 0 (Zhang and Stephens 2009,
    Technometrics 51:316), the shape with a weak prior about a half (Vehtari et al., appendix G)."""
    count = len(excess)
    grid = 30 + math.isqrt(count)
    quartile = excess[int(count / 4 + 0.5) - 1]
    rates = 1 / excess[-1] + (1 - np.sqrt(grid / (np.arange(1, grid + 1) - 0.5))) / (3 * quartile)
    shapes = np.log1p(-rates[:, np.newaxis] * excess).mean(axis=1)
    profile = count * (np.log(-rates / shapes) - shapes - 1)
    weights = np.exp(profile - profile.max())
    rate = float(weights @ rates / weights.sum())
    shape = float(np.log1p(-rate * excess).mean())
    leaning = (count * shape + _WORTH * _HALF) / (count + _WORTH)
    return leaning, -shape / rate
