"""What straight lines leave out of a set's evidence: its sizes, weighed as the effects bend.

Evidence and intervals of the motion are exact for effects that act along straight lines about the
fit (motion/evidence.py). How far they bend within the posterior is asked of the effects themselves:
at the nodes of a quadrature for one size or two, at draws for more. Each is weighed by its
likelihood as the effects act over that along the lines; the logarithm of the mean weight is what
the evidence lacks. Half of the draws come from a wider posterior: where the effects' own is wider
than the lines', no weight is large (a defensive mixture: T. Hesterberg, Technometrics 37, 1995).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.drawing import draw, is_news
from gap_diagnosis.motion.evidence import Gram, Scored, gram_of, log_sum, score
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.pareto import TRUSTED, smoothed
from gap_diagnosis.recording import Floats

MANY: Final = 3
"""So many sizes are drawn; of fewer a quadrature has its nodes all over them."""
_NODES: Final = {1: (7, 21), 2: (5, 13)}
"""Nodes along each size, by how many sizes there are: of straight lines, and where effects bend."""
_MOST_OF_AN_EDGE: Final = 0.1
"""Where the outermost nodes have more of the sum than that, it goes on beyond them: it is drawn."""
_FEW: Final = 24
_STRAIGHT: Final = 0.1
"""Where a few draws' weights lie within so many nats of each other, more of them tell nothing."""
_WIDER: Final = 3.0
"""Variance of the wider half. The two sets of the Kobuki with a play have shapes of 0.6 to 1.0
without that half, of 0.3 to 0.4 with it."""
_DRAWS: Final = 400
_MOST_DRAWS: Final = 1600
_ERROR: Final = 0.1
"""Standard error [nat] of a log evidence above which more is drawn."""
_AT_ONCE: Final = 32
"""Draws whitened together: of an hour's log they take 12 MB."""


@dataclass(frozen=True)
class Corrected:
    """What a fitted set explains as its effects act.

    Attributes:
        log_evidence: as that of a `Refitted`, bends taken in where *pareto_k* allows.
        log_likelihood: along the lines about the best coefficients.
        error: standard error of the evidence [nat] by so many draws; 0 by quadrature.
        pareto_k: how heavy the tail of the draws' weights is; None by quadrature, and where the
            effects do not bend within the posterior: few draws' weights are alike.
    """

    log_evidence: float
    log_likelihood: float
    error: float = 0.0
    pareto_k: float | None = None


@dataclass(frozen=True)
class Drawn:
    """Draws from the posterior of a fitted set.

    Attributes:
        sizes: float64[n, k].
        log_weights: float64[n], smoothed; None where the effects do not bend within the posterior.
        log_shares: float64[n], the same if they acted along the lines.
        pareto_k: the shape of the weights' tail; None where they do not bend.
    """

    sizes: Floats
    log_weights: Floats | None = None
    log_shares: Floats | None = None
    pareto_k: float | None = None

    @property
    def is_trusted(self) -> bool:
        """Whether means over the draws converge."""
        return self.pareto_k is None or self.pareto_k < TRUSTED

    @property
    def gained(self) -> tuple[float, float]:
        """What the bends add to the log evidence, and its standard error [nat], infinite where no
        draw has a weight."""
        if self.log_weights is None or self.log_shares is None:
            return 0.0, 0.0
        top = float(self.log_weights.max())
        if top == -math.inf:
            return 0.0, math.inf
        weights, shares = np.exp(self.log_weights - top), np.exp(self.log_shares)
        mean = float(weights.sum() / shares.sum())
        error = float(np.sqrt(np.sum((weights - mean * shares) ** 2)) / weights.sum())
        return math.log(mean) + top, error

    def resampled(self, count: int, rng: np.random.Generator) -> Floats:
        """Return *count* draws, each as often as its weight says: float64[count, k]."""
        if self.log_weights is None:
            return self.sizes[:count]
        weights = np.exp(self.log_weights - self.log_weights.max())
        picked = rng.choice(len(weights), size=count, p=weights / weights.sum())
        return np.asarray(self.sizes[picked])


