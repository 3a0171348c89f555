"""Play behind a motor: what follows it, and where it was between the edges of its encoder."""

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from gap_diagnosis.recording import Floats

_EDGE_COUNTS: Final = 1.2
"""From an edge that is counted one way to where it is counted the other way again: a count, and
the noise of a reading of a fifth of a count."""
_SETTLES_S: Final = 0.08
"""A motor that stops is where it stops so soon after the last edge, or a third of the way to the
next."""


@numba.njit(cache=True, nogil=True)
def followed(step_rad: Floats, width_rad: float, play_rad: float) -> Floats:
    """Return the wheel's steps behind a motor's, *play_rad* before its forward flank at first."""
    wheel = np.zeros_like(step_rad)
    for k in range(len(step_rad)):
        to_flank = play_rad - step_rad[k]
        play_rad = min(max(to_flank, 0.0), width_rad)
        wheel[k] = play_rad - to_flank
    return wheel


def motor_steps(step_rad: Floats, rounding_rad: float, tick_s: float) -> Floats:
    """Return the turns of a motor whose turns are counted, float64[n] each.

    Behind a play a count that trembles at rest would reach both flanks. So the motor is where its
    encoder's edges passed, and in between on a smooth way; where it turns back, it was between two
    edges, there where the counts are in the mean.
    """
    counts = np.cumsum(step_rad) / rounding_rad
    moves = followed(np.diff(counts, prepend=counts[0]), _EDGE_COUNTS, 0.5 * _EDGE_COUNTS)
    at = np.flatnonzero(moves)
    if len(at) < 2:
        return step_rad
    passed = counts[0] + np.cumsum(moves)[at]
    sign = np.sign(moves[at])
    # A fast motor is past its last edge by half a count in the mean, a slow one just there.
    past = np.minimum(1.0, np.abs(moves[at]) / np.diff(at, prepend=at[0] - 1))
    rows, places = _rests(counts, at, passed, sign, _SETTLES_S / tick_s)
    rows = np.concatenate([at, rows])
    places = np.concatenate([passed + 0.5 * _EDGE_COUNTS * sign * past, places])
    order = np.argsort(rows)
    angle = PchipInterpolator(rows[order], places[order])(np.arange(len(counts)))
    return np.diff(angle * rounding_rad, prepend=angle[0] * rounding_rad)


def _rests(
    counts: Floats, at: NDArray[np.int64], passed: Floats, sign: Floats, settles: float
) -> tuple[Floats, Floats]:
    """Return rows and counts at which the motor was before its first edge, after its last one and
    wherever it turned back, float64[2 r] each: soon after the edge before and until before the
    next."""
    last = len(counts) - 1
    turned = np.flatnonzero((sign[1:] != sign[:-1]) & (np.diff(at) > 2))
    first_row = np.concatenate([[0], at[turned], at[-1:]])
    next_row = np.concatenate([at[:1], at[turned + 1], [last]])
    low = np.concatenate([[-np.inf], np.minimum(passed, passed + sign)[turned], [-np.inf]])
    from_edge = np.append(False, np.ones(len(turned) + 1, dtype=np.bool_))
    to_edge = from_edge[::-1]
    is_rest = next_row > first_row
    first_row, next_row, low = first_row[is_rest], next_row[is_rest], low[is_rest]
    sums = np.concatenate([[0.0], np.cumsum(counts)])
    mean = (sums[next_row] - sums[first_row]) / (next_row - first_row)
    mean = np.where(np.isfinite(low), np.clip(mean, low, low + 1.0), mean)
    settled = np.minimum((next_row - first_row) / 3.0, settles)
    begins = first_row + np.where(from_edge[is_rest], settled, 0.0)
    ends = next_row - np.where(to_edge[is_rest], settled, 0.0)
    return np.concatenate([begins, ends]), np.concatenate([mean, mean])
