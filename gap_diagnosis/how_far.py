"""How far the gap shrinks on data that the fit of the values never saw."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import combinations
from typing import Final

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.block_sums import Effects
from gap_diagnosis.downstream import driven, reprogrammed
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.holdout import hold_out
from gap_diagnosis.gap.how_far import gap_of
from gap_diagnosis.gap.manoeuvres import kinds_of
from gap_diagnosis.gap.metrics import clock_skew_of
from gap_diagnosis.gap.on_recording import (
    levels_of,
    measure,
    odometry_rms,
    replayed_rms,
    timing_rms,
    windows_on,
)
from gap_diagnosis.gap.waterfall import shapley_reductions
from gap_diagnosis.gap.where import manoeuvre_segments, stage_shares
from gap_diagnosis.modelled import (
    ANOTHER_LOG,
    NO_GAP_MEASURED,
    Model,
    modelled_on,
    told_apart,
    unseen_dropped,
)
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.drawing import draw
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.pictures import Pictures
from gap_diagnosis.picturing import pictures_of
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import (
    Gap,
    Metric,
    Modelled,
    Segment,
    StageOrNone,
    Waterfall,
    WaterfallStep,
)
from hil_harness.assembly import Wire
from hil_harness.effects import catalogue
from hil_harness.robot import Robot

_DRAWS: Final = 40
_SKEW: Final = "clock_skew"
"""Of the bus's effects the one that shifts a beat; what spreads or takes frames leaves it."""
_ODOMETRY: Final = frozenset({"odometry_position_m", "odometry_heading_rad", "turn_difference_rad"})


@dataclass(frozen=True)
class Shrink:
    """The gap before and after, and where it lies.

    Attributes:
        gap: None where nothing could be held out or measured.
        waterfall: None where the winning effects do not act in the gap's metric.
        stages: share of each stage in the gap, in its own metric; empty without a gap.
        segments: the same, manoeuvre by manoeuvre; none without a gap.
        pictures: to draw from.
        notes: what could not be measured.
        modelled: the gap with a model of what an unlisted cause goes with; None with listed ones.
        why_not: in a few words why it is not known how far that closes the gap; None if it is.
    """

    gap: Gap | None = None
    waterfall: Waterfall | None = None
    stages: dict[StageOrNone, float] = field(default_factory=dict)
    segments: tuple[Segment, ...] = ()
    pictures: Pictures = field(default_factory=Pictures)
    notes: tuple[str, ...] = ()
    modelled: Modelled | None = None
    why_not: str | None = NO_GAP_MEASURED


def shrink(
    analysis: Analysis,
    effects: Effects,
    stage: StageOrNone,
    robot: Robot,
    wire: Wire,
    held: Recording | None,
) -> Shrink:
    """Measure the gap with and without *effects*, whose values are fitted on the other part.

    With *held*, another log, that is where it is measured; else on held-out stretches.
    """
    if analysis.motion is None:
        return Shrink(notes=("Neither gyro nor reference: the gap of the pose is not measured.",))
    own = analysis.motion.moving(effects)
    model, where = analysis.motion.model, analysis.recording
    unlisted: Model | None = None
    why_not: str | None = ANOTHER_LOG
    if held is None:
        kinds = kinds_of(where, robot)
        sides = hold_out(where.t_s, kinds)
        if sides.why_not is not None:
            return Shrink(
                stages={}, notes=(sides.why_not,), pictures=pictures_of(where, model, [], ())
            )
        is_unlisted = not effects and stage != "none"
        seen = unseen_dropped(where, sides.fit) if is_unlisted else where
        apart = MotionModel(seen, robot, model.prior, keep=sides.fit)
        fitted = _refitted(apart, analysis.motion, own)
        if is_unlisted:
            unlisted, why_not = modelled_on(apart, analysis, stage)
        motion, mask, kept = model.nodes.motion, sides.held_out, sides.fit
    else:
        where = held
        kinds = kinds_of(held, robot)
        fitted = _refitted(model, analysis.motion, own)
        motion = estimate_motion(held, robot)
        mask = np.ones(len(held.t_s), dtype=np.bool_)
        kept = np.ones(len(analysis.recording.t_s), dtype=np.bool_)
    settings, drawn = _settings(fitted)
    windows = windows_on(motion, mask)
    firmware = reprogrammed(analysis, effects, where, robot, wire, is_other_log=held is not None)
    drive = driven(analysis, effects, where, robot, kept if held is None else None)
    on_bus = frozenset(e for e in effects if e in catalogue() and catalogue()[e].stage == "bus")
    fitted_on = analysis.recording
    skew = clock_skew_of(fitted_on.frames, fitted_on.t_s, kept) if _SKEW in effects else 0.0
    metrics = measure(
        where,
        robot,
        motion,
        windows,
        effects=settings if unlisted is None else unlisted.settings,
        draws=drawn if unlisted is None else unlisted.drawn,
        levels=levels_of((unlisted or analysis.motion).levels, robot, motion),
        drive=None if drive is None else drive.replayed,
        firmware=None if firmware is None else firmware.replayed,
        clock_skew=skew if on_bus else None,
    )
    gap = gap_of(metrics, _acting(stage, own, where), "stretches" if held is None else "log")
    modelled = None
    if gap is None:
        why_not = NO_GAP_MEASURED
    elif unlisted is not None:
        gap, modelled, why_not = told_apart(gap, unlisted)
    named = gap.metric if gap is not None and gap.metric in _ODOMETRY else None
    waterfall = None
    behind = {"drive_position_m": drive, "firmware_position_m": firmware}
    if gap is not None and gap.after is not None:
        downstream, steps = behind.get(gap.metric), gap.metric
        if named is not None:

            def rms(some: Effects) -> float:
                chosen = [one for one in settings if one[0].effect in some]
                return odometry_rms(steps, where, robot, motion, windows, chosen)

            waterfall = _waterfall(gap, frozenset(one.effect for one, _ in settings), rms)
        elif downstream is not None:

            def rms_behind(some: Effects) -> float:
                path = downstream.path(some)
                return (
                    math.nan if path is None else replayed_rms(steps, where, motion, path, windows)
                )

            waterfall = _waterfall(gap, downstream.effects, rms_behind)
        elif gap.metric == "timing_s":

            def rms_of_stamps(some: Effects) -> float:
                return timing_rms(where, windows, skew if _SKEW in some else 0.0)

            waterfall = _waterfall(gap, on_bus, rms_of_stamps)
    shares: dict[StageOrNone, float] = {}
    segments: tuple[Segment, ...] = ()
    if gap is not None and stage != "none":
        metric = gap.metric
        shares = stage_shares(metric, where, robot, motion, windows, settings)
        segments = manoeuvre_segments(where, robot, motion, kinds, settings, metric=metric)
    return Shrink(
        gap=gap,
        waterfall=waterfall,
        stages=shares,
        segments=segments,
        pictures=pictures_of(where, model, windows, settings, motion=motion, robot=robot),
        modelled=modelled,
        why_not=why_not,
    )


