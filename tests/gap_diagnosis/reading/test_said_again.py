"""Rows of a table in which a counter only says again what it said last."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, Drive, drive
from full_size import at_full_size
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.said_again import with_news_only, without_said_again
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

FASTEST = 60
"""Counts per row."""


def wheel(seed: int, rows: int = 1500) -> Floats:
    """Return the counts of a wheel that is sped up, slowed down, stopped and turned back."""
    random = np.random.default_rng(seed)
    wanted = np.repeat(random.choice([-1.0, 0.0, 0.3, 1.0], rows // 50 + 1), 50)[:rows]
    ramp = np.convolve(wanted, np.ones(10) / 10)[:rows]
    return np.rint(np.cumsum(FASTEST * ramp + random.normal(0.0, 1.0, rows) * (ramp != 0)))


def held(counts: Floats, old: NDArray[np.bool_]) -> Floats:
    """Return what a table says that is not told of some rows."""
    last = np.maximum.accumulate(np.where(old, 0, np.arange(len(counts))))
    return counts[last]


def rows_of_a_lower_rate(rows: int, cycle: float) -> NDArray[np.bool_]:
    """Mark the rows in which nothing came of what comes once in so many."""
    at = np.floor(np.arange(rows) / cycle)
    return np.diff(at, prepend=-1.0) == 0.0


@given(st.integers(0, 10_000))
def test_counts_that_come_with_every_row_are_left_as_they_are(seed: int) -> None:
    counts = wheel(seed)
    found, again = without_said_again(counts)
    assert again == 0
    assert np.array_equal(found, counts)


@given(st.integers(0, 10_000), st.floats(1.3, 6.0))
@example(seed=0, cycle=5.875)
def test_of_a_counter_at_a_lower_rate_only_what_came_is_left(seed: int, cycle: float) -> None:
    counts = wheel(seed)
    old = rows_of_a_lower_rate(len(counts), cycle)
    table = held(counts, old)
    found, _ = without_said_again(table)
    left = np.isfinite(found)
    assert left[np.flatnonzero(np.diff(table)) + 1].all()
    assert np.array_equal(found[left], table[left])
    is_fast = np.abs(np.gradient(counts)) > 0.8 * FASTEST
    inside = np.convolve(is_fast, np.ones(41), mode="same") == 41
    assert not left[old & inside].any()


@given(st.integers(0, 10_000))
def test_rows_that_came_late_now_and_then_are_found(seed: int) -> None:
    counts = wheel(seed)
    old = np.random.default_rng(seed).random(len(counts)) < 0.05
    old[[0, -1]] = False
    found, _ = without_said_again(held(counts, old))
    is_fast = np.abs(np.gradient(counts)) > 0.8 * FASTEST
    inside = np.convolve(is_fast, np.ones(41), mode="same") == 41
    assert np.isnan(found[old & inside]).all()
    assert not np.isnan(found[~old & inside]).any()


def test_a_wheel_that_stalls_and_makes_up_for_nothing_is_no_late_row() -> None:
    """Blocked for a row in twenty it goes on as fast as before: that it did not turn is news."""
    steps = np.full(2000, 40.0)
    steps[::20] = 0.0
    assert without_said_again(np.cumsum(steps))[1] == 0


def test_a_wheel_of_one_count_per_row_says_the_same_twice_by_itself() -> None:
    assert without_said_again(np.floor(0.7 * np.arange(2000.0)))[1] == 0


@pytest.mark.parametrize("step", [0.3, 1.0, 2.6, 6.49, 57.3])
def test_nor_does_one_whose_way_is_told_in_coarse_steps(step: float) -> None:
    """Of distances in millimetres, 6.5 counts each, one row in 30 was said to be old."""
    speeds = np.array([0.4, 1.1, 1.7, 2.3, 3.1])
    way = np.cumsum(np.repeat(step * speeds, 400))
    assert without_said_again(step * np.floor(way / step))[1] == 0


def test_empty_rows_between_are_still_empty() -> None:
    counts = held(wheel(1), rows_of_a_lower_rate(1500, 4.0))
    counts[100:110] = np.nan
    found, again = without_said_again(counts)
    assert np.isnan(found[100:110]).all()
    assert again > 500


def test_a_table_tells_how_many_rows_have_no_news_of_a_wheel(tmp_path: Path) -> None:
    table = drive(2000)
    old = rows_of_a_lower_rate(2000, 2.0)
    columns = {
        name: held(column, old) if name == "left_ticks" else column
        for name, column in table.columns.items()
    }
    path = Drive(columns).write(tmp_path / "table.csv")
    found = read_recording(path, robot=ROBOT, signals=None)
    assert found.gyro_code is not None
    assert np.isfinite(found.gyro_code).all()
    (note,) = found.notes
    assert "rows of 2,000 say the left wheel's last count again and 0 the right one's" in note


def test_where_nothing_came_of_one_wheel_the_other_is_as_old() -> None:
    """A host read again a moment later: the right wheel had one count more by then, and the robot
    seemed to turn there and back."""
    left = 40.0 * np.arange(400)
    old = np.arange(400) % 20 == 7
    wheels = held(left, old), held(left, old)
    wheels[1][np.flatnonzero(old)[8:]] += 1.0
    at_s = 0.02 * np.arange(400)
    log = Recording("table.csv", 0.02, at_s, at_s, np.arange(400), *wheels)
    found = with_news_only(log)
    assert np.array_equal(np.isnan(found.left_ticks), old)
    assert np.array_equal(np.isnan(found.right_ticks), old)


def late_rows(seed: int, *effects: EffectSetting) -> Recording:
    """Return a drive as a table of which every twentieth row says the last counts again."""
    calm = replace(scenario("calibration"), effects=())
    log = synthetic_recording(ROBOT, load_wire(), calm, effects, seed)
    old = np.random.default_rng(seed).random(len(log.t_s)) < 0.05
    old[[0, -1]] = False
    said = {name: held(getattr(log, name), old) for name in ("left_ticks", "right_ticks")}
    return replace(log, frames={}, **said)


@pytest.mark.parametrize("seed", [1, *at_full_size(2)])
def test_a_healthy_robot_whose_table_has_late_rows_has_no_gap(seed: int) -> None:
    """An overflow and a resolution of the firmware, it was said (0.95): its odometry had not been
    made of these counts."""
    table = with_news_only(late_rows(seed))
    assert table.odometry_x_m is not None
    assert diagnose_recordings([table], ROBOT, load_wire()).diagnosis.verdict == "no_gap"


@pytest.mark.full_size
def test_an_effect_is_found_beside_late_rows() -> None:
    small = EffectSetting("radius_mismatch", (("mismatch", 0.01),))
    table = with_news_only(late_rows(3, small))
    found = diagnose_recordings([table], ROBOT, load_wire()).diagnosis
    assert "radius_mismatch" in found.which[0].effects
