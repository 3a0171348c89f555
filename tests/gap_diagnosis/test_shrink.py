"""How far the gap shrinks with what was found, stage by stage."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from structure_cases import ROBOT, WIRE, analysis_of, drive

from gap_diagnosis.bus import bus_block
from gap_diagnosis.drive import drive_block
from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.how_far import shrink, shrink_each, shrink_on
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

FEW = ("gyro_scale", "radius_mismatch", "wheelbase_scale")
"""The effects that are asked for: which of all it is, other tests ask."""
SLIPPING = ("one_sided_slip", "radius_mismatch")
"""And those of a drive on which a wheel slips."""


def test_a_program_that_is_found_closes_the_gap_of_the_firmware() -> None:
    wrong = EffectSetting("firmware_constant", (("constant", "wheel_radius"), ("scale", 0.01)))
    figure8 = replace(scenario("figure8"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, figure8, (wrong,), 3, reference=ReferenceNoise(), duration_s=30.0
    )
    motion, firmware = analysis_of(log, *FEW), firmware_block(log, ROBOT, WIRE)
    assert firmware is not None
    analysis = replace(motion, blocks=(*motion.blocks, firmware))
    shrunk = shrink(analysis, frozenset({"firmware_constant"}), "firmware", ROBOT, WIRE, None)
    found, fall = shrunk.gap, shrunk.waterfall
    assert found is not None
    assert found.metric == "firmware_position_m"
    assert found.before > 0.01
    assert found.after is not None
    assert found.after < 1e-6
    assert found.closed is not None
    assert found.closed > 0.999
    assert fall is not None
    assert [step.effect for step in fall.steps] == ["firmware_constant"]
    assert fall.steps[0].reduction == pytest.approx(found.before - found.after)
    assert shrunk.stages == {"firmware": 1.0}, "only the program touches the odometry's replay"
    assert {segment.stage for segment in shrunk.segments} == {"firmware"}


def test_each_effect_of_a_drive_takes_its_part_off_the_gap_on_commands() -> None:
    wrong = (
        EffectSetting("drive_lag", (("time_constant", 0.3),)),
        EffectSetting("drive_gain", (("left", 0.0), ("right", 0.08))),
    )
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario("calibration"), effects=()), wrong, 3,
        reference=ReferenceNoise(), duration_s=30.0,
    )  # fmt: skip
    motion, commands = analysis_of(log, *FEW), drive_block(log, ROBOT)
    assert commands is not None
    analysis = replace(motion, blocks=(*motion.blocks, commands))
    both = frozenset({"drive_lag", "drive_gain"})
    shrunk = shrink(analysis, both, "actuation", ROBOT, WIRE, None)
    gap, fall = shrunk.gap, shrunk.waterfall
    assert gap is not None
    assert gap.metric == "drive_position_m"
    assert gap.closed is not None
    assert gap.closed > 0.9
    assert fall is not None
    assert {step.effect for step in fall.steps} == both
    assert min(step.reduction for step in fall.steps) > 0
    assert fall.after == pytest.approx(gap.after)
    assert shrunk.stages == {"actuation": 1.0}, "not of the sensors, which tell what was driven"
    assert {segment.stage for segment in shrunk.segments} == {"actuation"}


def test_each_effect_of_the_bus_takes_its_part_off_the_gap_of_the_stamps() -> None:
    wrong = (
        EffectSetting("clock_skew", (("skew", 5e-4),)),
        EffectSetting("frame_jitter", (("sigma", 5e-4), ("frame", "IMU"))),
    )
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario("calibration"), effects=()), wrong, 3,
        reference=ReferenceNoise(), duration_s=60.0,
    )  # fmt: skip
    motion, bus = analysis_of(log, *FEW), bus_block(log, ROBOT, WIRE)
    assert bus is not None
    analysis = replace(motion, blocks=(*motion.blocks, bus))
    both = frozenset({"clock_skew", "frame_jitter"})
    shrunk = shrink(analysis, both, "bus", ROBOT, WIRE, None)
    gap, fall = shrunk.gap, shrunk.waterfall
    assert gap is not None
    assert gap.metric == "timing_s"
    assert gap.after is not None
    assert fall is not None
    steps = {step.effect: step.reduction for step in fall.steps}
    assert steps.keys() == both
    assert steps["clock_skew"] == pytest.approx(gap.before - gap.after)
    assert steps["clock_skew"] > 0.5 * gap.before
    assert steps["frame_jitter"] == 0.0, "it spreads stamps and leaves their beat"
    assert shrunk.stages == {"bus": 1.0}
    alone = shrink(analysis, frozenset({"frame_jitter"}), "bus", ROBOT, WIRE, None).waterfall
    assert alone is not None
    assert alone.before == alone.after


def test_what_takes_its_part_off_a_gap_stands_there_by_the_name_that_it_was_told_by() -> None:
    """Of a Kobuki whose counts per turn were told a bar said radius_scale."""
    wrong = (EffectSetting("ticks_per_rev", (("scale", 0.02),)),)
    figure8 = replace(scenario("figure8"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, figure8, wrong, 3, reference=ReferenceNoise(), duration_s=30.0
    )
    analysis = analysis_of(log, *FEW, "radius_scale", "ticks_per_rev")
    for name in ("ticks_per_rev", "radius_scale"):
        fall = shrink(analysis, frozenset({name}), "wheel", ROBOT, WIRE, None).waterfall
        assert fall is not None
        assert [step.effect for step in fall.steps] == [name]


def test_a_gap_of_the_odometry_falls_to_the_stages_of_its_chain() -> None:
    wider = EffectSetting("wheelbase_scale", (("scale", 0.02),))
    shrunk = shrink(
        analysis_of(drive("figure8", wider), *FEW), frozenset({"wheelbase_scale"}), "wheel",
        ROBOT, WIRE, None,
    )  # fmt: skip
    assert shrunk.gap is not None
    assert shrunk.gap.metric in {"odometry_position_m", "turn_difference_rad"}
    assert sum(shrunk.stages.values()) == pytest.approx(1)
    assert set(shrunk.stages) > {"wheel", "gyro"}


def test_the_gap_of_several_logs_is_over_all_their_windows_and_each_has_its_own() -> None:
    mismatch = EffectSetting("radius_mismatch", (("mismatch", 0.02),))
    logs = [
        replace(drive("calibration", *effects), name=name)
        for name, effects in (("good.log", ()), ("bad.log", (mismatch,)))
    ]
    found, (good, bad) = shrink_each(
        [analysis_of(log, *FEW) for log in logs],
        frozenset({"radius_mismatch"}),
        "wheel",
        ROBOT,
        WIRE,
    )
    assert bad["turn_difference_rad"].before > 10 * good["turn_difference_rad"].before
    assert found.gap is not None
    for name, both in found.gap.all.items():
        squares = [one[name].windows * one[name].before ** 2 for one in (good, bad)]
        assert both.windows == good[name].windows + bad[name].windows
        assert both.before == pytest.approx(math.sqrt(sum(squares) / both.windows))
    assert found.gap.closed is not None
    assert found.gap.closed > 0.9
    assert found.gap.ci95 is not None
    fall = found.waterfall
    assert fall is not None
    assert fall.before == pytest.approx(found.gap.before)
    assert fall.after == pytest.approx(found.gap.after)
    assert sum(found.stages.values()) == pytest.approx(1)
    (note,) = found.notes
    assert "over the windows of 2 logs together" in note
    assert "the pictures are of the one with the largest, bad.log, number 2" in note


def test_on_a_held_out_log_the_values_are_of_the_log_that_tells_most_of_them() -> None:
    """They were of the first: a straight line, which says nothing of a wheelbase."""
    wider = EffectSetting("wheelbase_scale", (("scale", 0.02),))
    blind, telling = (
        replace(drive(way, wider), name=f"{way}.log") for way in ("straight", "figure8")
    )
    found = shrink_on(
        [analysis_of(blind, *FEW), analysis_of(telling, *FEW)],
        frozenset({"wheelbase_scale"}),
        "wheel",
        ROBOT,
        WIRE,
        drive("square", wider),
    )
    assert found.gap is not None
    assert found.gap.held_out == "log"
    assert found.gap.closed is not None
    assert found.gap.closed > 0.9
    (note,) = found.notes
    assert "those of figure8.log" in note


def test_a_log_on_which_nothing_is_held_out_takes_no_part_in_the_gap_and_says_so() -> None:
    logs = [
        replace(synthetic_recording(
            ROBOT, WIRE, replace(scenario("figure8"), effects=()), (), 3, duration_s=duration_s,
            reference=ReferenceNoise(),
        ), name=f"{duration_s:.0f}s.log")
        for duration_s in (12.0, 60.0)
    ]  # fmt: skip
    found, (short, long) = shrink_each(
        [analysis_of(log, *FEW) for log in logs], frozenset(), "none", ROBOT, WIRE
    )
    assert not short
    assert found.unmeasured.keys() == {0}
    assert "lasts 12 s" in found.unmeasured[0]
    assert found.gap is not None
    assert found.gap.all == long
    assert found.notes[0].startswith("12s.log: ")
    assert "over the windows of 1 log" in found.notes[1]


def test_without_a_gap_no_stage_carries_it() -> None:
    shrunk = shrink(analysis_of(drive("figure8"), *FEW), frozenset(), "none", ROBOT, WIRE, None)
    assert shrunk.gap is not None, "how large it is with noise alone is measured all the same"
    assert not shrunk.stages
    assert not shrunk.segments


def test_what_is_held_out_of_a_drive_leaves_no_trace_in_its_values() -> None:
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario("calibration"), effects=()),
        (EffectSetting("drive_lag", (("time_constant", 0.3),)),), 3, duration_s=30.0,
    )  # fmt: skip
    late = log.t_s > 20.0
    other = replace(log, left_ticks=np.where(late, 2.0 * log.left_ticks, log.left_ticks))
    found = []
    for one in (log, other):
        block = drive_block(one, ROBOT)
        assert block is not None
        early = block.only(block.data.time_s < 19.5)
        found.append(early.fit(frozenset({"drive_lag"})).parameters["drive_lag.time_constant"])
    assert found[0].value == found[1].value
    assert float(found[0].value) == pytest.approx(0.3, abs=0.02)


def slip_of_the_left_wheel(start_s: float, stop_s: float) -> EffectSetting:
    window = (("start_s", start_s), ("stop_s", stop_s))
    return EffectSetting("one_sided_slip", (("side", "left"), ("ratio", 0.3), *window))


def test_of_an_effect_in_a_window_a_part_is_held_out() -> None:
    """The one stretch held out of this drive lay behind the slip, which closed 0 % of its gap."""
    log = drive("figure8", slip_of_the_left_wheel(10.0, 20.0))
    shrunk = shrink(
        analysis_of(log, *SLIPPING), frozenset({"one_sided_slip"}), "wheel", ROBOT, WIRE, None
    )
    assert shrunk.gap is not None
    assert shrunk.gap.closed == pytest.approx(1.0, abs=0.05)
    assert shrunk.notes == ()


def by_wall_clock(log: Recording) -> Recording:
    """Return a log without frames, stamped with seconds since 1970."""
    assert log.reference is not None
    reference = replace(log.reference, t_s=log.reference.t_s + 1.7e9)
    return replace(log, t_s=log.t_s + 1.7e9, reference=reference, frames={})


def test_a_window_of_which_nothing_is_held_out_is_told_from_the_log_s_start() -> None:
    log = by_wall_clock(drive("figure8", slip_of_the_left_wheel(12.0, 13.5)))
    slip = frozenset({"one_sided_slip"})
    (why,) = shrink(analysis_of(log, *SLIPPING), slip, "wheel", ROBOT, WIRE, None).notes
    assert "one_sided_slip acts from 12 to 13.5 s." in why


def test_where_nothing_of_an_effect_s_window_is_held_out_no_share_is_told_but_why() -> None:
    """Of 1.5 s no part can be held out and another one fitted; what is the same before and after
    there is not 0 % closed."""
    log = drive("figure8", slip_of_the_left_wheel(12.0, 13.5))
    analysis = analysis_of(log, *SLIPPING)
    shrunk = shrink(analysis, frozenset({"one_sided_slip"}), "wheel", ROBOT, WIRE, None)
    assert shrunk.gap is not None
    assert shrunk.gap.after is not None
    assert {one.closed for one in (shrunk.gap, *shrunk.gap.all.values())} == {None}
    assert shrunk.gap.ci95 is None
    (why,) = shrunk.notes
    assert why.startswith("Nothing that was held out lies in the window: one_sided_slip acts from")
    together, _ = shrink_each([analysis], frozenset({"one_sided_slip"}), "wheel", ROBOT, WIRE)
    assert any("Nothing that was held out lies in the window" in one for one in together.notes)
