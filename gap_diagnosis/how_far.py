"""How far the gap shrinks on data that the fit of the values never saw."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import combinations

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.block_sums import Effects, total_of
from gap_diagnosis.gap.how_far import Compared, gap_of, pooled
from gap_diagnosis.gap.shares import joined, shares_of
from gap_diagnosis.gap.waterfall import shapley_reductions
from gap_diagnosis.measured import Measured, Unmeasured, measured
from gap_diagnosis.modelled import NO_GAP_MEASURED, told_apart
from gap_diagnosis.motion.block import ALIASES
from gap_diagnosis.pictures import Pictures
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
        unmeasured: by place, the logs on which nothing was, each with the reason.
        modelled: the gap with a model of what an unlisted cause goes with; None with listed ones.
        why_not: in a few words why it is not known how far that closes the gap; None if it is.
    """

    gap: Gap | None = None
    waterfall: Waterfall | None = None
    stages: dict[StageOrNone, float] = field(default_factory=dict)
    segments: tuple[Segment, ...] = ()
    pictures: Pictures = field(default_factory=Pictures)
    notes: tuple[str, ...] = ()
    unmeasured: Mapping[int, str] = field(default_factory=dict)
    modelled: Modelled | None = None
    why_not: str | None = NO_GAP_MEASURED


def shrink(
    analysis: Analysis,
    effects: Effects,
    stage: StageOrNone,
    robot: Robot,
    wire: Wire,
    held: Recording | None = None,
) -> Shrink:
    """Measure the gap with and without *effects*, whose values are fitted on the other part.

    With *held*, another log, that is where it is measured; else on held-out stretches.
    """
    one = measured(analysis, effects, stage, robot, wire, held)
    if isinstance(one, Unmeasured):
        return Shrink(notes=(one.why,), unmeasured={0: one.why}, pictures=one.pictures)
    own = analysis.motion_of(effects)
    shrunk = _shrink([one], effects, own, stage, is_other_log=held is not None)
    return replace(shrunk, notes=(_unmet(one),)) if one.unmet else shrunk


def shrink_on(
    analyses: Sequence[Analysis],
    effects: Effects,
    stage: StageOrNone,
    robot: Robot,
    wire: Wire,
    held: Recording,
) -> Shrink:
    """Measure the gap on another log, with the values of the one that tells most of *effects*."""
    teller = max(analyses, key=lambda one: total_of([one.blocks], effects)[0])
    found = shrink(teller, effects, stage, robot, wire, held)
    if not effects or len(analyses) == 1:
        return found
    whose = (
        f"On the held-out log the values are those of {teller.recording.name}, which tells most of "
        f"them; {'the other log has' if len(analyses) == 2 else 'the other logs have'} no say."
    )
    return replace(found, notes=(*found.notes, whose))


def shrink_each(
    analyses: Sequence[Analysis], effects: Effects, stage: StageOrNone, robot: Robot, wire: Wire
) -> tuple[Shrink, list[dict[str, Metric]]]:
    """Return how far the gap shrinks over all windows of several logs together, and every metric of
    each log, on its own held-out stretches.

    What lies along a log is of the one with the largest gap.
    """
    names = [one.recording.name for one in analyses]
    found = [measured(one, effects, stage, robot, wire, None) for one in analyses]
    unmeasured = {place: one.why for place, one in enumerate(found) if isinstance(one, Unmeasured)}
    notes = [f"{names[place]}: {why}" for place, why in unmeasured.items()]
    parts = {place: one for place, one in enumerate(found) if isinstance(one, Measured)}
    metrics = [one.metrics if isinstance(one, Measured) else {} for one in found]
    if not parts:
        first = found[0]
        pictures = first.pictures if isinstance(first, Unmeasured) else Pictures()
        return Shrink(notes=tuple(notes), unmeasured=unmeasured, pictures=pictures), metrics
    own = frozenset[str]().union(*(analyses[place].motion_of(effects) for place in parts))
    shrunk = _shrink(list(parts.values()), effects, own, stage, is_other_log=False)
    notes += [f"{names[place]}: {_unmet(one)}" for place, one in parts.items() if one.unmet]
    if shrunk.gap is not None:
        notes.append(_which(shrunk.gap, names, metrics))
    return replace(shrunk, notes=tuple(notes), unmeasured=unmeasured), metrics


def _which(gap: Gap, names: Sequence[str], metrics: Sequence[dict[str, Metric]]) -> str:
    """Return what was pooled, and which log is shown where only one can be."""
    own = {place: one[gap.metric].before for place, one in enumerate(metrics) if gap.metric in one}
    most = max(own, key=lambda place: own[place])
    told = ", ".join(f"{names[place]} {1e3 * before:.3g}" for place, before in own.items())
    together = "s together" if len(own) > 1 else ""
    return (
        f"The gap is over the windows of {len(own)} log{together} (before, in thousandths of "
        f"{gap.unit}: {told}). Where it arises along the log and the pictures are of the one with "
        f"the largest, {names[most]}, number {most + 1}. A bound is held against every log."
    )


