"""Which effects a log cannot tell apart: one is imitated by another, or by two together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Floats
from gap_diagnosis.visibility import Sights

Effects = frozenset[str]

_SLIGHT: Final = 1e-3
"""A wrong sign that would be worth this much of a standard deviation is no objection."""


@dataclass(frozen=True)
class Truth:
    """An effect of a certain size, to be told from others.

    Attributes:
        variant: how it acts.
        rows: its coefficients in the inner products.
        cases: float64[c, k]: their sizes, several where a phase or direction may be any.
        is_positive: whether the opposite sizes make no sense.
    """

    variant: Variant
    rows: tuple[int, ...]
    cases: Floats
    is_positive: bool

    @property
    def effect(self) -> str:
        """Its name."""
        return self.variant.effect


@dataclass(frozen=True)
class Sets:
    """Sets of coefficients that may imitate, padded to one width.

    Attributes:
        rows: int64[s, w] rows in the inner products.
        used: bool[s, w] which of them are meant.
        restraint: float64[s, w] inverse squares of sizes that are still believed.
        positive: bool[s, w] sizes that cannot be negative.
    """

    rows: NDArray[np.int64]
    used: NDArray[np.bool_]
    restraint: Floats
    positive: NDArray[np.bool_]

    def at(self, places: NDArray[np.int64]) -> Sets:
        """Return some of the sets."""
        return Sets(
            self.rows[places], self.used[places], self.restraint[places], self.positive[places]
        )

    def beside(self, other: Sets) -> Sets:
        """Return each set together with the other's of the same place."""
        return Sets(
            np.hstack([self.rows, other.rows]),
            np.hstack([self.used, other.used]),
            np.hstack([self.restraint, other.restraint]),
            np.hstack([self.positive, other.positive]),
        )

    def separations(self, inner: Floats, truth: Truth) -> Floats:
        """Return float64[s]: how far each set stays from the truth, as a mean over its cases.

        Infinite where sizes would have to be negative that cannot be.
        """
        both = self.used[:, :, None] & self.used[:, None, :]
        stiff = np.where(both, inner[self.rows[:, :, None], self.rows[:, None, :]], 0.0)
        diagonal = np.arange(self.rows.shape[1])
        stiff[:, diagonal, diagonal] += self.restraint
        own = list(truth.rows)
        pull = np.where(self.used[..., None], (inner[:, own] @ truth.cases.T)[self.rows], 0.0)
        sizes = np.linalg.solve(stiff, pull)
        total = np.einsum("ct,tu,cu->c", truth.cases, inner[np.ix_(own, own)], truth.cases)
        left = np.maximum(total - (pull * sizes).sum(axis=1), 0.0).mean(axis=1)
        weight = sizes * np.sqrt(np.maximum(np.diag(inner), 0.0))[self.rows][..., None]
        weight = np.where(self.positive[..., None], weight, 0.0)
        agrees = np.all(weight >= -_SLIGHT, axis=1)
        if not truth.is_positive:
            agrees |= np.all(weight <= _SLIGHT, axis=1)
        return np.where(agrees.all(axis=1), left, np.inf)


class Imitators:
    """The search for what leaves nearly the same data as an effect."""

    def __init__(self, sights: Sights) -> None:
        """Lay out every variant of every effect that has a size."""
        self._sights = sights
        variants = [
            (effect, variant)
            for effect, terms in sights.terms.items()
            if terms[0].variant.coefficients
            for variant in range(len(terms))
        ]
        self._owners = np.array([effect for effect, _ in variants], dtype=str)
        self._variants = [sights.terms[effect][place].variant for effect, place in variants]
        self._singles = _sets(sights, variants)

    def of(self, truth: Truth) -> list[Effects]:
        """Return single effects that imitate *truth*, or else pairs, the best first."""
        return [frozenset(one.effect for one in each) for each in self.accounts(truth)]

    def accounts(self, truth: Truth) -> list[tuple[Variant, ...]]:
        """Return the same as ways in which they act."""
        others = np.flatnonzero(self._owners != truth.effect)
        if len(others) == 0:
            return []
        inner = self._sights.beside(truth.effect)
        left = self._singles.at(others).separations(inner, truth)
        order = others[np.argsort(left, kind="stable")]
        names, first = np.unique(self._owners[order], return_index=True)
        best = dict(zip(order[first].tolist(), names.tolist(), strict=True))
        alone = [place for place in best if left[others == place][0] < THRESHOLD]
        if alone or len(best) < 2:
            return [(self._variants[place],) for place in alone]
        places = np.array(list(best))
        one, two = (places[side] for side in np.triu_indices(len(places), 1))
        pairs = self._singles.at(one).beside(self._singles.at(two))
        left = pairs.separations(inner, truth)
        return [
            (self._variants[one[place]], self._variants[two[place]])
            for place in np.argsort(left, kind="stable")
            if left[place] < THRESHOLD
        ]


def _sets(sights: Sights, variants: Sequence[tuple[str, int]]) -> Sets:
    rows = [sights.rows(*one) for one in variants]
    shape = (len(variants), max(map(len, rows), default=1))
    place, used = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.bool_)
    restraint, positive = np.ones(shape), np.zeros(shape, dtype=np.bool_)
    for index, (effect, variant) in enumerate(variants):
        count = len(rows[index])
        place[index, :count] = rows[index]
        used[index, :count] = True
        restraint[index, :count] = sights.restraint(effect, variant)
        positive[index, :count] = sights.terms[effect][variant].variant.is_positive
    return Sets(place, used, restraint, positive)


def merged(found: Mapping[str, Sequence[Effects]], always: Iterable[Effects]) -> list[Effects]:
    """Return groups: an effect with all that imitate it alone, or with the best pair that does.

    *always* are effects that no log like this tells apart; a group that has one has the other.
    """
    groups: list[Effects] = []
    for effect, others in found.items():
        singles = [one for one in others if len(one) == 1]
        if singles:
            groups.append(frozenset({effect}).union(*singles))
        groups += [one | {effect} for one in others if len(one) == 2][:1]
    twins = list(always)
    groups = [group.union(*(twin for twin in twins if group & twin)) for group in [*groups, *twins]]
    every = set(groups)
    return sorted((one for one in every if not any(one < other for other in every)), key=sorted)
