"""What recorders make of a drive, jitter, courses, few decimals, is no gap of the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, Drive
from full_size import at_full_size

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.lattice import lattice_step
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.courses import without_courses
from gap_diagnosis.reading.held_poses import without_held_poses
from gap_diagnosis.reading.unlocked import without_unlocked_ends
from gap_diagnosis.recording import Floats, Recording, Reference
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_wire
from hil_harness.scenarios import scenario

RAD_PER_TICK = math.tau / ROBOT.plant.encoder.ticks_per_rev
RADIUS_M = ROBOT.plant.wheels.radius_m
CALM = replace(scenario("calibration"), effects=())


@dataclass
class Recorded:
    """Columns of a table and the lines of a TUM file."""

    columns: dict[str, Floats]
    tum: Floats
    units: Mapping[str, str]


def healthy(seed: int, rows_apart: int = 1) -> Recorded:
    log = synthetic_recording(
        ROBOT, load_wire(), CALM, (), seed, reference=ReferenceNoise(rate_hz=10.0)
    )
    assert log.reference is not None
    assert log.reference.heading_rad is not None
    assert log.gyro_rate_rad_s is not None
    rows = slice(None, None, rows_apart)
    rate = np.convolve(log.gyro_rate_rad_s, np.ones(rows_apart) / rows_apart)[: len(log.t_s)]
    half = 0.5 * log.reference.heading_rad
    zero = np.zeros(len(half))
    tum = np.column_stack(
        [
            log.reference.t_s,
            log.reference.x_m,
            log.reference.y_m,
            *(zero, zero, zero),
            np.sin(half),
            np.cos(half),
        ]
    )
    columns = {
        "t_s": log.t_s[rows],
        "left": log.left_ticks[rows],
        "right": log.right_ticks[rows],
        "rate": rate[rows],
    }
    return Recorded(columns, tum, {"left": "count", "right": "count"})


def jittering(drive: Recorded) -> None:
    """Stamps that are early or late by up to 5 ms."""
    off_s = np.random.default_rng(7).uniform(-0.005, 0.005, len(drive.columns["t_s"]))
    drive.columns["t_s"] = drive.columns["t_s"] + off_s


def in_millimetres(drive: Recorded) -> None:
    """A way that is written with three decimals: 6.5 counts apart."""
    for name in ("left", "right"):
        drive.columns[name] = np.round(drive.columns[name] * RAD_PER_TICK * RADIUS_M, 3)
    drive.units = {"left": "m", "right": "m"}


def angles_of_four_decimals(drive: Recorded) -> None:
    """Angles within a turn from 0, of which the largest, where the robot stands, is 6.2832."""
    for name in ("left", "right"):
        angle_rad = (drive.columns[name] - drive.columns[name][0]) * RAD_PER_TICK + 6.28316
        angle_rad = np.round(angle_rad % math.tau, 4)
        least = int(np.argmin(angle_rad))
        assert angle_rad[least] < 3 * RAD_PER_TICK
        angle_rad[least] = 0.0
        drive.columns[name] = angle_rad
    drive.units = {"left": "rad", "right": "rad"}


def with_courses(drive: Recorded) -> None:
    """Headings that were made of the positions."""
    half = 0.5 * np.arctan2(np.gradient(drive.tum[:, 2]), np.gradient(drive.tum[:, 1]))
    drive.tum[:, 6], drive.tum[:, 7] = np.sin(half), np.cos(half)


def holding_its_last_pose(drive: Recorded) -> None:
    """A reference that measures twice a second and is written ten times."""
    for first in range(0, len(drive.tum), 5):
        drive.tum[first : first + 5, 1:] = drive.tum[first, 1:]


def of_two_controllers(drive: Recorded) -> None:
    """The right wheel's counts are read 5 ms after the left's."""
    t_s = drive.columns["t_s"]
    drive.columns["right"] = np.rint(np.interp(t_s + 0.005, t_s, drive.columns["right"]))


def before_it_found_the_robot(drive: Recorded) -> None:
    """A reference that says the origin for four seconds, and stands elsewhere from then on."""
    drive.tum[:, 1] += 2.0
    drive.tum[:40, 1:] = (0, 0, 0, 0, 0, 0, 1)


def read(drive: Recorded, folder: Path) -> Recording:
    text = '[columns]\ntime = { column = "t_s", unit = "s" }\n'
    for role, name in (("left_count", "left"), ("right_count", "right")):
        text += f'{role} = {{ column = "{name}", unit = "{drive.units[name]}" }}\n'
    text += 'gyro = { column = "rate", unit = "rad/s" }\n'
    (folder / "map.toml").write_text(text, encoding="utf-8")
    np.savetxt(folder / "reference.tum", drive.tum, fmt="%.8f")
    return read_recording(
        Drive(drive.columns).write(folder / "table.csv"),
        robot=ROBOT,
        signals=folder / "map.toml",
        reference=folder / "reference.tum",
    )


@pytest.mark.parametrize(
    ("made", "rows_apart"),
    [
        (jittering, 5),
        *at_full_size(
            (in_millimetres, 1),
            (of_two_controllers, 1),
            (with_courses, 1),
            (holding_its_last_pose, 1),
            (before_it_found_the_robot, 1),
        ),
    ],
    ids=lambda one: getattr(one, "__name__", ""),
)
def test_what_a_recorder_makes_of_a_healthy_drive_is_no_gap(
    made: Callable[[Recorded], None], rows_apart: int, tmp_path: Path
) -> None:
    """It was a reference late by as much as stamps jitter (0.98); an unlisted cause (1.0); another
    (1.0); a reference late by what it held its poses for, on average (0.97); a gyro
    that heeds accelerations beside a floor that slopes (0.99); a reference that leaps
    (unlisted, 0.95)."""
    drive = healthy(1, rows_apart)
    made(drive)
    found = diagnose_recordings([read(drive, tmp_path)], ROBOT, load_wire()).diagnosis
    first = found.which[0]
    assert ("no_gap",) in {tuple(first.effects), *map(tuple, first.ambiguous_with)}


def test_a_reference_that_is_late_by_more_than_stamps_jitter_is_told(tmp_path: Path) -> None:
    drive = healthy(1, 5)
    jittering(drive)
    drive.tum[:, 0] += 0.05
    recording = read(drive, tmp_path)
    assert 0.004 < recording.stamps_late_s < 0.01
    found = diagnose_recordings([recording], ROBOT, load_wire()).diagnosis
    assert found.verdict == "reference_time_offset"


def test_even_stamps_are_not_late(tmp_path: Path) -> None:
    assert read(healthy(1), tmp_path).stamps_late_s == 0.0


@pytest.mark.parametrize("seed", range(8))
def test_rows_that_were_sampled_now_sooner_and_now_later_are_not_late(
    seed: int, tmp_path: Path
) -> None:
    """One to four ticks apart, 25 ms on average and a tick of 20 or 30: turns as fast by rows as by
    ticks made 5 to 13 ms of jitter of them in 15 of 24 tables, and 1 to 3 ms in three by time."""
    drive = healthy(1)
    rows = np.cumsum(np.random.default_rng(seed).integers(1, 5, len(drive.columns["t_s"])))
    rows = rows[rows < len(drive.columns["t_s"])]
    for name, values in drive.columns.items():
        drive.columns[name] = values[rows]
    assert read(drive, tmp_path).stamps_late_s < 0.005


def test_angles_are_unwrapped_however_few_decimals_they_have(tmp_path: Path) -> None:
    drive = healthy(1)
    want = drive.columns["left"] - drive.columns["left"][0]
    angles_of_four_decimals(drive)
    assert np.ptp(drive.columns["left"]) > math.tau
    found = read(drive, tmp_path)
    assert np.abs(found.left_ticks - want).max() < 3.2


def reference(drive: Recorded) -> Reference:
    heading = 2.0 * np.arctan2(drive.tum[:, 6], drive.tum[:, 7])
    return Reference(drive.tum[:, 0], drive.tum[:, 1], drive.tum[:, 2], heading)


def test_poses_that_are_only_said_again_are_left_out_and_told() -> None:
    drive = healthy(1)
    want = reference(drive).only(np.arange(len(drive.tum)) % 5 == 0)
    holding_its_last_pose(drive)
    found, (note,) = without_held_poses(reference(drive))
    assert np.array_equal(found.t_s, want.t_s)
    assert np.array_equal(found.x_m, want.x_m)
    assert f"in {len(drive.tum) - len(want.t_s):,} of {len(drive.tum):,} samples" in note


def test_poses_said_again_at_no_even_rate_are_left_out() -> None:
    drive = healthy(1)
    fresh = np.cumsum(np.random.default_rng(2).integers(2, 5, len(drive.tum)))
    fresh = np.concatenate(([0], fresh[fresh < len(drive.tum)]))
    held = fresh[np.searchsorted(fresh, np.arange(len(drive.tum)), side="right") - 1]
    drive.tum[:, 1:] = drive.tum[held, 1:]
    assert np.array_equal(without_held_poses(reference(drive))[0].t_s, drive.tum[fresh, 0])


def test_ends_that_say_one_pose_far_from_the_next_are_left_out_and_told() -> None:
    drive = healthy(1)
    before_it_found_the_robot(drive)
    drive.tum[-30:, 1:] = drive.tum[0, 1:]
    found, (note,) = without_unlocked_ends(reference(drive))
    assert np.array_equal(found.t_s, drive.tum[40:-30, 0])
    assert note.startswith("70 samples of the reference")


def test_a_car_at_rest_that_moves_off_is_seen_from_the_start() -> None:
    """A receiver of 1 Hz that says the same digits while the car stands."""
    t_s = np.arange(0.0, 120.0)
    way = np.cumsum(np.clip(3.0 * (t_s - 20.0), 0.0, 25.0))
    car = Reference(t_s, way, 0.0 * way, None)
    assert without_unlocked_ends(car) == (car, ())


def test_a_robot_at_rest_under_a_reference_without_noise_stays() -> None:
    t_s = np.arange(0.0, 60.0, 0.05)
    way = np.cumsum(np.where(t_s % 10 < 5, 0.0, 0.02))
    still = Reference(t_s, way, 0.0 * way, 0.0 * way)
    assert without_held_poses(still) == (still, ())


def test_a_slow_robot_under_a_reference_of_millimetres_stays() -> None:
    t_s = np.arange(0.0, 60.0, 0.01)
    slow = Reference(t_s, np.round(0.02 * t_s, 3), 0.0 * t_s, 0.0 * t_s)
    assert without_held_poses(slow) == (slow, ())


def test_headings_of_their_own_are_kept() -> None:
    own = reference(healthy(1))
    assert without_courses(own) == (own, ())


def test_headings_that_are_the_course_of_the_positions_are_left_out_and_told() -> None:
    drive = healthy(1)
    with_courses(drive)
    found, (note,) = without_courses(reference(drive))
    assert found.heading_rad is None
    assert "are the course of its positions" in note


def test_true_headings_of_a_robot_that_never_turns_on_the_spot_are_no_courses() -> None:
    """Without noise they are the same: that they do not leap says that somebody measured them."""
    t_s = np.arange(0.0, 60.0, 0.1)
    heading = 0.3 * np.sin(0.2 * t_s)
    way = np.cumsum(0.05 * np.exp(1j * heading))
    true = Reference(t_s, way.real, way.imag, heading)
    assert without_courses(true)[0] is true


@pytest.mark.parametrize(("step", "found"), [(0.3, 1.0), (1.0, 1.0), (6.49, 6.49), (57.3, 57.3)])
def test_the_step_in_which_counts_come_is_found(step: float, found: float) -> None:
    steps = 5.0 + 4.9 * np.sin(np.arange(3000.0) / 70.0)
    way = step * np.floor(np.cumsum(steps))
    assert lattice_step(way) == pytest.approx(found, rel=1e-9)


def test_degrees_that_were_rounded_to_counts_have_steps_of_57_and_58() -> None:
    steps = 5.0 + 4.9 * np.sin(np.arange(3000.0) / 70.0)
    assert lattice_step(np.rint(57.3 * np.floor(np.cumsum(steps)))) == pytest.approx(57.3, rel=2e-3)


def test_a_wheel_that_turns_as_fast_all_the_time_has_no_step() -> None:
    assert lattice_step(40.0 * np.arange(500.0)) == 1.0
