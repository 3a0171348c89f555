"""Which effects a log cannot tell apart: one is imitated by another, or by two together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Floats
from gap_diagnosis.visibility import Sights, left_over

Effects = frozenset[str]

_SLIGHT: Final = 1e-9


@dataclass(frozen=True)
class Truth:
    """An effect of a certain size, to be told from others.

    Attributes:
        effect: its name.
        variant: which of its variants.
        rows: its coefficients in the inner products.
        cases: float64[c, k]: their sizes, several where a phase or direction may be any.
        is_positive: whether the opposite sizes make no sense.
    """

    effect: str
    variant: int
    rows: tuple[int, ...]
    cases: Floats
    is_positive: bool


def imitators(sights: Sights, truth: Truth) -> list[Effects]:
    """Return single effects, then pairs, that leave nearly the same data as *truth*.

    A pair counts only where neither of the two does alone.
    """
    inner = sights.beside({truth.effect})
    alone: list[Effects] = []
    best: dict[str, tuple[int, ...]] = {}
    for effect, terms in sights.terms.items():
        if effect == truth.effect or not terms[0].variant.coefficients:
            continue
        left, variant = min(
            (_separation(sights, inner, truth, ((effect, index),)), index)
            for index in range(len(terms))
        )
        if left < THRESHOLD:
            alone.append(frozenset({effect}))
        else:
            best[effect] = (variant,)
    pairs = [
        (left, frozenset({first, second}))
        for first, second in combinations(best, 2)
        if (
            left := _separation(
                sights, inner, truth, ((first, best[first][0]), (second, best[second][0]))
            )
        )
        < THRESHOLD
    ]
    return alone + [pair for _, pair in sorted(pairs, key=lambda one: (one[0], sorted(one[1])))]


def _separation(
    sights: Sights, inner: Floats, truth: Truth, others: Sequence[tuple[str, int]]
) -> float:
    """Return the mean separation over the truth's cases; infinite where signs cannot agree."""
    rows: list[int] = []
    restraint: list[float] = []
    positive: list[bool] = []
    for effect, variant in others:
        own = sights.rows(effect, variant)
        rows += own
        restraint += list(sights.restraint(effect, variant))[: len(own)]
        positive += [sights.terms[effect][variant].variant.is_positive] * len(own)
    if not rows:
        return float("inf")
    total = 0.0
    for amounts in truth.cases:
        left, sizes = left_over(inner, truth.rows, amounts, rows, np.array(restraint))
        sized = sizes[np.array(positive)] * np.sqrt(np.diag(inner)[rows])[np.array(positive)]
        if sized.size and not _agree(sized, truth.is_positive):
            return float("inf")
        total += left
    return total / len(truth.cases)


def _agree(sizes: Floats, is_positive: bool) -> bool:
    """Tell whether sizes that cannot be negative are none, for one sign of the truth at least."""
    upward = bool(np.all(sizes > -_SLIGHT))
    return upward or (not is_positive and bool(np.all(sizes < _SLIGHT)))


def merged(found: Mapping[str, Sequence[Effects]], always: Iterable[Effects]) -> list[Effects]:
    """Return groups: an effect with all that imitate it alone, and with its best pair of helpers.

    What imitates one another belongs together; *always* are effects that no log tells apart.
    """
    groups: list[Effects] = []
    for effect, others in found.items():
        singles = [one for one in others if len(one) == 1]
        if singles:
            groups.append(frozenset({effect}).union(*singles))
        groups += [one | {effect} for one in others if len(one) == 2][:1]
    twins = [set(one) for one in always]
    widened = [
        group.union(*(twin for twin in twins if group & twin)) if twins else group
        for group in groups
    ]
    every = {frozenset(one) for one in [*widened, *twins]}
    return sorted((one for one in every if not any(one < other for other in every)), key=sorted)
