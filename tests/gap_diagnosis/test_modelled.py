"""How far a model of what an unlisted cause goes with closes the gap, where no fit has seen it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from full_size import at_full_size
from numpy.typing import NDArray
from structure_cases import PRIOR, ROBOT, WIRE, analysis_of, drive

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.answer import unknown_part
from gap_diagnosis.drive import drive_block
from gap_diagnosis.explanations import predict
from gap_diagnosis.firmware import firmware_block, replayed_pose
from gap_diagnosis.gap import hold_out, kinds_of
from gap_diagnosis.how_far import shrink
from gap_diagnosis.modelled import told_apart, unseen_dropped
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.stand_in import stand_in
from gap_diagnosis.motion.unknown import Alternative, alternatives
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result_parts import Gap, Metric, Modelled, StageOrNone
from hil_harness.effects import EffectSetting

SLIP = EffectSetting("lateral_slip", (("compliance", 0.05),))
SLIDES = Alternative("wheel", "lateral_acceleration", 0.0, 0.0, 1.0)
NOTHING: frozenset[str] = frozenset()
FEW = ("lateral_slip", "reference_lever_arm")
"""The effects that are asked for: no test here asks which of all it is."""


@cache
def analysed(*effects: EffectSetting) -> Analysis:
    """Return the analysis of a drive with these effects; made once."""
    return analysis_of(drive("calibration", *effects), *FEW)


class Nameless(MotionBlock):
    """The motion of a log of which no listed effect tells anything: its levels hold the cause."""

    @property
    def levels(self) -> Floats:
        """Those of no effect."""
        return self.model.no_effect_levels


def modelled(
    motion: Analysis, stage: StageOrNone, held: Recording | None = None
) -> tuple[Modelled | None, str | None]:
    """Return what is measured where no listed effect is taken for the cause."""
    assert motion.motion is not None
    model = motion.motion.model
    found = alternatives(model, model.no_effect_levels)
    shrunk = shrink(replace(motion, alternatives=tuple(found)), NOTHING, stage, ROBOT, WIRE, held)
    return shrunk.modelled, shrunk.why_not


def test_what_slides_with_the_pull_across_slides_less_where_the_model_never_saw_it() -> None:
    model, why_not = modelled(analysed(SLIP), "wheel")
    assert why_not is None
    assert model is not None
    assert model.variable == "lateral_acceleration"
    assert model.metric == "odometry_position_m"
    assert model.after is not None
    assert model.after < 0.3 * model.before
    assert model.closed is not None
    assert model.closed > 0.8
    assert model.ci95 is not None
    assert model.ci95[0] > 0.5


def test_what_noise_alone_leaves_is_told_without_the_cause_in_the_noise() -> None:
    """Levels that had risen with a slip without a name told a floor of 3.5 mm as 15."""
    motion = analysed(EffectSetting("lateral_slip", (("compliance", 0.3),)))
    assert motion.motion is not None
    nameless = Nameless(motion.motion.model, scan=motion.motion.scan)
    found = alternatives(nameless.model, nameless.levels)
    told = replace(motion, motion=nameless, alternatives=tuple(found))
    gap = shrink(told, NOTHING, "wheel", ROBOT, WIRE).gap
    assert gap is not None
    assert gap.floor is not None
    assert gap.floor < 0.1 * gap.before


def test_where_nothing_is_wrong_no_model_is_said_to_close_anything() -> None:
    model, why_not = modelled(analysed(), "wheel")
    assert model is None
    assert why_not == "it goes with no variable"


def test_what_a_model_of_noise_closes_may_be_chance() -> None:
    """Told that noise goes with the turn rate, it finds nothing there on the other stretches."""
    told = replace(analysed(), alternatives=(Alternative("wheel", "turn_rate", 5.0, 9.0, 0.5),))
    shrunk = shrink(told, NOTHING, "wheel", ROBOT, WIRE, None)
    assert shrunk.modelled is not None
    found = shrunk.modelled
    assert found.after == pytest.approx(found.before, rel=0.1)
    assert found.closed is None or found.ci95 is None or found.ci95[0] < 0


def test_without_a_stretch_held_out_nothing_is_claimed() -> None:
    analysis = analysed(SLIP)
    model, why_not = modelled(analysis, "wheel", held=analysis.recording)
    assert model is None
    assert why_not is not None
    assert why_not.startswith("another log was held out")
    of_the_drive = shrink(analysis, NOTHING, "actuation", ROBOT, WIRE, None)
    assert of_the_drive.modelled is None
    assert unknown_part([analysis], "actuation", None, of_the_drive.why_not).closes is None


@pytest.mark.parametrize(
    ("effect", "variable"),
    [
        (EffectSetting("drive_lag", (("time_constant", 0.2),)), "acceleration"),
        *at_full_size((EffectSetting("drive_gain", (("left", 0.05), ("right", -0.05))), "speed")),
    ],
)
def test_a_drive_without_a_name_is_modelled_where_no_fit_has_seen_it(
    effect: EffectSetting, variable: str
) -> None:
    """It was said that nothing stands in for it."""
    motion = analysed(effect)
    block = drive_block(motion.recording, ROBOT)
    assert block is not None
    made = replace(motion, blocks=(*motion.blocks, block))
    shrunk = shrink(made, NOTHING, "actuation", ROBOT, WIRE, None)
    found = shrunk.modelled
    assert shrunk.why_not is None
    assert found is not None
    assert (found.variable, found.metric) == (variable, "drive_position_m")
    assert found.closed is not None
    assert found.closed > 0.8


def reported(odometry: Callable[[Floats], Floats]) -> Analysis:
    """Return a drive's analysis whose frames report what *odometry* makes of the pose that the
    described program computes, float64[n, 3]."""
    motion = analysed()
    pose = odometry(replayed_pose(motion.recording, ROBOT, WIRE))
    recording = replace(
        motion.recording,
        odometry_x_m=pose[:, 0],
        odometry_y_m=pose[:, 1],
        odometry_heading_rad=pose[:, 2],
    )
    block = firmware_block(recording, ROBOT, WIRE)
    assert block is not None
    return replace(motion, recording=recording, blocks=(*motion.blocks, block))


def test_a_program_without_a_name_is_modelled_where_no_fit_has_seen_it() -> None:
    """It was said that nothing stands in for it. Ways forward count 2 % more than they are."""

    def longer(pose: Floats) -> Floats:
        return pose * np.where(np.arange(3) < 2, 1.02, 1.0)

    shrunk = shrink(reported(longer), NOTHING, "firmware", ROBOT, WIRE, None)
    found = shrunk.modelled
    assert shrunk.why_not is None
    assert found is not None
    assert (found.variable, found.metric) == ("speed", "firmware_position_m")
    assert found.closed is not None
    assert found.closed > 0.95


def test_a_model_of_a_programs_noise_closes_nothing() -> None:
    rng = np.random.default_rng(5)

    def shaken(pose: Floats) -> Floats:
        return pose + np.cumsum(rng.normal(0.0, 1e-3, pose.shape), axis=0)

    found = shrink(reported(shaken), NOTHING, "firmware", ROBOT, WIRE, None).modelled
    assert found is not None
    assert found.ci95 is None or found.ci95[0] < 0


def test_a_stand_in_leaves_alone_what_a_program_does_right_and_what_its_replay_never_does() -> None:
    def longer(pose: Floats) -> Floats:
        return pose * np.where(np.arange(3) < 2, 1.02, 1.0)

    analysis = reported(longer)
    assert analysis.firmware is not None
    pose = replayed_pose(analysis.recording, ROBOT, WIRE)
    every = np.ones(len(pose), np.bool_)
    path = analysis.firmware.stand_in(pose, "speed", every)
    assert path is not None
    known = np.isfinite(path).all(axis=1)
    np.testing.assert_allclose(path[known, 2], pose[known, 2], atol=1e-12)
    straight = np.column_stack([pose[:, 0], np.zeros((len(pose), 2))])
    assert analysis.firmware.stand_in(straight, "turn_rate", every) is None


def test_the_last_digits_of_a_program_without_a_name_are_no_gap_to_close() -> None:
    def coarser(pose: Floats) -> Floats:
        return np.asarray(np.round(pose, 5))

    shrunk = shrink(reported(coarser), NOTHING, "firmware", ROBOT, WIRE, None)
    assert shrunk.modelled is None
    assert shrunk.why_not == "it moves the odometry by less than makes a difference"


def slide(log: Recording, seen: NDArray[np.bool_]) -> Floats:
    """Return how far sideways the model has the robot slide, fitted on the ticks *seen*."""
    model = MotionModel(unseen_dropped(log, seen), ROBOT, PRIOR, keep=seen)
    found = stand_in(model, SLIDES, model.level_prior.median)
    assert found is not None
    return predict(model.nodes.motion, [found.best]).lateral_m


def test_the_model_never_sees_what_is_held_out() -> None:
    """A reference that is wrong there changes nothing; seen, it would."""
    log = drive("calibration", SLIP)
    sides = hold_out(log.t_s, kinds_of(log, ROBOT))
    reference = log.reference
    assert reference is not None
    unseen = np.zeros(len(reference.t_s), dtype=np.bool_)
    for start_s, stop_s in sides.windows:
        unseen |= (reference.t_s >= start_s) & (reference.t_s <= stop_s)
    bent = reference.x_m + np.where(unseen, 0.05 * np.sin(reference.t_s), 0.0)
    other = replace(log, reference=replace(reference, x_m=bent))
    told = slide(log, sides.fit)
    assert np.abs(told).sum() > 0.1
    assert slide(other, sides.fit) == pytest.approx(told, rel=1e-9)
    everything = np.ones(len(log.t_s), dtype=np.bool_)
    changed = slide(other, everything) - slide(log, everything)
    assert np.abs(changed).sum() > 0.1 * np.abs(told).sum()


def test_a_fit_never_sees_the_gyro_of_what_is_held_out() -> None:
    """By how far it turned across a stretch was handed on to the tick after it: three degrees too
    many a second in each made the fitted walk of its bias 3,500 times as wide."""
    log = drive("calibration", SLIP)
    sides = hold_out(log.t_s, kinds_of(log, ROBOT))
    assert log.gyro_rate_rad_s is not None
    turned = replace(log, gyro_rate_rad_s=log.gyro_rate_rad_s + np.where(sides.fit, 0.0, 0.05))
    told, other = (MotionModel(one, ROBOT, PRIOR, keep=sides.fit) for one in (log, turned))
    # A search ends where a step promises less than 0.05 nat: a third of how sure its levels are.
    assert other.no_effect_levels == pytest.approx(told.no_effect_levels, rel=0.05)
    seen = MotionModel(turned, ROBOT, PRIOR).no_effect_levels
    assert np.abs(np.log(seen / told.no_effect_levels)).max() > 0.1


def test_the_gap_is_the_same_whether_or_not_a_model_of_it_is_tried() -> None:
    """A lawnmower's gap of 139 mm was told as 84: windows that a model could not be laid on, the
    worst, were left out of both."""
    bare = Metric(unit="m", before=0.139, floor=0.01, windows=81)
    fewer = bare.model_copy(update={"before": 0.084, "after": 0.09, "windows": 78})
    tried = Gap(metric="odometry_position_m", held_out="stretches", **dict(fewer))
    gap, model, why_not = told_apart({"odometry_position_m": bare}, tried, "speed")
    assert gap.before == 0.139
    assert model is None
    assert why_not == "it moves the robot too little in some windows to compare them"