def shrink_each(
    analyses: Sequence[Analysis], effects: Effects, stage: StageOrNone, robot: Robot, wire: Wire
) -> tuple[Shrink, list[dict[str, Metric]]]:
    """Return how far the gap shrinks on the first of several logs that has one, and every metric
    of each log, on its own held-out stretches."""
    names = [one.recording.name for one in analyses]
    found = [shrink(one, effects, stage, robot, wire, None) for one in analyses]
    shown = next((place for place, one in enumerate(found) if one.gap is not None), 0)
    notes = [
        f"{name}: {note}" for name, one in zip(names, found, strict=True) for note in one.notes
    ]
    notes.append(
        f"{names[shown]}: the gap, its waterfall, where it arises and the pictures are of this log "
        f"alone, number {shown + 1} of {len(names)}. A bound is held against every log."
    )
    metrics = [{} if one.gap is None else one.gap.all for one in found]
    return replace(found[shown], notes=tuple(notes)), metrics


def _acting(stage: StageOrNone, own: Effects, where: Recording) -> StageOrNone:
    """Return the stage whose metrics speak of *own*, the effects that the motion shows.

    What lies behind the motor, which is counted, is the drive's; but it is odometry that errs. So
    it is where a table's columns are late: there are no frames whose beat would tell.
    """
    known = catalogue()
    behind = any(one in known and known[one].stage == "actuation" for one in own)
    is_table = stage == "bus" and not where.frames
    return "wheel" if is_table or (stage == "actuation" and behind) else stage


def _refitted(model: MotionModel, motion: MotionBlock, effects: Effects) -> Refitted | None:
    """Fit the values of the chosen effects again on what *model* may see."""
    if not effects:
        return None
    found = motion.scan.account(effects)
    terms = [
        model.add(term.variant, term) if model is not motion.model else term for term in found.terms
    ]
    return model.refit(terms, found.levels, free_levels=False)


def _settings(fitted: Refitted | None) -> tuple[list[Setting], list[list[Setting]]]:
    """Return the best values and draws from their posterior."""
    if fitted is None:
        return [], []
    terms = fitted.scored.terms
    best: list[Setting] = [(t.variant, c) for t, c in zip(terms, fitted.coefficients, strict=True)]
    draws = draw(fitted.scored, [t for t in terms if not t.is_fixed], np.random.default_rng(0))[
        :_DRAWS
    ]
    drawn = []
    for row in draws:
        place = 0
        one: list[Setting] = []
        for term in terms:
            width = len(term.variant.coefficients)
            one.append((term.variant, tuple(row[place : place + width])))
            place += width
        drawn.append(one)
    return best, drawn if draws.shape[1] else []


def _waterfall(gap: Gap, names: Effects, rms: Callable[[Effects], float]) -> Waterfall | None:
    """Return what switching each effect on takes away; *rms* is the gap with some of them on."""
    known = cache(rms)
    subsets = (
        frozenset(some)
        for size in range(len(names) + 1)
        for some in combinations(sorted(names), size)
    )
    if not names or not all(np.isfinite(known(some)) for some in subsets):
        return None  # one of them alone leaves no window that moves far enough to be compared
    reductions = shapley_reductions(names, known)
    return Waterfall(
        metric=gap.metric,
        unit=gap.unit,
        before=known(frozenset()),
        steps=tuple(
            WaterfallStep(effect=name, reduction=value)
            for name, value in sorted(reductions.items(), key=lambda item: -item[1])
        ),
        after=known(names),
        floor=gap.floor,
    )
