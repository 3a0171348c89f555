"""Turns a Plaza recording (text, and GPS as a MATLAB file) into a table and a reference.

    python lawnmower_table.py Plaza1 OUT
    python lawnmower_table.py Plaza2 OUT --left 1.02

The second one has an error made up: its left wheel counts 2 % too much.

`Plaza1_DR.txt` has distance and heading increments; the distances of two wheels that would have
made them go into the table. `Plaza1_.mat` has GPS positions; they become a reference without
heading, as the recording's own heading of the reference is not independent of the odometry.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from robots import LAWNMOWER, LAWNMOWER_MAP
from scipy.io import loadmat

WHEELBASE_M = 0.5


def main() -> None:
    """Convert one recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="path and name, without _DR.txt")
    parser.add_argument("out", type=Path)
    for side in ("left", "right"):
        text = f"so many times the {side} wheel's way is counted"
        parser.add_argument(f"--{side}", type=float, default=1.0, help=text)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    time_s, distance_m, turn_rad = np.loadtxt(f"{given.recording}_DR.txt").T
    apart_m = np.cumsum(turn_rad) * WHEELBASE_M / 2
    along_m = np.cumsum(distance_m)
    np.savetxt(
        given.out / "table.csv",
        np.stack(
            [time_s, given.left * (along_m - apart_m), given.right * (along_m + apart_m)], axis=1
        ),
        fmt="%.9f",
        delimiter=",",
        header="t_s,left_m,right_m",
        comments="",
    )
    gps = loadmat(f"{given.recording}_.mat")["GT"]
    rows = np.zeros((len(gps), 8))
    rows[:, :3] = gps[:, :3]
    rows[:, 7] = 1
    np.savetxt(given.out / "reference.tum", rows, fmt="%.9f")
    (given.out / "robot.toml").write_text(LAWNMOWER, encoding="utf-8")
    (given.out / "map.toml").write_text(LAWNMOWER_MAP, encoding="utf-8")
    print(f"{given.out}: {len(time_s)} rows, {len(gps)} GPS positions")


if __name__ == "__main__":
    main()
