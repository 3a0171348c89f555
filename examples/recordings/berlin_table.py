"""Turns a part of a smartLoc recording of libRSF (lines of text) into a table and a reference.

    python berlin_table.py datasets/smartLoc/Berlin_Potsdamer_Platz OUT --begin 145

`Berlin_Potsdamer_Platz_Input.txt` has a car's speed and turn rate in its lines `odom3`; the speeds
of two wheels that would have made them go into the table. `Berlin_Potsdamer_Platz_GT.txt` has
places on the earth, which become a reference without heading, in metres to the east and the north.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pymap3d
from chemnitz_table import part, write_table
from robots import BERLIN

TRACK_M = 1.5
SPEED, TURN_RATE = 1, 6


def main() -> None:
    """Convert one part of the recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="path and name, without _Input.txt")
    parser.add_argument("out", type=Path)
    parser.add_argument("--begin", type=float, default=0.0, help="of the part [s]")
    parser.add_argument("--end", type=float, default=np.inf, help="of the part [s]")
    given = parser.parse_args()
    recording: Path = given.recording
    rows, places = (
        part(recording.with_name(recording.name + end), kind, columns, given.begin, given.end)
        for end, kind, columns in (("_Input.txt", "odom3", 7), ("_GT.txt", "point3", 4))
    )
    apart_m_s = rows[:, TURN_RATE] * TRACK_M / 2
    wheels = np.stack([rows[:, SPEED] - apart_m_s, rows[:, SPEED] + apart_m_s], axis=1)
    on_earth = pymap3d.ecef2geodetic(*places[:, 1:].T)
    first = tuple(float(one[0]) for one in on_earth)
    east_m, north_m, _ = pymap3d.geodetic2enu(*on_earth, *first)
    write_table(
        given.out,
        np.column_stack([rows[:, 0], wheels]),
        np.stack([places[:, 0], east_m, north_m], axis=1),
        BERLIN,
    )


if __name__ == "__main__":
    main()
