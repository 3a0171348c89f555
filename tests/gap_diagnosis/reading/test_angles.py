"""Angles that jump by a turn come back without their jumps."""

import math

import numpy as np
import pytest
from scipy.ndimage import median_filter

from gap_diagnosis.reading.angles import unwrapped


def wrapped(angle_rad: np.ndarray) -> np.ndarray:
    return np.asarray((angle_rad + math.pi) % math.tau - math.pi)


@pytest.mark.parametrize("noise_rad", [0.0, 0.1, 0.4, 0.6, 0.77])
@pytest.mark.parametrize("seed", range(5))
def test_a_heading_keeps_its_turns_however_it_trembles(seed: int, noise_rad: float) -> None:
    """Of 0.77 rad a sample the steps go beyond half a turn once in 260: the heading was whole turns
    off for seconds, and a healthy robot had a walking gyro that saturates (> 99.9 %)."""
    random = np.random.default_rng(seed)
    turn = np.cumsum(np.repeat(random.uniform(-2, 2, 60), 100)) * 0.01
    found = unwrapped(wrapped(turn + random.normal(0, noise_rad, len(turn))))
    away = found - turn
    whole_turns_off = np.abs(away - away[:50].mean()) > math.pi + noise_rad
    assert whole_turns_off.mean() < 1e-3


@pytest.mark.parametrize("noise_rad", [0.1, 0.3, 0.42, 0.6])
@pytest.mark.parametrize("turn_rad_s", [0.0, 2.0])
def test_tails_of_noise_make_no_turns(turn_rad_s: float, noise_rad: float) -> None:
    """Student's noise of three degrees of freedom (a reference of 0.3 rad made four turns in 80
    seconds: a healthy robot had an unlisted cause in its wheels, > 99.9 %)."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        turn = np.cumsum(np.tile(np.repeat([0.0, turn_rad_s], 250), 12)) * 0.01
        noise = noise_rad * random.standard_t(3, len(turn)) / math.sqrt(3.0)
        away = unwrapped(wrapped(turn + noise)) - turn
        assert np.abs(median_filter(away - np.median(away), 101)).max() < 1.0


@pytest.mark.parametrize("noise_rad", [0.0, 0.02, 0.06])
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("fastest_rad_s", [0.3, 1.0, 2.0])
def test_a_slow_reference_of_a_robot_that_turns_fast_keeps_its_turns(
    fastest_rad_s: float, rate_hz: float, noise_rad: float
) -> None:
    """What bends from sample to sample looks like noise, and a mean of seven may be of a whole
    turn."""
    for seed, period_s in enumerate((6.0, 12.0, 40.0)):
        t_s = np.arange(0.0, 300.0, 1.0 / rate_hz)
        turn = fastest_rad_s * period_s / math.tau * np.sin(math.tau * t_s / period_s) + 0.2 * t_s
        noise = np.random.default_rng(seed).normal(0, noise_rad, len(turn))
        away = unwrapped(wrapped(turn + noise)) - turn
        assert np.ptp(away) < 1.0


def test_what_is_not_known_stays_so() -> None:
    angle = np.array([3.0, np.nan, -3.0, np.nan])
    found = unwrapped(angle)
    assert np.array_equal(np.isnan(found), np.isnan(angle))
    assert found[2] == pytest.approx(math.tau - 3.0)


def test_fast_turns_without_noise_are_counted_from_sample_to_sample() -> None:
    turn = np.arange(200) * 2.9
    assert unwrapped(wrapped(turn)) == pytest.approx(turn)
