"""One Kalman filter that turns residuals of any colour into independent ones of unit variance.

The noise of a log, in the terms of docs/explanation: the contact of each wheel is a random walk
over distance, the gyro's angle a random walk over time on a walking bias, each count is off by a
quantum that stays while the wheel stands, the reference is off by white and by slow noise. Because
the filter is linear, one pass whitens the data and every effect's column alike, with the same
gains; what comes out is a plain least-squares problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations.registry import dead_ticks
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.recording import Floats

LEVELS: Final = (
    "contact_m_per_sqrt_m",
    "lateral_m_per_sqrt_m",
    "gyro_noise_rad_per_sqrt_s",
    "gyro_bias_walk_rad_s_per_sqrt_s",
    "reference_position_m",
    "reference_heading_rad",
    "reference_slow_position_m",
    "reference_slow_heading_rad",
    "reference_slow_s",
)
"""Levels of noise, in the order of a vector of levels."""

QUANTUM_S: Final = 0.5
"""Correlation time of a count's quantisation error: at steady speed it beats with the samples."""


@dataclass(frozen=True)
class Course:
    """What the filter must know of the motion, per block: float64[m] each."""

    dt_s: Floats
    step_x_m: Floats
    step_y_m: Floats
    left_path_m: Floats
    right_path_m: Floats
    left_moved: Floats
    right_moved: Floats
    cosine: Floats
    sine: Floats
    quantum_m: float
    wheelbase_m: float
    samples: Floats
    gyro_floor_rad: float


def course_of(nodes: Nodes, noise_ticks: float) -> Course:
    """Return the motion between the blocks' middles; *noise_ticks* is the described jitter."""
    motion = nodes.motion
    x_m, y_m = nodes.mean(motion.x_m), nodes.mean(motion.y_m)
    t_s = nodes.mean(motion.t_s)
    radius = motion.radius_m
    # A wheel that is not counted slips as much as the other one.
    steps = np.abs([motion.left_step_rad, motion.right_step_rad])
    dead = dead_ticks(motion)
    steps[:, dead] = steps[:, dead].max(axis=0)
    paths = [nodes.mean(np.cumsum(step) * radius) for step in steps]
    samples = np.zeros(nodes.count)
    samples[nodes.sample_node] = nodes.samples
    per_count_m = radius * motion.rad_per_count
    heading = nodes.mean(motion.heading_rad)
    left_path, right_path = (np.diff(path, prepend=path[0]) for path in paths)
    return Course(
        dt_s=np.diff(t_s, prepend=t_s[0]),
        step_x_m=np.diff(x_m, prepend=x_m[0]),
        step_y_m=np.diff(y_m, prepend=y_m[0]),
        left_path_m=left_path,
        right_path_m=right_path,
        left_moved=left_path / per_count_m,
        right_moved=right_path / per_count_m,
        cosine=np.cos(heading),
        sine=np.sin(heading),
        quantum_m=per_count_m * float(np.sqrt(1 / 12 + noise_ticks**2)),
        wheelbase_m=motion.wheelbase_m,
        samples=samples,
        gyro_floor_rad=1e-6,
    )


