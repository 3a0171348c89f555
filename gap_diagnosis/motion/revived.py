"""What else is wrong beside a dead encoder: sought in the log in which its wheel turns again.

About a wheel that stands no column says anything of one that turns. With turns put in that the gyro
and the other wheel tell, and nothing taken to be known of them, the log is like any other: what its
effects gain there they gain beside the dead encoder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.missing import filled
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.recording import Recording


def revived(model: MotionModel, dead: Term) -> MotionModel:
    """Return the motion of the log with the wheel of a *dead* encoder turning; of its turns nothing
    is known."""
    own = frozenset({dead.variant.effect}) | GROSS
    return model.of(_with_turns(model, dead), without=own, unsure=dead.variant.unsure)


def beside(
    dead: Found, nothing: Found, one: Found, by_effect: Mapping[str, Sequence[Term]]
) -> Found:
    """Return what a set gains beside a *dead* encoder: *one*, what it accounts for in the revived
    log, where no effect is *nothing*.

    *by_effect* are the terms of the log as it is.
    """
    terms = (*dead.terms, *(_as_here(term, by_effect[term.variant.effect]) for term in one.terms))
    apart = dead.log_evidence - nothing.log_evidence, dead.log_likelihood - nothing.log_likelihood
    fit = None
    if one.refitted is not None:
        own = replace(one.refitted, scored=replace(one.refitted.scored, terms=terms[1:]))
        fit = with_dead(dead.terms, own, *apart)
    return Found(
        dead.effects | one.effects,
        terms,
        one.log_evidence + apart[0],
        one.log_likelihood + apart[1],
        one.levels,
        fit,
        one.fell,
    )


def with_dead(
    dead: Sequence[Term], fit: Refitted, log_evidence: float = 0.0, log_likelihood: float = 0.0
) -> Refitted:
    """Return a fit of the revived log with the dead encoder among its terms, worth so much more."""
    return replace(
        fit,
        scored=replace(fit.scored, terms=(*dead, *fit.scored.terms)),
        log_evidence=fit.log_evidence + log_evidence,
        log_likelihood=fit.log_likelihood + log_likelihood,
        coefficients=((), *fit.coefficients),
    )


def _with_turns(model: MotionModel, dead: Term) -> Recording:
    """Return the recording with whole counts of the turns that the gyro and the other wheel tell;
    where there are no counts there are none.

    Where the gyro says nothing either, a gyro put in its place by wheels of which one stands would
    tell half of the turn.
    """
    recording, motion = model.recording, model.nodes.motion
    told, counted = predict(motion, [(dead.variant, ())]), predict(motion)
    silent = np.zeros(len(motion.t_s), dtype=np.bool_)
    if recording.gyro_rate_rad_s is not None:
        silent = ~np.isfinite(recording.gyro_rate_rad_s)
    left, right = (
        np.cumsum(filled(np.where(silent, np.nan, turned - stood), motion.t_s))
        for turned, stood in (
            (told.left_rad, counted.left_rad),
            (told.right_rad, counted.right_rad),
        )
    )
    return replace(
        recording,
        left_ticks=recording.left_ticks + np.round(left / motion.rad_per_count),
        right_ticks=recording.right_ticks + np.round(right / motion.rad_per_count),
    )


def _as_here(term: Term, own: Sequence[Term]) -> Term:
    """Return a term of the revived log with the columns of the nearest one of the log as it is."""

    def away(other: Term) -> float:
        if other.variant.report.get("side") != term.variant.report.get("side"):
            return math.inf
        fixed = term.variant.fixed
        shared = fixed.keys() & other.variant.fixed.keys()
        return math.fsum(abs(float(fixed[key]) - float(other.variant.fixed[key])) for key in shared)

    return replace(term, weights=min(own, key=away).weights)
