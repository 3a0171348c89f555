"""One log measured with and without effects, on data that the fit of their values never saw."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.block_sums import Effects
from gap_diagnosis.downstream import Downstream, driven, reprogrammed
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.explanations.known import known_effects
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.holdout import hold_out
from gap_diagnosis.gap.how_far import Compared, metrics_of
from gap_diagnosis.gap.manoeuvres import Kinds, kinds_of
from gap_diagnosis.gap.metrics import clock_skew_of
from gap_diagnosis.gap.on_recording import (
    compare_all,
    levels_of,
    odometry_rms,
    replayed_rms,
    timing_rms,
    windows_on,
)
from gap_diagnosis.gap.shares import Chain
from gap_diagnosis.gap.where import manoeuvre_segments, metric_chain
from gap_diagnosis.gap.windows import Window
from gap_diagnosis.modelled import (
    ANOTHER_LOG,
    Model,
    modelled_on,
    unseen_dropped,
)
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.bursts import beside_burst
from gap_diagnosis.motion.drawing import draw
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.neighbours import DEAD
from gap_diagnosis.motion.revived import revived, with_dead
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.pictures import Pictures, ResidualSeries
from gap_diagnosis.picturing import pictures_of
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import Metric, Segment, StageOrNone
from gap_diagnosis.rows_apart import rows_apart
from gap_diagnosis.touching import (
    ODOMETRY_AGAINST_REPLAY,
    STAMPS_AGAINST_BEAT,
    WHEELS_AGAINST_COMMANDS,
)
from hil_harness.assembly import Wire
from hil_harness.effects import catalogue
from hil_harness.robot import Robot

_DRAWS: Final = 40
_SKEW: Final = "clock_skew"
"""Of the bus's effects the one that shifts a beat; what spreads or takes frames leaves it."""
_ODOMETRY: Final = frozenset({"odometry_position_m", "odometry_heading_rad", "turn_difference_rad"})


@dataclass(frozen=True)
class Measured:
    """One log with everything that its gap is measured with.

    Attributes:
        where: the log, or the held-out one.
        robot: as described.
        model: of the log that was fitted.
        motion, windows, kinds: of *where*; windows on its held-out part.
        settings: the effects that the motion shows, as fitted.
        compared: each metric, window by window.
        behind: the drive's and the program's simulation, by metric.
        on_bus: the winning effects of the bus.
        skew: the explained part of the ECU's clock error.
        unlisted: the model of what an unlisted cause goes with; None with listed effects.
        why_not: in a few words why there is none.
        beside: each metric with that model, window by window; empty without one.
        unmet: of the effects that act in a window of the log, those in whose window nothing was
            held out, with the window.
    """

    where: Recording
    robot: Robot
    model: MotionModel
    motion: Motion
    windows: tuple[Window, ...]
    kinds: Kinds
    settings: tuple[Setting, ...]
    compared: Mapping[str, Compared]
    behind: Mapping[str, Downstream | None]
    on_bus: Effects
    skew: float
    unlisted: Model | None = None
    why_not: str | None = ANOTHER_LOG
    beside: Mapping[str, Compared] = field(default_factory=dict)
    unmet: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def is_untested(self) -> bool:
        """All that was switched on acts where nothing was held out."""
        acting = self.on_bus.union(one.effect for one, _ in self.settings)
        acting = acting.union(*(one.effects for one in self.behind.values() if one is not None))
        return bool(acting) and acting <= self.unmet.keys()

    @cached_property
    def metrics(self) -> dict[str, Metric]:
        """Each metric of this log alone."""
        return metrics_of(self.compared)

    def acting(self, metric: str) -> Effects | None:
        """Return the winning effects that act in a metric; None where none was switched on."""
        if metric in _ODOMETRY:
            return frozenset(one.effect for one, _ in self.settings)
        if metric == "timing_s":
            return self.on_bus
        downstream = self.behind.get(metric)
        return None if downstream is None else downstream.effects

    def rms(self, metric: str, effects: Effects) -> float:
        """Return a metric with some of the winning effects on; NaN where it cannot be."""
        if metric in _ODOMETRY:
            chosen = [one for one in self.settings if one[0].effect in effects]
            return odometry_rms(metric, self.where, self.robot, self.motion, self.windows, chosen)
        if metric == "timing_s":
            known = self.where.granted.number("clock_skew.skew")
            return timing_rms(self.where, self.windows, self.skew if _SKEW in effects else known)
        downstream = self.behind.get(metric)
        path = None if downstream is None else downstream.path(effects)
        if path is None:
            return math.nan
        return replayed_rms(metric, self.where, self.robot, self.motion, path, self.windows)

    def chain(self, metric: str) -> Chain:
        """Return which stage's data carries the errors of a metric."""
        return metric_chain(
            metric, self.where, self.robot, self.motion, self.windows, self.settings
        )

    def segments(self, metric: str) -> tuple[Segment, ...]:
        """Return the same, manoeuvre by manoeuvre."""
        return manoeuvre_segments(
            self.where, self.robot, self.motion, self.kinds, self.settings, metric=metric
        )

    def pictures(self) -> Pictures:
        """Return what to draw from; residuals are of the fitted log."""
        apart: list[ResidualSeries] = []
        others = WHEELS_AGAINST_COMMANDS, ODOMETRY_AGAINST_REPLAY, STAMPS_AGAINST_BEAT
        missing = [f"{', '.join(others)}: another log was held out"]
        if self.motion is self.model.nodes.motion:
            drive, program = (
                None if one is None else one.replayed
                for one in (self.behind["drive_position_m"], self.behind["firmware_position_m"])
            )
            skew = self.skew if _SKEW in self.on_bus else None
            apart, missing = rows_apart(self.where, self.robot, self.motion, drive, program, skew)
        return pictures_of(
            self.where,
            self.model,
            self.windows,
            self.settings,
            motion=self.motion,
            robot=self.robot,
            apart=apart,
            missing=missing,
        )


