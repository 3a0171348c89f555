"""The trajectories of a log: what its odometry frames state, and the float twin on its counts.

Each comes with the twist of its steps and with covariances: those of the SE(2) recursion for
independent contact noise of both wheels, whose variance grows with the distance a wheel covers
(Chong and Kleeman, ICRA 1997; `hil_harness.se2`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil_harness.assembly import Wire
from hil_harness.errors import HarnessError
from hil_harness.firmware_program import FirmwareProgram
from hil_harness.nodes import FirmwareNode
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.replaying import logged_steps
from hil_harness.robot import Robot
from hil_harness.se2 import propagate_covariance
from hil_harness.traces import odometry_poses, trace

Floats = NDArray[np.float64]

CONTACT_NOISE_M_PER_SQRT_M = 1e-3
"""Of each wheel, where nobody has measured it: the middle of what hard floors show."""


@dataclass(frozen=True)
class Trajectory:
    """A robot's way.

    Attributes:
        name: ``odometry``, ``float`` or ``truth``.
        time_s: float64[n], ascending, on the clock of the log.
        poses: float64[n, 3], x_m, y_m, heading_rad, unwrapped; the frame ``odom``.
        twist: float64[n, 2], forward speed in m/s and turn rate in rad/s over the step before, in
            the robot's own frame.
        pose_covariance: float64[n, 3, 3] of x, y, heading; zeros for the truth.
        twist_covariance: float64[n, 2, 2].
    """

    name: str
    time_s: Floats
    poses: Floats
    twist: Floats
    pose_covariance: Floats
    twist_covariance: Floats


def logged_trajectories(
    log: Path,
    robot: Robot,
    wire: Wire,
    contact_noise_m_per_sqrt_m: float = CONTACT_NOISE_M_PER_SQRT_M,
) -> tuple[Trajectory, Trajectory]:
    """Return what a log's odometry frames state, and the described firmware's float twin.

    The twin runs on what the log's firmware received, with the same checks. Raises CanBusError for
    a log that cannot be read, HarnessError for one without odometry.
    """
    wire.signal_map.require(ODOMETRY_ROLES, "an export")
    node = FirmwareNode(
        robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=wire.tick_period_us,
    )
    stamps_us, answers = [], []
    for step in logged_steps(log, wire):
        node.step(step.now_us, step.received)
        stamps_us.append(step.now_us)
        answers.append((step.now_us, step.sent))
    stated = odometry_poses(answers, len(answers), wire.database, wire.signal_map)
    is_known = np.asarray(np.isfinite(stated.poses).all(axis=1))
    if not is_known.any():
        names = ", ".join(stated.receptions)
        raise HarnessError(f"{log}: no odometry frames: expected {names} in the log")
    program = FirmwareProgram(robot, wire.signal_map, wire.tick_period_us)
    twin = trace(program, node.inputs).float_twin
    time_s = np.array(stamps_us) / 1e6
    wheelbase_m = robot.plant.wheels.wheelbase_m
    return (
        _trajectory(
            "odometry", time_s, stated.poses, is_known, wheelbase_m, contact_noise_m_per_sqrt_m
        ),
        _trajectory("float", time_s, twin, is_known, wheelbase_m, contact_noise_m_per_sqrt_m),
    )


def with_truth(time_s: Floats, poses: Floats, wheelbase_m: float) -> Trajectory:
    """Return a measured or simulated truth as a trajectory, without covariance."""
    everything = np.ones(len(time_s), dtype=np.bool_)
    return replace(_trajectory("truth", time_s, poses, everything, wheelbase_m, 0.0), name="truth")


def _trajectory(
    name: str,
    time_s: Floats,
    poses: Floats,
    rows: NDArray[np.bool_],
    wheelbase_m: float,
    noise_m_per_sqrt_m: float,
) -> Trajectory:
    rows = rows.copy()
    rows[1:] &= np.diff(time_s) > 0  # ticks of one stamp are one pose
    time_s, poses = time_s[rows], poses[rows]
    step_s = np.diff(time_s)
    turn_rad = np.diff(poses[:, 2])
    along_rad = poses[:-1, 2] + turn_rad / 2
    moved_m = np.diff(poses[:, :2], axis=0)
    distance_m = moved_m[:, 0] * np.cos(along_rad) + moved_m[:, 1] * np.sin(along_rad)
    twist = np.zeros((len(time_s), 2))
    twist[1:] = np.column_stack([distance_m, turn_rad]) / step_s[:, np.newaxis]
    left_m = distance_m - turn_rad * wheelbase_m / 2
    right_m = distance_m + turn_rad * wheelbase_m / 2
    variance = noise_m_per_sqrt_m**2
    start_rad = float(poses[0, 2])
    covariance = _turned(propagate_covariance(left_m, right_m, wheelbase_m, variance), start_rad)
    body = np.array([[0.5, 0.5], [-1 / wheelbase_m, 1 / wheelbase_m]])
    wheels = variance * np.abs(np.column_stack([left_m, right_m]))
    twist_covariance = np.zeros((len(time_s), 2, 2))
    twist_covariance[1:] = (body * wheels[:, np.newaxis, :]) @ body.T
    twist_covariance[1:] /= (step_s**2)[:, np.newaxis, np.newaxis]
    return Trajectory(name, time_s, poses, twist, covariance, twist_covariance)


def _turned(covariance: Floats, start_rad: float) -> Floats:
    """Turn covariances from the frame of the first pose, where they are propagated, to odom."""
    sine, cosine = np.sin(start_rad), np.cos(start_rad)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return np.asarray(turn @ covariance @ turn.T)
