"""The floor of the commands' gap: what a drive's own noise leaves of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from gap_cases import drives
from numpy.typing import NDArray

from gap_diagnosis.drive.data import drive_data
from gap_diagnosis.drive.noise import Levels
from gap_diagnosis.gap.drive_floor import DriveNoise, drive_floor
from gap_diagnosis.gap.drive_path import commanded_path
from gap_diagnosis.gap.metrics import Path, path_errors
from gap_diagnosis.gap.on_recording import Replayed, compare_all, windows_on

DRIVES = 40
"""Mean squares of walks are known to sqrt(2/(40 drives·4 windows that count)) = 11 %, so the RMS to
6 %; the tolerance is three times that."""
LEVELS = {
    "a walk": Levels(white=1e-6, walk=0.01, spread=1e-9, memory_s=0.3),
    "a rate error with a memory": Levels(white=1e-6, walk=1e-9, spread=0.02, memory_s=0.5),
    "white noise": Levels(white=0.02, walk=1e-9, spread=1e-9, memory_s=0.3),
}


@pytest.mark.parametrize("kind", LEVELS)
def test_wheels_that_leave_their_commands_are_off_by_as_much_as_the_floor_says(kind: str) -> None:
    levels = LEVELS[kind]
    robot, [(recording, motion)] = drives("random")
    data, commanded = drive_data(recording, robot), commanded_path(recording, robot)
    assert data is not None
    assert commanded is not None
    wheels, tick_s = robot.plant.wheels, recording.tick_period_s
    path, windows = Path(recording.t_s, *commanded.T), windows_on(motion)
    turn = np.diff(commanded[:, 2], prepend=0.0)
    middle = commanded[:, 2] - 0.5 * turn
    ahead = np.hypot(*np.diff(commanded[:, :2], axis=0, prepend=0.0).T)
    cosine = np.diff(commanded[:, 0], prepend=0.0) * np.cos(middle)
    ahead *= np.sign(cosine + np.diff(commanded[:, 1], prepend=0.0) * np.sin(middle))
    draw = np.random.default_rng(0)
    squares = []
    for _ in range(DRIVES):
        off = wheels.radius_m * np.stack(
            [
                _errors(np.interp(recording.t_s, data.time_s, activity), levels, tick_s, draw)
                for activity in data.activity
            ]
        )
        steps = np.diff(off, axis=1, prepend=off[:, :1])
        heading = np.cumsum(turn + (steps[1] - steps[0]) / wheels.wheelbase_m)
        between = heading - 0.5 * np.diff(heading, prepend=0.0)
        forward = ahead + 0.5 * (steps[0] + steps[1])
        went = np.cumsum(forward * np.exp(1j * between))
        measured = Path(recording.t_s, went.real, went.imag, heading)
        squares.append(path_errors(path, measured, windows).position.mean_square)
    floor = drive_floor(
        path, DriveNoise.of(data, levels), windows,
        radius_m=wheels.radius_m, wheelbase_m=wheels.wheelbase_m,
    )  # fmt: skip
    assert math.sqrt(np.mean(squares) / floor.mean()) == pytest.approx(1, abs=0.2)


def _errors(
    activity: NDArray[np.float64], levels: Levels, tick_s: float, draw: np.random.Generator
) -> NDArray[np.float64]:
    """Return a wheel's angle errors at the ticks as the likelihood has them."""
    keep = math.exp(-tick_s / levels.memory_s)
    rate, rates = levels.spread * draw.normal(), []
    for fresh in draw.normal(size=len(activity)):
        rates.append(rate)
        rate = keep * rate + levels.spread * math.sqrt(1 - keep**2) * fresh
    walk = levels.walk * math.sqrt(tick_s) * draw.normal(size=len(activity))
    steps = activity * (np.array(rates) * tick_s + walk)
    return np.asarray(np.cumsum(steps) + levels.white * draw.normal(size=len(activity)))


def test_a_noisy_drive_has_a_higher_floor_than_its_counters() -> None:
    robot, [(recording, motion)] = drives("random")
    data, commanded = drive_data(recording, robot), commanded_path(recording, robot)
    assert data is not None
    assert commanded is not None
    noise = DriveNoise.of(data, LEVELS["a walk"])
    windows = windows_on(motion)
    floors = [
        compare_all(recording, robot, motion, windows, drive=one)["drive_position_m"].floor
        for one in (Replayed(commanded), Replayed(commanded, noise=noise))
    ]
    quiet, noisy = (float(np.mean(one)) for one in floors if one is not None)
    assert noisy > 100 * quiet, "mean squares"
