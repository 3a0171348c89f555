"""The laws of scoring, on forecasts whose quality is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gap_diagnosis.trials.yardsticks import (
    CalibrationBin,
    Share,
    auroc,
    best_miss,
    brier,
    calibration,
    calibration_interval,
    mean,
    perfect_calibration,
    perfect_share,
    rank_bin,
    rank_test,
    ratio,
    share,
)

CASES = 20_000


def test_a_share_lies_in_its_interval_and_of_nothing_there_is_none() -> None:
    found = share([True] * 90 + [False] * 10)
    assert found.value == 0.9
    assert found.low is not None
    assert found.high is not None
    # Wilson's interval of 90 in 100, as tabulated.
    assert (found.low, found.high) == pytest.approx((0.8256, 0.9448), abs=1e-4)
    assert share([]).value is None
    assert mean([]).value is None


def test_wilsons_interval_holds_the_true_share_about_95_times_in_100() -> None:
    draw = np.random.default_rng(1)
    held = 0
    for _ in range(2000):
        found = share((draw.random(50) < 0.9).tolist())
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 0.9 <= found.high
    # Four standard deviations of 2,000 draws about 0.95, and what discreteness adds.
    assert 0.92 < held / 2000 < 0.98


def test_a_ratio_that_is_the_same_in_every_case_is_certain_however_the_cases_differ() -> None:
    """An interval of one sum alone would be as wide as that sum is uncertain."""
    lower = np.random.default_rng(7).exponential(size=50) + 0.01
    found = ratio((3 * lower).tolist(), lower.tolist())
    assert (found.value, found.low, found.high) == pytest.approx((3.0, 3.0, 3.0))
    assert ratio([], []).value is None
    assert ratio([1.0], [2.0]) == Share(0.5, None, None, 1)


def test_a_ratios_interval_holds_the_true_ratio_about_95_times_in_100() -> None:
    draw = np.random.default_rng(8)
    held = 0
    for _ in range(200):
        lower = draw.exponential(size=100)
        upper = 0.9 * lower + 0.3 * draw.standard_normal(100)
        found = ratio(upper.tolist(), lower.tolist())
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 0.9 <= found.high
    # Four standard deviations of 200 draws about 0.95.
    assert held / 200 > 0.95 - 4 * math.sqrt(0.95 * 0.05 / 200)


def test_a_calibrated_forecaster_has_no_calibration_error_but_that_of_chance() -> None:
    draw = np.random.default_rng(2)
    said = draw.random(CASES)
    error, bins = calibration(said.tolist(), (draw.random(CASES) < said).tolist())
    # Mean of |N(0, p(1-p)/n)| over 15 bins is at most 0.8·0.5/sqrt(20000/15).
    assert error is not None
    assert error < 0.8 * 0.5 / math.sqrt(CASES / 15)
    assert {one.count for one in bins} <= {CASES // 15, CASES // 15 + 1}


def test_a_perfect_forecaster_is_right_in_a_bin_as_often_as_it_is_said_to_be() -> None:
    draw = np.random.default_rng(9)
    low, high = perfect_share(CalibrationBin(0.9, 0.5, 200))
    shares = draw.binomial(200, 0.9, size=CASES) / 200
    within = float(np.mean((low <= shares) & (shares <= high)))
    # Both ends are counts of 200, none of which is as likely as 0.1.
    assert 0.95 - 4 * math.sqrt(0.95 * 0.05 / CASES) < within < 0.98
    assert perfect_share(CalibrationBin(1.0 + 1e-12, 1.0, 10)) == (1.0, 1.0)


def test_an_overconfident_forecaster_is_caught_by_as_much_as_it_exaggerates() -> None:
    draw = np.random.default_rng(3)
    error, _ = calibration([0.95] * CASES, (draw.random(CASES) < 0.8).tolist())
    assert error == pytest.approx(0.15, abs=4 * math.sqrt(0.16 / CASES))


def test_the_brier_score_is_0_for_a_seer_and_2_for_a_fool() -> None:
    assert brier([], 1.0) == 0.0
    assert brier([1.0], 0.0) == 2.0
    assert brier([0.25, 0.25, 0.25], 0.25) == pytest.approx(0.75)


def test_auroc_is_1_for_perfect_order_and_one_half_for_chance() -> None:
    draw = np.random.default_rng(4)
    assert auroc([0.9, 0.8], [0.1, 0.2, 0.3]).value == 1.0
    assert auroc([0.5] * 5, [0.5] * 7).value == 0.5
    by_chance = auroc(draw.random(2000).tolist(), draw.random(2000).tolist())
    assert by_chance.value == pytest.approx(0.5, abs=4 * math.sqrt(1 / 12 * 2 / 2000))
    assert by_chance.low is not None
    assert by_chance.high is not None
    assert by_chance.low < 0.5 < by_chance.high or abs((by_chance.value or 0) - 0.5) < 0.04
    assert auroc([], [0.5]).value is None


def test_ranks_of_a_true_posterior_are_even_and_of_a_narrow_one_are_not() -> None:
    draw = np.random.default_rng(5)
    z95, z80, z50 = 1.959964, 1.281552, 0.674490
    values = draw.standard_normal(5000)
    for width, even in ((1.0, True), (0.7, False)):
        intervals = [(-z * width, z * width) for z in (z95, z80, z50)]
        counts, p = rank_test([rank_bin(value, intervals) for value in values])
        assert sum(counts) == 5000
        assert p is not None
        assert (p > 1e-4) is even
    assert rank_test([])[1] is None


def test_at_the_detection_limit_the_best_test_misses_one_in_twenty() -> None:
    # docs/design.md: 29 is where 1 % over 60 candidates leaves 95 % power.
    assert best_miss(1.0) == pytest.approx(0.05, abs=0.003)
    assert best_miss(0.0) == pytest.approx(1.0, abs=1e-3)
    assert best_miss(2.0) < 1e-10


def test_a_perfect_forecasters_error_is_within_what_chance_allows() -> None:
    draw = np.random.default_rng(6)
    said = draw.random(600)
    chance = perfect_calibration(said.tolist())
    right = (draw.random(600) < said).tolist()
    error, _ = calibration(said.tolist(), right)
    assert chance is not None
    assert error is not None
    mean, low, high = chance
    assert low < mean < high
    assert error < 1.5 * high
    interval = calibration_interval(said.tolist(), right)
    assert interval is not None
    assert interval[0] < interval[1]
    assert perfect_calibration([]) is None
    assert calibration_interval([0.5], [True]) is None
