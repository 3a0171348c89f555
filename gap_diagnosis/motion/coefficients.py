"""Coefficients of several terms: one tuple for each."""

from __future__ import annotations

from collections.abc import Sequence

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.recording import Floats


def split(terms: Sequence[Term], values: Floats) -> tuple[tuple[float, ...], ...]:
    """Return values, one after the other, by term; a variant that is fixed has none."""
    parts = []
    place = 0
    for term in terms:
        width = 0 if term.is_fixed else len(term.weights)
        parts.append(tuple(float(value) for value in values[place : place + width]))
        place += width
    return tuple(parts)


def bounded(
    terms: Sequence[Term], coefficients: tuple[tuple[float, ...], ...]
) -> tuple[tuple[float, ...], ...]:
    """Keep sizes that cannot be negative at their tolerance or more: below, no slope is told."""
    return tuple(
        tuple(max(value, low) for value, low in zip(one, term.tolerances, strict=True))
        if term.variant.is_positive
        else one
        for term, one in zip(terms, coefficients, strict=True)
    )
