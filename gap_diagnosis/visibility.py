"""What a log can see: inner products of whitened effects, and how well some stand in for others.

All of it follows from the manoeuvres and the noise; no fit is made. The separation of two
hypotheses is twice the expected difference of their best log likelihoods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gap_diagnosis.motion.columns import Columns, Term
from gap_diagnosis.motion.evidence import Gram
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats

Key = tuple[str, int, int]
"""An effect, which of its variants, which of that variant's coefficients."""


@dataclass(frozen=True)
class Sight:
    """The inner products of one log's columns at its noise levels.

    Attributes:
        terms: by effect, its variants.
        keys: every coefficient of every variant.
        inner: float64[k, k] of these coefficients' columns.
        across: float64[q, k] of them with the columns that are free within tolerance.
        free: float64[q, q] of those columns with each other.
        owners: the effect of each of those columns.
        free_sd: float64[q], their standard deviations.
        prior: sizes beyond which no coefficient is believed.
    """

    terms: Mapping[str, tuple[Term, ...]]
    keys: tuple[Key, ...]
    inner: Floats
    across: Floats
    free: Floats
    owners: tuple[str, ...]
    free_sd: Floats
    prior: Prior

    @cached_property
    def effects(self) -> frozenset[str]:
        """The effects that have a column."""
        return frozenset(self.terms)

    @cached_property
    def _posterior(self) -> tuple[Floats, Floats, Floats]:
        """Return the tolerances' posterior covariance, their slopes, and what is left of inner."""
        covariance: Floats = np.asarray(
            np.linalg.inv(self.free + np.diag(self.free_sd**-2.0)), dtype=np.float64
        )
        slopes = covariance @ self.across
        return covariance, slopes, self.inner - self.across.T @ slopes

    def beside(self, *effects: str) -> Floats:
        """Return inner products float64[k, k] with the tolerances of all but *effects* free.

        What of an effect lies within its own tolerance is still the effect.
        """
        if not self.owners:
            return self.inner
        covariance, slopes, left = self._posterior
        own = [row for row, owner in enumerate(self.owners) if owner in effects]
        if not own:
            return left
        # Holding some tolerances at zero again: the inverse of marginalising them.
        back = np.linalg.solve(covariance[np.ix_(own, own)], slopes[own])
        return np.asarray(left + slopes[own].T @ back)


def sight_of(columns: Columns, gram: Gram, prior: Prior) -> Sight:
    """Return what the columns of a log say of each other."""
    terms: dict[str, list[Term]] = {}
    keys: list[Key] = []
    mix: list[tuple[tuple[int, float], ...]] = []
    owner_of: dict[int, str] = {}
    for term in columns.terms:
        effect = term.variant.effect
        variant = len(terms.setdefault(effect, []))
        terms[effect].append(term)
        for coefficient, weight in enumerate(term.weights):
            keys.append((effect, variant, coefficient))
            mix.append(weight)
            for index, _ in weight:
                owner_of[index] = effect
    weights = np.zeros((gram.full_inner.shape[0], len(keys)))
    for column, weight in enumerate(mix):
        for index, value in weight:
            weights[index, column] = value
    rows = [index for index, _ in columns.nuisances]
    return Sight(
        terms={effect: tuple(some) for effect, some in terms.items()},
        keys=tuple(keys),
        inner=weights.T @ gram.full_inner @ weights,
        across=gram.full_inner[rows] @ weights,
        free=gram.full_inner[np.ix_(rows, rows)],
        owners=tuple(owner_of.get(index, "") for index in rows),
        free_sd=np.array([sd for _, sd in columns.nuisances]),
        prior=prior,
    )


@dataclass(frozen=True)
class Sights:
    """Several logs together: what each sees adds up, with the same sizes of effects in all."""

    logs: tuple[Sight, ...]

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """Every coefficient that some log knows."""
        return tuple(dict.fromkeys(key for one in self.logs for key in one.keys))

    @cached_property
    def place(self) -> Mapping[Key, int]:
        """Row of each key."""
        return {key: row for row, key in enumerate(self.keys)}

    @cached_property
    def terms(self) -> Mapping[str, tuple[Term, ...]]:
        """By effect its variants, as the log that knows most of them has it."""
        found: dict[str, tuple[Term, ...]] = {}
        for log in self.logs:
            for effect, terms in log.terms.items():
                if len(terms) > len(found.get(effect, ())):
                    found[effect] = terms
        return found

    @cached_property
    def prior(self) -> Prior:
        """Of the first log."""
        return self.logs[0].prior

    def beside(self, *effects: str) -> Floats:
        """Return inner products float64[k, k], added up; see `Sight.beside`."""
        if len(self.logs) == 1:
            return self.logs[0].beside(*effects)
        total = np.zeros((len(self.keys), len(self.keys)))
        for log in self.logs:
            rows = [self.place[key] for key in log.keys]
            total[np.ix_(rows, rows)] += log.beside(*effects)
        return total

    def rows(self, effect: str, variant: int) -> list[int]:
        """Return the rows of one variant's coefficients."""
        count = len(self.terms[effect][variant].weights)
        keys = ((effect, variant, coefficient) for coefficient in range(count))
        return [self.place[key] for key in keys if key in self.place]

    def restraint(self, effect: str, variant: int) -> Floats:
        """Return float64[k]: coefficients far beyond the prior's high end are not believed."""
        names = self.terms[effect][variant].variant.coefficients
        return np.array([self.prior.of(effect, name).high ** -2.0 for name in names])