@dataclass(frozen=True)
class Unmeasured:
    """A log whose gap is not measured.

    Attributes:
        why: in a sentence.
        pictures: of what there is.
    """

    why: str
    pictures: Pictures


def measured(
    analysis: Analysis,
    effects: Effects,
    stage: StageOrNone,
    robot: Robot,
    wire: Wire,
    held: Recording | None,
) -> Measured | Unmeasured:
    """Measure with and without *effects*, whose values are fitted on the other part; without any,
    with a model of what an unlisted cause in *stage* goes with.

    With *held*, another log, that is where it is measured; else on held-out stretches.
    """
    if analysis.motion is None:
        return Unmeasured(
            "Neither gyro nor reference: the gap of the pose is not measured.", Pictures()
        )
    own = analysis.motion.moving(effects)
    model, where = analysis.motion.model, analysis.recording
    unlisted: Model | None = None
    why_not: str | None = ANOTHER_LOG
    unmet: Mapping[str, tuple[float, float]] = {}
    if held is None:
        kinds = kinds_of(where, robot)
        acting_s = _windows_s(analysis.motion, own)
        sides = hold_out(where.t_s, kinds, list(acting_s.values()))
        unmet = {effect: one for effect, one in acting_s.items() if one in sides.unmet}
        if sides.why_not is not None:
            drive = driven(analysis, effects, where, robot, None)
            firmware = reprogrammed(analysis, effects, where, robot, wire, is_other_log=False)
            told, ran = (None if one is None else one.replayed for one in (drive, firmware))
            apart, missing = rows_apart(where, robot, model.nodes.motion, told, ran, None)
            known = pictures_of(where, model, [], (), apart=apart, missing=missing)
            return Unmeasured(sides.why_not, known)
        is_unlisted = not effects and stage != "none"
        seen = unseen_dropped(where, sides.fit) if is_unlisted else where
        fitted = None
        if own or is_unlisted:
            others = frozenset[str]() if is_unlisted else frozenset(EXPLAINED) - own
            fit_side = MotionModel(seen, robot, model.prior, keep=sides.fit, without=others)
            if analysis.burst is not None and analysis.has_burst:
                fit_side = beside_burst(fit_side, analysis.burst)
            fitted = _refitted(fit_side, analysis.motion, own)
            if is_unlisted:
                unlisted, why_not = modelled_on(fit_side, analysis, stage, wire, sides.fit)
        motion, mask, kept = model.nodes.motion, sides.held_out, sides.fit
    else:
        where = held
        kinds = kinds_of(held, robot)
        fitted = _refitted(model, analysis.motion, own)
        motion = _motion_of(held, robot, model.prior)
        mask = np.ones(len(held.t_s), dtype=np.bool_)
        kept = np.ones(len(analysis.recording.t_s), dtype=np.bool_)
    settings, drawn = _settings(fitted)
    windows = windows_on(motion, mask)
    firmware = reprogrammed(analysis, effects, where, robot, wire, is_other_log=held is not None)
    drive = driven(analysis, effects, where, robot, kept if held is None else None)
    on_bus = frozenset(e for e in effects if e in catalogue() and catalogue()[e].stage == "bus")
    fitted_on = analysis.recording
    skew = clock_skew_of(fitted_on.frames, fitted_on.t_s, kept) if _SKEW in effects else 0.0
    # Without a name the log's levels have the cause in them: noise alone leaves what is left of a
    # model of it.
    own_levels = analysis.motion.levels_beside(effects) if unlisted is None else unlisted.levels
    levels = levels_of(own_levels, robot, motion)
    compared = compare_all(
        where,
        robot,
        motion,
        windows,
        effects=settings,
        draws=drawn,
        levels=levels,
        drive=None if drive is None else drive.replayed,
        firmware=None if firmware is None else firmware.replayed,
        clock_skew=skew if on_bus else None,
    )
    beside: Mapping[str, Compared] = {}
    if unlisted is not None:
        beside = compare_all(
            where, robot, motion, windows,
            effects=unlisted.settings, draws=unlisted.drawn, levels=levels, drive=unlisted.drive,
            firmware=unlisted.firmware, clock_skew=unlisted.clock_skew,
        )  # fmt: skip
    return Measured(
        where=where,
        robot=robot,
        model=model,
        motion=motion,
        windows=windows,
        kinds=kinds,
        settings=tuple(settings),
        compared=compared,
        behind={"drive_position_m": drive, "firmware_position_m": firmware},
        on_bus=on_bus,
        skew=skew,
        unlisted=unlisted,
        why_not=why_not,
        beside=beside,
        unmet=unmet,
    )


