"""A program that nobody listed, modelled by what its leftover goes with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gap_diagnosis.firmware.comparison import COMPONENTS, Windows, relative_motion
from gap_diagnosis.firmware.leftover import row_by_row
from gap_diagnosis.recording import Floats


def stand_in(
    windows: Windows, replayed: Floats, t_s: Floats, variable: str, kept: NDArray[np.bool_]
) -> Floats | None:
    """Return the path of a program whose steps are those of *replayed*, float64[n, 3] by row, and
    some function of a variable more; None where fewer windows tell than that has sizes, where the
    replay does not vary by it, or where nothing is off by more than makes a difference.

    Least squares on the windows whose rows are all *kept*, bool[n]. The variable is that of the
    replay: of what was not kept nothing of the record is used. What is off by no more than makes a
    difference, forward, left or turning, is left alone: a turn that is right, bent by a little,
    would stand in for a way that is not.
    """
    rows, first, last = windows.rows, windows.first, windows.last
    path = replayed[rows]
    functions = row_by_row(path, t_s[rows])[variable][1:]
    functions = functions[:, np.any(functions != 0.0, axis=0)]
    told = np.logical_and.reduceat(kept[rows], first) & kept[rows[last]]
    told &= np.isfinite(windows.motion).all(axis=1)
    sizes_each = functions.shape[1]
    if not np.isfinite(path).all() or not 0 < sizes_each < np.count_nonzero(told):
        return None
    # Of size one, a function moves or turns by 1 m or 1 rad in all.
    functions = functions / np.abs(functions).sum(axis=0)
    steps = relative_motion(path, np.arange(len(path) - 1), np.arange(1, len(path)))

    def left_by(moved: Floats) -> Floats:
        return ((windows.motion - relative_motion(moved, first, last)) / windows.floor)[told]

    is_off = np.sqrt(np.mean(left_by(path) ** 2, axis=0)) > 1.0
    if not is_off.any():
        return None

    def bent(sizes: Floats) -> Floats:
        more = np.zeros((sizes_each, COMPONENTS))
        more[:, is_off] = sizes.reshape(sizes_each, -1)
        return _laid(path[0], steps + functions @ more)

    start = np.zeros(sizes_each * np.count_nonzero(is_off))
    found = least_squares(lambda sizes: left_by(bent(sizes)).ravel(), start)
    after = np.full_like(replayed, np.nan)
    after[rows] = bent(found.x)
    return after


def _laid(start: Floats, steps: Floats) -> Floats:
    """Return the path, float64[r, 3], of steps forward, left and turn, float64[r - 1, 3]."""
    heading_rad = start[2] + np.append(0.0, np.cumsum(steps[:, 2]))
    cosine, sine = np.cos(heading_rad[:-1]), np.sin(heading_rad[:-1])
    x_m = np.cumsum(cosine * steps[:, 0] - sine * steps[:, 1])
    y_m = np.cumsum(sine * steps[:, 0] + cosine * steps[:, 1])
    along = np.column_stack([x_m, y_m])
    return np.column_stack([start[:2] + np.vstack([np.zeros(2), along]), heading_rad])
