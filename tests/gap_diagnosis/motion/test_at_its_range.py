"""A gyro at the end of its described range does as described, and says no more than that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario

SCRUB = -0.75
RIVALS = frozenset(
    {
        "gyro_nonlinearity",
        "gyro_saturation",
        "gyro_scale",
        "radius_scale",
        "turn_scrub",
        "wheelbase_scale",
    }
)


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


@pytest.mark.full_size
def test_what_a_gyro_shows_at_the_end_of_its_range_is_no_limit_of_its_own(
    spinning: Recording,
) -> None:
    """A saturation at the described range, a window and another track were named beside the scrub
    (> 0.99)."""
    assert at_its_end(ROBOT, spinning).mean() > 0.05
    others = frozenset(EXPLAINED) - RIVALS
    model = MotionModel(spinning, ROBOT, default_prior(), without=others)
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
    narrow = with_range(ROBOT, 2.0)
    code = spinning.gyro_code
    assert code is not None
    assert np.count_nonzero(code > narrow.plant.gyro_code_limits[1] + 1) > 100
    assert not MotionModel(spinning, narrow, default_prior()).nodes.motion.gyro_at_its_end.any()


def test_a_spike_is_neither_the_end_of_a_range_nor_beyond_it(spinning: Recording) -> None:
    code = spinning.gyro_code
    assert code is not None
    low, high = ROBOT.plant.gyro_code_limits
    usual = MotionModel(spinning, ROBOT, default_prior()).nodes.motion.gyro_at_its_end
    spiked = replace(spinning, gyro_code=np.where(np.arange(len(code)) == 50, high + 500.0, code))
    also = MotionModel(spiked, ROBOT, default_prior()).nodes.motion.gyro_at_its_end
    assert np.array_equal(np.delete(also, 50), np.delete(usual, 50))
    middle = 0.5 * (low + high)
    once = np.where(np.arange(len(code)) == 50, float(high), middle + 0.1 * (code - middle))
    calm = MotionModel(replace(spinning, gyro_code=once), ROBOT, default_prior())
    assert not calm.nodes.motion.gyro_at_its_end.any()


def test_within_noise_of_the_end_and_between_two_rows_there_nothing_is_said_either(
    spinning: Recording,
) -> None:
    """Only those readings would be left that chance has made smaller."""
    code = spinning.gyro_code
    assert code is not None
    low, high = ROBOT.plant.gyro_code_limits
    at_an_end = at_its_end(ROBOT, spinning)
    inside = np.flatnonzero(at_an_end[:-2] & at_an_end[1:-1] & at_an_end[2:]) + 1
    lost = np.where(np.isin(np.arange(len(code)), inside[::7]), np.nan, code)
    motion = MotionModel(replace(spinning, gyro_code=lost), ROBOT, default_prior()).nodes.motion
    assert motion.gyro_at_its_end[inside].all()
    near = np.minimum(code - low, high - code) < 2.0 * motion.gyro_noise_lsb
    assert motion.gyro_at_its_end[near].all()
    assert motion.gyro_noise_lsb > 2.0


def with_range(robot: Robot, range_rad_s: float) -> Robot:
    """Return the robot described with another range of its gyro."""
    gyro = robot.plant.gyro.model_copy(update={"range_rad_s": range_rad_s})
    return replace(robot, plant=robot.plant.model_copy(update={"gyro": gyro}))
