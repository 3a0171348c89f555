"""Counts that stand still, now and then, while their wheels turn: a plug that is loose.

A listed encoder dies once. Where it comes and goes, the gyro and the other wheel tell what each
wheel did meanwhile, as they do of a dead one; without that, a track several times as wide passes
for what only one wheel counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.standstill import DEAD, standstills
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.levels import Weighed, best_levels
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats


@dataclass(frozen=True)
class Standstills:
    """Stretches in which counts stand while their wheels turn.

    Attributes:
        sides: whose counts, in order of time.
        windows: [start_s, stop_s] each, log time.
        log_evidence, log_likelihood: less those of no effect.
        share: of the whitened residual's energy above noise that they take.
    """

    sides: tuple[str, ...]
    windows: tuple[tuple[float, float], ...]
    log_evidence: float
    log_likelihood: float
    share: float


def find_standstills(model: MotionModel, nothing: Found) -> Standstills | None:
    """Return what a log shows if counts stand; None where they do not, where a listed encoder died
    so, or where that is no likelier than *nothing*, the account of no effect."""
    nodes, t_s = model.nodes, model.nodes.motion.t_s
    known = sorted(standstills(nodes.motion), key=lambda one: one.first)
    is_listed = len(known) == 1 and DEAD not in model.without
    if not known or is_listed:
        return None
    variants = [one.variant(nodes.motion) for one in known]
    counted, turned = (
        residuals(nodes, predict(nodes.sharp, [(one, ()) for one in some]))
        for some in ((), variants)
    )
    nuisances = [(place, sd) for place, (_, sd) in enumerate(model.columns.nuisances)]
    free = [model.columns.values[..., 1 + index] for index, _ in model.columns.nuisances]
    data = model.columns.values[..., 0]

    def weigh(values: Floats, levels: Floats) -> Weighed:
        columns = np.ascontiguousarray(np.stack([values, *free], axis=-1))
        white, log_variance = whiten(columns, model.course, levels, nodes.ticks)
        gram = gram_of(white, log_variance, nuisances, levels)
        return Weighed(gram.log_nothing, white, log_variance)

    mended = data + turned - counted
    levels = best_levels(
        lambda levels: weigh(mended, levels), model.level_prior, model.level_prior.median
    )
    after = weigh(mended, levels)
    gained = after.log_evidence + model.level_prior.log_density(np.log(levels))
    gained -= nothing.log_evidence
    log_share = math.fsum(one.log_share(nodes.motion) for one in known)
    if gained + log_share <= 0:
        return None
    noise = float(np.sum(after.white[:, 0] ** 2))
    whole = float(np.sum(weigh(data, levels).white[:, 0] ** 2))
    return Standstills(
        sides=tuple(one.side for one in known),
        windows=tuple((float(t_s[one.first - 1]), float(t_s[one.last])) for one in known),
        log_evidence=gained + log_share,
        log_likelihood=gained,
        share=max(1.0 - noise / whole, 0.0),
    )
