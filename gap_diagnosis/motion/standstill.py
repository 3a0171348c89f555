"""Counts that stand still, now and then, while their wheels turn: a plug that is loose.

A listed encoder dies once. Where it comes and goes, the gyro and the other wheel tell what each
wheel did meanwhile, as they do of a dead one; without that, a track several times as wide passes
for what only one wheel counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.standstill import DEAD, Standstill, standstills
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import Nodes, residuals
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import best_levels

_LEANS: Final = 0.15
"""What a block gains for nothing [nat] where a gyro is held against what it said itself: of 24
stretches of healthy drives, a tenth to two fifths of a log, -0.46 to 0.14."""


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
    motion = model.nodes.motion
    sure = standstills(motion)
    is_listed = len(sure) == 1 and DEAD not in model.without
    choices = [] if is_listed or not sure else [sure]
    if sure:
        # What was loose once may have been loose while its wheel hardly turned.
        more = standstills(motion, is_loose=True)
        choices += [more] if len(more) > len(sure) else []
    found = [_stood(model, nothing, sorted(one, key=lambda one: one.first)) for one in choices]
    best = max(found, key=lambda one: one.log_evidence, default=None)
    return None if best is None or best.log_evidence <= 0 else best


def _stood(model: MotionModel, nothing: Found, known: Sequence[Standstill]) -> Standstills:
    """Return what a log shows if counts stand in these stretches."""
    nodes, motion = model.nodes, model.nodes.motion
    counted, turned = (
        residuals(nodes, predict(nodes.sharp, [(one, ()) for one in some]))
        for some in ((), [one.variant(motion) for one in known])
    )
    described = model.columns.values[..., 0]
    put_right = described + turned - counted
    nuisances = [(place, sd) for place, (_, sd) in enumerate(model.columns.nuisances)]
    free = [model.columns.values[..., 1 + index] for index, _ in model.columns.nuisances]

    def weighing(values: Floats) -> Weighing:
        columns = np.ascontiguousarray(np.stack([values, *free], axis=-1))
        return Weighing(columns, nuisances, model.course, nodes.ticks)

    weigh = weighing(put_right)

    def height(levels: Floats) -> float:
        return weigh(levels).log_evidence + model.level_prior.log_density(np.log(levels))

    start = max((model.level_prior.median, nothing.levels), key=height)
    levels = best_levels(weigh, model.level_prior, start)
    gained = height(levels) - nothing.log_evidence - _LEANS * _guessed(nodes, known)
    left, whole = (weighing(values).gram(levels).left_over for values in (put_right, described))
    above_noise = max(whole - np.count_nonzero(np.isfinite(described)), 1.0)
    return Standstills(
        sides=tuple(one.side for one in known),
        windows=tuple(
            (float(motion.t_s[max(one.first - 1, 0)]), float(motion.t_s[one.last])) for one in known
        ),
        log_evidence=gained + math.fsum(one.log_share(motion) for one in known),
        log_likelihood=gained,
        share=min(max(whole - left, 0.0) / above_noise, 1.0),
    )


def _guessed(nodes: Nodes, known: Sequence[Standstill]) -> int:
    """Return of how many blocks a gyro tells the turn by which one wheel's counts are put right."""
    inside = np.zeros(len(nodes.motion.t_s))
    for one in known:
        inside[one.first : one.last + 1] = 1.0
    return int(np.count_nonzero(nodes.mean(inside) > 0.5)) if nodes.has_gyro else 0
