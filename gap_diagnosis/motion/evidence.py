"""Log evidence of sets of effects from one Gram matrix.

At given noise levels the whitened log is a linear regression on the effects' columns. Parameters
within tolerance are always free and marginalised first; an effect adds a coefficient whose prior
is a mixture of normals over orders of magnitude, so that every integral is exact; then what lies
inside the tolerance is cut off, because that is no news (Bayesian linear regression: Bishop 2006,
section 3.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtr

from gap_diagnosis.motion.columns import Columns, Term
from gap_diagnosis.motion.whitening import Course, whiten
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats

_SCALES: Final = 5
_ALMOST: Final = 1 - 1e-16


@dataclass(frozen=True)
class Gram:
    """Inner products of all whitened base columns, tolerances marginalised.

    Attributes:
        levels: at which noise levels.
        log_nothing: log evidence of no effect.
        inner: float64[c, c] and
        data: float64[c]: of the base columns with each other and with the data.
        full_inner, full_data: before the tolerances were marginalised.
    """

    levels: Floats
    log_nothing: float
    inner: Floats
    data: Floats
    full_inner: Floats
    full_data: Floats


def make_gram(columns: Columns, course: Course, levels: Floats, ticks: Floats) -> Gram:
    """Whiten and multiply."""
    white, log_determinant, rows = whiten(columns.values, course, levels, ticks)
    whole = white.T @ white
    return gram_of(whole, log_determinant, rows, columns.nuisances, levels)


def gram_of(
    whole: Floats,
    log_determinant: float,
    rows: int,
    nuisances: Sequence[tuple[int, float]],
    levels: Floats,
) -> Gram:
    """Marginalise the nuisances out of inner products float64[1 + c, 1 + c] (data first)."""
    data, inner = whole[0, 1:], whole[1:, 1:]
    index = np.array([column for column, _ in nuisances], dtype=np.int64)
    precision = np.array([sd**-2 for _, sd in nuisances])
    log_nothing = -0.5 * (whole[0, 0] + log_determinant + rows * math.log(math.tau))
    if len(index) == 0:
        return Gram(levels, log_nothing, inner, data, inner, data)
    # Scaled by the prior, so that the Cholesky factor stays well conditioned.
    scale = 1 / np.sqrt(precision)
    small = np.eye(len(index)) + scale[:, None] * inner[np.ix_(index, index)] * scale
    factor = cho_factor(small, lower=True)
    across = scale[:, None] * inner[index]
    solved = cho_solve(factor, across)
    solved_data = cho_solve(factor, scale * data[index])
    log_nothing += 0.5 * float((scale * data[index]) @ solved_data)
    log_nothing -= float(np.log(np.diag(factor[0])).sum())
    return Gram(
        levels,
        log_nothing,
        inner - across.T @ solved,
        data - across.T @ solved_data,
        inner,
        data,
    )


@dataclass(frozen=True)
class Scored:
    """A set of terms at one set of levels.

    Attributes:
        terms: what acts.
        log_evidence: less that of no effect at the same levels.
        log_likelihood: at the best coefficients, less that of none.
        means, covariances: per mixture component of the prior.
        weights: of those components.
    """

    terms: tuple[Term, ...]
    log_evidence: float
    log_likelihood: float
    means: Floats
    covariances: Floats
    weights: Floats


def reduce_to(gram: Gram, terms: Sequence[Term]) -> tuple[Floats, Floats]:
    """Return inner products float64[k, k] and float64[k] of the terms' coefficients."""
    weights = [weight for term in terms for weight in term.weights]
    used = sorted({index for weight in weights for index, _ in weight})
    place = {index: row for row, index in enumerate(used)}
    mix = np.zeros((len(used), len(weights)))
    for column, weight in enumerate(weights):
        for index, value in weight:
            mix[place[index], column] = value
    block = gram.inner[np.ix_(used, used)]
    return mix.T @ block @ mix, mix.T @ gram.data[used]


def log_sum(logarithms: Floats) -> float:
    """Return the logarithm of a sum given by logarithms."""
    top = float(logarithms.max())
    return top + math.log(float(np.exp(logarithms - top).sum()))


