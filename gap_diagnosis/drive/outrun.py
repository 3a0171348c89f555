"""Limits of a drive's description that its wheels outrun.

A drive that is slower than its description has effects of that name. One that is faster was
described by somebody who did not know how fast it is, or who said nothing of it and was given the
usual limits: that is no gap of the robot, and what its wheels do beside such a limit is no cause.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from gap_diagnosis.drive.answer import predict
from hil_harness.robot import Robot

if TYPE_CHECKING:
    from gap_diagnosis.drive.data import DriveData

Floats = NDArray[np.float64]

RATE: Final = "max_wheel_rate_rad_s"
ACCELERATION: Final = "max_wheel_acceleration_rad_s2"
_APART_S: Final = 0.2
"""Over which what wheels turn is held against their commands: what they do otherwise adds up."""
_MEMORY_S: Final = 1.0
"""A drive's errors hang together for about so long: each such while says something once."""
_LAGS_S: Final = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5)
_GRID: Final = 33
_CLEARLY: Final = 14.5
"""Log likelihood by which two causes are told apart (half of 29 in separation)."""


def outrun(data: DriveData, robot: Robot) -> dict[str, float]:
    """Return the limits of table [drive] that this log's wheels outrun, by key, as they have them:
    a value that nothing told to these wheels comes near where they have none."""
    drive = robot.plant.drive
    fastest = 2.0 * float(np.abs(data.commanded).max())
    beyond = {RATE: fastest, ACCELERATION: 2.0 * fastest / max(drive.time_constant_s, data.dt_s)}
    raised = {key: value for key, value in beyond.items() if value > getattr(drive, key)}
    if not raised or _left_by(data, robot, raised, 0.0) == _left_by(data, robot, {}, 0.0):
        return {}
    sets = [keys for n in range(1, len(raised) + 1) for keys in combinations(raised, n)]
    found = [_best(data, robot, {key: raised[key] for key in keys}) for keys in sets]
    whiles = float(data.seen.sum()) * data.block_s / _MEMORY_S
    described = min(_left_by(data, robot, {}, lag_s) for lag_s in _LAGS_S)
    gains = [whiles * math.log(described / left) for _, left in found]
    if max(gains) < _CLEARLY:
        return {}
    fewest = next(place for place, gain in enumerate(gains) if gain > max(gains) - _CLEARLY)
    return found[fewest][0]


def _best(
    data: DriveData, robot: Robot, beyond: dict[str, float]
) -> tuple[dict[str, float], float]:
    """Return the limits, from described ones to *beyond*, that leave least, and what they leave.

    A drive may be later than described and outrun a limit all the same.
    """
    found = dict(beyond)
    lag_s = min(_LAGS_S, key=lambda one: _left_by(data, robot, beyond, one))
    for key in [*beyond, *beyond] if len(beyond) > 1 else beyond:
        low, high = math.log(getattr(robot.plant.drive, key)), math.log(beyond[key])

        def left(log_limit: float, key: str = key) -> float:
            return _left_by(data, robot, {**found, key: math.exp(log_limit)}, lag_s)

        # Beyond what nothing comes near all is flat: a search from there would miss the limit.
        grid = np.linspace(low, high, _GRID).tolist()
        at = min(range(_GRID), key=[left(one) for one in grid].__getitem__)
        if at < _GRID - 1:
            about = (grid[max(at - 1, 0)], grid[at + 1])
            found[key] = math.exp(minimize_scalar(left, bounds=about, method="bounded").x)
    return found, _left_by(data, robot, found, lag_s)


def _left_by(data: DriveData, robot: Robot, limits: dict[str, float], lag_s: float) -> float:
    """Return the root mean square of what wheels turn otherwise than the described drive with these
    limits, and so much more of a lag, has them [rad]."""
    drive = robot.plant.drive
    angles: Any = predict(
        data.commanded,
        data.rate_0,
        data.dt_s,
        drive.time_constant_s + lag_s,
        drive.delay_s,
        0.0,
        limits.get(RATE, drive.max_wheel_rate_rad_s),
        limits.get(ACCELERATION, drive.max_wheel_acceleration_rad_s2),
        np.ones(2),
        0.0,
    )
    apart = max(1, round(_APART_S / data.block_s))
    off = data.angle - data.blocks(angles)
    both = data.seen[:, apart:] & data.seen[:, :-apart]
    turned = (off[:, apart:] - off[:, :-apart])[both]
    rounding = data.tick_rad**2 / 6.0
    return math.sqrt(float(np.sum(turned**2)) / max(turned.size, 1) + rounding)
