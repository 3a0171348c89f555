"""Draws from the posterior of a fitted set, as its evidence knows it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.evidence import Scored
from gap_diagnosis.recording import Floats

DRAWS: Final = 4000
_REDRAWN: Final = 30
"""So often what is no news is drawn again; what then remains there has none in it."""


def draw(scored: Scored, terms: Sequence[Term], rng: np.random.Generator) -> Floats:
    """Return draws float64[4000, k] of the coefficients from the posterior mixture.

    What lies within its tolerance is no news and is drawn again, as the evidence leaves it out;
    sizes that cannot be negative are never drawn so.
    """
    count = scored.means.shape[1]
    if count == 0:
        return np.zeros((DRAWS, 0))
    picked = rng.choice(len(scored.weights), size=DRAWS, p=scored.weights / scored.weights.sum())
    factors = np.linalg.cholesky(
        scored.covariances + 1e-18 * np.eye(count) * np.trace(scored.covariances[0])
    )
    draws = np.zeros((DRAWS, count))
    again = np.ones(DRAWS, dtype=np.bool_)
    for _ in range(_REDRAWN):
        which = picked[again]
        normal = rng.standard_normal((len(which), count))
        draws[again] = scored.means[which] + np.einsum("sij,sj->si", factors[which], normal)
        again = ~is_news(draws, terms)
        if not again.any():
            break
    column = 0
    for term in terms:
        for _ in term.weights:
            if term.variant.is_positive:
                draws[:, column] = np.abs(draws[:, column])
            column += 1
    return draws


def is_news(draws: Floats, terms: Sequence[Term]) -> NDArray[np.bool_]:
    """Tell of draws float64[s, k] whether each term has a coefficient beyond its tolerance, and no
    size is negative that cannot be."""
    news = np.ones(len(draws), dtype=np.bool_)
    column = 0
    for term in terms:
        beyond = np.zeros(len(draws), dtype=np.bool_)
        for tolerance in term.tolerances:
            size = draws[:, column]
            if term.variant.is_positive:
                news &= size >= 0
            beyond |= np.abs(size) > tolerance
            column += 1
        news &= beyond
    return news
