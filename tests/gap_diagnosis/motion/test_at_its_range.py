"""A gyro at the end of its described range does as described, and says no more than that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario

SCRUB = -0.75


@pytest.fixture(scope="module")
def spinning() -> Recording:
    """The log of a robot that turns four times as fast as it is told, and as its gyro can say."""
    scrub = EffectSetting("turn_scrub", (("scrub", SCRUB),))
    return synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), [scrub], 1, reference=ReferenceNoise()
    )


def at_its_end(robot: Robot, log: Recording) -> np.ndarray:
    low, high = robot.plant.gyro_code_limits
    return np.asarray((log.gyro_code == low) | (log.gyro_code == high))


def test_what_a_gyro_shows_at_the_end_of_its_range_is_no_limit_of_its_own(
    spinning: Recording,
) -> None:
    """A saturation at the described range, a window and another track were named beside the scrub
    (> 0.99)."""
    assert at_its_end(ROBOT, spinning).mean() > 0.05
    model = MotionModel(spinning, ROBOT, default_prior())
    assert all(term.variant.effect != "gyro_saturation" for term in model.columns.terms)
    scan = Scan(model)
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    (own,) = [term for term in best.terms if term.variant.effect == "turn_scrub"]
    assert "start_s" not in own.variant.fixed
    alone = scan.account(frozenset({"turn_scrub"}))
    assert alone.refitted is not None
    assert alone.refitted.coefficients[0][0] == pytest.approx(SCRUB, abs=0.01)
    assert best.log_evidence < alone.log_evidence + 5.0


def test_a_gyro_that_goes_beyond_its_described_range_is_believed(spinning: Recording) -> None:
    """Its range was left out of robot.toml, and is another one."""
    gyro = replace_range(ROBOT, 2.0)
    code = spinning.gyro_code
    assert code is not None
    low, high = gyro.plant.gyro_code_limits
    assert code.max() > high + 1
    model = MotionModel(spinning, gyro, default_prior())
    usual = MotionModel(spinning, ROBOT, default_prior())
    at_a_lower_end = (np.abs(code - low) < 0.5) | (np.abs(code - high) < 0.5)
    unsure = model.nodes.motion.gyro_unsure_rad2
    assert unsure[at_a_lower_end].max() < usual.nodes.motion.gyro_unsure_rad2.max()


def replace_range(robot: Robot, range_rad_s: float) -> Robot:
    gyro = robot.plant.gyro.model_copy(update={"range_rad_s": range_rad_s})
    return replace(robot, plant=robot.plant.model_copy(update={"gyro": gyro}))