def _motion_of(held: Recording, robot: Robot, prior: Prior) -> Motion:
    """Return the motion of a held-out log, what is known as that log has it."""
    motion = estimate_motion(held, robot)
    if all(len(one.ways) == 1 for one in known_effects(held.granted, motion)):
        return motion
    return MotionModel(held, robot, prior).nodes.motion


def _windows_s(motion: MotionBlock, effects: Effects) -> dict[str, tuple[float, float]]:
    """Return where in the log those of the effects act that do so in a window [start_s, stop_s]."""
    found = {}
    for term in motion.scan.account(effects).terms if effects else ():
        fixed = term.variant.fixed
        if {"start_s", "stop_s"} <= fixed.keys():
            found[term.variant.effect] = float(fixed["start_s"]), float(fixed["stop_s"])
    return found


def _refitted(model: MotionModel, motion: MotionBlock, effects: Effects) -> Refitted | None:
    """Fit the values of the chosen effects again on what *model* may see."""
    if not effects:
        return None
    there = motion.scan.turning_with(effects)
    if there is None:
        return _fitted_on(model, motion.scan, effects)
    dead = motion.scan.account(DEAD).terms
    turning = there.model if model is motion.model else revived(model, dead[0])
    return with_dead(dead, _fitted_on(turning, there, effects - DEAD))


def _fitted_on(model: MotionModel, scan: Scan, effects: Effects) -> Refitted:
    found = scan.account(effects)
    terms = [model.take(term) if model is not scan.model else term for term in found.terms]
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
