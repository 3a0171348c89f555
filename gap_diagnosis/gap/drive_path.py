"""Where the simulated drive takes the wheels when it is fed the recorded commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from gap_diagnosis.drive.answer import for_a_while, predict
from gap_diagnosis.drive.data import DriveData, drive_data
from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

_APART_S: Final = 0.4
_MOST_SD: Final = 2.0
_LAID_ANEW: Final = 3


def commanded_path(
    recording: Recording,
    robot: Robot,
    parameters: Mapping[str, float] | None = None,
    added: Floats | None = None,
    late_s: float = 0.0,
) -> Floats | None:
    """Return x_m, y_m, heading_rad that the commands lead to, float64[n, 3].

    *parameters* are deviations of the drive, keyed ``effect.parameter`` as in the catalogue; None
    is the described drive. *added* is what goes on top of the wheels' angles from the row of the
    first command on, float64[2, m]. *late_s* is by how much the wheels' stamps are later than the
    commands'. Rows before the first command are NaN. Returns None where the log has no commands, no
    motion or too few rows.
    """
    data = drive_data(recording, robot)
    if data is None:
        return None
    wheels = robot.plant.wheels
    angles = _angles(data, robot, parameters or {})
    if added is not None:
        angles = angles + added
    left_m, right_m = (np.diff(wheels.radius_m * one, prepend=0.0) for one in angles)
    heading = np.cumsum((right_m - left_m) / wheels.wheelbase_m)
    middle = heading - 0.5 * np.diff(heading, prepend=0.0)
    forward = 0.5 * (left_m + right_m)
    columns = (np.cumsum(forward * np.cos(middle)), np.cumsum(forward * np.sin(middle)), heading)
    t_s = recording.t_s[len(recording.t_s) - len(heading) :]
    path = np.full((len(recording.t_s), 3), np.nan)
    path[len(recording.t_s) - len(heading) :] = np.column_stack(
        [np.interp(t_s - late_s, t_s, column) for column in columns]
    )
    return path


def late_s_of(data: DriveData, robot: Robot, parameters: Mapping[str, float]) -> float:
    """Return by how much the wheels' stamps are later than the commands', as far as rows or stamps
    leave it open, beside a drive with these parameters.

    By least squares of what wheels turn in a few tenths of a second: what they do otherwise than
    the drive adds up over more.
    """
    apart = max(1, round(_APART_S / data.block_s))
    most_s = _MOST_SD * data.delay_sd_s
    late_s = 0.0
    t_s = data.block_s * np.arange(data.angle.shape[1])
    there = data.blocks(_angles(data, robot, parameters))
    both = data.seen[:, apart:] & data.seen[:, :-apart]
    for _ in range(_LAID_ANEW):
        moved = np.stack(
            [
                np.interp(t_s - late_s, t_s[seen], one[seen])
                for one, seen in zip(there, data.seen, strict=True)
            ]
        )
        rate = np.gradient(moved, data.block_s, axis=1)
        left, slope = (one[:, apart:] - one[:, :-apart] for one in (data.angle - moved, rate))
        power = float(np.sum(slope[both] ** 2))
        if power == 0.0:
            return 0.0
        late_s = float(np.clip(late_s - np.sum((left * slope)[both]) / power, -most_s, most_s))
    return late_s


def _angles(data: DriveData, robot: Robot, known: Mapping[str, float]) -> Floats:
    """Return the wheels' angles at the rows, float64[2, n], with effects that begin or end within
    the log as they do."""
    within = _all_along(data, robot, known)
    rows = [_row_at(data, known, name) for name in ("start_s", "stop_s")]
    if rows == [None, None]:
        return within
    first = rows[0] if rows[0] is not None else 0
    last = rows[1] if rows[1] is not None else within.shape[1]
    lag_s = robot.plant.drive.time_constant_s
    lags_s = lag_s, lag_s + known.get("drive_lag.time_constant", 0.0)
    described = _all_along(data, robot, {})
    angles: Floats = for_a_while(described, within, first, last, lags_s, data.dt_s)
    return angles


def _row_at(data: DriveData, known: Mapping[str, float], name: str) -> int | None:
    """Return the row at which effects begin or end, which they all do together; None where that is
    the log's own end."""
    found = [value for key, value in known.items() if key.endswith(f".{name}")]
    return round((found[0] - float(data.time_s[0])) / data.dt_s) if found else None


def _all_along(data: DriveData, robot: Robot, known: Mapping[str, float]) -> Floats:
    drive = robot.plant.drive
    fastest, strongest = data.limits_beside(robot)
    gains = [1.0 + known.get(f"drive_gain.{side}", 0.0) for side in ("left", "right")]
    angles: Floats = predict(
        data.commanded,
        data.rate_0,
        data.dt_s,
        drive.time_constant_s + known.get("drive_lag.time_constant", 0.0),
        drive.delay_s + known.get("drive_delay.delay", 0.0),
        known.get("drive_deadband.rate", 0.0),
        min(fastest, known.get("drive_saturation.limit", math.inf)),
        min(strongest, known.get("drive_acceleration_limit.limit", math.inf)),
        np.array(gains),
        0.0,
    )
    return angles
