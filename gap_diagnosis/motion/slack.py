"""What a healthy robot is off by, free beside every effect.

A description is right to within its tolerances, and within these a wheel may drift or scrub by some
smooth function that no effect is. Where that explains most of a log, it is no gap; but an effect
beyond tolerance may be at work beside it, and would lose to it if the two were rivals.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.columns import Columns
from gap_diagnosis.motion.components import gains
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.unknown import CODE, Alternative, Laid, seen_by
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats


@dataclass(frozen=True)
class Slack:
    """What a healthy robot may be off by in one way.

    Attributes:
        columns: float64[4, m, k], what a unit of each shape changes.
        sds: float64[k], by how much of each it may be off.
    """

    columns: Floats
    sds: Floats


def slack_of(model: MotionModel, laid: Laid, one: Alternative, levels: Floats) -> Slack:
    """Return what of an alternative is no gap, in the likeliest of its shapes at these levels,
    float64[levels].

    Only what no constant of the description does: how far these may be off, their own tolerances
    say, and a wheelbase that is off by three of them is not one that wanders within one.
    """
    variable = CODE[1] if one.variable == CODE[0] else one.variable
    own = laid.only(one.stage, variable)
    (plan,) = own.plans
    white, log_variance = whiten(own.values, model.course, levels, model.nodes.ticks)
    gram = gram_of(white, log_variance, own.nuisances, levels)
    shape = max(
        plan.shapes, key=lambda one: float(gains(*seen_by(gram, plan, one.mix), one.sizes)[0][-1])
    )
    constants = [1 + place for place, _ in own.nuisances if _is_constant(model, place)]
    told = np.linalg.lstsq(white[:, constants], white[:, 1 + plan.columns] @ shape.mix)[0]
    columns = own.values[..., 1 + plan.columns] @ shape.mix - own.values[..., constants] @ told
    return Slack(columns, shape.sizes[-1])


def with_slack(model: MotionModel, slack: Slack) -> MotionModel:
    """Return the model with that free."""
    known = model.columns
    first = known.values.shape[-1] - 1
    free = [(first + place, float(sd)) for place, sd in enumerate(slack.sds)]
    healthy = copy(model)
    healthy.columns = replace(
        known,
        values=np.ascontiguousarray(np.concatenate([known.values, slack.columns], axis=-1)),
        nuisances=(*known.nuisances, *free),
    )
    vars(healthy).pop("no_effect_levels", None)  # those of the description without slack
    return healthy


def about(model: MotionModel, found: Found) -> MotionModel:
    """Return the model of what an account leaves; by how much its effects act is free to be as much
    again, or as their tolerances."""
    fit = found.refitted or model.refit(found.terms, found.levels)
    values, nuisances, tangent = model.linearised(found.terms, fit.coefficients, fit.levels)
    fitted = [
        sizes
        for term, sizes in zip(found.terms, fit.coefficients, strict=True)
        if not term.is_fixed
    ]
    free = []
    for term, sizes in zip(tangent, fitted, strict=True):
        for ((place, _),), size, limit in zip(term.weights, sizes, term.tolerances, strict=True):
            values[..., 0] -= size * values[..., 1 + place]
            free.append((place, max(abs(size), limit)))
    own = {index for term in found.terms for weight in term.weights for index, _ in weight}
    kept = [index for index, _ in model.columns.nuisances if index not in own]
    known = model.columns.little
    little = {place: known[index] for place, index in enumerate(kept) if index in known}
    left = copy(model)
    left.columns = Columns(values, (), (*nuisances, *free), little)
    left.course = model.scattered(found.terms, fit.coefficients, fit.levels)
    return left


def _is_constant(model: MotionModel, place: int) -> bool:
    """Tell whether a nuisance is a constant that the description states a tolerance for."""
    index, _ = model.columns.nuisances[place]
    variant, own = model.columns.little.get(index, (None, 0))
    if variant is None:
        return False
    return f"{variant.effect}.{variant.coefficients[own]}" in model.tolerances