def _shrink(
    parts: Sequence[Measured],
    effects: Effects,
    own: Effects,
    stage: StageOrNone,
    *,
    is_other_log: bool,
) -> Shrink:
    """Return the gap of all windows together; *own* are those *effects* that the motion shows."""
    acting = _acting(stage, own, has_frames=any(one.where.frames for one in parts))
    compared = _together([one.compared for one in parts])
    gap = gap_of(compared, acting, "log" if is_other_log else "stretches")
    if gap is None:
        return Shrink(pictures=parts[0].pictures())
    gap, modelled, why_not = _modelled(gap, acting, parts)
    if all(one.is_untested for one in parts):
        gap = _untested(gap)
    name = gap.metric
    having = [one for one in parts if name in one.metrics]
    shown = max(having, key=lambda one: one.metrics[name].before)
    shares: dict[StageOrNone, float] = {}
    segments: tuple[Segment, ...] = ()
    if stage != "none":
        shares = shares_of(joined([one.chain(name) for one in having]))
        segments = shown.segments(name)
    return Shrink(
        gap=gap,
        waterfall=None if gap.after is None else _waterfall(gap, effects, having),
        stages=shares,
        segments=segments,
        pictures=shown.pictures(),
        modelled=modelled,
        why_not=why_not,
    )


def _untested(gap: Gap) -> Gap:
    """Return a gap of which no share is closed or left open: no effect acts where it was held out.

    What noise leaves of it before is what it leaves after: a share of 0 would be no finding.
    """
    blank = {"closed": None, "ci95": None}
    metrics = {name: one.model_copy(update=blank) for name, one in gap.all.items()}
    return gap.model_copy(update={**blank, "all": metrics})


def _unmet(part: Measured) -> str:
    """Return which effects act where nothing was held out, so that nothing tests them; from the
    log's start: nobody counts from that of a wall clock."""
    begun_s = float(part.where.t_s[0])
    told = ", ".join(
        f"{effect} acts from {start_s - begun_s:.4g} to {stop_s - begun_s:.4g} s"
        for effect, (start_s, stop_s) in sorted(part.unmet.items())
    )
    return f"Nothing that was held out lies in the window: {told}. Its size is not tested there."


def _together(logs: Sequence[Mapping[str, Compared]]) -> dict[str, Compared]:
    """Return each metric over the windows of all logs that have it."""
    names = dict.fromkeys(name for one in logs for name in one)
    return {name: pooled([one[name] for one in logs if name in one]) for name in names}


def _modelled(
    gap: Gap, acting: StageOrNone, parts: Sequence[Measured]
) -> tuple[Gap, Modelled | None, str | None]:
    """Return the gap, in the metric in which a model of an unlisted cause tells most, the gap with
    it, and why there is none: of several logs all must have one, of the same variable."""
    models = [one.unlisted for one in parts if one.unlisted is not None]
    if not models:
        return gap, None, parts[0].why_not
    if len(models) < len(parts) or len({one.variable for one in models}) > 1:
        return gap, None, "it does not go with the same variable in all logs"
    with_model = gap_of(_together([one.beside for one in parts]), acting, gap.held_out)
    if with_model is None:
        return gap, None, NO_GAP_MEASURED
    return told_apart(gap.all, with_model, models[0].variable)


def _acting(stage: StageOrNone, own: Effects, *, has_frames: bool) -> StageOrNone:
    """Return the stage whose metrics speak of *own*, the effects that the motion shows.

    What lies behind the motor, which is counted, is the drive's; but it is odometry that errs. So
    it is where a table's columns are late: there are no frames whose beat would tell.
    """
    known = catalogue()
    behind = any(one in known and known[one].stage == "actuation" for one in own)
    is_table = stage == "bus" and not has_frames
    return "wheel" if is_table or (stage == "actuation" and behind) else stage


def _waterfall(gap: Gap, effects: Effects, parts: Sequence[Measured]) -> Waterfall | None:
    """Return what switching each of these effects on takes away, over the windows of all *parts*:
    by their own names, and not by those that the motion knows them by."""
    named = {ALIASES[effect]: effect for effect in effects & ALIASES.keys()}
    acting = [one.acting(gap.metric) for one in parts]
    if any(one is None for one in acting):
        return None
    names = frozenset[str]().union(*(one for one in acting if one is not None))
    windows = np.array([len(one.compared[gap.metric].before.mean_square) for one in parts])

    @cache
    def known(some: Effects) -> float:
        rms = [one.rms(gap.metric, some) for one in parts]
        if len(rms) == 1:
            return rms[0]
        return math.sqrt(float(np.average(np.square(rms), weights=windows)))

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
            WaterfallStep(effect=named.get(name, name), reduction=value)
            for name, value in sorted(reductions.items(), key=lambda item: -item[1])
        ),
        after=known(names),
        floor=gap.floor,
    )