def score(gram: Gram, terms: Sequence[Term], prior: Prior) -> Scored:
    """Return the evidence of *terms* acting together."""
    inner, data = reduce_to(gram, terms)
    fixed = np.array([term.is_fixed for term in terms for _ in term.weights])
    gained = 0.0
    if fixed.any():
        ones = fixed.astype(np.float64)
        gained = float(data @ ones - 0.5 * ones @ inner @ ones)
        data = (data - inner @ ones)[~fixed]
        inner = inner[np.ix_(~fixed, ~fixed)]
    free = [term for term in terms if not term.is_fixed]
    count = len(data)
    if count == 0:
        none = np.zeros((1, 0))
        return Scored(tuple(terms), gained, gained, none, np.zeros((1, 0, 0)), np.ones(1))
    choices = [
        [
            np.array([_scale(prior, term, i, j) for i in range(len(term.weights))])
            for j in range(_SCALES)
        ]
        for term in free
    ]
    scales = np.array([np.concatenate(one) for one in product(*choices)])
    eye = np.eye(count)
    small = eye + scales[:, :, None] * inner * scales[:, None, :]
    scaled = scales * data
    solved = np.linalg.solve(small, scaled[..., None])[..., 0]
    means = scales * solved
    covariances = scales[:, :, None] * np.linalg.inv(small) * scales[:, None, :]
    _, log_det = np.linalg.slogdet(small)
    log_parts = 0.5 * (scaled * solved).sum(axis=1) - 0.5 * log_det
    sds = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 1e-300))
    log_parts = log_parts + _news(free, means, sds, scales)
    total = log_sum(log_parts)
    whole = total - math.log(len(log_parts))
    ridge = inner + 1e-10 * np.diag(np.maximum(np.diag(inner), 1e-12))
    best = np.linalg.solve(ridge, data)
    likelihood = gained + float(data @ best - 0.5 * best @ inner @ best)
    weights = np.exp(log_parts - total)
    return Scored(tuple(terms), gained + whole, likelihood, means, covariances, weights)


def _scale(prior: Prior, term: Term, coefficient: int, step: int) -> float:
    known = prior.of(term.variant.effect, term.variant.coefficients[coefficient])
    low = max(term.tolerances[coefficient], 1e-3 * known.high)
    return float(low * (known.high / low) ** (step / (_SCALES - 1)))


def _news(free: Sequence[Term], means: Floats, sds: Floats, scales: Floats) -> Floats:
    """Log of how much likelier it has become that each effect is beyond its tolerance."""
    total = np.zeros(len(means))
    place = 0
    for term in free:
        # Log of the probability that every coefficient is within its tolerance.
        after, before = np.zeros(len(means)), np.zeros(len(means))
        one_sided = term.variant.is_positive and len(term.tolerances) == 1
        if term.variant.is_positive and not one_sided:
            total += _log_positive(term, means, sds, place)
        for tolerance in term.tolerances:
            mean, sd, scale = means[:, place], sds[:, place], scales[:, place]
            beyond, expected = ndtr((mean - tolerance) / sd), ndtr(-tolerance / scale)
            if not one_sided:
                beyond = beyond + ndtr((-tolerance - mean) / sd)
                expected = 2 * expected
            after += np.log1p(-np.minimum(beyond, _ALMOST))
            before += np.log1p(-expected)
            place += 1
        total += np.log(np.maximum(-np.expm1(after), 1e-300)) - np.log(-np.expm1(before))
    return total


def _log_positive(term: Term, means: Floats, sds: Floats, place: int) -> Floats:
    """Log of how much likelier it has become that no coefficient is negative.

    Sizes of one effect go together (a load presses both wheels): the least likely one decides.
    """
    own = slice(place, place + len(term.tolerances))
    positive = ndtr(means[:, own] / sds[:, own]).min(axis=1)
    return np.asarray(np.log(np.maximum(positive, 1e-300)) + len(term.tolerances) * math.log(2))
