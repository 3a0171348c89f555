"""How far straight lines lead astray within a posterior: its draws, weighed as effects bend.

Evidence and intervals of the motion are exact for effects that act along straight lines about the
fit (motion/evidence.py). With more sizes than two no quadrature checks that; draws from the
posterior do, each weighed by its likelihood as the effects act over that along the lines.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats


def log_weights(model: MotionModel, terms: Sequence[Term], fit: Refitted, draws: Floats) -> Floats:
    """Return log likelihoods of sizes *draws* float64[n, k] as the effects act, less those along
    the lines about the fit: float64[n]. Tolerances are marginalised in both."""
    values, nuisances, tangent = model.linearised(terms, fit.coefficients)
    course = model.scattered(terms, fit.coefficients, leans=fit.leans)
    lines = [place + 1 for term in tangent for weight in term.weights for place, _ in weight]
    about = _changes(model, terms, np.concatenate([np.array(c) for c in fit.coefficients]))
    here = values[..., 0] - values[..., lines] @ np.concatenate(
        [np.array(c) for c, t in zip(fit.coefficients, terms, strict=True) if not t.is_fixed]
    )
    bent = [here + _changes(model, terms, one) - about for one in draws]
    known = values[..., [place + 1 for place, _ in nuisances]]
    straight = values[..., :1] - values[..., lines] @ draws.T
    stacked = np.concatenate([np.stack(bent, axis=-1), straight, known], axis=-1)
    white, _ = whiten(np.ascontiguousarray(stacked), course, fit.levels, model.nodes.ticks)
    own, free = white[:, : 2 * len(draws)], white[:, 2 * len(draws) :]
    across = free.T @ own
    inner = free.T @ free + np.diag([sd**-2 for _, sd in nuisances])
    squares = (own**2).sum(axis=0) - (across * np.linalg.solve(inner, across)).sum(axis=0)
    return np.asarray(-0.5 * (squares[: len(draws)] - squares[len(draws) :]))


def _changes(model: MotionModel, terms: Sequence[Term], sizes: Floats) -> Floats:
    """Return the residuals with these sizes of the effects, without the data's details."""
    settings = []
    place = 0
    for term in terms:
        width = 0 if term.is_fixed else len(term.variant.coefficients)
        settings.append((term.variant, tuple(float(one) for one in sizes[place : place + width])))
        place += width
    return residuals(model.nodes, predict(model.nodes.smooth, settings))
