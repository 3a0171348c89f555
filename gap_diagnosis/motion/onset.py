"""When an effect begins and ends: windows for effects that act on the whole log otherwise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import fields, replace
from itertools import combinations
from typing import Final

import numpy as np

from gap_diagnosis.explanations import EXPLAINED, predict
from gap_diagnosis.explanations.choices import LASTING, SLIP_WINDOWS
from gap_diagnosis.explanations.registry import rank_of
from gap_diagnosis.explanations.variant import Action, Scatter, Variant
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.evidence import Gram, gram_of, score
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.priors import FOR_A_WHILE
from gap_diagnosis.recording import Floats

_GYRO_RANK: Final = 2
LOG_SHARE: Final = math.log(FOR_A_WHILE)
_FOR_A_WHILE: Final = frozenset({"one_sided_slip", "gyro_frozen", "encoder_dead"})
_MOMENT: Final = 0.5 / SLIP_WINDOWS
"""Of a log: half of a part of the grid in which windows are sought."""
LOG_WEIGHT: Final = LOG_SHARE - math.log(SLIP_WINDOWS * (SLIP_WINDOWS + 1) / 2)
"""Log prior of one window of the grid, beside the effect on the whole log."""


_OF_REFERENCE: Final = frozenset({"reference_yaw", "reference_time_offset"})
"""What changes at once where a tracker loses a robot and finds it again, or a clock is set."""


def can_begin(term: Term) -> bool:
    """Tell whether an effect is sought in windows: one amplitude, of a wheel, encoder or gyro, or
    how a reference is turned or late."""
    variant = term.variant
    return (
        len(variant.coefficients) == 1
        and "start_s" not in variant.fixed
        and variant.effect not in GROSS
        and (rank_of(variant) <= _GYRO_RANK or variant.effect in _OF_REFERENCE)
    )


def is_a_moment(term: Term, motion: Motion) -> bool:
    """Tell whether an effect that usually acts all the time would act for a moment only: what is
    over so soon is an event of its own, a patch of ice or a push."""
    fixed = term.variant.fixed
    if "start_s" not in fixed or term.variant.effect not in EXPLAINED.keys() - _FOR_A_WHILE:
        return False
    return bool(fixed["stop_s"] - fixed["start_s"] < _MOMENT * (motion.t_s[-1] - motion.t_s[0]))


def windowed(variant: Variant, start_s: float, stop_s: float) -> Variant:
    """Return the variant acting from *start_s* until *stop_s* [s, log time] only."""
    window = {"start_s": start_s, "stop_s": stop_s}
    return replace(
        variant,
        act=_between(variant),
        exact=None if variant.exact is None else _between(variant.in_detail),
        rectifies=False,
        about=None,
        scatter=None if variant.scatter is None else _scattered_between(variant, variant.scatter),
        fixed=window,
        report={**variant.report, **window},
    )


def _between(variant: Variant) -> Action:
    def act(prediction: Prediction, *, start_s: float, stop_s: float, **size: float) -> None:
        whole = copy(prediction)
        variant.act(whole, **size, **variant.fixed)
        t_s = prediction.motion.t_s
        inside = (t_s >= start_s) & (t_s < stop_s)
        for one in fields(prediction):
            before, after = getattr(prediction, one.name), getattr(whole, one.name)
            if after is not before:
                setattr(prediction, one.name, np.where(inside, after, before))

    return act


def _scattered_between(variant: Variant, whole: Scatter) -> Scatter:
    def scatter(
        motion: Motion, size: float, *, start_s: float, stop_s: float
    ) -> tuple[Floats, Floats]:
        inside = (motion.t_s >= start_s) & (motion.t_s < stop_s)
        left, right = whole(motion, size, **variant.fixed)
        return np.where(inside, left, 0.0), np.where(inside, right, 0.0)

    return scatter


def best_window(model: MotionModel, term: Term, levels: Floats) -> tuple[Term, float] | None:
    """Return the term in the window of a grid that suits it best, with its log evidence.

    The choice of a window costs what its prior says. None where the whole log is better.
    """
    t_s = model.nodes.motion.t_s
    edges = np.linspace(t_s[0] - 1e-6, t_s[-1] + 1e-6, SLIP_WINDOWS + 1)
    gram, until = _up_to(model, term, levels, edges)

    def evidence_in(first: int, last: int) -> float:
        weight: Sequence[tuple[int, float]] = ((until + last, 1.0), (until + first, -1.0))
        own = replace(term, weights=(tuple(weight[: 2 if first else 1]),))
        return gram.log_nothing + score(gram, [own], model.prior).log_evidence

    whole = 0, SLIP_WINDOWS
    windows = [one for one in combinations(range(len(edges)), 2) if one != whole]
    if term.variant.effect in LASTING:
        windows = [window for window in windows if set(window) & set(whole)]
    best, found = -math.inf, windows[0]
    most = _most_in(gram, until, windows)
    for place in np.argsort(-most):
        if gram.log_nothing + most[place] <= best:
            break
        evidence = evidence_in(*windows[place])
        if evidence > best:
            best, found = evidence, windows[place]
    best += LOG_WEIGHT
    if best <= evidence_in(*whole):
        return None
    variant = windowed(term.variant, *(float(edges[one]) for one in found))
    return replace(term, variant=variant), best


def _up_to(model: MotionModel, term: Term, levels: Floats, edges: Floats) -> tuple[Gram, int]:
    """Return the products of an effect's columns up to each of the *edges* but the first, and
    before which column they begin."""
    nodes = model.nodes
    nominal = residuals(nodes, predict(nodes.smooth))
    step = math.sqrt(
        term.tolerances[0] * model.prior.of(term.variant.effect, term.variant.coefficients[0]).high
    )
    columns: list[Floats] = []
    for edge in edges[1:]:
        variant = windowed(term.variant, float(edges[0]), float(edge))
        moved = residuals(nodes, predict(nodes.smooth, [(variant, (step,))]))
        columns.append((nominal - moved) / step)
    free = model.columns.within_tolerance
    values = np.concatenate([free, np.stack(columns, axis=-1)], axis=-1)
    white = whiten(values, model.course, levels, nodes.ticks)
    nuisances = [(place, sd) for place, (_, sd) in enumerate(model.columns.nuisances)]
    return gram_of(*white, nuisances, levels), len(nuisances) - 1


def _most_in(gram: Gram, until: int, windows: Sequence[tuple[int, int]]) -> Floats:
    """Return the log likelihood that the best size gains in each window: no evidence is larger."""
    own = slice(until + 1, None)
    data = np.append(0.0, gram.data[own])
    inner = np.pad(gram.inner[own, own], (1, 0))
    first, last = np.array(windows).T
    power = inner[first, first] + inner[last, last] - 2.0 * inner[first, last]
    pull = data[last] - data[first]
    return np.asarray(0.5 * pull**2 / np.maximum(power, np.finfo(np.float64).tiny))
