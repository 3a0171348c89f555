"""The components of the coefficients' prior, each updated by the data: compiled."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

_ALMOST: Final = 1 - 1e-16
_LEAST: Final = 1e-300


@numba.njit(cache=True, nogil=True, error_model="numpy")
def update(
    inner: Any, data: Any, scales: Any, tolerances: Any, widths: Any, is_positive: Any
) -> tuple[Any, Any, Any]:
    """Return means float64[s, k], covariances float64[s, k, k] and log evidences float64[s].

    Args:
        inner: float64[k, k], inner products of the coefficients' columns.
        data: float64[k], those with the data.
        scales: float64[s, k], the prior's standard deviations in each component.
        tolerances: float64[k], what is no news of a coefficient.
        widths: int64[t], how many coefficients each effect has, one after the other.
        is_positive: bool[t], whether they are sizes that cannot be negative.
    """
    components, count = scales.shape
    means = np.empty((components, count))
    covariances = np.empty((components, count, count))
    log_parts = np.empty(components)
    lower = np.zeros((count, count))
    inverse = np.zeros((count, count))
    solved = np.empty(count)
    for s in range(components):
        scale = scales[s]
        log_determinant = _factor(inner, scale, lower)
        for column in range(count):  # of the inverse of lower
            for i in range(column, count):
                value = 1.0 if i == column else 0.0
                for k in range(column, i):
                    value -= lower[i, k] * inverse[k, column]
                inverse[i, column] = value / lower[i, i]
        power = 0.0
        for i in range(count):
            solved[i] = 0.0
            for k in range(i + 1):
                solved[i] += inverse[i, k] * scale[k] * data[k]
            power += solved[i] * solved[i]
        for i in range(count):
            value = 0.0
            for k in range(i, count):
                value += inverse[k, i] * solved[k]
            means[s, i] = scale[i] * value
            for j in range(count):
                value = 0.0
                for k in range(max(i, j), count):
                    value += inverse[k, i] * inverse[k, j]
                covariances[s, i, j] = scale[i] * value * scale[j]
        news = _news(means[s], covariances[s], scale, tolerances, widths, is_positive)
        log_parts[s] = 0.5 * (power - log_determinant) + news
    return means, covariances, log_parts


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fitted(inner: Any, data: Any, high: Any) -> tuple[Any, Any, float]:
    """Return the best coefficients, float64[k], how large they are at the largest order of
    magnitude *high* of the prior, float64[k], and the log likelihood that the best ones gain.

    Columns that are nearly each other's sums are held at little.
    """
    count = len(data)
    ridge, held = inner.copy(), inner.copy()
    for i in range(count):
        ridge[i, i] += 1e-10 * max(inner[i, i], 1e-12)
        held[i, i] += high[i] ** -2.0
    best = np.linalg.solve(ridge, data)
    explained = 0.0
    for i in range(count):
        pull = data[i]
        for j in range(count):
            pull -= 0.5 * inner[i, j] * best[j]
        explained += best[i] * pull
    return best, np.abs(np.linalg.solve(held, data)), explained


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gains(inner: Any, data: Any, scales: Any) -> tuple[Any, Any]:
    """Return log evidences and log likelihoods, float64[s], of coefficients within no tolerance.

    Args:
        inner: float64[k, k], inner products of the coefficients' columns.
        data: float64[k], those with the data.
        scales: float64[s, k], the prior's standard deviations in each component.
    """
    components, count = scales.shape
    evidences, likelihoods = np.empty(components), np.empty(components)
    lower = np.zeros((count, count))
    solved, mean = np.empty(count), np.empty(count)
    for s in range(components):
        scale = scales[s]
        log_determinant = _factor(inner, scale, lower)
        power = 0.0
        for i in range(count):
            value = scale[i] * data[i]
            for k in range(i):
                value -= lower[i, k] * solved[k]
            solved[i] = value / lower[i, i]
            power += solved[i] * solved[i]
        for i in range(count - 1, -1, -1):
            value = solved[i]
            for k in range(i + 1, count):
                value -= lower[k, i] * solved[k]
            solved[i] = value / lower[i, i]
            mean[i] = scale[i] * solved[i]
        evidences[s] = 0.5 * (power - log_determinant)
        likelihoods[s] = 0.0
        for i in range(count):
            pull = data[i]
            for j in range(count):
                pull -= 0.5 * inner[i, j] * mean[j]
            likelihoods[s] += mean[i] * pull
    return evidences, likelihoods


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _factor(inner: Any, scale: Any, lower: Any) -> float:
    """Write 1 + scaled inner products as *lower* times its transpose; return the logarithm of the
    determinant. No pivot is less than 1."""
    log_determinant = 0.0
    for i in range(len(scale)):
        for j in range(i + 1):
            value = scale[i] * inner[i, j] * scale[j]
            if i == j:
                value += 1.0
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i == j:
                value = max(value, 1.0)
                log_determinant += math.log(value)
                lower[i, i] = math.sqrt(value)
            else:
                lower[i, j] = value / lower[j, j]
    return log_determinant


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _news(
    mean: Any, covariance: Any, scale: Any, tolerances: Any, widths: Any, is_positive: Any
) -> float:
    """Log of how much likelier it has become that each effect is beyond its tolerance."""
    total = 0.0
    place = 0
    for term in range(len(widths)):
        width = widths[term]
        one_sided = is_positive[term] and width == 1
        # Log of the probability that every coefficient is within its tolerance.
        after, before, positive = 0.0, 0.0, 1.0
        for i in range(place, place + width):
            sd = math.sqrt(max(covariance[i, i], _LEAST))
            beyond = _below((mean[i] - tolerances[i]) / sd)
            expected = _below(-tolerances[i] / scale[i])
            if not one_sided:
                beyond += _below((-tolerances[i] - mean[i]) / sd)
                expected *= 2.0
            after += math.log1p(-min(beyond, _ALMOST))
            before += math.log1p(-expected)
            positive = min(positive, _below(mean[i] / sd))
        if is_positive[term] and not one_sided:
            # Sizes of one effect go together (a load presses both wheels): the least likely one
            # decides.
            total += math.log(max(positive, _LEAST)) + width * math.log(2.0)
        total += math.log(max(-math.expm1(after), _LEAST)) - math.log(-math.expm1(before))
        place += width
    return total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _below(score: float) -> float:
    """Return the probability that a standard normal value is less."""
    return 0.5 * math.erfc(-score / math.sqrt(2.0))
