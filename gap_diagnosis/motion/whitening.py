"""One Kalman filter that turns residuals of any colour into independent ones of unit variance.

The noise of a log, in the terms of docs/explanation: the contact of each wheel is a random walk
over distance, the gyro's angle a random walk over time on a walking bias, each count is off by a
quantum that stays while the wheel stands and is averaged over what it counts while it turns, the
reference is off by white and by slow noise, and each wheel slips by a share of its way that
wanders, and by a share more or less than an effect of its tyre has it. Because the filter is
linear, one pass whitens the data and every effect's column alike, with the same gains; what comes
out is a plain least-squares problem.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.recording import Floats

LEVELS: Final = (
    "contact_m_per_sqrt_m",
    "lateral_m_per_sqrt_m",
    "gyro_noise_rad_per_sqrt_s",
    "gyro_bias_walk_rad_s_per_sqrt_s",
    "inexact",
    "slip_wander",
    "reference_position_m",
    "reference_heading_rad",
    "reference_slow_position_m",
    "reference_slow_heading_rad",
    "reference_slow_s",
)
"""Levels of noise, in the order of a vector of levels."""
CONTACT: Final = LEVELS.index("contact_m_per_sqrt_m")
INEXACT: Final = LEVELS.index("inexact")
SLIP_WANDER: Final = LEVELS.index("slip_wander")

QUANTUM_S: Final = 0.5
"""Correlation time of what lasts of a count's quantisation error in motion: at steady speed it
beats with the samples."""
SLIP_S: Final = 2.0
"""Correlation time of the share of its way by which a wheel slips more than on average, with or
without an effect of the contact: a turn of a robot lasts for so long."""


def whiten(columns: Floats, course: Course, levels: Floats, ticks: Floats) -> tuple[Floats, Floats]:
    """Whiten residual columns float64[4, m, c]; return float64[rows, c] and the logarithm of each
    row's variance before, float64[rows] (their sum is that of the determinant of the covariance, of
    counts as described).

    Raises ValueError unless there is one level for each of LEVELS.
    """
    if len(levels) != len(LEVELS):
        raise ValueError(f"{len(levels)} levels of noise: {len(LEVELS)} are meant: {LEVELS}")
    white, log_variance = _whiten(
        columns,
        course.dt_s,
        course.step_x_m,
        course.step_y_m,
        course.left_way_m,
        course.right_way_m,
        course.left_path_m,
        course.right_path_m,
        course.left_moved,
        course.right_moved,
        course.left_kept,
        course.right_kept,
        course.left_scatter_m2,
        course.right_scatter_m2,
        course.left_astray_m,
        course.right_astray_m,
        course.cosine,
        course.sine,
        course.quantum_m,
        course.beat_m,
        course.wheelbase_m,
        course.count_base_m,
        course.samples,
        course.gyro_floor_rad,
        course.gyro_unsure_rad2,
        QUANTUM_S,
        SLIP_S,
        levels,
        ticks,
    )
    return white, log_variance + course.log_more


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "arcp", "nsz"})
def _whiten(
    columns: NDArray[np.float64],
    dt_s: Floats,
    step_x: Floats,
    step_y: Floats,
    left_way: Floats,
    right_way: Floats,
    left_path: Floats,
    right_path: Floats,
    left_moved: Floats,
    right_moved: Floats,
    left_kept: Floats,
    right_kept: Floats,
    left_scatter: Floats,
    right_scatter: Floats,
    left_astray: Floats,
    right_astray: Floats,
    cosine: Floats,
    sine: Floats,
    quantum_m: Floats,
    beat_m: Floats,
    wheelbase_m: float,
    count_base_m: float,
    samples: Floats,
    gyro_floor: Floats,
    gyro_unsure: Floats,
    quantum_s: float,
    slip_s: float,
    levels: Floats,
    ticks: Floats,
) -> tuple[Floats, Floats]:
    nodes, width = columns.shape[1], columns.shape[2]
    # States: heading, x, y, gyro angle, gyro bias, quantum left, right, slow x, y, heading, slip of
    # the wheels left, right in units of what they slip by. The covariance is one flat row of
    # 12 × 12 numbers: with sizes known, its loops are vectorised.
    contact, lateral, gyro_noise, walk = levels[0], levels[1], levels[2], levels[3]
    inexact, wander, position, heading = levels[4], levels[5], levels[6], levels[7]
    slow_position, slow_heading, slow_s = levels[8], levels[9], levels[10]
    covariance = np.zeros(144)
    state = np.zeros((12, width))
    for i in range(4):
        covariance[13 * i] = 25.0
    covariance[52] = 1e-12
    covariance[91] = slow_position**2
    covariance[104] = slow_position**2
    covariance[117] = slow_heading**2
    covariance[130] = 1.0
    covariance[143] = 1.0
    out = np.empty((4 * nodes, width))
    log_variance = np.empty(4 * nodes)
    rows = 0
    gain = np.zeros(12)
    fresh_angle = 0.0
    # What the contact adds to the heading from a block's mean to its end: its covariance with the
    # states, its variance, its estimate.
    late = np.zeros(12)
    late_variance = 0.0
    late_state = np.zeros(width)
    for k in range(nodes):
        # States are those at a block's end, what is compared are means over its ticks: for noise
        # that is fresh at each tick, the covariance of end and lateness and the latter's variance.
        together = (ticks[k] - 1.0) / (2.0 * ticks[k])
        spread = (ticks[k] - 1.0) * (2.0 * ticks[k] - 1.0) / (6.0 * ticks[k] ** 2)
        if k > 0:
            dx, dy, dt = step_x[k], step_y[k], dt_s[k]
            # x -= dy * heading, y += dx * heading, gyro angle += bias * dt
            for j in range(width):
                state[1, j] -= dy * state[0, j]
                state[2, j] += dx * state[0, j]
                state[3, j] += dt * state[4, j]
            for j in range(12):
                covariance[12 + j] -= dy * covariance[j]
                covariance[24 + j] += dx * covariance[j]
                covariance[36 + j] += dt * covariance[48 + j]
            for i in range(12):
                covariance[12 * i + 1] -= dy * covariance[12 * i]
                covariance[12 * i + 2] += dx * covariance[12 * i]
                covariance[12 * i + 3] += dt * covariance[12 * i + 4]
            c, s = cosine[k], sine[k]
            for q in range(10, 12):
                # Both last for as long: an effect that varies and slip of its own are one motion.
                effect = inexact * (left_astray[k] if q == 10 else right_astray[k])
                own = wander * (left_way[k] if q == 10 else right_way[k])
                slips = np.sqrt(effect * effect + own * own)
                if slips == 0.0:
                    continue
                if effect < 0.0:
                    slips = -slips
                turned = -slips if q == 10 else slips
                astray = (turned / wheelbase_m, 0.5 * c * slips, 0.5 * s * slips)
                for i in range(3):
                    for j in range(width):
                        state[i, j] += astray[i] * state[q, j]
                    for j in range(12):
                        covariance[12 * i + j] += astray[i] * covariance[12 * q + j]
                    for j in range(12):
                        covariance[12 * j + i] += astray[i] * covariance[12 * j + q]
            decay = np.exp(-dt / slip_s)
            for q in range(10, 12):
                for j in range(width):
                    state[q, j] *= decay
                _scale_state(covariance, q, decay)
                covariance[13 * q] += 1.0 - decay * decay
            decay = np.exp(-dt / slow_s)
            for i in range(7, 10):
                for j in range(width):
                    state[i, j] *= decay
                _scale_state(covariance, i, decay)
            fresh = 1.0 - decay * decay
            covariance[91] += fresh * slow_position**2
            covariance[104] += fresh * slow_position**2
            covariance[117] += fresh * slow_heading**2
            left, right = contact * contact * left_path[k], contact * contact * right_path[k]
            along = 0.25 * (left + right + left_scatter[k] + right_scatter[k])
            cross = 0.5 * (right - left) / wheelbase_m
            cross += 0.5 * (right_scatter[k] - left_scatter[k]) / count_base_m
            side = lateral * lateral * 0.5 * (left_path[k] + right_path[k])
            turn = (left + right) / (wheelbase_m * wheelbase_m)
            turn += (left_scatter[k] + right_scatter[k]) / (count_base_m * count_base_m)
            covariance[0] += turn
            covariance[13] += c * c * along + s * s * side
            covariance[26] += s * s * along + c * c * side
            covariance[14] += c * s * (along - side)
            covariance[25] += c * s * (along - side)
            covariance[1] += c * cross
            covariance[12] += c * cross
            covariance[2] += s * cross
            covariance[24] += s * cross
            fresh_angle = gyro_noise * gyro_noise * dt + gyro_unsure[k]
            covariance[39] += fresh_angle
            covariance[52] += walk * walk * dt
            late[:] = 0.0
            late[0] = together * turn
            late[1] = together * c * cross
            late[2] = together * s * cross
            late_variance = spread * turn
            late_state[:] = 0.0
        stays = 0.0 if k == 0 else np.exp(-dt_s[k] / quantum_s)
        few = 0.0
        for q in range(5, 7):
            moved = left_moved[k] if q == 5 else right_moved[k]
            quantum_variance, beat_variance = quantum_m[q - 5] ** 2, beat_m[q - 5] ** 2
            # In motion a block averages its readings' errors. At one speed in so many as a block
            # has ticks, they beat more slowly than blocks follow each other.
            averaged = min(max(moved, 1.0), ticks[k])
            mean_variance = quantum_variance / averaged
            in_step = stays * min(beat_variance / mean_variance, 1.0) / ticks[k]
            kept = left_kept[k] if q == 5 else right_kept[k]
            keep = 0.0 if k == 0 else max(kept, in_step)
            for j in range(width):
                state[q, j] *= keep
            _scale_state(covariance, q, keep)
            covariance[13 * q] += (1.0 - keep * keep) * mean_variance
            # The reference meets fewer readings than the block has: those are averaged less.
            met = min(max(samples[k], 1.0), averaged)
            few += quantum_variance / met - mean_variance
        c, s = cosine[k], sine[k]
        for channel in range(4):
            if np.isnan(columns[channel, k, 0]):
                continue
            # Every channel is the sum of two states and a share of each wheel's quantum.
            if channel == 0:
                first, second, left_share, right_share = 1, 7, -0.5 * c, -0.5 * c
                noise = position * position / samples[k] + 0.25 * c * c * few + 1e-12
            elif channel == 1:
                first, second, left_share, right_share = 2, 8, -0.5 * s, -0.5 * s
                noise = position * position / samples[k] + 0.25 * s * s * few + 1e-12
            elif channel == 2:
                first, second = 0, 9
                left_share, right_share = 1.0 / count_base_m, -1.0 / count_base_m
                noise = heading * heading / samples[k] + few / (count_base_m * count_base_m) + 1e-12
            else:
                first, second = 0, 3
                left_share, right_share = 1.0 / count_base_m, -1.0 / count_base_m
                noise = gyro_floor[k] * gyro_floor[k]
            one, two = 12 * first, 12 * second
            for i in range(12):
                gain[i] = (
                    covariance[one + i]
                    + covariance[two + i]
                    + left_share * covariance[60 + i]
                    + right_share * covariance[72 + i]
                )
            late_gain = late[first] + late[second]
            late_gain += left_share * late[5] + right_share * late[6]
            variance = noise + gain[first] + gain[second]
            variance += left_share * gain[5] + right_share * gain[6]
            if channel >= 2:
                variance += late_variance - 2.0 * late_gain
                late_gain -= late_variance
                for i in range(12):
                    gain[i] -= late[i]
            if channel == 3:
                variance += fresh_angle * (spread - 2.0 * together)
                gain[3] -= fresh_angle * together
            log_variance[rows] = np.log(variance)
            scale = 1.0 / np.sqrt(variance)
            late_gain *= scale
            for i in range(12):
                gain[i] *= scale
            for j in range(width):
                expected = state[first, j] + state[second, j]
                expected += left_share * state[5, j] + right_share * state[6, j]
                if channel >= 2:
                    expected -= late_state[j]
                out[rows, j] = (columns[channel, k, j] - expected) * scale
            for j in range(width):
                late_state[j] += late_gain * out[rows, j]
            late_variance -= late_gain * late_gain
            for i in range(12):
                amount = gain[i]
                late[i] -= amount * late_gain
                for j in range(width):
                    state[i, j] += amount * out[rows, j]
                for j in range(12):
                    covariance[12 * i + j] -= amount * gain[j]
            rows += 1
    return out[:rows], log_variance[:rows]


@numba.njit(cache=True, nogil=True, inline="always")
def _scale_state(covariance: Floats, place: int, factor: float) -> None:
    """Scale one state: its row and its column of the flat covariance."""
    for j in range(12):
        covariance[12 * place + j] *= factor
    for j in range(12):
        covariance[12 * j + place] *= factor
