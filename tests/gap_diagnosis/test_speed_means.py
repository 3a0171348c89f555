"""Speeds that are means since the row before are added up as such where a reference tells."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.reading.speeds import integrated_speed
from gap_diagnosis.recording import Floats, Recording, Reference
from gap_diagnosis.speed_means import with_means_added_up
from hil_harness.robot import load_robot

ROBOT = load_robot()
FINE_S, LASTS_S = 0.001, 60.0
FINE = np.arange(0.0, LASTS_S, FINE_S)
SPEED_M_S = 0.3 + 0.2 * np.sin(FINE) * np.sin(0.37 * FINE)
HEADING_RAD = 2.0 * np.sin(0.3 * FINE)
WAY_M = np.cumsum(SPEED_M_S) * FINE_S
PER_M = ROBOT.plant.encoder.ticks_per_rev / (math.tau * ROBOT.plant.wheels.radius_m)


def drive(row_s: float, *, means: bool, fix_s: float = 0.01, seed: int = 0) -> Recording:
    """Return noisy speeds of a drive, and where a reference saw it."""
    rng = np.random.default_rng(seed)
    rows_s = np.arange(row_s, LASTS_S, row_s)
    way_m = np.interp(rows_s, FINE, WAY_M)
    moment = np.interp(rows_s, FINE, SPEED_M_S)
    told = np.diff(way_m, prepend=0.0) / row_s if means else moment
    told = told + 0.01 * rng.standard_normal(len(told))
    added = integrated_speed(told, rows_s, scale=PER_M)
    stamps = np.arange(0.3, LASTS_S - 0.3, fix_s)
    places = np.cumsum([SPEED_M_S * np.cos(HEADING_RAD), SPEED_M_S * np.sin(HEADING_RAD)], 1)
    x_m, y_m = (np.interp(stamps, FINE, one) * FINE_S for one in places)
    noise = 0.0005 * rng.standard_normal((2, len(stamps)))
    return Recording(
        name="log",
        tick_period_s=row_s,
        t_s=rows_s,
        stamp_s=rows_s,
        tick=np.arange(len(rows_s)),
        left_ticks=added.ticks,
        right_ticks=added.ticks,
        speed_cycle_s=row_s,
        unsure_ticks2=np.stack([added.unsure_ticks2] * 2),
        half_row_ticks=np.stack([added.half_row_ticks] * 2),
        reference=Reference(stamps, x_m + noise[0], y_m + noise[1], None),
    )


def late_m(recording: Recording) -> float:
    """Return how far the counted way is behind where the robot speeds up, as a time by speed."""
    off_m = recording.left_ticks / PER_M - np.interp(recording.t_s, FINE, WAY_M)
    speed = np.interp(recording.t_s, FINE, SPEED_M_S)
    faster: Floats = speed - speed.mean()
    drift = np.polynomial.Polynomial.fit(recording.t_s, off_m, 3)(recording.t_s)
    return -float(faster @ (off_m - drift)) / float(faster @ faster)


@pytest.mark.parametrize("row_s", [0.05, 0.1])
@pytest.mark.parametrize("means", [True, False])
def test_the_way_is_in_time_whichever_the_speeds_are(row_s: float, means: bool) -> None:
    """Along trapezoids means were half a row late. Of 24 healthy robots with noisy or coarse speeds
    13 had a cause for it (up to 0.96), of six cars at 10 Hz five an antenna ahead (up to 0.89)."""
    for seed in range(5):
        recording = drive(row_s, means=means, seed=seed)
        found = with_means_added_up(recording, ROBOT)
        assert np.array_equal(found.left_ticks, recording.left_ticks) is not means
        assert abs(late_m(found)) < 0.2 * row_s
        assert found.half_row_ticks is None


def test_means_are_added_up_over_their_own_rows_however_uneven_and_from_the_first_on() -> None:
    """A log that began in motion began with half a row too many, and uneven rows trembled."""
    rows_s = np.cumsum(np.random.default_rng(1).uniform(0.03, 0.07, 200))
    way_m = np.interp(rows_s, FINE, WAY_M)
    told = np.diff(way_m, prepend=np.interp(rows_s[0] - 0.05, FINE, WAY_M)) / np.diff(
        rows_s, prepend=rows_s[0] - 0.05
    )
    added = integrated_speed(told, rows_s, scale=1.0)
    ways_m = added.ticks + added.half_row_ticks
    np.testing.assert_allclose(np.diff(ways_m), np.diff(way_m), atol=1e-9)


def test_without_a_reference_that_tells_nothing_is_changed() -> None:
    recording = drive(0.1, means=True)
    seldom = drive(0.1, means=True, fix_s=1.0)
    for one in (replace(recording, reference=None), seldom):
        found = with_means_added_up(one, ROBOT)
        np.testing.assert_array_equal(found.left_ticks, one.left_ticks)