class Bends:
    """A fitted set about its best coefficients: straight lines, and the effects as they act.

    *dispersion*: how many times the log's likelihood is too sure.
    """

    def __init__(
        self, model: MotionModel, terms: Sequence[Term], fit: Refitted, dispersion: float = 1.0
    ) -> None:
        self._model, self._terms, self._fit = model, tuple(terms), fit
        self._dispersion = dispersion
        values, self._nuisances, self._tangent = model.linearised(
            terms, fit.coefficients, fit.levels
        )
        self._course: Course = model.scattered(terms, fit.coefficients, fit.levels)
        white, log_variance = whiten(values, self._course, fit.levels, model.nodes.ticks)
        lines = [place + 1 for term in self._tangent for one in term.weights for place, _ in one]
        known = [place + 1 for place, _ in self._nuisances]
        self._data, self._lines, self._known = white[:, 0], white[:, lines], white[:, known]
        self._restrained = self._known.T @ self._known
        self._restrained += np.diag([sd**-2 for _, sd in self._nuisances])
        self._gram: Gram = gram_of(white, log_variance, self._nuisances, fit.levels)
        self._best = np.concatenate([np.array(one, dtype=np.float64) for one in fit.coefficients])
        own = values[..., 0] - values[..., lines] @ self._best
        self._unexplained = own - self._changes(self._best)

    @cached_property
    def scored(self) -> Scored:
        """The posterior along the lines, with as much more variance as the likelihood is too
        sure."""
        scored = score(self._gram, self._tangent, self._model.prior)
        return replace(scored, covariances=scored.covariances * self._dispersion)

    @property
    def sizes(self) -> int:
        """How many there are."""
        return len(self._best)

    def corrected(self) -> Corrected:
        """Return evidence and likelihood about the best coefficients, with what the bends add."""
        density = self._model.level_prior.log_density(np.log(self._fit.levels))
        offset = self._gram.log_nothing + density
        straight = Corrected(offset + self.scored.log_evidence, offset + self.scored.log_likelihood)
        if self.sizes == 0:
            return straight
        told = self._by_quadrature() if self.sizes < MANY else None
        if told is not None:
            return replace(straight, log_evidence=straight.log_evidence + told)
        few = self._along[:_FEW]
        drawn = Drawn(few, self._weights_of_few, np.zeros(len(few)))
        if drawn.gained[1] > 0.5 * _ERROR:
            drawn = self.drawn(_DRAWS)
        if drawn.is_trusted and drawn.gained[1] > _ERROR:
            drawn = self.drawn(_MOST_DRAWS)
        if not drawn.is_trusted:
            return replace(straight, pareto_k=drawn.pareto_k)
        gain, error = drawn.gained
        evidence = straight.log_evidence + gain
        return replace(straight, log_evidence=evidence, error=error, pareto_k=drawn.pareto_k)

    def drawn(self, count: int) -> Drawn:
        """Return draws, always the same; weighed, *count* of them, where the effects bend.

        Not where none has a weight, as of a set of which a size lies within its tolerance, far
        from the end: its evidence is what the lines say.
        """
        terms = [term for term in self._terms if not term.is_fixed]
        if np.ptp(self._weights_of_few) < _STRAIGHT:
            return Drawn(self._along)
        wide = replace(self.scored, covariances=self.scored.covariances * _WIDER)
        rng = np.random.default_rng(0)
        halves = (_anywhere(one, count // 2, rng) for one in (self.scored, wide))
        sizes = np.concatenate(list(halves))
        own, other = (_log_density(sizes, one) for one in (self.scored, wide))
        shares = own - np.logaddexp(own, other) + math.log(2)
        shares[~is_news(sizes, terms)] = -np.inf
        weights = shares + self.log_weights(sizes)
        if not np.isfinite(weights).any():
            return Drawn(self._along)
        weights, pareto_k = smoothed(weights)
        return Drawn(sizes, weights, shares, pareto_k)

    @cached_property
    def _along(self) -> Floats:
        """Draws from the posterior along the lines, float64[4000, k]."""
        terms = [term for term in self._terms if not term.is_fixed]
        return draw(self.scored, terms, np.random.default_rng(0))

    @cached_property
    def _weights_of_few(self) -> Floats:
        """Log weights of the first few of these, float64[24]."""
        return self.log_weights(self._along[:_FEW])

    def log_weights(self, sizes: Floats) -> Floats:
        """Return log likelihoods of sizes float64[n, k] as the effects act, less those along the
        lines: float64[n]. Tolerances are marginalised in both."""
        straight = self._left(self._data[:, np.newaxis] - self._lines @ sizes.T)
        bent = np.concatenate([self._left(some) for some in self._bent(sizes)])
        logs = 0.5 * (straight - bent) / self._dispersion
        return np.where(np.isfinite(logs), logs, -np.inf)

    def _by_quadrature(self) -> float | None:
        """Return the logarithm of the mean weight of one size or two; None where much of it lies
        beyond the nodes, which draws reach."""
        few, many = _NODES[self.sizes]
        gain, differ = self._over_nodes(few)
        return gain if differ < _STRAIGHT else self._over_nodes(many)[0]

    def _over_nodes(self, count: int) -> tuple[float | None, float]:
        """Return the same by so many nodes along each size, and by how much their weights differ
        [nat]."""
        terms = [term for term in self._terms if not term.is_fixed]
        shares = self.scored.weights / self.scored.weights.sum()
        mean = shares @ self.scored.means
        away = self.scored.means - mean
        spread = np.einsum("s,sij->ij", shares, self.scored.covariances)
        spread += np.einsum("s,si,sj->ij", shares, away, away)
        axis, weight = hermegauss(count)
        nodes = np.array(list(product(axis, repeat=self.sizes)))
        is_edge = np.abs(nodes).max(axis=1) == axis[-1]
        sizes = mean + nodes @ np.linalg.cholesky(spread).T
        log_shares = np.log([math.prod(one) for one in product(weight, repeat=self.sizes)])
        log_shares += _log_density(sizes, self.scored) + 0.5 * (nodes**2).sum(axis=1)
        inside = is_news(sizes, terms)
        if not inside.any():
            return 0.0, 0.0
        log_shares, sizes, is_edge = log_shares[inside], sizes[inside], is_edge[inside]
        weights = self.log_weights(sizes)
        logs = log_shares + weights
        whole = log_sum(logs)
        edge = float(np.exp(logs[is_edge] - whole).sum())
        gain = None if edge > _MOST_OF_AN_EDGE else whole - log_sum(log_shares)
        return gain, float(np.ptp(weights))

    def _bent(self, sizes: Floats) -> Iterator[Floats]:
        """Yield what sizes leave of the data as the effects act, whitened, some at a time."""
        for place in range(0, len(sizes), _AT_ONCE):
            some = [
                self._unexplained + self._changes(one) for one in sizes[place : place + _AT_ONCE]
            ]
            columns = np.ascontiguousarray(np.stack(some, axis=-1))
            yield whiten(columns, self._course, self._fit.levels, self._model.nodes.ticks)[0]

    def _left(self, white: Floats) -> Floats:
        """Return sums of squares float64[n] of whitened columns, tolerances marginalised."""
        across = self._known.T @ white
        explained = (across * np.linalg.solve(self._restrained, across)).sum(axis=0)
        return np.asarray((white**2).sum(axis=0) - explained)

    def _changes(self, sizes: Floats) -> Floats:
        """Return the residuals with these sizes of the effects, without the data's details."""
        settings = []
        place = 0
        for term in self._terms:
            width = 0 if term.is_fixed else len(term.variant.coefficients)
            own = tuple(float(one) for one in sizes[place : place + width])
            settings.append((term.variant, own))
            place += width
        return residuals(self._model.nodes, predict(self._model.nodes.smooth, settings))


def _anywhere(scored: Scored, count: int, rng: np.random.Generator) -> Floats:
    """Return draws float64[count, k] from a posterior's mixture, within tolerances too."""
    picked = rng.choice(len(scored.weights), size=count, p=scored.weights / scored.weights.sum())
    normal = rng.standard_normal((count, scored.means.shape[1]))
    factors = np.linalg.cholesky(scored.covariances)
    return np.asarray(scored.means[picked] + np.einsum("sij,sj->si", factors[picked], normal))


def _log_density(sizes: Floats, scored: Scored) -> Floats:
    """Return the log density float64[n] of a posterior's mixture, but for a constant."""
    parts = []
    for mean, covariance, share in zip(
        scored.means, scored.covariances, scored.weights, strict=True
    ):
        away = np.linalg.solve(np.linalg.cholesky(covariance), (sizes - mean).T)
        parts.append(
            np.log(max(float(share), 1e-300))
            - 0.5 * (away**2).sum(axis=0)
            - 0.5 * np.linalg.slogdet(covariance)[1]
        )
    return np.asarray(np.logaddexp.reduce(parts))
