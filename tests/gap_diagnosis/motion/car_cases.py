"""Cars as tables: the rear wheels' speeds, the yaw rate, and where a GPS was, without headings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Floats, Recording
from hil_harness import Robot, load_robot

CREEP_S2_PER_M = 0.002
"""Two thirds of what is no gap."""
TRACK_M = 1.52
STEP_S, FIX_S = 0.01, 0.1
GPS_M = 0.02
WANDER_S = 80.0

_MAP = """[columns]
time = { column = "t_s", unit = "s" }
left_count = { column = "left_m_s", unit = "m/s" }
right_count = { column = "right_m_s", unit = "m/s" }
gyro = { column = "yaw_rad_s", unit = "rad/s" }
"""
_ROBOT = """schema = 1
[robot]
name = "car"
[wheels]
radius_m = 0.316
wheelbase_m = {track_m}
[encoder]
ticks_per_rev = 4096
[drive]
max_wheel_rate_rad_s = 150.0
"""


def read_car(home: Path, track_m: float, rows: Floats, fixes: Floats) -> tuple[Recording, Robot]:
    """Return a car's log as it is read, and the car as it is described.

    *rows* are time, speeds of the left and the right wheel and yaw rate, float64[n, 4]; *fixes*
    stamps and positions, float64[m, 3].
    """
    np.savetxt(
        home / "car.csv",
        rows,
        fmt="%.5f",
        delimiter=",",
        header="t_s,left_m_s,right_m_s,yaw_rad_s",
        comments="",
    )
    poses = np.zeros((len(fixes), 8))
    poses[:, :3], poses[:, 7] = fixes, 1.0
    np.savetxt(home / "car.tum", poses, fmt="%.5f")
    for name, text in (("map.toml", _MAP), ("robot.toml", _ROBOT.format(track_m=track_m))):
        (home / name).write_text(text, encoding="utf-8")
    robot = load_robot(home / "robot.toml")
    (recording,) = read_recordings(
        [home / "car.csv"],
        robot=robot,
        references=[home / "car.tum"],
        signals=home / "map.toml",
    )
    return recording, robot


def driven(
    home: Path,
    seed: int,
    slip_angle_s2_per_m: float = 0.0,
    left_larger: float = 0.0,
    wander: float = 0.0,
    pressed_s2_per_m: float = 0.0,
    creep_s2_per_m: float = CREEP_S2_PER_M,
    driven_s2_per_m: float = 0.0,
    under_load_s4_per_m2: float = 0.0,
) -> MotionModel:
    """Return what a car's bus and its GPS say of four minutes in town: the rear wheels' speeds and
    the yaw rate, and where it was, not which way it pointed.

    Its tyres yield by *slip_angle_s2_per_m*, its left wheel is by *left_larger* larger than it is
    described, and the wheels come apart to and fro by *wander*, parts of their way. In a turn the
    outer wheel rolls on a radius smaller by *pressed_s2_per_m* times the sideways acceleration, the
    inner one on one as much larger. Both creep by *creep_s2_per_m*, and by *driven_s2_per_m* more
    while it speeds up and less while it slows down; the inner one creeps more than the outer by
    2 *under_load_s4_per_m2* times both accelerations.
    """
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, 240.0, STEP_S)
    asked = np.zeros((2, len(t_s)))
    at_s = 3.0
    while at_s < t_s[-1] - 12.0:
        part = (t_s >= at_s) & (t_s < (at_s := at_s + rng.uniform(4.0, 12.0)))
        if rng.random() < 0.8:
            speed = rng.uniform(3.0, 16.0)
            bend = min(rng.uniform(0.01, 0.12), 2.5 / speed**2) * (rng.random() < 0.55)
            asked[:, part] = [[speed], [rng.choice([-1.0, 1.0]) * bend]]
    speed = gaussian_filter1d(asked[0], 1.5 / STEP_S)
    bend = gaussian_filter1d(asked[1], 0.6 / STEP_S)
    turn_rate = speed * bend
    heading = np.cumsum(turn_rate) * STEP_S
    middle = heading - 0.5 * turn_rate * STEP_S - slip_angle_s2_per_m * speed * turn_rate
    x_m, y_m = np.cumsum([speed * np.cos(middle), speed * np.sin(middle)], axis=1) * STEP_S
    ahead = np.gradient(speed, STEP_S)
    creeps = 1.0 + creep_s2_per_m * ahead + driven_s2_per_m * np.abs(ahead)
    relieved = under_load_s4_per_m2 * ahead * speed * turn_rate
    apart = 0.5 * TRACK_M * turn_rate
    apart_more = 0.5 * wander * np.sin(math.tau * t_s / WANDER_S)
    pressed = pressed_s2_per_m * speed * turn_rate
    rows = [
        t_s,
        (speed - apart)
        * (creeps + relieved)
        * (1.0 - apart_more)
        / ((1.0 + left_larger) * (1.0 + pressed)),
        (speed + apart) * (creeps - relieved) * (1.0 + apart_more) / (1.0 - pressed),
        turn_rate,
    ]
    noise = np.array([[0.0], [0.003], [0.003], [5e-4]]) * rng.standard_normal((4, len(t_s)))
    fixes_s = np.arange(0.0037, t_s[-1], FIX_S)
    way = np.array([np.interp(fixes_s, t_s, one) for one in (x_m, y_m)])
    way += GPS_M * rng.standard_normal(way.shape)
    table, fixes = (np.array(rows) + noise).T, np.column_stack([fixes_s, *way])
    recording, robot = read_car(home, TRACK_M, table, fixes)
    return MotionModel(recording, robot, default_prior())
