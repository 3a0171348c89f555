"""In which window each wheel may have slipped, however short, before anything is fitted.

A window a tenth as long as the grid's weighs a tenth in each of them, and levels of noise that have
risen with a slip hide it in all. At the described levels it stands out. And how loosely: no wheel
on ice slips by the same share all the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product, takewhile
from typing import Final

import numpy as np

from gap_diagnosis.explanations.choices import of_side
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.edges import Edged, edged_by
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.windows import at_window, windows_of
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats

SLIP: Final = "one_sided_slip"
_WORTH: Final = 20.0
"""A window that gains less [nat] is not worth a column."""
_STEPS: Final = 2
LOOSE: Final = (0.3, 1.0)
"""Shares of its ratio by which a wheel that slips loosely slips more or less,"""
_LASTS_S: Final = 0.3
"""each for so long."""
_LEAST_S: Final = 4 * _LASTS_S
"""In less than that nothing is now more and now less: a push is over sooner."""
_ENDS_S: Final = (0.5, 0.1, 0.02)
"""Steps by which a loose slip's ends are moved."""
_UNLIKELY: Final = 2.5
"""Ends that lack more [nat] are not believed."""
_ONE_WAY: Final = 2.0
"""Standard deviations by which a loose slip's ratio is not zero."""


def windows_beside(
    model: MotionModel, leading: Sequence[Term], slips: Sequence[Term], levels: Floats
) -> list[tuple[Edged, Term]]:
    """Return each wheel's slip in its best window at *levels*, with a term of the grid.

    Beside it stands what leads before any slip does. Empty where no window is worth it.
    """
    beside = tuple(takewhile(lambda term: term.variant.effect != SLIP, leading))
    by_side = {str(term.variant.report["side"]): term for term in reversed(slips)}
    if not by_side:
        return []
    start: Sequence[tuple[float, ...]] = ()
    if beside:
        start = model.refit(beside, levels, free_levels=False, steps=_STEPS).coefficients
    found = []
    for _, term in sorted(by_side.items()):
        terms, sizes = [*beside, term], [*start, (0.0,)]
        windows = windows_of(model, terms, len(beside), sizes, levels, worth=_WORTH)
        if windows.log_evidence.max() > _WORTH:
            found.append((edged_by(term, windows), term))
    return found


def loose(term: Term) -> list[Term]:
    """Return a slip's term with slips that are now more and now less than its ratio says; none
    where it is too short."""
    variant = term.variant
    if variant.fixed["stop_s"] - variant.fixed["start_s"] < _LEAST_S:
        return []
    return [
        replace(
            term,
            variant=replace(
                variant, scatter=partial(_scatter, side=str(variant.report["side"]), share=share)
            ),
        )
        for share in LOOSE
    ]


def is_loose(term: Term) -> bool:
    """Tell whether a term is a slip that is now more and now less."""
    return term.variant.effect == SLIP and term.variant.scatter is not None


def is_a_slip(fit: Refitted, place: int, dispersion: float = 1.0) -> bool:
    """Tell whether a loose slip at *place* of a fit goes one way: a wheel that goes to and fro as
    far as it goes either way was pushed, or has lost its hold now and then.

    *dispersion*: how many times the log's likelihood is too sure. By where the fit's last step
    leads, not by where it began: in its own window a lawnmower's wheel that had slipped by 0.47
    slipped by -0.02.
    """
    scored = fit.scored
    at = sum(len(one) for one in fit.coefficients[:place])
    means = scored.means[:, at]
    mean = float(scored.weights @ means)
    second = float(scored.weights @ (scored.covariances[:, at, at] + means**2))
    return mean**2 > _ONE_WAY**2 * dispersion * (second - mean**2)


def in_its_window(
    model: MotionModel, terms: Sequence[Term], place: int, fit: Refitted
) -> tuple[Term, ...]:
    """Return the terms with the loose slip at *place* in the window that suits it best about a fit.

    A slip that were always the same would end with a spell in which it was much less.
    """

    def at(ends: tuple[float, float]) -> tuple[Term, ...]:
        return (*terms[:place], at_window(terms[place], *ends), *terms[place + 1 :])

    def worth(ends: tuple[float, float]) -> float:
        if ends[1] - ends[0] < _LEAST_S:
            return -math.inf
        return model.evidence_about(at(ends), fit.coefficients, fit.levels).log_evidence

    def moved(ends: tuple[float, float], end: int, by_s: float) -> tuple[float, float]:
        return (ends[0] + by_s, ends[1]) if end == 0 else (ends[0], ends[1] + by_s)

    fixed = terms[place].variant.fixed
    best = fixed["start_s"], fixed["stop_s"]
    most = worth(best)
    for step_s in _ENDS_S:
        for end, way_s in product((0, 1), (-step_s, step_s)):
            while (gained := worth(moved(best, end, way_s))) > most:
                best, most = moved(best, end, way_s), gained
    told = {}
    for end, name in enumerate(("start_s", "stop_s")):
        reach = []
        for sign in (-1.0, 1.0):
            away_s = _ENDS_S[-1]
            while worth(moved(best, end, sign * away_s)) > most - _UNLIKELY and away_s < _ENDS_S[0]:
                away_s *= 1.5
            reach.append(best[end] + sign * away_s)
        told[name] = (reach[0], reach[1])
    found = at(best)
    variant = replace(found[place].variant, told=told, is_held=True)
    return (*found[:place], replace(found[place], variant=variant), *found[place + 1 :])


def _scatter(
    motion: Motion, ratio: float, *, start_s: float, stop_s: float, side: str, share: float
) -> tuple[Floats, Floats]:
    """Return the variance of each wheel's counts, counts² per tick: the way of a wheel that spins
    or is dragged along is its own or the body's, whichever is more."""
    sign, own = (-1.0, motion.left_rate_rad_s) if side == "left" else (1.0, motion.right_rate_rad_s)
    aside = 0.5 * sign * motion.wheelbase_m * motion.turn_rate_rad_s
    body = np.abs(motion.speed_m_s + aside) / motion.radius_m
    rate = np.maximum(np.abs(own), body) / motion.rad_per_count
    inside = (motion.t_s > start_s) & (motion.t_s <= stop_s)
    variance = np.where(inside, 2.0 * _LASTS_S * motion.dt_s * (share * ratio * rate) ** 2, 0.0)
    return of_side(side, variance)
