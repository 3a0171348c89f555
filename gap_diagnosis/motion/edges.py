"""Windows, thresholds and limits: real numbers that no column is linear in."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.thresholds import coarse_thresholds, has_threshold
from gap_diagnosis.motion.windows import Windows, at_window, has_window, windows_of
from gap_diagnosis.recording import Floats

EDGES: Final = ("start_s", "stop_s", "threshold", "limit")
_HALVINGS: Final = 5
_SHARP: Final = 4
"""So often more, where that still brings more than _GAIN nats."""
_GAIN: Final = 3.0
_HALF_A_NAT: Final = 0.5
_GROWN: Final = 14


@dataclass(frozen=True)
class Edged:
    """A term at its best edges.

    Attributes:
        term: there.
        spans: how far each edge can move: half a nat of evidence, or the standard deviation of a
            window's end.
        log_width: logarithm of what some edges are worth beside the best ones; None where they are
            known beforehand, and count as one variant.
    """

    term: Term
    spans: dict[str, float]
    log_width: float | None


def edges_of(variant: Variant) -> frozenset[str]:
    """Return the names of a variant's edges."""
    return frozenset(name for name in EDGES if name in variant.fixed)


def has_edges(term: Term) -> bool:
    """Tell whether a term has a window, a threshold or a limit that is to be sought."""
    return not term.variant.is_held and bool(edges_of(term.variant))


def edged_by(term: Term, windows: Windows) -> Edged:
    """Return a term in the best of its windows."""
    return Edged(at_window(term, *windows.best_s), windows.spans_s, windows.log_width)


def best_edges(
    model: MotionModel,
    terms: Sequence[Term],
    place: int,
    coefficients: Sequence[tuple[float, ...]],
    levels: Floats,
) -> Edged:
    """Move the edges of ``terms[place]`` to where the evidence is best: both ends of a window at
    once, a threshold on a coarse grid, a limit by halving steps."""
    term = terms[place]
    if has_window(term):
        windows = windows_of(model, terms, place, coefficients, levels)
        return edged_by(term, windows)
    if has_threshold(term):
        known = coarse_thresholds(model, terms, place, coefficients, levels)
        return Edged(known.best[place], {}, known.log_width)
    step = 0.05 * max(float(term.variant.fixed["limit"]), 0.5)

    def value(candidate: Term) -> float:
        trial = [*terms[:place], candidate, *terms[place + 1 :]]
        return model.evidence_about(trial, coefficients, levels).log_evidence

    best = value(term)
    for halving in range(_HALVINGS + _SHARP):
        before = best
        for sign in (-1, 1):
            moved = _moved(term, sign * step)
            found = value(moved)
            if found > best:
                best, term = found, moved
        step *= 0.5
        if halving >= _HALVINGS and best < before + _GAIN:
            break
    reaches = [_reach(value, term, sign * step, best) for sign in (-1, 1)]
    spans = {"limit": max(reaches)}
    if "limit" in term.variant.told:  # by the codes themselves
        return Edged(term, spans, None)
    # Half a nat is a standard deviation on its side, of a limit that may be any up to the fastest.
    width = math.sqrt(math.tau) * sum(reaches) / 2
    fastest = float(np.abs(model.nodes.motion.turn_rate_rad_s).max())
    return Edged(term, spans, math.log(width / max(width, fastest)))


def _reach(value: Callable[[Term], float], term: Term, step: float, best: float) -> float:
    """Return how far a limit moves to one side for half a nat."""
    near, far = 0.0, step
    for _ in range(_GROWN):
        moved = _moved(term, far)
        if moved is term or best - value(moved) > _HALF_A_NAT:
            break
        near, far = far, 2.0 * far
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        moved = _moved(term, middle)
        if moved is term or best - value(moved) > _HALF_A_NAT:
            far = middle
        else:
            near = middle
    return abs(0.5 * (near + far))


def _moved(term: Term, by: float) -> Term:
    """Return the term with its limit moved."""
    limit = float(term.variant.fixed["limit"]) + by
    if limit <= 0:
        return term
    fixed = {**term.variant.fixed, "limit": limit}
    report = {**term.variant.report, "limit": limit}
    return replace(term, variant=replace(term.variant, fixed=fixed, report=report))
