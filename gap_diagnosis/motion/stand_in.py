"""A model of what an unlisted cause goes with: fitted on a part of a log, to be tried on the rest.

It is the stand-in that weighed the cause: a smooth function of a variable, acting in one stage.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gap_diagnosis.explanations.variant import Setting, Variant
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.levels import is_louder
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.unknown import (
    CODE,
    Alternative,
    Fitted,
    Plan,
    fit_of,
    lay_out,
    levels_beside,
)
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.recording import Floats

_DRAWS: Final = 40
_SEED: Final = 0


@dataclass(frozen=True)
class StandIn:
    """A stand-in as it acts on predictions: with its best sizes, and with draws of them.

    Attributes:
        best, drawn: what acts.
        levels: noise levels beside it, float64[levels].
    """

    best: Setting
    drawn: list[Setting]
    levels: Floats


def stand_in(model: MotionModel, one: Alternative, start: Floats) -> StandIn | None:
    """Return the stand-in of *one* as it suits best what *model* may see of the log; None where the
    log has nothing that it could be a function of.

    Its noise levels are sought beside it from *start*, float64[levels], and where some noise is
    louder there than described from the described ones too: it may have taken what the stand-in
    explains.
    """
    is_of_codes = one.variable == CODE[0]
    variable = CODE[1] if is_of_codes else one.variable
    laid = lay_out(model, only=(one.stage, variable))
    if not laid.plans:
        return None
    plan = laid.plans[0]
    if is_of_codes:
        plan = replace(plan, shapes=plan.shapes[:1])

    def fitted(levels: Floats) -> tuple[float, Fitted]:
        white, log_variance = whiten(laid.values, model.course, levels, model.nodes.ticks)
        gram = gram_of(white, log_variance, laid.nuisances, levels)
        found = fit_of(gram, plan)
        density = model.level_prior.log_density(np.log(levels))
        return gram.log_nothing + found.log_evidence + density, found

    tried, described = [start], model.level_prior.median
    for begin in (start, described) if is_louder(start, described) else (start,):
        beside = levels_beside(model, one, begin, laid)
        tried += [] if beside is None else [beside]
    scored = [(*fitted(levels), levels) for levels in tried]
    _, best, levels = max(scored, key=lambda each: each[0])
    drawn = np.random.default_rng(_SEED).multivariate_normal(
        best.mean, best.covariance, _DRAWS, method="eigh"
    )
    return StandIn(_setting(plan, best.mean), [_setting(plan, sizes) for sizes in drawn], levels)


def _setting(plan: Plan, sizes: Floats) -> Setting:
    """Return the stand-in as what acts on a prediction, after all else."""

    def act(prediction: Prediction, **_: Any) -> None:
        plan.act(prediction, sizes)

    return Variant("unlisted", act), ()
