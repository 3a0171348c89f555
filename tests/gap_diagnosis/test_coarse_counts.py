"""A wheel of a few counts, and one of very many, are told apart from faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed import WIRE
from full_size import at_full_size

from gap_diagnosis.drive import drive_block
from gap_diagnosis.explanations.standstill import dead_ticks
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios import scenario

ROBOT = """\
schema = 1
[wheels]
radius_m = {radius_m}
wheelbase_m = {wheelbase_m}
[encoder]
ticks_per_rev = {ticks_per_rev}
[gyro]
noise_density_rad_per_sqrt_s = 0.0003
"""


def robot_of(
    folder: Path, ticks_per_rev: int, radius_m: float = 0.033, wheelbase_m: float = 0.13
) -> Robot:
    text = ROBOT.format(radius_m=radius_m, wheelbase_m=wheelbase_m, ticks_per_rev=ticks_per_rev)
    (folder / "robot.toml").write_text(text, encoding="ascii")
    return load_robot(folder / "robot.toml")


def calibration_drive(robot: Robot, seed: int, *effects: EffectSetting) -> Recording:
    return synthetic_recording(
        robot,
        WIRE,
        replace(scenario("calibration"), effects=()),
        effects,
        seed,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )


@pytest.mark.parametrize("seed", [715, *at_full_size(716, 717)])
def test_the_rounding_of_twenty_counts_a_turn_is_no_drive_without_a_name(
    tmp_path: Path, seed: int
) -> None:
    """Where a wheel stands is known by its counts, and their rounding goes round with them: ten
    poles were told, 20 to 26 nats, and that the wheels go 3 % wrong in half a second."""
    robot = robot_of(tmp_path, 20)
    block = drive_block(calibration_drive(robot, seed), robot)
    assert block is not None
    assert block.unexplained().log_evidence < 0.0


def test_a_wheel_that_comes_to_rest_a_count_early_is_not_dead(tmp_path: Path) -> None:
    """Of 78,000 counts a turn the other wheel made a few more: by the gyro this one had not moved,
    and it was told dead beside an eccentric disc (> 0.99)."""
    robot = robot_of(tmp_path, 78000, 0.165, 0.545)
    values = (("side", "right"), ("amplitude", 0.05), ("phase", 1.0))
    disc = EffectSetting("encoder_eccentricity", values)
    motion = estimate_motion(calibration_drive(robot, 710, disc), robot)
    assert not np.any(dead_ticks(motion))
