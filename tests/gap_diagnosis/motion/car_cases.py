"""Cars as tables: the rear wheels' speeds, the yaw rate, and where a GPS was, without headings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Floats, Recording
from hil_harness import Robot, load_robot

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
