"""Rows of the map of residuals beside the motion's: commands, replay, stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from structure_cases import ROBOT, WIRE, analysis_of

from gap_diagnosis.drive import drive_block
from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.how_far import Shrink, shrink
from gap_diagnosis.pictures import ResidualSeries
from gap_diagnosis.picturing import residual_times
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import StageOrNone
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

LAGS = EffectSetting("drive_lag", (("time_constant", 0.3),))
SCALED = EffectSetting("firmware_constant", (("constant", "wheel_radius"), ("scale", 0.01)))
LOSES = EffectSetting("frame_loss", (("probability", 0.02), ("frame", "ENCODER")))


def drive(*effects: EffectSetting, duration_s: float = 30.0) -> Recording:
    return synthetic_recording(
        ROBOT, WIRE, replace(scenario("calibration"), effects=()), effects, 3,
        reference=ReferenceNoise(), duration_s=duration_s,
    )  # fmt: skip


def shrunk(log: Recording, stage: StageOrNone = "none", *effects: str) -> Shrink:
    motion = analysis_of(log)
    blocks = [drive_block(log, ROBOT), firmware_block(log, ROBOT, WIRE)]
    made = replace(motion, blocks=(*motion.blocks, *(one for one in blocks if one is not None)))
    return shrink(made, frozenset(effects), stage, ROBOT, WIRE, None)


def series(found: Shrink, name: str) -> ResidualSeries:
    return next(one for one in found.pictures.residuals if one.name == name)


def test_commands_replay_and_stamps_have_rows_that_add_up() -> None:
    """A wheel's size in the program, the same of both wheels, leaves the heading to the gyro."""
    found = shrunk(drive(LAGS, SCALED, LOSES), "actuation", "drive_lag")
    times = residual_times(found.pictures)
    assert times is not None
    rows = {row.residual: row for row in times.rows}
    assert {row.stage for row in times.rows} == {"wheel", "gyro", "actuation", "firmware", "bus"}
    assert all(sum(row.shares) == pytest.approx(1) for row in times.rows)
    assert rows["frames missing"].stage == "bus"
    assert times.missing == ("odometry − replay, heading: the same all along",)
    way = series(found, "wheels − commands, way")
    assert way.explained is not None
    assert np.nanmax(np.abs(way.explained)) < 0.05 * np.nanmax(np.abs(way.value))


def test_lost_frames_are_counted_when_they_should_have_come() -> None:
    log = drive(LOSES)
    lost = series(shrunk(log), "frames missing").value
    there = log.frames["ENCODER"]
    told = there.counter.max() - there.counter.min() + 1
    assert lost[-1] == told - len(there.t_s)
    assert lost[-1] > 10


@pytest.mark.full_size
def test_a_scaled_wheel_in_the_program_shows_in_the_replay_alone() -> None:
    found = shrunk(drive(SCALED))
    assert np.nanmax(np.abs(series(found, "odometry − replay, along x").value)) > 1e-3
    same = shrunk(drive())
    assert np.nanmax(np.abs(series(same, "odometry − replay, along x").value)) == 0
    assert "odometry − replay, along x: the same all along" in same.pictures.missing


def test_what_a_log_has_no_data_for_is_said() -> None:
    bare = replace(
        drive(),
        frames={},
        odometry_x_m=None,
        odometry_y_m=None,
        odometry_heading_rad=None,
        v_command_m_s=None,
        w_command_rad_s=None,
        reference=None,
    )
    assert shrunk(bare).pictures.missing == (
        "reference − wheels: no reference",
        "wheels − commands: no commands, or no motion",
        "odometry − replay: no odometry frames",
        "stamps − beat: no stamped frames",
    )


def test_a_log_too_short_to_hold_anything_out_has_its_rows_too() -> None:
    found = shrunk(drive(LAGS, duration_s=20.0))
    assert found.gap is None
    assert {one.stage for one in found.pictures.residuals} == {
        "wheel",
        "gyro",
        "actuation",
        "firmware",
        "bus",
    }
