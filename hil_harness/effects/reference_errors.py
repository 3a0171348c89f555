"""What a measuring system outside the robot makes of the truth: motion capture, RTK, a tracker."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_plant import stream_generator

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ReferenceErrors:
    """How the reference differs from the truth; all neutral by default. Signs as in the catalogue.

    Attributes:
        yaw_rad: its heading reads high by this, against the body's x axis.
        lever_x_m, lever_y_m: the tracked point, in the body frame from the axle's middle.
        time_offset_s: stamp − true time.
        scale: reported over true distance − 1; headings are untouched.
        clock_skew: reference clock rate over log clock rate − 1.
        position_noise_m, heading_noise_rad: standard deviations of one sample.
        correlation_time_s: of that noise (first-order Gauss-Markov); 0 is white.
        dropout_start_s, dropout_stop_s: true time without samples.
        jump_s: true time from which on the pose is off by jump_x_m, jump_y_m and jump_yaw_rad.
    """

    yaw_rad: float = 0.0
    lever_x_m: float = 0.0
    lever_y_m: float = 0.0
    time_offset_s: float = 0.0
    scale: float = 0.0
    clock_skew: float = 0.0
    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    correlation_time_s: float = 0.0
    dropout_start_s: float = math.inf
    dropout_stop_s: float = math.inf
    jump_s: float = math.inf
    jump_x_m: float = 0.0
    jump_y_m: float = 0.0
    jump_yaw_rad: float = 0.0


NO_ERRORS: Final = ((-math.inf, ReferenceErrors()),)
"""A schedule of a reference that reports the truth."""


def measure(
    time_s: Floats, truth: Floats, errors: ReferenceErrors, seed: int
) -> tuple[Floats, Floats]:
    """Return stamps float64[n] and poses float64[n, 3] that the reference reports.

    Args:
        time_s: float64[n], true times, ascending.
        truth: float64[n, 3], x_m, y_m, heading_rad (unwrapped) at these times.
        errors: of the measuring system.
        seed: of its noise.

    At neutral the arrays come back as they are. Samples in a dropout are left out (NaN rows of the
    pose), so that the caller can join windows before dropping them.
    """
    if errors == ReferenceErrors():
        return time_s, truth
    x_m, y_m, heading_rad = truth.T
    if errors.lever_x_m != 0.0 or errors.lever_y_m != 0.0:
        cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
        x_m = x_m + errors.lever_x_m * cosine - errors.lever_y_m * sine
        y_m = y_m + errors.lever_x_m * sine + errors.lever_y_m * cosine
    jumped = time_s >= errors.jump_s
    x_m = x_m * (1.0 + errors.scale) + np.where(jumped, errors.jump_x_m, 0.0)
    y_m = y_m * (1.0 + errors.scale) + np.where(jumped, errors.jump_y_m, 0.0)
    heading_rad = heading_rad + errors.yaw_rad + np.where(jumped, errors.jump_yaw_rad, 0.0)
    poses = np.column_stack([x_m, y_m, heading_rad])
    levels = (errors.position_noise_m, errors.position_noise_m, errors.heading_noise_rad)
    for column, level in enumerate(levels):
        if level > 0.0:
            poses[:, column] += level * correlated_noise(
                time_s, errors.correlation_time_s, seed, column
            )
    poses[(time_s >= errors.dropout_start_s) & (time_s < errors.dropout_stop_s)] = np.nan
    return time_s * (1.0 + errors.clock_skew) + errors.time_offset_s, poses


def correlated_noise(time_s: Floats, correlation_time_s: float, seed: int, stream: int) -> Floats:
    """Return standard noise at times: white, or first-order Gauss-Markov.

    One stream of normals per *stream*, by the lower 128 bits of *seed*, whatever else is on.
    """
    normals = stream_generator(seed, 0x7265666572656E63 + stream).standard_normal(len(time_s))
    if correlation_time_s <= 0.0 or len(time_s) < 2:
        return normals
    kept = np.exp(-np.diff(time_s) / correlation_time_s)
    _follow(normals, kept, np.sqrt(1.0 - kept**2))
    return normals


@njit(cache=True)
def _follow(noise: Floats, kept: Floats, fresh: Floats) -> None:
    """Turn normals into a first-order Gauss-Markov process, in place."""
    for k in range(1, len(noise)):
        noise[k] = kept[k - 1] * noise[k - 1] + fresh[k - 1] * noise[k]


def measure_over_time(
    time_s: Floats,
    truth: Floats,
    schedule: tuple[tuple[float, ReferenceErrors], ...],
    seed: int,
) -> tuple[Floats, Floats]:
    """Return stamps and poses where the errors change with time; `schedule` as (from_s, errors).

    Samples in a dropout are gone. Stamps may step where an error of time ends.
    """
    stamps, poses = measure(time_s, truth, schedule[0][1], seed)
    for start_s, errors in schedule[1:]:
        later_stamps, later_poses = measure(time_s, truth, errors, seed)
        since = time_s >= start_s
        stamps = np.where(since, later_stamps, stamps)
        poses = np.where(since[:, np.newaxis], later_poses, poses)
    there = np.isfinite(poses[:, 0])
    if there.all():
        return stamps, poses
    return stamps[there], poses[there]
