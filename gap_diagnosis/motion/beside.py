"""What one more effect would gain beside a fit, along columns about that fit.

Columns are drawn about no effect at all. Where a fit bends them (a gyro that clips has no scale
there, a dead encoder no size), sums of straight lines do not tell what comes on top of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.evidence import gram_of, log_sum, score
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats

_STEP: Final = 3.0
"""Columns are chords from the fit to one so many tolerances off."""


@dataclass(frozen=True)
class Beside:
    """One more effect beside a fit.

    Attributes:
        log_evidence: what its variants gain in sum [nat].
        term, sizes: the best of them and its coefficients.
    """

    log_evidence: float
    term: Term
    sizes: tuple[float, ...]


def gains_beside(
    model: MotionModel,
    terms: Sequence[Term],
    fit: Refitted,
    more: Mapping[str, Sequence[Term]],
) -> dict[str, Beside]:
    """Return what each effect of *more* gains beside a fit, at its noise levels."""
    values, nuisances, tangent = model.linearised(terms, fit.coefficients, fit.levels)
    smooth = model.nodes.smooth
    settings = [(t.variant, c) for t, c in zip(terms, fit.coefficients, strict=True)]
    there = residuals(model.nodes, predict(smooth, settings))
    columns = [values]
    count = values.shape[-1]
    about: dict[str, list[tuple[Term, Term]]] = {}
    for effect, variants in more.items():
        for term in variants:
            weights = []
            for steps in _steps(term):
                moved = residuals(model.nodes, predict(smooth, [*settings, (term.variant, steps)]))
                columns.append(((there - moved) / (max(steps, default=1.0)))[..., np.newaxis])
                weights.append(((count - 1, 1.0),))
                count += 1
            line = Term(term.variant, tuple(weights), term.tolerances, term.log_weight)
            about.setdefault(effect, []).append((term, line))
    whole = np.ascontiguousarray(np.concatenate(columns, axis=-1))
    course = model.scattered(terms, fit.coefficients, fit.levels)
    white = whiten(whole, course, fit.levels, model.nodes.ticks)
    gram = gram_of(*white, nuisances, fit.levels)
    alone = score(gram, tangent, model.prior).log_evidence
    found = {}
    for effect, lines in about.items():
        scored = [score(gram, [*tangent, line], model.prior) for _, line in lines]
        gained = np.array([one.log_evidence for one in scored]) - alone
        gained += [term.log_weight + term.variant.log_share for term, _ in lines]
        best = int(np.argmax(gained))
        sizes: Floats = scored[best].means[int(np.argmax(scored[best].weights))]
        own = len(lines[best][0].variant.coefficients)
        found[effect] = Beside(
            log_sum(gained),
            lines[best][0],
            tuple(float(one) for one in sizes[len(sizes) - own :]),
        )
    return found


def _steps(term: Term) -> list[list[float]]:
    """Return for each coefficient how far its chord leads; for a variant without any, nothing."""
    if term.is_fixed:
        return [[]]
    return [list(row) for row in _STEP * np.diag(term.tolerances)]
