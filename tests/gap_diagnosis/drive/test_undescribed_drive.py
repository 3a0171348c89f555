"""How a drive answers that nobody described is no news, as long as no listed effect says it."""

from dataclasses import replace

import pytest
from drive_recordings import ACTUATION, ROBOT, evidence, simulated
from foreign_drives import velocity_loop
from full_size import at_full_size

from gap_diagnosis.drive import DriveBlock, drive_block
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot, load_robot


@pytest.fixture
def undescribed(tmp_path) -> Robot:
    """A robot whose file says nothing of its drive but how fast it is."""
    file = tmp_path / "robot.toml"
    file.write_text("[drive]\nmax_wheel_rate_rad_s = 30.0\n")
    return load_robot(file)


def block_of(recording: Recording, robot: Robot) -> DriveBlock:
    block = drive_block(recording, robot)
    assert block is not None
    return block


def test_a_file_describes_a_drive_where_it_says_how_that_answers(tmp_path, undescribed):
    file = tmp_path / "described.toml"
    file.write_text("[drive]\ntime_constant_s = 0.05\n")
    assert load_robot(file).describes_drive
    assert ROBOT.describes_drive
    assert not undescribed.describes_drive


@pytest.mark.parametrize("seed", [2, *at_full_size(1, 3, 4)])
def test_a_velocity_loop_that_nobody_described_is_no_gap(seed, undescribed):
    """Real robots have one; of 7 healthy ones of another simulator all were an unlisted cause in
    the actuation, 0.95."""
    log = velocity_loop(seed)
    described = replace(undescribed, source=None)
    assert block_of(log, described).unexplained().log_evidence > 20.0
    block = block_of(log, undescribed)
    assert block.answers is not None
    assert block.unexplained().log_evidence == 0.0
    assert max(evidence(block, one) for one in {*ACTUATION} & block.effects) < 2.0


def test_what_a_listed_effect_says_of_it_is_told_all_the_same(undescribed):
    block = block_of(simulated({"drive_lag": {"time_constant": 0.07}}), undescribed)
    assert block.answers is None
    assert evidence(block, "drive_lag") > 20.0
