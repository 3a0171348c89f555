"""The odometry that a description, or an explanation, makes of what was recorded.

Heading comes from where the described firmware takes it: the wheels, the gyro, or both.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.gap.metrics import Path
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats
from hil_harness.robot import Robot

_REST_TICKS: Final = 10


def gyro_share(robot: Robot, motion: Motion) -> float:
    """Return how much of the heading the described firmware takes from the gyro, 0 to 1."""
    firmware = robot.firmware
    if motion.gyro_turn_rad is None or firmware.mode == "wheel":
        return 0.0
    return 1.0 if firmware.mode == "gyro" else float(firmware.blend_weight)


def gyro_turn_rad(prediction: Prediction) -> Floats:
    """Return the turn since the start by the gyro, float64[n], freed of the effects at work.

    What the effects add to the true rate is taken off what was recorded. Without a gyro: zeros.
    """
    motion = prediction.motion
    if motion.gyro_turn_rad is None:
        return np.zeros(len(motion.t_s))
    added = prediction.gyro_added_rad_s * motion.dt_s
    return np.asarray(motion.gyro_turn_rad - np.cumsum(added))


def heading_rad(prediction: Prediction, robot: Robot) -> Floats:
    """Return the odometry's heading since the start, float64[n]."""
    share = gyro_share(robot, prediction.motion)
    wheels = np.cumsum(prediction.turn_rad)
    if share == 0.0:
        return wheels
    gyro = without_offset(prediction.motion, gyro_turn_rad(prediction), robot)
    return share * gyro + (1 - share) * wheels


def without_offset(motion: Motion, turn_rad: Floats, robot: Robot) -> Floats:
    """Take the zero-rate offset off a gyro's turn as the firmware does: learnt at rest, then kept.

    A standstill counts when it is long enough for the described first estimate; its mean rate holds
    from its beginning to the next one.
    """
    offset = np.zeros(len(motion.t_s))
    for first, inner in _standstills(motion, robot):
        rate = (turn_rad[inner][-1] - turn_rad[inner][0]) / _lasted_s(motion, inner)
        if abs(rate) < robot.firmware.standstill.max_rate_rad_s:
            offset[first:] = rate
    return np.asarray(turn_rad - np.cumsum(offset * motion.dt_s))


def offset_time_s(motion: Motion, robot: Robot) -> Floats:
    """Return over what time the offset in use at each tick was averaged, float64[n]; ∞: none is."""
    time_s = np.full(len(motion.t_s), np.inf)
    for first, inner in _standstills(motion, robot):
        time_s[first:] = _lasted_s(motion, inner)
    return time_s


def odometry_path(prediction: Prediction, robot: Robot) -> Path:
    """Return the odometry at the ticks."""
    x_m, y_m, heading = prediction.path(heading_rad(prediction, robot))
    return Path(prediction.motion.t_s, x_m, y_m, heading)


def as_reported(prediction: Prediction, path: Path) -> Path:
    """Return what the reference should report of *path*, stamped as it should stamp it."""
    if path.heading_rad is None:
        raise ValueError("an odometry path has headings")
    grown = 1 + prediction.reference_scale
    cos, sin = np.cos(path.heading_rad), np.sin(path.heading_rad)
    forward, left = prediction.reference_forward_m, prediction.reference_left_m
    return Path(
        path.t_s + prediction.reference_delay_s - prediction.encoder_delay_s,
        grown * (path.x_m + cos * forward - sin * left),
        grown * (path.y_m + sin * forward + cos * left),
        path.heading_rad + prediction.reference_heading_rad,
    )


def as_travelled(prediction: Prediction, path: Path) -> Path:
    """Return the true path behind a reported one: the inverse of `as_reported`."""
    if path.heading_rad is None:
        raise ValueError("the motion's path has headings")
    heading = path.heading_rad - prediction.reference_heading_rad
    cos, sin = np.cos(heading), np.sin(heading)
    forward, left = prediction.reference_forward_m, prediction.reference_left_m
    grown = 1 + prediction.reference_scale
    return Path(
        np.asarray(path.t_s - prediction.reference_delay_s),
        path.x_m / grown - (cos * forward - sin * left),
        path.y_m / grown - (sin * forward + cos * left),
        heading,
    )


def _standstills(motion: Motion, robot: Robot) -> list[tuple[int, slice]]:
    """Return each standstill's first row and the rows that its offset is averaged over."""
    told = robot.firmware.standstill
    least = 1 << told.block_log2
    found = []
    for first, stop in _rests(motion, told.tolerance_ticks):
        inner = slice(first + told.ticks + told.settle_ticks, stop - told.settle_ticks)
        if inner.stop - inner.start >= least:
            found.append((first, inner))
    return found


def _lasted_s(motion: Motion, rows: slice) -> float:
    return float(motion.t_s[rows][-1] - motion.t_s[rows][0])


def _rests(motion: Motion, tolerance_ticks: int) -> list[tuple[int, int]]:
    """Return the runs of rows, first to stop − 1, in which the wheels rest."""
    still = np.ones(len(motion.t_s), np.bool_)
    for angle in (motion.left_angle_rad, motion.right_angle_rad):
        counts = angle / motion.rad_per_count
        moved = np.zeros(len(counts))
        moved[_REST_TICKS:-_REST_TICKS] = counts[2 * _REST_TICKS :] - counts[: -2 * _REST_TICKS]
        still &= np.abs(moved) <= tolerance_ticks + 0.5
    return _runs(still)


def _runs(inside: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]
