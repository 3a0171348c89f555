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
    given.out.mkdir(parents=True, exist_ok=True)
    recording: Path = given.recording

    def named(end: str) -> Path:
        return recording.with_name(recording.name + end)

    time_s, along_m_s, _, turn_rad_s = part(named("_Input.txt"), "odom2", given, 4).T
    apart_m_s = turn_rad_s * WHEELBASE_M / 2
    wheels = [given.left * (along_m_s - apart_m_s), given.right * (along_m_s + apart_m_s)]
    np.savetxt(
        given.out / "table.csv",
        np.stack([time_s, *wheels], axis=1),
        fmt="%.9f",
        delimiter=",",
        header="t_s,left_m_s,right_m_s",
        comments="",
    )
    laser = part(named("_GT.txt"), "point2", given, 3)
    rows = np.zeros((len(laser), 8))
    rows[:, :3] = laser
    rows[:, 7] = 1
    np.savetxt(given.out / "reference.tum", rows, fmt="%.9f")
    (given.out / "robot.toml").write_text(CHEMNITZ, encoding="utf-8")
    (given.out / "map.toml").write_text(SPEEDS_MAP, encoding="utf-8")
    print(f"{given.out}: {len(time_s)} rows, {len(laser)} positions")


def part(path: Path, kind: str, given: argparse.Namespace, columns: int) -> NDArray[np.float64]:
    """Return the first columns of a kind of line, float64[n, columns], its time since the part
    began."""
    with path.open(encoding="utf-8") as lines:
        words = [line.split() for line in lines]
    rows = np.array([[float(one) for one in w[1 : columns + 1]] for w in words if w[0] == kind])
    rows = rows[(rows[:, 0] >= given.begin) & (rows[:, 0] < given.end)]
    rows[:, 0] -= given.begin
    return rows


if __name__ == "__main__":
    main()
