"""Turns the example minute of comma2k19 (NumPy files) into a table and references.

    python car_table.py "Example_1/b0c9d2329ad1606b|2018-08-02--08-34-47/40" OUT

The car's rear wheels say their speeds, a phone behind its windscreen its turn rate (downwards, so
that a turn to the left is negative; with the bias it has). `reference.tum` has the positions of a
filter of GPS and phone, `fixes.tum` those of the GPS receiver alone: neither has headings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pymap3d
from robots import CAR, CAR_MAP

LEFT, RIGHT = 2, 3
"""The rear wheels, of front left, front right, rear left, rear right."""
DOWN = 2


def load(folder: Path, name: str) -> np.ndarray:
    """Return one of the recording's arrays."""
    return np.asarray(np.load(folder / name, allow_pickle=False))


def write_positions(path: Path, t_s: np.ndarray, x_m: np.ndarray, y_m: np.ndarray) -> None:
    """Write positions without headings."""
    rows = np.zeros((len(t_s), 8))
    rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 7] = t_s, x_m, y_m, 1.0
    np.savetxt(path, rows, fmt="%.6f")


def main() -> None:
    """Convert the recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "recording", type=Path, help="the folder with processed_log and global_pose"
    )
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    log = given.recording / "processed_log"
    t_s, speeds = load(log, "CAN/wheel_speed/t"), load(log, "CAN/wheel_speed/value")
    gyro_s, gyro = load(log, "IMU/gyro_uncalibrated/t"), load(log, "IMU/gyro_uncalibrated/value")
    begins_s = t_s[0]
    np.savetxt(
        given.out / "table.csv",
        np.column_stack(
            [
                t_s - begins_s,
                speeds[:, LEFT],
                speeds[:, RIGHT],
                -np.interp(t_s, gyro_s, gyro[:, DOWN]),
            ]
        ),
        fmt="%.6f",
        delimiter=",",
        header="t_s,left_m_s,right_m_s,yaw_rad_s",
        comments="",
    )
    pose_s = load(given.recording, "global_pose/frame_times")
    places = pymap3d.ecef2geodetic(*load(given.recording, "global_pose/frame_positions").T)
    first = tuple(float(one[0]) for one in places)
    east_m, north_m, _ = pymap3d.geodetic2enu(*places, *first)
    write_positions(given.out / "reference.tum", pose_s - begins_s, east_m, north_m)
    fix_s, fixes = load(log, "GNSS/live_gnss_ublox/t"), load(log, "GNSS/live_gnss_ublox/value")
    east_m, north_m, _ = pymap3d.geodetic2enu(fixes[:, 0], fixes[:, 1], first[2], *first)
    write_positions(given.out / "fixes.tum", fix_s - begins_s, east_m, north_m)
    (given.out / "robot.toml").write_text(CAR, encoding="utf-8")
    (given.out / "map.toml").write_text(CAR_MAP, encoding="utf-8")
    print(f"{given.out}: {len(t_s)} rows, {len(pose_s)} positions, {len(fix_s)} fixes")


if __name__ == "__main__":
    main()
