"""From which size on the bounds of a drive show: they do where a command meets them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.signal import lfilter

from gap_diagnosis.drive.data import DriveData, Floats, drive_data
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

BOUNDS: Final = ("drive_acceleration_limit", "drive_deadband", "drive_saturation")


def limits_of_bounds(recordings: Sequence[Recording], robot: Robot) -> dict[str, float]:
    """Return the largest acceleration limit, the smallest deadband and the largest saturation
    that these drives meet [rad/s², rad/s, rad/s]; nothing where no wheel is told to turn."""
    described = robot.plant.drive
    drives = [data for one in recordings if (data := drive_data(one, robot)) is not None]
    if not drives:
        return {}
    told = np.concatenate([np.abs(data.commanded).ravel() for data in drives])
    steepest = max(_steepest_rad_s2(data, described.time_constant_s) for data in drives)
    return {
        "drive_acceleration_limit": min(steepest, described.max_wheel_acceleration_rad_s2),
        "drive_deadband": float(told[told > 0].min()),
        "drive_saturation": min(float(told.max()), described.max_wheel_rate_rad_s),
    }


def _steepest_rad_s2(data: DriveData, lag_s: float) -> float:
    """Return the largest acceleration of a first-order drive that no limit holds back: what it is
    short of a command, over its lag; or over a tick, if that is longer."""
    follows = -np.expm1(-data.dt_s / lag_s) if lag_s > 0 else 1.0
    rates: Floats = lfilter([0.0, follows], [1.0, follows - 1.0], data.commanded, axis=1)
    return float(np.abs(data.commanded - rates).max() / max(lag_s, data.dt_s))
