"""Stamps of a table that jitter while its rows were sampled evenly: the counts tell.

A row that was sampled late shows more counts than its neighbours, one that was only stamped late
does not. Of how far stamps lie from the even grid about them, the counts follow a share: 1 where a
row was sampled when it says, 0 where all is jitter of the stamp. For both at once that share of the
distance is the best guess (the regression of the sampling time on the stamp).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, median_filter

from gap_diagnosis.reading.clock import lower_edge
from gap_diagnosis.recording import Floats

Ints = NDArray[np.int64]

_GRID_S: Final = 5.0
"""Over a longer time two clocks, or a loop that sleeps between its rows, keep no even grid."""
_RATE_ROWS: Final = 3.0
_FARTHEST_ROWS: Final = 12
_TOLD: Final = 0.1
"""A share with a larger standard deviation is not told; stamps are then believed,"""
_CLEAR: Final = 3.0
"""and where it is not so many standard deviations below 1."""
_SECOND_DIFFERENCES: Final = math.sqrt(1 + 2 * (4 / 9 + 1 / 36))
"""How much wider a slope is when what lies on it are second differences of independent errors."""


def sampled_at(
    t_s: Floats, tick: Ints, wheels: Sequence[Floats], period_s: float
) -> tuple[Floats, float]:
    """Return when the rows of a table were sampled, float64[n], and by how much their stamps are
    late on average: as if none was early, which nothing tells.

    Args:
        t_s: float64[n], the rows' stamps, ascending.
        tick: int64[n], ascending.
        wheels: running counts, float64[n] each, NaN where a row has none.
        period_s: duration of a tick.
    """
    known = np.flatnonzero(np.isfinite(wheels).all(axis=0))
    if len(known) < 2 * _GRID_S / period_s:
        return t_s, 0.0
    away_s = _away(t_s[known], tick[known], period_s)
    own = [counts[known] for counts in wheels]
    share, sd = _share(away_s, t_s[known], tick[known], own, period_s)
    jitter = 1.0 - max(share, 0.0)
    if not sd < _TOLD or jitter < _CLEAR * sd:
        return t_s, 0.0
    late_s = jitter * (away_s - lower_edge(away_s, float(np.ptp(t_s))))
    return np.asarray(t_s - np.interp(tick, tick[known], late_s)), float(np.mean(late_s))


def _away(t_s: Floats, tick: Ints, period_s: float) -> Floats:
    """Return how far each stamp is from the even grid about it."""
    rows = round(_GRID_S / period_s)
    # The median passes over ticks that were counted wrongly where stamps came in a burst.
    tick_s = float(np.median((t_s[rows:] - t_s[:-rows]) / (tick[rows:] - tick[:-rows])))
    late_s = t_s - t_s[0] - tick_s * tick
    return np.asarray(late_s - median_filter(late_s, rows, mode="nearest"))


def _share(
    away_s: Floats, t_s: Floats, tick: Ints, wheels: Sequence[Floats], period_s: float
) -> tuple[float, float]:
    """Return by which share of *away_s* the counts follow, and its standard deviation."""
    even = (np.diff(tick) == 1) & (np.abs(np.diff(away_s)) < 0.5 * period_s)
    even = even[:-2] & even[1:-1] & even[2:]  # three steps of one tick each
    longer, more = [], []
    # By their times, not by ticks: of rows sampled unevenly one is not a tick.
    apart_s = _around(np.diff(t_s))
    for counts in wheels:
        steps = np.diff(counts)
        rate = (_around(steps) / apart_s)[1:-1]
        more.append(_bend(steps)[even])
        longer.append((rate * _bend(np.diff(away_s)))[even])
    x, y = np.concatenate(longer), np.concatenate(more)
    power = float(x @ x)
    if power <= 0:
        return 1.0, math.inf
    share = float(x @ y) / power
    sd = math.sqrt(float(np.sum((x * (y - share * x)) ** 2))) / power
    return share, _SECOND_DIFFERENCES * sd


def _around(values: Floats) -> Floats:
    """Return the mean of the values about each one, but for those its bend shares ends with."""
    place = np.arange(-_FARTHEST_ROWS, _FARTHEST_ROWS + 1)
    weight = np.where(np.abs(place) > 2, np.exp(-0.5 * (place / _RATE_ROWS) ** 2), 0.0)
    return np.asarray(convolve1d(values, weight / weight.sum(), mode="nearest"))


def _bend(values: Floats) -> Floats:
    """Return how far each value is above the mean of its neighbours."""
    return np.asarray(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
