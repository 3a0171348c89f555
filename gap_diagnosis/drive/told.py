"""How far wheels go against how far they are told to go."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.data import DriveData
from gap_diagnosis.drive.shapes import Shapes
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_HALF_S: Final = 0.5
GIVES_WAY: Final = 0.006
"""Of its rate a wheel is off under load."""
_MENDED: Final = 0.5
_MATTERS: Final = 0.05
"""Where a mistake has been put right, wheels go no more than half as far wrong as they go, forwards
and in turns: in what of the two is not next to nothing beside the other."""


def off(data: DriveData, robot: Robot) -> float:
    """Return by which share of their rates the wheels do otherwise than they are told."""
    told, gone, seen = _ways(data, robot)
    wrong, told = (gone - told)[seen], told[seen]
    beyond = max(float(np.mean(wrong**2)) - _rounded(data), 0.0)
    return math.sqrt(beyond / max(float(np.mean(told**2)), 1e-12))


def is_as_described(data: DriveData, robot: Robot) -> bool:
    """Tell whether wheels go no more wrong than they do where gain, lag and delay are at the ends
    of their tolerances.

    How they answer within that, as a loop with an integral does, is a manner and no news. A gain is
    one number for each wheel; beside it a loop gives way by a little under load.
    """
    told, gone, seen = _ways(data, robot)
    gone = gone - _gain_within_tolerance(told, gone, seen) * told
    rate = data.commanded[:, data.start[:-1]]
    apart = rate.shape[1] - told.shape[1]
    changed = rate[:, apart:] - rate[:, :-apart]
    late_s = math.hypot(prior.LAG_S.tolerance, data.delay_sd_s)
    may_be = (GIVES_WAY * told) ** 2 + (late_s * changed) ** 2
    return bool(np.mean((gone - told)[seen] ** 2) < np.mean(may_be[seen]) + _rounded(data))


def _gain_within_tolerance(told: Floats, gone: Floats, seen: NDArray[np.bool_]) -> Floats:
    """Return each wheel's gain less one, float64[2, 1], as far as it is no news."""
    told, gone = np.where(seen, told, 0.0), np.where(seen, gone, 0.0)
    power = np.maximum(np.sum(told**2, axis=1), 1e-12)
    gain = np.sum(told * (gone - told), axis=1) / power
    no_news = np.clip(gain, -prior.GAIN.tolerance, prior.GAIN.tolerance)
    return np.asarray(no_news[:, np.newaxis], dtype=np.float64)


def _rounded(data: DriveData) -> float:
    """Return the variance that the rounding of counts adds at both ends of a way [rad²]: a wheel of
    twenty counts is off by 3 % of what it goes in half a second."""
    return 2.0 * data.tick_rad**2 / 12.0


def mends(data: DriveData, robot: Robot) -> bool:
    """Tell whether wheels do about as they are told, forwards and in turns, in data in which a
    mistake of the set-up has been put right."""
    told, gone, seen = _ways(data, robot)
    both = np.all(seen, axis=0)
    if not both.any():
        return True
    sides = np.array([[0.5, 0.5], [-0.5, 0.5]])
    wrong, told, gone = (
        np.sqrt(np.mean((sides @ one[:, both]) ** 2, axis=1)) for one in (gone - told, told, gone)
    )
    moved = np.maximum(told, gone)
    matters = moved > _MATTERS * moved.max()
    return bool(np.all(wrong[matters] < _MENDED * moved[matters]))


def _ways(data: DriveData, robot: Robot) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return [2, k] each: how far wheels are told to go in half a second, how far they go, and
    where that is seen."""
    described = Shapes(data, robot).angle({})
    apart = max(1, round(_HALF_S / data.block_s))
    told, gone = (one[:, apart:] - one[:, :-apart] for one in (described, data.angle))
    return told, gone, data.seen[:, apart:] & data.seen[:, :-apart]