def whiten(
    columns: Floats, course: Course, levels: Floats, ticks: Floats
) -> tuple[Floats, float, int]:
    """Whiten residual columns float64[4, m, c]; return float64[rows, c], log determinant, rows."""
    return _whiten(
        columns,
        course.dt_s,
        course.step_x_m,
        course.step_y_m,
        course.left_path_m,
        course.right_path_m,
        course.left_moved,
        course.right_moved,
        course.cosine,
        course.sine,
        course.quantum_m,
        course.wheelbase_m,
        course.samples,
        course.gyro_floor_rad,
        QUANTUM_S,
        levels,
        ticks,
    )


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "arcp", "nsz"})
def _whiten(
    columns: NDArray[np.float64],
    dt_s: Floats,
    step_x: Floats,
    step_y: Floats,
    left_path: Floats,
    right_path: Floats,
    left_moved: Floats,
    right_moved: Floats,
    cosine: Floats,
    sine: Floats,
    quantum_m: float,
    wheelbase_m: float,
    samples: Floats,
    gyro_floor: float,
    quantum_s: float,
    levels: Floats,
    ticks: Floats,
) -> tuple[Floats, float, int]:
    nodes, width = columns.shape[1], columns.shape[2]
    # States: heading, x, y, gyro angle, gyro bias, quantum left, right, slow x, y, heading.
    n = 10
    slow_s = levels[8]
    contact, lateral, gyro_noise, walk = levels[0], levels[1], levels[2], levels[3]
    position, heading, slow_position, slow_heading = levels[4], levels[5], levels[6], levels[7]
    covariance = np.zeros((n, n))
    state = np.zeros((n, width))
    for i in range(4):
        covariance[i, i] = 25.0
    covariance[4, 4] = 1e-12
    covariance[7, 7] = slow_position**2
    covariance[8, 8] = slow_position**2
    covariance[9, 9] = slow_heading**2
    quantum_variance = quantum_m**2
    out = np.empty((4 * nodes, width))
    rows = 0
    log_determinant = 0.0
    h = np.zeros(n)
    gain = np.zeros(n)
    ph = np.zeros(n)
    for k in range(nodes):
        if k > 0:
            dx, dy, dt = step_x[k], step_y[k], dt_s[k]
            # x -= dy * heading, y += dx * heading, gyro angle += bias * dt
            for j in range(width):
                state[1, j] -= dy * state[0, j]
                state[2, j] += dx * state[0, j]
                state[3, j] += dt * state[4, j]
            for j in range(n):
                covariance[1, j] -= dy * covariance[0, j]
                covariance[2, j] += dx * covariance[0, j]
                covariance[3, j] += dt * covariance[4, j]
            for i in range(n):
                covariance[i, 1] -= dy * covariance[i, 0]
                covariance[i, 2] += dx * covariance[i, 0]
                covariance[i, 3] += dt * covariance[i, 4]
            decay = np.exp(-dt / slow_s)
            for i in range(7, 10):
                for j in range(width):
                    state[i, j] *= decay
                for j in range(n):
                    covariance[i, j] *= decay
                for j in range(n):
                    covariance[j, i] *= decay
            fresh = 1.0 - decay * decay
            covariance[7, 7] += fresh * slow_position**2
            covariance[8, 8] += fresh * slow_position**2
            covariance[9, 9] += fresh * slow_heading**2
            left = contact * contact * left_path[k]
            right = contact * contact * right_path[k]
            c, s = cosine[k], sine[k]
            turn = (left + right) / (wheelbase_m * wheelbase_m)
            along = 0.25 * (left + right)
            cross = 0.5 * (right - left) / wheelbase_m
            side = lateral * lateral * 0.5 * (left_path[k] + right_path[k])
            covariance[0, 0] += turn
            covariance[1, 1] += c * c * along + s * s * side
            covariance[2, 2] += s * s * along + c * c * side
            covariance[1, 2] += c * s * (along - side)
            covariance[2, 1] += c * s * (along - side)
            covariance[0, 1] += c * cross
            covariance[1, 0] += c * cross
            covariance[0, 2] += s * cross
            covariance[2, 0] += s * cross
            covariance[3, 3] += gyro_noise * gyro_noise * dt
            covariance[4, 4] += walk * walk * dt
        for side_index in range(2):
            q = 5 + side_index
            moved = left_moved[k] if side_index == 0 else right_moved[k]
            keep = 0.0 if k == 0 else max(1.0 - moved, np.exp(-dt_s[k] / quantum_s))
            for j in range(width):
                state[q, j] *= keep
            for j in range(n):
                covariance[q, j] *= keep
            for j in range(n):
                covariance[j, q] *= keep
            covariance[q, q] += (1.0 - keep * keep) * quantum_variance
        c, s = cosine[k], sine[k]
        for channel in range(4):
            value = columns[channel, k, 0]
            if np.isnan(value):
                continue
            h[:] = 0.0
            if channel == 0:
                h[1] = 1.0
                h[5] = -0.5 * c
                h[6] = -0.5 * c
                h[7] = 1.0
                noise = position * position / samples[k] + 1e-12
            elif channel == 1:
                h[2] = 1.0
                h[5] = -0.5 * s
                h[6] = -0.5 * s
                h[8] = 1.0
                noise = position * position / samples[k] + 1e-12
            elif channel == 2:
                h[0] = 1.0
                h[5] = 1.0 / wheelbase_m
                h[6] = -1.0 / wheelbase_m
                h[9] = 1.0
                noise = heading * heading / samples[k] + 1e-12
            else:
                h[0] = 1.0
                h[3] = 1.0
                h[5] = 1.0 / wheelbase_m
                h[6] = -1.0 / wheelbase_m
                averaged = min(max(left_moved[k], right_moved[k], 1.0), ticks[k])
                fast = 2.0 * quantum_variance / (wheelbase_m * wheelbase_m) / averaged
                noise = gyro_floor * gyro_floor + fast
            variance = noise
            for i in range(n):
                total = 0.0
                for j in range(n):
                    if h[j] != 0.0:
                        total += covariance[i, j] * h[j]
                ph[i] = total
            for i in range(n):
                if h[i] != 0.0:
                    variance += h[i] * ph[i]
            scale = 1.0 / np.sqrt(variance)
            for i in range(n):
                gain[i] = ph[i] / variance
            log_determinant += np.log(variance)
            for j in range(width):
                innovation = columns[channel, k, j]
                for i in range(n):
                    if h[i] != 0.0:
                        innovation -= h[i] * state[i, j]
                out[rows, j] = innovation * scale
            for i in range(n):
                if gain[i] != 0.0:
                    amount = gain[i] / scale
                    for j in range(width):
                        state[i, j] += amount * out[rows, j]
            for i in range(n):
                for j in range(i, n):
                    value = covariance[i, j] - gain[i] * ph[j]
                    covariance[i, j] = value
                    covariance[j, i] = value
            rows += 1
    return out[:rows], log_determinant, rows
