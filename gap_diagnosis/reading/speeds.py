"""Wheel speeds added up to counts, and how sure each step of them is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Floats = NDArray[np.float64]

_BENT_ROWS: Final = 2.0
_JUMP: Final = 5.0
"""A wheel that always starts with so many times what it gains in the next row is not told before:
no wheel leaps."""
_LEAST_SPEEDS: Final = 3.0
"""A wheel that is told at so many times the least speed does not creep from there to its stop."""
_SLOPE_S: Final = 0.3
_LONGEST_S: Final = 1.0
_UNSURE: Final = 0.5


@dataclass(frozen=True)
class AddedUp:
    """A wheel's way from its speeds.

    Attributes:
        ticks: float64[n], running count; NaN where there is no speed.
        unsure_ticks2: float64[n], variance of the step that ends at each row.
    """

    ticks: Floats
    unsure_ticks2: Floats


def integrated_speed(speed: Floats, time_s: Floats, *, scale: float) -> AddedUp:
    """Return the running count that wheel speeds, float64[n], add up to (a gap is bridged).

    Trapezoids. What they do not know: where a speed bends within a row (nothing says whether it is
    of the moment), what a step of the signal rounds off for as long as it says the same, and how
    far a wheel crept that is too slow for its sensor.
    """
    valid = np.flatnonzero(np.isfinite(speed))
    ticks, unsure = np.full(len(speed), np.nan), np.zeros(len(speed))
    if len(valid) < 3:
        ticks[valid] = 0.0
        return AddedUp(ticks, unsure)
    told, t_s = speed[valid], time_s[valid]
    crept = _crept(told, t_s)
    every = told + crept
    apart_s = np.diff(t_s, prepend=t_s[0])
    variance = (_bends2(every) + _rounded2(told)) * apart_s**2
    # What crept in one go is off together.
    for first, stop in _runs(crept != 0.0):
        way = float(np.sum((crept * apart_s)[first:stop]))
        variance[first:stop] += (_UNSURE * way) ** 2 / (stop - first)
    steps = 0.5 * (every + np.append(every[0], every[:-1])) * apart_s
    ticks[valid] = np.cumsum(steps) * scale
    unsure[valid] = variance * scale**2
    return AddedUp(ticks, unsure)


def _crept(told: Floats, t_s: Floats) -> Floats:
    """Return the speeds that a sensor with a least speed does not tell, float64[n].

    A wheel slows down to its stop as it slowed down before, and starts likewise.
    """
    moves = told != 0.0
    crept = np.zeros(len(told))
    starts = np.flatnonzero(~moves[:-1] & moves[1:]) + 1
    stops = np.flatnonzero(moves[:-1] & ~moves[1:])
    ends = [(at, 1) for at in starts] + [(at, -1) for at in stops]
    if not ends:
        return crept
    rows = max(1, round(_SLOPE_S / float(np.median(np.diff(t_s)))))
    inside = [(at, way) for at, way in ends if 0 <= at + way * rows < len(told)]
    gains = [abs(told[at + way] - told[at]) for at, way in inside]
    first = float(np.median([abs(told[at]) for at, _ in ends]))
    if not gains or first < _JUMP * float(np.median(gains)):
        return crept
    for at, way in inside:
        if abs(told[at]) > _LEAST_SPEEDS * first:
            continue  # so fast a wheel was told: it says nothing for another reason
        away = way * rows
        slope = (abs(told[at + away]) - abs(told[at])) / abs(t_s[at + away] - t_s[at])
        lasts_s = min(abs(told[at]) / max(slope, 1e-9), _LONGEST_S)
        row = at - way
        while 0 <= row < len(told) and not moves[row] and crept[row] == 0.0:
            left = 1.0 - abs(t_s[row] - t_s[at]) / lasts_s
            if left <= 0.0:
                break
            crept[row] = left * told[at]
            row -= way
    return crept


def _bends2(speed: Floats) -> Floats:
    """Return the variance of a row's mean speed where its speed bends, float64[n].

    It is off the straight line between two readings of a moment by up to a quarter of the bend.
    """
    bend = np.zeros(len(speed))
    bend[1:-1] = speed[1:-1] - 0.5 * (speed[:-2] + speed[2:])
    return np.asarray(gaussian_filter1d(bend**2, _BENT_ROWS) / 16.0)


def _rounded2(told: Floats) -> Floats:
    """Return the variance of a row's speed by the signal's step, float64[n]; none at rest.

    While a signal says the same, it is off by the same: of so many rows each takes its share.
    """
    changes = np.abs(np.diff(told))
    moving = changes[changes > 0.0]
    if len(moving) == 0:
        return np.zeros(len(told))
    step = float(np.quantile(moving, 0.01))
    same = np.cumsum(np.concatenate(([True], changes > 0.0))) - 1
    lengths = np.bincount(same)[same]
    return np.asarray(np.where(told != 0.0, lengths * step**2 / 12.0, 0.0))


def _runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return first and past-the-last index of each run of true: int64[r, 2]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return edges.reshape(-1, 2)
