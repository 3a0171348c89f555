"""What noise alone leaves of a gap, where positions tell the start heading."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from gap_diagnosis.gap.floor import NoiseLevels, noise_floor
from gap_diagnosis.gap.metrics import Path, path_errors
from gap_diagnosis.gap.windows import Window

QUIET = NoiseLevels(0.0, 0.0, 0.0, 0.0, reference_position_m=0.005, reference_heading_rad=0.0)
WINDOW = Window(0.0, 10.0, 1.0)


def test_a_receiver_that_is_silent_while_a_car_stands_leaves_the_floor_of_those_that_it_sent():
    """Of a recorded car whose receiver sent new positions only, 7.5 m of floor hid all else."""
    t_s = np.arange(0.0, 10.01, 0.01)
    x_m = np.maximum(t_s - 5.0, 0.0)
    path = Path(t_s, x_m, np.zeros_like(t_s), np.zeros_like(t_s))
    sent_s = np.append(0.1, np.arange(5.1, 10.0, 0.2))
    still = np.zeros((2, len(t_s)))
    floor = noise_floor(
        path, (x_m, x_m), still, sent_s, [WINDOW], QUIET, radius_m=0.05, wheelbase_m=0.3,
        gyro_share=0.0, offset_time_s=np.full(len(t_s), np.inf), has_heading=False,
    )  # fmt: skip
    generator = np.random.default_rng(1)
    squares = []
    for _ in range(400):
        noise_x, noise_y = QUIET.reference_position_m * generator.standard_normal((2, len(sent_s)))
        measured = Path(sent_s, np.interp(sent_s, t_s, x_m) + noise_x, noise_y, None)
        squares.append(path_errors(path, measured, [WINDOW]).position.mean_square[0])
    # Of squares whose one large part is a heading's, the means of 200 and of 400 scatter by 10 and
    # 7 %, together 12 %; 30 % are two and a half of these.
    assert math.isclose(floor.position.mean(), np.mean(squares), rel_tol=0.3)


def test_stamps_that_are_off_leave_the_floor_of_the_poses_that_they_move():
    t_s = np.arange(0.0, 10.01, 0.01)
    heading = 0.8 * t_s
    x_m, y_m = np.cumsum(0.005 * np.cos(heading)), np.cumsum(0.005 * np.sin(heading))
    path = Path(t_s, x_m, y_m, heading)
    stamps_s = np.arange(0.05, 9.95, 0.05)
    off = replace(QUIET, reference_position_m=0.0, reference_stamp_s=0.02)
    way_m, still = 0.5 * t_s, np.zeros((2, len(t_s)))
    floor = noise_floor(
        path, (way_m, way_m), still, stamps_s, [WINDOW], off, radius_m=0.05, wheelbase_m=0.3,
        gyro_share=0.0, offset_time_s=np.full(len(t_s), np.inf),
    )  # fmt: skip
    generator = np.random.default_rng(1)
    squares = []
    for _ in range(400):
        seen_s = stamps_s + off.reference_stamp_s * generator.standard_normal(len(stamps_s))
        seen = (np.interp(seen_s, t_s, one) for one in (x_m, y_m, heading))
        errors = path_errors(path, Path(stamps_s, *seen), [WINDOW])
        squares.append((errors.position.mean_square[0], errors.heading.mean_square[0]))
    # A start's error is drawn once a window, and is a twentieth of a sample's: its squares make up
    # less than a tenth of the mean, which a few hundred draws then tell to a hundredth.
    for found, seen in zip((floor.position, floor.heading), np.mean(squares, axis=0), strict=True):
        assert math.isclose(found.mean(), seen, rel_tol=0.1)


@pytest.mark.parametrize("are_speeds", [False, True])
def test_wheels_that_are_read_late_leave_the_floor_of_what_they_miss(are_speeds: bool) -> None:
    """What counts miss they make up for; what a speed misses stays."""
    t_s = np.arange(0.0, 10.01, 0.01)
    heading = np.sin(t_s)
    x_m, y_m = np.cumsum(0.005 * np.cos(heading)), np.cumsum(0.005 * np.sin(heading))
    path = Path(t_s, x_m, y_m, heading)
    late = replace(
        QUIET,
        reference_position_m=0.0,
        wheels_late_s=0.02,
        late_lasts_s=1.0,
        are_speeds_late=are_speeds,
    )
    way_m, still = 0.5 * t_s, np.zeros((2, len(t_s)))
    floor = noise_floor(
        path, (way_m, way_m), still, t_s[5::5], [WINDOW], late, radius_m=0.05, wheelbase_m=0.3,
        gyro_share=0.0, offset_time_s=np.full(len(t_s), np.inf),
    )  # fmt: skip
    generator, stays = np.random.default_rng(1), math.exp(-0.01)
    seen = Path(t_s[5::5], x_m[5::5], y_m[5::5], heading[5::5])
    squares = []
    for _ in range(200):
        noise = generator.normal(size=1501)
        off_s = 0.02 * lfilter([math.sqrt(1 - stays**2)], [1, -stays], noise)[500:]
        if are_speeds:
            turned = np.cumsum(0.01 * np.interp(t_s - off_s, t_s, np.cos(t_s)))
        else:
            turned = np.sin(t_s - off_s)
        way_m = 0.5 * (t_s if are_speeds else t_s - off_s)
        steps_m = np.diff(way_m, prepend=way_m[0])
        told = np.cumsum(steps_m * np.cos(turned)), np.cumsum(steps_m * np.sin(turned))
        errors = path_errors(Path(t_s, *told, turned), seen, [WINDOW])
        squares.append((errors.position.mean_square[0], errors.heading.mean_square[0]))
    # Squares of a window have few large parts: the means of 200 and of 200 scatter by 15 %.
    for found, own in zip((floor.position, floor.heading), np.mean(squares, axis=0), strict=True):
        assert math.isclose(found.mean(), own, rel_tol=0.3)


def test_what_wheels_slip_on_the_way_back_leaves_the_floor_that_it_takes_off_again() -> None:
    """Of a path, which has no sign, slip there and slip back would add up: of wheels that turn back
    every half second the floor was ten times as high."""
    t_s = np.arange(0.0, 10.01, 0.01)
    steps_m = 0.01 * np.where(t_s % 1.0 < 0.5, 1.0, -1.0)
    way_m = np.cumsum(steps_m)
    path = Path(t_s, way_m, np.zeros_like(t_s), np.zeros_like(t_s))
    slips = replace(QUIET, reference_position_m=0.0, slip_wander=0.01, slip_s=2.0)
    still = np.zeros((2, len(t_s)))
    floor = noise_floor(
        path, (way_m, way_m), still, t_s[5::5], [WINDOW], slips, radius_m=0.05, wheelbase_m=0.3,
        gyro_share=1.0, offset_time_s=np.full(len(t_s), np.inf),
    )  # fmt: skip
    generator, stays = np.random.default_rng(1), math.exp(-0.005)
    squares = []
    for _ in range(400):
        noise = generator.normal(size=(2, 2001))
        shares = 0.01 * lfilter([math.sqrt(1 - stays**2)], [1, -stays], noise)[:, 1000:]
        x_m = np.cumsum(steps_m * (1 + shares.mean(axis=0)))[5::5]
        seen = Path(t_s[5::5], x_m, np.zeros_like(x_m), np.zeros_like(x_m))
        squares.append(path_errors(path, seen, [WINDOW]).position.mean_square[0])
    assert math.isclose(floor.position.mean(), np.mean(squares), rel_tol=0.3)
