"""Where the simulated drive takes the wheels when it is fed the recorded commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gap_diagnosis.drive.data import drive_data
from gap_diagnosis.drive.kernels import predict
from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot


def commanded_path(
    recording: Recording,
    robot: Robot,
    parameters: Mapping[str, float] | None = None,
    added: Floats | None = None,
) -> Floats | None:
    """Return x_m, y_m, heading_rad that the commands lead to, float64[n, 3].

    *parameters* are deviations of the drive, keyed ``effect.parameter`` as in the catalogue; None
    is the described drive. *added* is what goes on top of the wheels' angles from the row of the
    first command on, float64[2, m]. Rows before the first command are NaN. Returns None where the
    log has no commands, no motion or too few rows.
    """
    data = drive_data(recording, robot)
    if data is None:
        return None
    known, drive, wheels = parameters or {}, robot.plant.drive, robot.plant.wheels
    angles = []
    for wheel, side in enumerate(("left", "right")):
        both: Any = predict(
            data.commanded,
            data.rate_0,
            data.dt_s,
            drive.time_constant_s + known.get("drive_lag.time_constant", 0.0),
            drive.delay_s + known.get("drive_delay.delay", 0.0),
            known.get("drive_deadband.rate", 0.0),
            min(drive.max_wheel_rate_rad_s, known.get("drive_saturation.limit", math.inf)),
            min(
                drive.max_wheel_acceleration_rad_s2,
                known.get("drive_acceleration_limit.limit", math.inf),
            ),
            1.0 + known.get(f"drive_gain.{side}", 0.0),
            0.0,
        )
        angles.append(both[wheel] if added is None else both[wheel] + added[wheel])
    left_m, right_m = (np.diff(wheels.radius_m * one, prepend=0.0) for one in angles)
    heading = np.cumsum((right_m - left_m) / wheels.wheelbase_m)
    middle = heading - 0.5 * np.diff(heading, prepend=0.0)
    forward = 0.5 * (left_m + right_m)
    path = np.full((len(recording.t_s), 3), np.nan)
    path[len(recording.t_s) - len(heading) :] = np.column_stack(
        [np.cumsum(forward * np.cos(middle)), np.cumsum(forward * np.sin(middle)), heading]
    )
    return path
