"""A gyro that repeats its code says nothing of the motion, whatever the code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import LEVELS, ROBOT, WIRE

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

START_S, STOP_S = 20.0, 22.0


def held_at(code: float, log: Recording) -> Recording:
    """Return the log with another code held."""
    assert log.gyro_code is not None
    assert log.gyro_rate_rad_s is not None
    inside = (log.t_s > START_S) & (log.t_s <= STOP_S)
    sensitivity = ROBOT.plant.gyro.sensitivity_lsb_per_rad_s
    rate_rad_s = (code - ROBOT.plant.gyro.zero_rate_code) / sensitivity
    return replace(
        log,
        gyro_code=np.where(inside, code, log.gyro_code),
        gyro_rate_rad_s=np.where(inside, rate_rad_s, log.gyro_rate_rad_s),
    )


def misfit(log: Recording) -> float:
    """Return the sum of squares of the whitened residuals that no effect leaves."""
    model = MotionModel(log, ROBOT, default_prior())
    values = np.ascontiguousarray(model.columns.values[..., :1])
    left = whiten(values, model.course, LEVELS, model.nodes.ticks)[0]
    return float(np.sum(left**2))


def test_what_a_frozen_gyro_holds_is_no_evidence() -> None:
    """0.6 rad off over 200 ticks, each unsure by 1 rad: 0.36/200 of a sum of squares."""
    frozen = EffectSetting("gyro_frozen", (("start_s", START_S), ("stop_s", STOP_S)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("random"), (frozen,), 1, reference=ReferenceNoise(), duration_s=40.0
    )
    zero, turning = ROBOT.plant.gyro.zero_rate_code, ROBOT.plant.gyro.sensitivity_lsb_per_rad_s
    at_rest, in_a_turn = (misfit(held_at(zero + rate * turning, log)) for rate in (0.01, 0.3))
    assert at_rest == pytest.approx(in_a_turn, abs=0.01)


def test_a_gyro_is_known_to_freeze_and_to_go_on_between_two_rows_and_no_closer() -> None:
    """Told as the rows' own times, both ends of a sealed case had intervals of no width."""
    start_s, stop_s = 20.0042, 22.0077
    frozen = EffectSetting("gyro_frozen", (("start_s", start_s), ("stop_s", stop_s)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("random"), (frozen,), 1, reference=ReferenceNoise(), duration_s=25.0
    )
    (variant,) = EXPLAINED["gyro_frozen"].variants(estimate_motion(log, ROBOT))
    for name, true_s in (("start_s", start_s), ("stop_s", stop_s)):
        low_s, high_s = variant.told[name]
        assert low_s < true_s < high_s
        assert high_s - low_s < 1.001 * log.tick_period_s
