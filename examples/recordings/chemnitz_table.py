"""Turns a part of a TUC SLAM recording (lines of text) into a table and a reference.

    python chemnitz_table.py Corridor OUT --begin 0 --end 240
    python chemnitz_table.py Lecture_Hall OUT --begin 240 --end 480 --left 1.0204

The second one has an error made up: its left wheel counts 2.04 % too much.

`Corridor_Input.txt` has speeds and turn rates in its lines `odom2`; the speeds of two wheels that
would have made them go into the table. `Corridor_GT.txt` has a laser's positions, which become a
reference without heading.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from robots import CHEMNITZ, SPEEDS_MAP

WHEELBASE_M = 0.4


def main() -> None:
    """Convert one part of a recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="path and name, without _Input.txt")
    parser.add_argument("out", type=Path)
    parser.add_argument("--begin", type=float, default=0.0, help="of the part [s]")
    parser.add_argument("--end", type=float, default=np.inf, help="of the part [s]")
    for side in ("left", "right"):
        text = f"so many times the {side} wheel's speed is told"
        parser.add_argument(f"--{side}", type=float, default=1.0, help=text)
    given = parser.parse_args()
    recording: Path = given.recording
    rows, laser = (
        part(recording.with_name(recording.name + end), kind, columns, given.begin, given.end)
        for end, kind, columns in (("_Input.txt", "odom2", 4), ("_GT.txt", "point2", 3))
    )
    time_s, along_m_s, _, turn_rad_s = rows.T
    apart_m_s = turn_rad_s * WHEELBASE_M / 2
    wheels = [given.left * (along_m_s - apart_m_s), given.right * (along_m_s + apart_m_s)]
    write_table(given.out, np.stack([time_s, *wheels], axis=1), laser, CHEMNITZ)


def part(path: Path, kind: str, columns: int, begin_s: float, end_s: float) -> NDArray[np.float64]:
    """Return the first columns of a kind of line, float64[n, columns], its time since the part
    began."""
    with path.open(encoding="utf-8") as lines:
        words = [line.split() for line in lines]
    rows = np.array([[float(one) for one in w[1 : columns + 1]] for w in words if w[:1] == [kind]])
    rows = rows[(rows[:, 0] >= begin_s) & (rows[:, 0] < end_s)]
    rows[:, 0] -= begin_s
    return rows


def write_table(
    out: Path, speeds: NDArray[np.float64], places: NDArray[np.float64], robot: str
) -> None:
    """Write a table of time and two wheels' speeds, float64[n, 3], and a reference of time and
    place, float64[m, 3], with what is known of the robot."""
    out.mkdir(parents=True, exist_ok=True)
    header = "t_s,left_m_s,right_m_s"
    np.savetxt(out / "table.csv", speeds, "%.9f", delimiter=",", header=header, comments="")
    rows = np.zeros((len(places), 8))
    rows[:, :3], rows[:, 7] = places, 1
    np.savetxt(out / "reference.tum", rows, fmt="%.9f")
    (out / "robot.toml").write_text(robot, encoding="utf-8")
    (out / "map.toml").write_text(SPEEDS_MAP, encoding="utf-8")
    print(f"{out}: {len(speeds)} rows, {len(places)} positions")


if __name__ == "__main__":
    main()
