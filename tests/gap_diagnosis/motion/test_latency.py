"""A gyro stamped late in a table, whose rows have no counters to put them in place."""

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

LATE_TICKS = 3
LATE_S = 0.03


def table_with_a_late_gyro() -> Recording:
    """Return a drive as a table has it, each gyro sample standing three rows too late."""
    whole = synthetic_recording(
        load_robot(),
        load_wire(),
        scenario("calibration"),
        (),
        seed=11,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=3e-4,
        duration_s=60.0,
    )
    late = {
        name: np.concatenate([np.repeat(values[:1], LATE_TICKS), values[:-LATE_TICKS]])
        for name in ("gyro_code", "gyro_rate_rad_s")
        if (values := getattr(whole, name)) is not None
    }
    return replace(whole, frames={}, **late)


@pytest.fixture(scope="module")
def block() -> MotionBlock:
    return MotionBlock(MotionModel(table_with_a_late_gyro(), load_robot(), default_prior()))


def test_the_late_message_is_named(block):
    singles = [one for one in block.scan.found.values() if len(one.effects) == 1]
    best = max(singles, key=lambda one: one.log_evidence)
    assert best.effects == {"frame_latency"}
    assert best.terms[0].variant.report["frame"] == "IMU"


def test_the_delay_is_estimated_within_four_standard_deviations(block):
    delay = block.detail(frozenset({"frame_latency"})).parameters["frame_latency.delay"]
    assert abs(delay.value - LATE_S) < 4 * delay.sd
