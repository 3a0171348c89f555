"""The statistics behind the laws: intervals cover, tolerances are left as rarely as they say."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from hil_harness.laws.law import Check
from hil_harness.laws.statistics import (
    Interval,
    growth,
    growth_tolerance,
    mean_interval,
    mean_tolerance,
    split_error,
    variance_interval,
    variance_tolerance,
    variance_tolerance_of,
)

TRIALS = 4000


def left_too_often(times: int, probability: float) -> bool:
    """Tell whether *times* out of TRIALS contradicts *probability* at one in a million."""
    return bool(stats.binomtest(times, TRIALS, probability).pvalue < 1e-6)


def normal(trials: int, runs: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(3.0, 2.0, (trials, runs))


def test_the_interval_of_a_mean_covers_it_as_often_as_it_says() -> None:
    missed = sum(3.0 not in mean_interval(runs) for runs in normal(TRIALS, 8, 1))
    assert not left_too_often(missed, 0.05)


def test_the_interval_of_a_variance_covers_it_as_often_as_it_says() -> None:
    missed = sum(4.0 not in variance_interval(runs) for runs in normal(TRIALS, 8, 2))
    assert not left_too_often(missed, 0.05)


def test_student_s_interval_is_the_textbook_s() -> None:
    # Five values of mean 10 and deviation 1: 10 ± 2.776 / √5.
    samples = 10 + np.array([-1.2, -0.6, 0.0, 0.6, 1.2]) / np.std([-1.2, -0.6, 0, 0.6, 1.2], ddof=1)
    interval = mean_interval(samples)
    assert interval.high - 10 == pytest.approx(2.7764451 / math.sqrt(5))
    assert 10 - interval.low == pytest.approx(2.7764451 / math.sqrt(5))


def test_a_mean_leaves_its_tolerance_as_often_as_it_says() -> None:
    off = np.abs(np.mean(normal(TRIALS, 10, 3), axis=1) - 3.0)
    assert not left_too_often(int(np.sum(off > mean_tolerance(2.0, 10, 0.02))), 0.02)


@pytest.mark.parametrize("runs", [5, 50])
def test_a_variance_leaves_its_tolerance_as_often_as_it_says(runs: int) -> None:
    off = np.abs(np.var(normal(TRIALS, runs, 4), axis=1, ddof=1) - 4.0)
    assert not left_too_often(int(np.sum(off > variance_tolerance(4.0, runs - 1, 0.02))), 0.02)


def test_the_variance_of_uniform_readings_strays_less_than_that_of_normal_ones() -> None:
    readings = np.random.default_rng(5).random((TRIALS, 400))
    off = np.abs(np.var(readings, axis=1, ddof=1) - 1 / 12)
    tolerance = variance_tolerance_of(9 / 5, 1 / 12, 400, 0.02)
    assert not left_too_often(int(np.sum(off > tolerance)), 0.02)
    assert tolerance < variance_tolerance(1 / 12, 399, 0.02)


def test_growth_tells_a_walk_from_a_drift_and_from_noise_of_readings() -> None:
    rng = np.random.default_rng(6)
    steps = rng.normal(size=(200, 320))
    walk = np.pad(np.cumsum(steps, axis=1), ((0, 0), (1, 0)))
    drift = np.arange(321) * rng.normal(size=(200, 1))
    reading = np.pad(steps, ((0, 0), (1, 0)))
    tolerance = growth_tolerance(16, 200, 16)
    assert abs(growth(walk, 16) - 16) < tolerance
    assert growth(drift, 16) == pytest.approx(256, rel=0.02)  # the runs differ in their mean, too
    assert abs(growth(reading, 16) - 16) > tolerance


def test_growth_refuses_blocks_of_unequal_length() -> None:
    with pytest.raises(ValueError, match=r"^10 steps: expected a multiple of 3 blocks$"):
        growth(np.zeros((2, 11)), 3)


def test_growth_stays_inside_its_tolerance_at_least_as_often_as_it_says() -> None:
    steps = np.random.default_rng(7).normal(size=(1000, 40, 32))
    walks = np.pad(np.cumsum(steps, axis=2), ((0, 0), (0, 0), (1, 0)))
    tolerance = growth_tolerance(16, 40, 16, 0.02)
    outside = sum(abs(growth(walk, 16) - 16) > tolerance for walk in walks)
    assert outside <= stats.binom.ppf(1 - 1e-6, 1000, 0.02)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=50))
def test_a_split_holds_mean_and_spread_inside_their_intervals(values: list[float]) -> None:
    split = split_error(np.array(values), "error", "m")
    assert split.runs == len(values)
    assert split.systematic in split.systematic_interval
    assert split.random_interval.low <= split.random * (1 + 1e-9)
    assert split.random <= split.random_interval.high * (1 + 1e-9)


def test_one_run_has_no_interval() -> None:
    with pytest.raises(ValueError, match=r"^samples of shape \(1,\): expected one value per run"):
        split_error(np.array([1.0]), "error", "m")


def test_an_interval_does_not_end_before_it_begins() -> None:
    with pytest.raises(ValueError, match=r"^interval from 2 to 1: expected low <= high$"):
        Interval(2, 1)


def test_a_measurement_that_is_not_a_number_never_agrees() -> None:
    assert not Check("law", 1.0, math.nan, math.inf, "m", "none").passed


def test_a_measurement_on_the_border_agrees() -> None:
    assert Check("law", 1.0, 1.5, 0.5, "m", "none").passed
