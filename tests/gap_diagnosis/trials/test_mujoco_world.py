"""The second world: wheels of MuJoCo roll, slip and creep as its state says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.trials.layout import LOG, REFERENCE, ROBOT
from gap_diagnosis.trials.mujoco_cases import write_case
from gap_diagnosis.trials.mujoco_engine import drive_through
from gap_diagnosis.trials.mujoco_truth import calibrated
from gap_diagnosis.trials.mujoco_world import World
from hil_harness.robot import load_robot

PLANT = load_robot().plant
TICK_US = 10_000


def commands(v_m_s: float, w_rad_s: float) -> np.ndarray:
    """Return half a second of smooth start and one of driving on."""
    rise = np.clip(np.arange(150) / 50, 0, 1)
    return np.column_stack([v_m_s * rise, w_rad_s * rise])


def test_wheels_roll_on_their_radius_and_the_robot_turns_about_its_track() -> None:
    there_and_round = np.concatenate([commands(0.3, 0.0), commands(0.0, 0.8)])
    found = calibrated(drive_through(World(), PLANT, there_and_round, TICK_US))
    assert found.radius_m == pytest.approx(0.05, rel=0.002)
    assert found.wheelbase_m == pytest.approx(0.30, rel=0.003)


def test_soft_tyres_slide_outward_in_proportion_to_the_lateral_force() -> None:
    driven = drive_through(World(soft_s=0.02), PLANT, commands(0.3, 0.8), TICK_US)
    assert driven.sideways_m_s[-1] == pytest.approx(-0.5 * 0.02 * 0.3 * 0.8, rel=0.1)


def test_a_load_on_the_left_makes_the_left_wheel_smaller() -> None:
    world = World(tyre_m_per_n=1.2e-5, load_kg=4.0, load_at_m=(0.0, 0.1, 0.1))
    driven = drive_through(world, PLANT, commands(0.3, 0.0), TICK_US)
    left_n, right_n = driven.normal_n[-1]
    assert left_n - right_n == pytest.approx(4.0 * 9.81 * 0.1 / 0.15, rel=0.1)
    turned = driven.pose[-1, 2] * 0.30
    rolled = 0.05 * driven.wheel_rad[-1].mean()
    assert turned / rolled == pytest.approx(1.2e-5 * (left_n - right_n) / 0.05, rel=0.1)


def test_motors_of_too_little_torque_are_told_as_a_limit_and_nothing_else(tmp_path: Path) -> None:
    """Each wheel moves the body that the other stands on, and friction helps to brake: no limit is
    exact, and a gain of -10 % and +8 % was told beside it (> .99)."""
    write_case("weak_motors", 1, tmp_path / "case", kind="weave")
    log, robot = tmp_path / "case" / LOG, tmp_path / "case" / ROBOT
    reference = tmp_path / "case" / REFERENCE
    found = diagnose([log], robot=robot, references=[reference]).diagnosis
    assert found.verdict == "drive_acceleration_limit"
    assert found.which[0].probability > 0.8
