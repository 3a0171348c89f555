"""A gyro that is told in steps wider than its noise is as unsure as what they round off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.lattice import step_of_values
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.gyro_steps import variance_of_steps
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_robot, load_wire
from hil_harness.scenarios import scenario

ROBOT, WIRE = load_robot(), load_wire()
TICK_S = 0.01
STEP = math.radians(1.0)


def in_steps(rate_rad_s: Floats) -> Floats:
    return np.asarray(STEP * np.rint(rate_rad_s / STEP))


def drive(name: str, seed: int, rate_rad_s: float | None = None) -> Recording:
    """A healthy robot's table with yaw rates in whole degrees per second, or always the same."""
    calm = replace(scenario(name), effects=())
    log = synthetic_recording(ROBOT, WIRE, calm, (), seed, reference=ReferenceNoise(rate_hz=50.0))
    assert log.gyro_rate_rad_s is not None
    told = in_steps(log.gyro_rate_rad_s) if rate_rad_s is None else 0 * log.t_s + rate_rad_s
    gyro = ROBOT.plant.gyro
    return replace(
        log,
        gyro_rate_rad_s=told,
        gyro_code=gyro.zero_rate_code + gyro.sensitivity_lsb_per_rad_s * told,
        odometry_x_m=None,
        odometry_y_m=None,
        odometry_heading_rad=None,
        frames={},
    )


@pytest.mark.parametrize("noise_steps", [0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_turns_at_a_steady_rate_are_off_by_as_much_as_is_said(noise_steps: float) -> None:
    """Of 400 rates, held for 5 s each, beside what noise itself adds: the squares' mean is that of
    the variances with a standard deviation of 7 %. How much averages out is read off codes that
    toggle, and where few do, none is taken to: never less than is true, and at most three times
    as much."""
    generator = np.random.default_rng(3)
    held = 500
    rates = STEP * np.sort(generator.uniform(5, 2000, 400))
    true = np.repeat(rates, held)
    told = in_steps(true + generator.normal(0.0, noise_steps * STEP, len(true)))
    variance = variance_of_steps(told, STEP, true, TICK_S)
    off = (told - true).reshape(-1, held).sum(axis=1)
    by_noise = held * ((noise_steps * STEP) ** 2 + STEP**2 / 12.0 * (noise_steps > 0))
    expected = variance.reshape(-1, held).sum(axis=1) + by_noise
    assert 0.8 < np.mean(expected) / np.mean(off**2) < 3.0


def test_a_rate_that_comes_back_is_off_by_the_same_again() -> None:
    """Ten visits of 1 s are as unsure as 10 s at once: N steps of a twelfth's root each."""
    there_and_back = np.concatenate([np.full(100, 10.4), np.full(100, 20.4)] * 10) * STEP
    variance = variance_of_steps(in_steps(there_and_back), STEP, there_and_back, TICK_S)
    at_one_rate = variance[there_and_back < 15 * STEP].sum()
    assert math.sqrt(at_one_rate) == pytest.approx(1000 * STEP / math.sqrt(12.0), rel=0.02)


def test_another_rate_within_the_same_step_is_off_otherwise() -> None:
    rates = np.concatenate([np.full(500, 9.7), np.full(500, 20.0), np.full(500, 10.3)]) * STEP
    variance = variance_of_steps(in_steps(rates), STEP, rates, TICK_S)
    assert math.sqrt(variance[:500].sum()) == pytest.approx(500 * STEP / math.sqrt(12.0), rel=0.02)


def test_a_gyro_of_fine_codes_has_no_such_variance() -> None:
    rate = np.random.default_rng(1).normal(0.0, 0.002, 5000)
    assert not variance_of_steps(rate, step_of_values(rate), rate, TICK_S).any()
    codes = np.rint(rate * 7505.747) / 7505.747
    step = step_of_values(codes)
    assert step == pytest.approx(1.0 / 7505.747, rel=1e-6)
    # Fifteen codes of noise: what is left over is less than a millionth of a step.
    assert variance_of_steps(codes, step, 0.0 * codes, TICK_S).max() < 1e-6 * step**2


@pytest.mark.parametrize("name", ["calibration", *at_full_size("square", "random")])
def test_whole_degrees_per_second_are_no_gap(name: str) -> None:
    """They were a gyro that bends by 0.7 % and reads 1.4 % less (0.97), a frozen one (0.98),
    another that bends."""
    assert diagnose_recordings([drive(name, 1)], ROBOT, WIRE).diagnosis.verdict == "no_gap"


def test_the_steps_of_a_gyro_are_found_beside_lost_samples() -> None:
    """What is put in their place lies between two steps."""
    log = drive("square", 1)
    assert log.gyro_rate_rad_s is not None
    rate = log.gyro_rate_rad_s.copy()
    rate[np.random.default_rng(4).random(len(rate)) < 0.02] = np.nan
    motion = estimate_motion(replace(log, gyro_rate_rad_s=rate), ROBOT)
    lsb = STEP * ROBOT.plant.gyro.sensitivity_lsb_per_rad_s
    assert motion.gyro_step_lsb == pytest.approx(lsb, rel=1e-6)


@pytest.mark.full_size
def test_a_coarse_gyro_that_says_zero_all_along_a_straight_is_no_gap() -> None:
    """It was a ValueError: the logarithm of no rate at all."""
    found = diagnose_recordings([drive("stop_and_go", 1, 0.0)], ROBOT, WIRE).diagnosis
    assert found.verdict == "no_gap"


@pytest.mark.full_size
def test_a_coarse_gyro_that_freezes_is_told() -> None:
    log = drive("calibration", 1)
    assert log.gyro_rate_rad_s is not None
    assert log.gyro_code is not None
    rate, code = log.gyro_rate_rad_s.copy(), log.gyro_code.copy()
    rate[4000:8000], code[4000:8000] = rate[4000], code[4000]
    frozen = replace(log, gyro_rate_rad_s=rate, gyro_code=code)
    assert "gyro_frozen" in diagnose_recordings([frozen], ROBOT, WIRE).diagnosis.verdict
