"""A table has no frames, but where it has two clocks it tells of the ECU's like any log."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosed import ROBOT, WIRE
from structure_cases import analysis_of

from gap_diagnosis.diagnose import _stage, diagnose_recordings
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.how_far import shrink
from gap_diagnosis.ranking import Ranking
from gap_diagnosis.recording import Recording
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import StageOrNone
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def table(*effects: EffectSetting, seed: int = 3) -> Recording:
    drive = replace(scenario("calibration"), effects=())
    log = synthetic_recording(ROBOT, WIRE, drive, effects, seed, duration_s=60.0)
    return replace(log, frames={})


OTHERS = frozenset(EXPLAINED) - {
    "clock_skew",
    "extra_ticks",
    "frame_latency",
    "gyro_bias",
    "gyro_lag",
    "gyro_scale",
    "radius_scale",
    "reference_clock_skew",
    "wheelbase_scale",
}
"""What a library lacks of which these alone are asked."""
FAST = EffectSetting("clock_skew", (("skew", 0.001),))


def diagnosed(recording: Recording) -> Diagnosis:
    return diagnose_recordings([recording], ROBOT, WIRE, without=OTHERS).diagnosis


def test_a_table_of_a_fast_clock_names_the_clock() -> None:
    found = diagnosed(table(FAST))
    assert found.verdict == "clock_skew"
    known = found.which[0].parameters["clock_skew.skew"]
    assert getattr(known, "estimate", 0.0) == pytest.approx(0.001, abs=5e-6)


def test_a_table_of_even_clocks_or_of_one_names_none() -> None:
    even = table()
    assert diagnosed(even).verdict == "no_gap"
    alone = replace(even, clock_skew=float("nan"), clock_skew_sd=float("nan"))
    assert diagnosed(alone).verdict == "no_gap"


def test_a_table_of_nothing_but_wheels_says_nothing_of_the_robot_whatever_its_clocks() -> None:
    wheels = replace(
        table(FAST),
        gyro_code=None,
        gyro_rate_rad_s=None,
        v_command_m_s=None,
        w_command_rad_s=None,
        odometry_x_m=None,
        odometry_y_m=None,
        odometry_heading_rad=None,
    )
    with pytest.raises(DiagnosisError, match="nothing to compare the wheels with"):
        diagnosed(wheels)


def test_a_clock_and_a_late_column_are_not_where_a_tables_gap_lies() -> None:
    """Two of a Kobuki's seven effects: no beat of frames tells them, and no gap was measured."""
    stages: dict[StageOrNone, float] = {"none": 0.0, "wheel": 0.4, "bus": 0.6}
    verdict = "clock_skew+frame_latency+wheelbase_scale"
    nothing = Ranking((), {})
    assert _stage(verdict, nothing, stages, has_frames=False) == "wheel"
    assert _stage(verdict, nothing, stages, has_frames=True) == "bus"
    assert _stage("clock_skew", nothing, stages, has_frames=False) == "bus"


def test_a_mistake_of_the_set_up_is_where_the_gap_lies_whatever_is_beside_it() -> None:
    """A Kobuki's swapped wheels closed -13 % of what its firmware's constant left."""
    stages: dict[StageOrNone, float] = {"none": 0.0, "firmware": 0.6, "setup": 0.4}
    nothing = Ranking((), {})
    for verdict, stage in (
        ("fixed_tick_period+setup_wheels_swapped", "setup"),
        ("fixed_tick_period", "firmware"),
    ):
        assert _stage(verdict, nothing, stages, has_frames=False) == stage


def test_a_table_of_a_fast_clock_has_the_gap_of_its_motion() -> None:
    analysis = analysis_of(table(FAST, EffectSetting("wheelbase_scale", (("scale", 0.03),))))
    both = frozenset({"clock_skew", "wheelbase_scale"})
    gap = shrink(analysis, both, "bus", ROBOT, WIRE, None).gap
    assert gap is not None
    assert gap.metric == "turn_difference_rad"
    assert gap.closed is not None
    assert gap.closed > 0.9
