"""Log evidence of sets of effects from one Gram matrix.

At given noise levels the whitened log is a linear regression on the effects' columns. Parameters
within tolerance are always free and marginalised first; an effect adds a coefficient whose prior
is a mixture of normals over orders of magnitude, so that every integral is exact; then what lies
inside the tolerance is cut off, because that is no news (Bayesian linear regression: Bishop 2006,
section 3.5).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import Columns, Term
from gap_diagnosis.motion.components import fitted, update
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats

_SCALES: Final = 5
_ALL_SCALES: Final = 3
"""Of so many terms every choice of scales is weighed."""
_STEPS: Final = np.linspace(0.0, 1.0, _SCALES)[:, np.newaxis]
_NEVER: Final = -1e15


@dataclass(frozen=True)
class Gram:
    """Inner products of all whitened base columns, tolerances marginalised.

    Attributes:
        levels: at which noise levels.
        log_nothing: log evidence of no effect.
        inner: float64[c, c] and
        data: float64[c]: of the base columns with each other and with the data.
        full_inner, full_data: before the tolerances were marginalised.
        restraint: inverse variance beforehand of each column that a tolerance is.
        left_over: square of the data beside the best tolerances.
    """

    levels: Floats
    log_nothing: float
    inner: Floats
    data: Floats
    full_inner: Floats
    full_data: Floats
    restraint: Mapping[int, float] = field(default_factory=dict)
    left_over: float = 0.0


def make_gram(columns: Columns, course: Course, levels: Floats, ticks: Floats) -> Gram:
    """Whiten and multiply."""
    return gram_of(*whiten(columns.values, course, levels, ticks), columns.nuisances, levels)


def _never(levels: Floats, inner: Floats, data: Floats) -> Gram:
    """Return the products at which nothing is believed."""
    none, nothing = np.zeros_like(inner), np.zeros_like(data)
    return Gram(levels, _NEVER, none, nothing, none, nothing)


def gram_of(
    white: Floats,
    log_variance: Floats,
    nuisances: Sequence[tuple[int, float]],
    levels: Floats,
) -> Gram:
    """Multiply whitened rows float64[r, 1 + c] (data first) and marginalise the nuisances.

    *log_variance*: of each row before it was whitened, float64[r].
    """
    whole = white.T @ white
    data, inner = whole[0, 1:], whole[1:, 1:]
    if not np.isfinite(whole).all():
        # Levels too far apart for the filter's digits: whatever they are, the log's they are not.
        return _never(levels, inner, data)
    index = np.array([column for column, _ in nuisances], dtype=np.int64)
    precision = np.array([sd**-2 for _, sd in nuisances])
    log_nothing = -0.5 * (whole[0, 0] + float(log_variance.sum()) + len(white) * math.log(math.tau))
    if len(index) == 0:
        return Gram(levels, log_nothing, inner, data, inner, data, left_over=float(whole[0, 0]))
    # Scaled by the prior, so that the Cholesky factor stays well conditioned.
    scale = 1 / np.sqrt(precision)
    small = np.eye(len(index)) + scale[:, None] * inner[np.ix_(index, index)] * scale
    try:
        factor = cho_factor(small, lower=True, check_finite=False)
    except LinAlgError:
        # A step of a fit to where columns are larger than all digits hold: it leads nowhere.
        return _never(levels, inner, data)
    across = scale[:, None] * inner[index]
    solved = cho_solve(factor, across, check_finite=False)
    solved_data = cho_solve(factor, scale * data[index], check_finite=False)
    explained = float((scale * data[index]) @ solved_data)
    log_nothing += 0.5 * explained
    log_nothing -= float(np.log(np.diag(factor[0])).sum())
    return Gram(
        levels,
        log_nothing,
        inner - across.T @ solved,
        data - across.T @ solved_data,
        inner,
        data,
        dict(zip(index.tolist(), precision.tolist(), strict=True)),
        float(whole[0, 0]) - explained,
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


def reduce_to(gram: Gram, terms: Sequence[Term]) -> tuple[Floats, Floats, float]:
    """Return inner products float64[k, k] and float64[k] of the terms' coefficients, and what it
    costs [nat] that tolerances which are little of the same effects are held at nothing.

    An effect is the whole deviation: a chord and its own tangent, both free, would leave the way's
    bends between them, and in these stands the rows' own noise.
    """
    weights = [weight for term in terms for weight in term.weights]
    if all(len(weight) == 1 and weight[0][1] == 1.0 for weight in weights):
        own = [weight[0][0] for weight in weights]
        return _among(gram.inner, own), gram.data.take(own), 0.0
    used = sorted({index for weight in weights for index, _ in weight})
    place = {index: row for row, index in enumerate(used)}
    mix = np.zeros((len(used), len(weights)))
    for column, weight in enumerate(weights):
        for index, value in weight:
            mix[place[index], column] = value
    block, data, cost = _among(gram.inner, used), gram.data.take(used), 0.0
    little = {index for weight in weights for index, value in weight if value == 0.0}
    held = sorted(place[index] for index in little & gram.restraint.keys())
    if held:
        # The reverse of marginalising: what that took away came through these columns alone.
        beforehand = np.array([gram.restraint[used[row]] for row in held])
        across, pull = block.take(held, 0), data.take(held)
        left = np.diag(beforehand) - across.take(held, 1)
        back = np.linalg.solve(left, np.column_stack([pull, across]))
        cost = -0.5 * float(pull @ back[:, 0])
        cost += 0.5 * float(np.log(beforehand).sum() - np.linalg.slogdet(left)[1])
        along = block.take(held, 1)
        data = data + along @ back[:, 0]
        block = block + along @ back[:, 1:]
    return mix.T @ block @ mix, mix.T @ data, cost


def _among(inner: Floats, own: list[int]) -> Floats:
    """Return the inner products of some columns with each other."""
    return inner.take(own, 0).take(own, 1)


def log_sum(logarithms: Floats) -> float:
    """Return the logarithm of a sum given by logarithms."""
    top = float(logarithms.max())
    return top + math.log(float(np.exp(logarithms - top).sum()))


def score(gram: Gram, terms: Sequence[Term], prior: Prior) -> Scored:
    """Return the evidence of *terms* acting together."""
    inner, data, gained = reduce_to(gram, terms)
    free = [term for term in terms if not term.is_fixed]
    if len(free) < len(terms):
        fixed = np.array([term.is_fixed for term in terms for _ in term.weights])
        ones = fixed.astype(np.float64)
        gained += float(data @ ones - 0.5 * ones @ inner @ ones)
        data = (data - inner @ ones)[~fixed]
        inner = inner[np.ix_(~fixed, ~fixed)]
    if len(data) == 0:
        none = np.zeros((1, 0))
        return Scored(tuple(terms), gained, gained, none, np.zeros((1, 0, 0)), np.ones(1))
    ladders = [scales_of(prior, term) for term in free]
    high = np.concatenate([one[-1] for one in ladders])
    best, pulled, explained = fitted(inner, data, high)
    ladders, costs = _reaching(pulled, high, ladders, free, prior)
    steps = _combinations(len(free)) if len(free) <= _ALL_SCALES else _nearest(ladders, best)
    means, covariances, log_parts = update(
        inner,
        data,
        np.concatenate([ladder[steps[:, place]] for place, ladder in enumerate(ladders)], axis=1),
        np.array([tolerance for term in free for tolerance in term.tolerances]),
        np.array([len(term.tolerances) for term in free]),
        np.array([term.variant.is_positive for term in free]),
    )
    log_parts = log_parts - (steps == _SCALES - 1) @ costs
    total = log_sum(log_parts)
    whole = total - len(free) * math.log(_SCALES)
    likelihood = gained + explained
    weights = np.exp(log_parts - total)
    return Scored(tuple(terms), gained + whole, likelihood, means, covariances, weights)


@cache
def _combinations(terms: int) -> NDArray[np.int64]:
    """Return every choice of a step for each term: int64[_SCALES ** terms, terms]."""
    return np.array(list(product(range(_SCALES), repeat=terms)), dtype=np.int64)


def _nearest(ladders: Sequence[Floats], sizes: Floats) -> NDArray[np.int64]:
    """Return the choices of each term's two steps next to its size: int64[2 ** terms, terms].

    Of many terms all choices are too many; those far from the sizes have no weight.
    """
    near = []
    place = 0
    for ladder in ladders:
        own = np.abs(sizes[place : place + ladder.shape[1]])
        place += ladder.shape[1]
        away = np.abs(np.log(ladder / np.maximum(own, ladder[0])).max(axis=1))
        near.append(sorted(np.argsort(away, kind="stable")[:2]))
    return np.array(list(product(*near)), dtype=np.int64)


def _reaching(
    pulled: Floats, high: Floats, ladders: list[Floats], free: Sequence[Term], prior: Prior
) -> tuple[list[Floats], Floats]:
    """Return each term's orders of magnitude, the largest (*high*) where the data have *pulled* it,
    and what that costs [nat]: float64[terms].

    A size beyond the end of its prior is as rare as a square says, not as a normal tail does: of
    two parameters that together are far off, a normal tail would have both be half as far.
    """
    costs = np.zeros(len(free))
    if (pulled <= high).all():
        return ladders, costs
    place = 0
    for one, (term, ladder) in enumerate(zip(free, ladders, strict=True)):
        own = slice(place, place + ladder.shape[1])
        place = own.stop
        most = [prior.of(term.variant.effect, name).most for name in term.variant.coefficients]
        reach = np.clip(pulled[own], high[own], np.maximum(most, high[own]))
        costs[one] = float(np.log(reach / high[own]).sum())
        ladders[one] = np.vstack([ladder[:-1], reach])
    return ladders, costs


def scales_of(prior: Prior, term: Term) -> Floats:
    """Return the orders of magnitude of a term's coefficients: float64[_SCALES, k]."""
    names = term.variant.coefficients
    high = tuple(prior.of(term.variant.effect, name).high for name in names)
    return _ladder(high, tuple(term.tolerances[: len(names)]))


@cache
def _ladder(high: tuple[float, ...], tolerances: tuple[float, ...]) -> Floats:
    """Return orders of magnitude from what is no news, or nearly nothing, to the largest."""
    most = np.array(high)
    low = np.maximum(tolerances, 1e-3 * most)
    return np.asarray(low * (most / low) ** _STEPS)
