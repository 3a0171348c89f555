"""Odometry of a firmware that turns by a gyro is replayed only with what the gyro said."""

from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from simulated import kernel_pose, plant_runs, recording_of, robot, wire

from firmware_model import STALE, run_batch
from firmware_model.batch import pose_m_rad
from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.nodes.firmware import firmware_config
from hil_harness.scenarios import scenario

TICKS = 3000


def blind(log: Recording) -> Recording:
    return replace(log, gyro_code=None, gyro_rate_rad_s=None)


@pytest.mark.parametrize(
    ("has_frames", "has_reference"),
    [(True, False), (False, True), *at_full_size((True, True), (False, False))],
)
def test_a_healthy_robot_whose_gyro_nobody_recorded_has_no_gap(
    has_frames: bool, has_reference: bool
) -> None:
    """It had an unlisted cause (0.96) or an auto zero (0.92): the replay went without a gyro that
    the ECU had."""
    log = blind(synthetic_recording(robot(), wire(), scenario("calibration"), (), 3))
    log = log if has_frames else replace(log, frames={})
    log = log if has_reference else replace(log, reference=None)
    found = diagnose_recordings([log], robot(), wire()).diagnosis
    assert found.verdict == "no_gap"
    assert any("its odometry is not replayed" in note for note in found.notes)


def test_what_an_ecu_without_a_gyro_says_is_its_replay() -> None:
    """Its gyro was dead: nothing of it in the log, and none for the ECU."""
    runs = plant_runs(TICKS)
    config = firmware_config(robot(), wire().signal_map, wire().tick_period_us)
    stale = np.full(runs.left_count.shape, STALE)
    batch = run_batch(
        config, runs.left_count, runs.right_count, runs.gyro_code, gyro_validity=stale, twin=False
    )
    assert batch.pose_q is not None
    log = blind(recording_of(runs, pose_m_rad(config, batch.pose_q[0])))
    block = firmware_block(log, robot(), wire())
    assert block is not None
    assert block.is_equal


def test_a_firmware_that_turns_by_its_wheels_is_replayed_without_a_gyro() -> None:
    one = replace(robot(), firmware=robot().firmware.model_copy(update={"mode": "wheel"}))
    runs = plant_runs(TICKS)
    block = firmware_block(blind(recording_of(runs, kernel_pose(runs, one))), one, wire())
    assert block is not None
    assert block.is_equal


def test_wheels_and_odometry_alone_are_nothing_to_compare() -> None:
    runs = plant_runs(TICKS)
    table = replace(blind(recording_of(runs, kernel_pose(runs))), frames={})
    with pytest.raises(DiagnosisError, match="odometry frames of a firmware that needs none"):
        diagnose_recordings([table], robot(), wire())


@pytest.mark.full_size
def test_a_held_out_log_without_a_gyro_is_not_replayed_either() -> None:
    """A healthy one had a gap of 0.8 mm, and no floor."""
    calm = scenario("calibration")
    log, held = (synthetic_recording(robot(), wire(), calm, (), seed) for seed in (3, 4))
    found = diagnose_recordings([log], robot(), wire(), held=blind(held)).diagnosis
    assert found.gap is None or "firmware_position_m" not in found.gap.all
    assert sum("its odometry is not replayed" in note for note in found.notes) == 1


def test_a_firmware_that_turns_by_its_wheels_misses_no_gyro() -> None:
    one = replace(robot(), firmware=robot().firmware.model_copy(update={"mode": "wheel"}))
    log = blind(synthetic_recording(one, wire(), scenario("calibration"), (), 3))
    heedless = replace(log, odometry_heading_rad=None)
    found = diagnose_recordings([heedless], one, wire()).diagnosis
    assert not any("turns by a gyro" in note for note in found.notes)
