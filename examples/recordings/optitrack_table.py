"""Turns a run of a robot under OptiTrack, as its authors synchronised it, into a table.

    python optitrack_table.py 030120210006_run-02.csv OUT

A row without a header: time, the pose that OptiTrack saw at it, and the counts of the right and the
left wheel since the row before (in this order: the robot's own log beside it has them the other way
round). The counts are added up; the poses become a reference.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from robots import OPTITRACK


def main() -> None:
    """Convert one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="a file *_run-NN.csv")
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    time_s, x_m, y_m, heading_rad, right, left = np.loadtxt(given.run, delimiter=",").T
    np.savetxt(
        given.out / "table.csv",
        np.stack([time_s, np.cumsum(left), np.cumsum(right)], axis=1),
        fmt=["%.4f", "%d", "%d"],
        delimiter=",",
        header="t_s,left_ticks,right_ticks",
        comments="",
    )
    rows = np.zeros((len(time_s), 8))
    rows[:, 0], rows[:, 1], rows[:, 2] = time_s, x_m, y_m
    rows[:, 6], rows[:, 7] = np.sin(heading_rad / 2), np.cos(heading_rad / 2)
    np.savetxt(given.out / "reference.tum", rows, fmt="%.9f")
    (given.out / "robot.toml").write_text(OPTITRACK, encoding="utf-8")
    print(f"{given.out}: {len(time_s)} rows")


if __name__ == "__main__":
    main()
