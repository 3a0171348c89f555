"""Windows, thresholds and limits: real numbers that no column is linear in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.windows import at_window, has_window, windows_of
from gap_diagnosis.recording import Floats

EDGES: Final = ("start_s", "stop_s", "threshold", "limit")
_SOUGHT: Final = ("threshold", "limit")
_HALVINGS: Final = 5
_SHARP: Final = 4
"""So often more, where that still brings more than _GAIN nats."""
_GAIN: Final = 3.0
_HALF_A_NAT: Final = 0.5
_PARTS: Final = 20
_TWICE: Final = 2
_GROWN: Final = 14


@dataclass(frozen=True)
class Edged:
    """A term at its best edges, with how far each can move: half a nat of evidence, or the standard
    deviation of a window's end."""

    term: Term
    spans: dict[str, float]


def has_edges(term: Term) -> bool:
    """Tell whether a term has a window, a threshold or a limit that is to be sought."""
    return not term.variant.is_held and any(name in term.variant.fixed for name in EDGES)


def best_edges(
    model: MotionModel,
    terms: Sequence[Term],
    place: int,
    coefficients: Sequence[tuple[float, ...]],
    levels: Floats,
) -> Edged:
    """Move the edges of ``terms[place]`` to where the evidence is best: both ends of a window at
    once, a threshold or a limit by halving steps."""
    term = terms[place]
    if has_window(term):
        windows = windows_of(model, terms, place, coefficients, levels)
        return Edged(at_window(term, *windows.best_s), windows.spans_s)
    names = [name for name in _SOUGHT if name in term.variant.fixed]
    steps = {name: 0.05 * max(term.variant.fixed[name], 0.5) for name in names}

    def fitted(candidate: Term) -> Refitted:
        trial = [*terms[:place], candidate, *terms[place + 1 :]]
        return model.evidence_about(trial, coefficients, levels)

    def value(candidate: Term) -> float:
        return fitted(candidate).log_evidence

    if "threshold" in steps:
        # Not uphill alone: each speed at which a log drives for long has a peak of its own. Where
        # an effect sets in goes with its size, so that each is sought about the other once more.
        fastest = model.nodes.motion.fastest_rad_s
        steps["threshold"] = fastest / _PARTS
        for _ in range(_TWICE):
            every = [_at(term, "threshold", part * fastest / _PARTS) for part in range(_PARTS)]
            fits = [(fitted(one), one) for one in (term, *every)]
            fit, term = max(fits, key=lambda one: one[0].log_evidence)
            coefficients = fit.coefficients
    best = value(term)
    for halving in range(_HALVINGS + _SHARP):
        before = best
        for name in names:
            for sign in (-1, 1):
                moved = _moved(term, name, sign * steps[name])
                found = value(moved)
                if found > best:
                    best, term = found, moved
            steps[name] *= 0.5
        if halving >= _HALVINGS and best < before + _GAIN:
            break
    return Edged(term, {name: _span(value, term, name, steps[name], best) for name in names})


def _span(value: Callable[[Term], float], term: Term, name: str, step: float, best: float) -> float:
    """Return how far an edge moves, on the side where it moves farther, for half a nat."""
    farthest = 0.0
    for sign in (-1, 1):
        reach = step
        for _ in range(_GROWN):
            moved = _moved(term, name, sign * reach)
            if moved is term:
                break
            farthest = max(farthest, reach)
            if best - value(moved) > _HALF_A_NAT:
                break
            reach *= 2.0
    return farthest or step


def _moved(term: Term, name: str, by: float) -> Term:
    """Return the term with one edge moved."""
    value = float(term.variant.fixed[name]) + by
    if value < 0 or (name == "limit" and value == 0):
        return term
    return _at(term, name, value)


def _at(term: Term, name: str, value: float) -> Term:
    """Return the term with one edge elsewhere."""
    fixed = {**term.variant.fixed, name: value}
    report = {key: fixed.get(key, value) for key, value in term.variant.report.items()}
    return replace(term, variant=replace(term.variant, fixed=fixed, report=report))
