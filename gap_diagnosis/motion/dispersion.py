"""By how much the evidence of a log is too large where no model of it is right.

Noise levels are sought until the log's surprises are of unit size on average, so their size says
nothing. But where the model is right they are independent, and what the stretches of a log say of
any pattern scatters as the noise does. Where it is not, a turn or a stop leaves surprises that
hang together, and stretches scatter by more. The mean ratio, over the patterns of all effects, is
the log's dispersion: log likelihoods are divided by it (quasi-likelihood, with the dispersion
of the most general model: Wedderburn 1974, Biometrika 61; Burnham and Anderson 2002, section 2.5;
of dependent data with stretches as clusters: Pauli, Racugno and Ventura 2011, Statistica Sinica 21,
section 3).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.robust import BY_CHANCE, STRETCHES
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats

_PATTERNS: Final = 20
"""Of all effects' columns, beside those of the fit: so many directions hold most of what they
share, and leave most of a log to tell its scatter."""
_SHARED: Final = 1e-4
"""Directions with less of a single column's square are rounding."""


def dispersion(
    model: MotionModel,
    terms: tuple[Term, ...],
    coefficients: tuple[tuple[float, ...], ...],
    levels: Floats,
) -> float:
    """Return how many times too large log likelihoods about a fit are, 1 where chance explains it.

    All patterns are fitted first, so that an effect that the fit lacks is no misfit. Then stretch i
    pulls at pattern j by s_ij, and E[s_i s_i'] = H_i - H_i H_i with the patterns' inner products
    H_i, which add up to the unit matrix.
    """
    values, _, _ = model.linearised(terms, coefficients, levels)
    course = model.scattered(terms, coefficients, levels)
    about, _ = whiten(values, course, levels, model.nodes.ticks)
    library, _ = whiten(model.columns.values, course, levels, model.nodes.ticks)
    if not (np.isfinite(about).all() and np.isfinite(library).all()):
        return 1.0
    patterns = _directions(about[:, 1:], None)
    patterns = np.hstack([patterns, _directions(library[:, 1:], patterns)])
    left = about[:, 0] - patterns @ (patterns.T @ about[:, 0])
    pulled = allowed = squares = 0.0
    for part in np.array_split(np.arange(len(left)), STRETCHES):
        own = patterns[part]
        inner = own.T @ own
        variances = np.diag(inner) - np.einsum("ij,ij->i", inner, inner)
        pulled += float(np.sum((own.T @ left[part]) ** 2))
        allowed += float(np.sum(variances))
        squares += float(np.sum(variances**2))
    if allowed <= 0:
        return 1.0
    by_chance = 1.0 + BY_CHANCE * math.sqrt(2.0 * squares) / allowed
    return max(1.0, pulled / (allowed * by_chance))


def _directions(columns: Floats, beside: Floats | None) -> Floats:
    """Return orthonormal directions float64[rows, k] of columns: all of them, or, *beside* others,
    the few that most of the columns share."""
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    some = columns[:, size > 0] / size[size > 0]
    if beside is not None:
        some = some - beside @ (beside.T @ some)
    shared, turn = np.linalg.eigh(some.T @ some)
    order = np.argsort(-shared)[: len(shared) if beside is None else _PATTERNS]
    kept = order[shared[order] > _SHARED]
    return np.asarray(some @ turn[:, kept] / np.sqrt(shared[kept]))
