"""How far a gap closes: the formula, its interval, shares and waterfall."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gap_diagnosis.gap.how_far import Compared, closed_share, gap_of, metric_of, pooled
from gap_diagnosis.gap.metrics import WindowErrors
from gap_diagnosis.gap.shares import chain_of, shares_of
from gap_diagnosis.gap.waterfall import MOST_EFFECTS, shapley_reductions
from gap_diagnosis.result_parts import StageOrNone

STAGES: tuple[StageOrNone, ...] = ("wheel", "encoder", "gyro", "reference")
sizes = st.floats(0.01, 100.0)
errors = st.floats(-10, 10)


def errors_of(mean_square: np.ndarray) -> WindowErrors:
    count = len(mean_square)
    return WindowErrors(np.arange(count), mean_square, np.zeros((count, 2)))


@given(floor=sizes, gap=st.floats(0.3, 50.0), after=sizes)
def test_closed_is_the_share_of_what_can_be_closed_and_never_clipped(
    floor: float, gap: float, after: float
) -> None:
    before = floor * (1 + gap)
    assert closed_share(before, floor, floor) == pytest.approx(1)
    assert closed_share(before, before, floor) == pytest.approx(0)
    assert closed_share(before, after, floor) == pytest.approx((before - after) / (before - floor))


@given(floor=sizes, part=st.floats(0.0, 1.19), after=sizes)
def test_near_the_floor_there_is_no_gap_to_close(floor: float, part: float, after: float) -> None:
    assert closed_share(part * floor, after, floor) is None


def test_a_metric_without_a_window_is_not_given() -> None:
    assert metric_of("timing_s", Compared(errors_of(np.zeros(0)))) is None


def test_a_log_without_a_window_takes_nothing_from_what_others_tell_together() -> None:
    """Without windows no floor is drawn."""
    none, some = np.zeros(0), np.array([4.0, 5.0, 6.0])
    telling = Compared(errors_of(some), errors_of(0.5 * some), np.ones((3, 3)))
    silent = Compared(errors_of(none), errors_of(none))
    alone = metric_of("odometry_position_m", telling)
    assert alone is not None
    assert alone.closed is not None
    for logs in ([silent, telling], [telling, silent]):
        assert metric_of("odometry_position_m", pooled(logs)) == alone
    assert metric_of("odometry_position_m", pooled([silent, silent])) is None


def test_the_interval_of_closed_holds_its_value_and_shrinks_with_windows() -> None:
    random = np.random.default_rng(2)
    widths = []
    for count in (10, 160):
        before, after = random.chisquare(4, count) + 5, random.chisquare(4, count) / 4
        metric = metric_of(
            "odometry_position_m",
            Compared(errors_of(before), errors_of(after), np.ones((3, count))),
        )
        assert metric is not None
        assert metric.ci95 is not None
        assert metric.closed is not None
        assert metric.ci95[0] < metric.closed < metric.ci95[1]
        widths.append(metric.ci95[1] - metric.ci95[0])
    assert widths[1] < 0.5 * widths[0]


@given(spread=st.floats(0.02, 0.3))
def test_of_a_single_window_values_and_noise_tell_how_sure_the_share_is(spread: float) -> None:
    """A log of a minute holds one window back: 29 of 70 shares had no interval."""
    random = np.random.default_rng(2)
    before, after = np.array([9.0]), np.array([1.2])
    drawn = after * (1 + spread * random.standard_normal((40, 1))) ** 2
    floor = random.chisquare(20, (40, 1)) / 20
    known = Compared(errors_of(before), errors_of(after), floor, drawn)
    metric = metric_of("odometry_position_m", known)
    assert metric is not None
    assert metric.ci95 is not None
    assert metric.closed is not None
    assert metric.ci95[0] < metric.closed < metric.ci95[1]
    # To first order, of sqrt(9) - sqrt(1.2) out of sqrt(9) - 1; the floor is 1 +- 0.16 by its law.
    by_values = spread * math.sqrt(1.2) / 2.0
    by_noise = metric.closed * 0.16 / 2.0
    wide = 2 * 1.96 * math.hypot(by_values, by_noise)
    assert 0.6 * wide < metric.ci95[1] - metric.ci95[0] < 1.5 * wide


def test_the_interval_holds_the_share_where_every_drawn_value_leaves_more_than_the_best() -> None:
    """Said of a wheelbase: 100 % closed (95 %: 0 to 99 %)."""
    before, after = np.array([9.0, 25.0]), np.array([1.0, 1.0])
    drawn = np.full((40, 2), 1.5)
    known = Compared(errors_of(before), errors_of(after), np.ones((3, 2)), drawn)
    metric = metric_of("odometry_position_m", known)
    assert metric is not None
    assert metric.ci95 is not None
    assert metric.ci95[0] < metric.ci95[1] == metric.closed == 1.0


def test_windows_in_which_nothing_is_to_be_closed_do_not_make_it_chance() -> None:
    """Of a demo's three windows one had no turn in it, and 14.2° closed to 0.2° might be chance:
    of drawn triples one in 27 has that window alone."""
    before, after = np.array([90.0, 110.0, 1.01]), np.array([1.2, 0.9, 1.01])
    metric = metric_of(
        "turn_difference_rad", Compared(errors_of(before), errors_of(after), np.ones((3, 3)))
    )
    assert metric is not None
    assert metric.closed is not None
    assert metric.ci95 is not None
    assert 0.9 < metric.ci95[0] <= metric.closed <= metric.ci95[1]


def test_a_gap_that_is_not_closed_may_still_be_chance() -> None:
    before, after = np.array([90.0, 110.0, 100.0]), np.array([80.0, 150.0, 60.0])
    metric = metric_of(
        "turn_difference_rad", Compared(errors_of(before), errors_of(after), np.ones((3, 3)))
    )
    assert metric is not None
    assert metric.ci95 is not None
    assert metric.ci95[0] < 0.0 < metric.ci95[1]


def compared(before: float, after: float, moved: float) -> Compared:
    """Return four windows of one metric, of floor 1, whose ends the effects move by so much."""
    there = WindowErrors(np.arange(4), np.full(4, after), np.full((4, 1), moved))
    was = WindowErrors(np.arange(4), np.full(4, before), np.zeros((4, 1)))
    return Compared(was, there, np.ones((2, 4)))


def test_the_gap_is_told_in_the_first_metric_of_its_stage_that_has_one() -> None:
    known = {
        "odometry_position_m": compared(1.01, 1.0, 0.6),
        "turn_difference_rad": compared(9.0, 1.0, 3.0),
    }
    gap = gap_of(known, "wheel", "stretches")
    assert gap is not None
    assert gap.metric == "turn_difference_rad"
    assert gap.closed == pytest.approx(1)
    assert set(gap.all) == set(known)
    assert gap_of(known, "firmware", "stretches") is None


@pytest.mark.parametrize(
    ("moved", "turned", "told"),
    [
        (0.0, 2.8, "turn_difference_rad"),
        (0.1, 2.8, "turn_difference_rad"),
        (0.8, 2.8, "turn_difference_rad"),
        (5.0, 8.0, "odometry_position_m"),
        (0.1, 0.3, "turn_difference_rad"),
    ],
)
def test_a_gap_that_the_cause_has_no_part_in_is_not_told_as_its_own(
    moved: float, turned: float, told: str
) -> None:
    """A wider axle moves no odometry that turns by its gyro: 4.41 mm before, 4.41 after, none of it
    closed, was told of an axle that is right to 0.06 %; and 5.5 mm of a gyro's scale within its
    tolerance of a mismatch that closes 93 % of the turns' difference. Of wheels that differ by 1 %,
    which the turns tell to 92 %, 2.58 mm before and 2.56 after were told: 1 % closed."""
    known = {
        "odometry_position_m": compared(20.0, 20.0, moved),
        "turn_difference_rad": compared(9.0, 1.0, turned),
    }
    gap = gap_of(known, "wheel", "stretches")
    assert gap is not None
    assert gap.metric == told


def test_a_metric_without_a_gap_takes_none_from_another() -> None:
    """Moved by four times what there was to close, it stood for a gap that was closed by half."""
    known = {
        "odometry_position_m": compared(1.01, 9.0, 4.0),
        "turn_difference_rad": compared(81.0, 9.0, 6.0),
    }
    gap = gap_of(known, "wheel", "stretches")
    assert gap is not None
    assert gap.metric == "turn_difference_rad"


@given(arrays(np.float64, (4, 6, 2), elements=errors))
def test_shares_of_the_stages_add_up_to_one(ends: np.ndarray) -> None:
    shares = shares_of(chain_of(dict(zip(STAGES, ends, strict=True))))
    if (ends[-1] ** 2).sum() < 1e-3:
        return
    assert math.fsum(shares.values()) == pytest.approx(1, abs=1e-12 * _size(ends))


def _size(ends: np.ndarray) -> float:
    """How much larger than the whole the parts are: cancelling loses as many digits."""
    return float(max(1.0, (np.abs(ends) ** 2).sum() / (ends[-1] ** 2).sum()))


def test_a_stage_whose_recorded_input_changes_nothing_has_no_share() -> None:
    end = np.random.default_rng(1).normal(size=(5, 2))
    chain = chain_of({"wheel": 0 * end, "encoder": 0 * end, "gyro": end, "reference": end})
    assert shares_of(chain) == {"wheel": 0, "encoder": 0, "gyro": 1, "reference": 0}


def test_without_any_error_there_are_no_shares() -> None:
    assert shares_of(chain_of({"wheel": np.zeros((3, 2))})) == {}


@given(
    values=st.lists(st.floats(0, 100), min_size=16, max_size=16),
    count=st.integers(0, 4),
)
def test_shapley_values_add_up_to_what_all_effects_take_off(
    values: list[float], count: int
) -> None:
    names = "abcd"[:count]
    subsets = [frozenset(s) for k in range(count + 1) for s in combinations(names, k)]
    gap = dict(zip(subsets, values, strict=False))
    reductions = shapley_reductions(names, gap.__getitem__)
    taken = gap[frozenset()] - gap[frozenset(names)]
    assert math.fsum(reductions.values()) == pytest.approx(taken, abs=1e-10)


@given(gaps=st.lists(st.floats(0, 100), min_size=5, max_size=5))
def test_effects_that_do_the_same_in_every_company_take_off_the_same(gaps: list[float]) -> None:
    reductions = shapley_reductions("abcd", lambda on: gaps[len(on)])
    assert len(set(reductions.values())) == 1


@given(own=st.lists(st.floats(-10, 10), min_size=4, max_size=4))
def test_an_effect_that_adds_the_same_to_every_company_takes_off_just_that(
    own: list[float],
) -> None:
    part = dict(zip("abcd", own, strict=True))
    reductions = shapley_reductions("abcd", lambda on: 50 - math.fsum(part[name] for name in on))
    assert reductions == pytest.approx(part, abs=1e-12)


def test_more_effects_than_a_waterfall_bears_are_refused() -> None:
    with pytest.raises(ValueError, match="expected at most"):
        shapley_reductions([str(k) for k in range(MOST_EFFECTS + 1)], lambda on: 0.0)
