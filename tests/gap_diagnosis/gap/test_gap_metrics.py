"""The metrics: what they see, and what they must not see."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from gap_cases import TICK_S, moved, wavy_path, way_of
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.gap.metrics import (
    Path,
    WindowErrors,
    clock_skew_of,
    drifting_share,
    path_errors,
    series_errors,
    stamp_errors,
)
from gap_diagnosis.gap.windows import LEAST_S, WINDOW_M, WINDOW_S, Window, windows_of
from gap_diagnosis.recording import FrameTimes

PATH = wavy_path()
WINDOWS = windows_of(PATH.t_s, way_of(PATH))
ROUNDING_M = 1e-10
angles = st.floats(-10, 10)
places = st.floats(-100, 100)


def without_heading(path: Path) -> Path:
    return Path(path.t_s, path.x_m, path.y_m, None)


def bent(path: Path, bend_rad_per_s: float) -> Path:
    heading = np.asarray(path.heading_rad) + bend_rad_per_s * path.t_s
    steps = np.hypot(np.diff(path.x_m, prepend=0.0), np.diff(path.y_m, prepend=0.0))
    return Path(
        path.t_s, np.cumsum(steps * np.cos(heading)), np.cumsum(steps * np.sin(heading)), heading
    )


@given(angle=angles, x=places, y=places)
def test_equal_paths_have_no_error_wherever_the_reference_has_its_origin(
    angle: float, x: float, y: float
) -> None:
    errors = path_errors(PATH, moved(PATH, angle, x, y), WINDOWS)
    assert errors.heading is not None
    assert errors.position.rms == pytest.approx(0, abs=ROUNDING_M)
    assert errors.heading.rms == pytest.approx(0, abs=ROUNDING_M)


@given(angle=angles, x=places, y=places, seed=st.integers(1, 9), has_heading=st.booleans())
def test_turning_and_moving_the_reference_changes_no_error(
    angle: float, x: float, y: float, seed: int, has_heading: bool
) -> None:
    other = wavy_path(seed=seed)
    measured = other if has_heading else without_heading(other)
    here = path_errors(PATH, measured, WINDOWS)
    there = path_errors(PATH, moved(measured, angle, x, y), WINDOWS)
    assert there.position.mean_square == pytest.approx(here.position.mean_square, rel=1e-7)
    assert there.position.end == pytest.approx(here.position.end, rel=1e-6, abs=1e-9)


def test_a_car_seen_once_a_second_has_errors_too() -> None:
    """The first second holds one fix, and the start heading is told by two."""
    t_s = np.arange(0.0, 60.0, TICK_S)
    straight = Path(t_s, 16.0 * t_s, 0.0 * t_s, 0.0 * t_s)
    longer = Path(t_s, 16.16 * t_s, 0.0 * t_s, 0.0 * t_s)
    fixes = Path(*(one[::100] for one in (straight.t_s, straight.x_m, straight.y_m)), None)
    errors = path_errors(longer, fixes, [Window(0.5, 20.5, 1.5)])
    # A hundredth of the way from the middle of two fixes, 16 m apart.
    assert errors.position.end[0] == pytest.approx([0.16 * (20.0 - 1.5), 0.0], abs=1e-6)


def test_a_window_starts_anew_so_an_error_does_not_grow_from_one_to_the_next() -> None:
    errors = path_errors(bent(PATH, 0.002), PATH, WINDOWS)
    assert errors.heading is not None
    # The start heading is that of the middle of the first second.
    ends = [0.002 * (one.stop_s - one.start_s - 0.5) for one in WINDOWS]
    assert errors.heading.end[:, 0] == pytest.approx(ends, abs=1e-4)


def test_a_scale_error_leaves_its_share_of_the_way() -> None:
    straight = Path(PATH.t_s, 0.5 * PATH.t_s, 0.0 * PATH.t_s, 0.0 * PATH.t_s)
    longer = Path(PATH.t_s, 1.01 * straight.x_m, straight.y_m, straight.heading_rad)
    errors = path_errors(longer, straight, [Window(0.0, 10.0, 1.0)])
    assert errors.position.end == pytest.approx(np.array([[0.005 * 9.5, 0.0]]), abs=1e-9)
    # The mean of (0.005·(t − ½))² for t from 1 to 10.
    expected = 0.005 * math.sqrt((9.5**3 - 0.5**3) / 3 / 9)
    assert errors.position.rms == pytest.approx(expected, rel=1e-2)


def test_the_prediction_is_read_at_the_references_own_stamps() -> None:
    stamps = np.sort(np.random.default_rng(4).uniform(0.5, 39.0, 700))
    x, y, heading = (
        np.interp(stamps, PATH.t_s, one) for one in (PATH.x_m, PATH.y_m, PATH.heading_rad)
    )
    errors = path_errors(PATH, Path(stamps, x, y, heading), WINDOWS)
    assert errors.position.rms == pytest.approx(0, abs=ROUNDING_M)


def test_positions_alone_tell_the_start_heading() -> None:
    errors = path_errors(PATH, without_heading(moved(PATH, 1.0, 3.0, 4.0)), WINDOWS)
    assert errors.heading is None
    assert len(errors.position.window) == len(WINDOWS)
    assert errors.position.rms == pytest.approx(0, abs=ROUNDING_M)


def test_a_headings_whole_turns_do_not_matter() -> None:
    assert PATH.heading_rad is not None
    wrapped = np.angle(np.exp(1j * (PATH.heading_rad + 3.0)))
    errors = path_errors(PATH, Path(PATH.t_s, *_turned(3.0), wrapped), WINDOWS)
    assert errors.heading is not None
    assert errors.heading.rms == pytest.approx(0, abs=ROUNDING_M)


def _turned(angle_rad: float) -> tuple[np.ndarray, np.ndarray]:
    other = moved(PATH, angle_rad, 0.0, 0.0)
    return other.x_m, other.y_m


def test_windows_end_after_five_metres_or_ten_seconds_and_never_overlap() -> None:
    assert len(WINDOWS) >= 3
    way = way_of(PATH)
    for one, following in itertools.pairwise(WINDOWS):
        far = np.diff(np.interp([one.start_s, one.stop_s], PATH.t_s, way))[0]
        assert one.stop_s - one.start_s == pytest.approx(WINDOW_S) or far >= WINDOW_M - 1e-9
        assert far <= WINDOW_M + 0.01
        assert following.start_s >= one.stop_s


def test_a_fast_vehicle_is_measured_over_all_of_its_drive() -> None:
    t_s = TICK_S * np.arange(6000)
    windows = windows_of(t_s, 20.0 * t_s)
    assert windows[0].start_s == 0.0
    assert windows[-1].stop_s > t_s[-1] - LEAST_S
    for one, following in itertools.pairwise(windows):
        assert one.stop_s - one.start_s == pytest.approx(LEAST_S)
        assert following.start_s == one.stop_s


def test_windows_stay_inside_the_stretches_they_are_given() -> None:
    inside = (PATH.t_s > 7.0) & (PATH.t_s < 19.5)
    windows = windows_of(PATH.t_s, way_of(PATH), inside)
    assert windows
    assert all(7.0 < one.start_s < one.stop_s < 19.5 for one in windows)


@given(st.floats(-50, 50))
def test_a_constant_angle_between_two_signals_is_no_turn_difference(offset: float) -> None:
    difference = np.full(len(PATH.t_s), offset)
    assert series_errors(PATH.t_s, difference, WINDOWS).rms == pytest.approx(0, abs=1e-12)


def test_a_clock_that_runs_fast_is_late_by_its_skew() -> None:
    number = np.arange(4000)
    skew = 1e-3
    stamps = number * 0.01 / (1 + skew)
    frames = FrameTimes(
        t_s=stamps,
        counter=number.astype(np.int64),
        modulo=256,
        cycle_s=0.01,
        payload=np.zeros(4000, np.uint64),
    )
    plain = stamp_errors(frames, [Window(0.0, 10.0, 1.0)])
    assert plain.end[0, 0] == pytest.approx(-skew * 9.5, rel=5e-3)
    explained = stamp_errors(frames, [Window(0.0, 10.0, 1.0)], clock_skew=skew)
    assert explained.rms == pytest.approx(0, abs=1e-9)
    ends = np.arange(0.01, 45.0, 0.01)
    kept = ends > 20.0
    assert clock_skew_of({"IMU": frames}, ends, kept) == pytest.approx(skew, rel=1e-6)
    assert clock_skew_of({"IMU": frames}, ends, ends < 0) == 0.0
    assert drifting_share({"IMU": frames}) == pytest.approx(1.0)
    jitter_s = np.random.default_rng(1).normal(0.0, 1e-3, len(number))
    jumpy = replace(frames, t_s=number * frames.cycle_s + jitter_s)
    assert drifting_share({"IMU": jumpy}) < 0.01
    assert drifting_share({}) == 0.0


def test_errors_are_compared_in_the_windows_that_all_have() -> None:
    errors = WindowErrors(np.array([0, 2, 5]), np.array([1.0, 4.0, 9.0]), np.zeros((3, 2)))
    kept = errors.at(np.array([2, 3, 5]))
    assert kept.window.tolist() == [2, 5]
    assert kept.mean_square.tolist() == [4.0, 9.0]
    assert kept.end.shape == (2, 2)
