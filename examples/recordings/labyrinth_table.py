"""Turns the Labyrinth recording of libRSF (lines of text) into a table and a reference.

    python labyrinth_table.py datasets/Indoor_UWB/Indoor_UWB OUT

`Indoor_UWB_Input.txt` has the speeds of the right and of the left wheel, in this order by its
readme, in its lines `odom2diff`, `Indoor_UWB_GT.txt` positions, which become a reference without
heading. `--exchanged` reads the two speeds the other way round.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from chemnitz_table import part, write_table
from robots import LABYRINTH


def main() -> None:
    """Convert the recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="path and name, without _Input.txt")
    parser.add_argument("out", type=Path)
    parser.add_argument("--exchanged", action="store_true", help="left before right")
    given = parser.parse_args()
    recording: Path = given.recording
    path = recording.with_name(recording.name + "_Input.txt")
    time_s, *wheels = part(path, "odom2diff", 3, 0.0, np.inf).T
    right_m_s, left_m_s = wheels[::-1] if given.exchanged else wheels
    places = part(recording.with_name(recording.name + "_GT.txt"), "point2", 3, 0.0, np.inf)
    write_table(given.out, np.stack([time_s, left_m_s, right_m_s], axis=1), places, LABYRINTH)


if __name__ == "__main__":
    main()
