"""One Kalman filter that turns residuals of any colour into independent ones of unit variance.

The noise of a log, in the terms of docs/explanation: the contact of each wheel is a random walk
over distance, the gyro's angle a random walk over time on a walking bias, each count is off by a
quantum that stays while the wheel stands and is averaged over what it counts while it turns, the
reference is off by white and by slow noise, and effects of tyres lead each wheel astray by a share
more or less. Because the filter is linear, one pass whitens the data and every effect's column
alike, with the same gains; what comes out is a plain least-squares problem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from gap_diagnosis.explanations.choices import dead_ticks
from gap_diagnosis.explanations.reference import USUAL_S, counting_slope
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats
from gap_diagnosis.standing import STANDS_S

LEVELS: Final = (
    "contact_m_per_sqrt_m",
    "lateral_m_per_sqrt_m",
    "gyro_noise_rad_per_sqrt_s",
    "gyro_bias_walk_rad_s_per_sqrt_s",
    "inexact",
    "reference_position_m",
    "reference_heading_rad",
    "reference_slow_position_m",
    "reference_slow_heading_rad",
    "reference_slow_s",
)
"""Levels of noise, in the order of a vector of levels."""
CONTACT: Final = LEVELS.index("contact_m_per_sqrt_m")
INEXACT: Final = LEVELS.index("inexact")

_LEAST_TURN_RAD: Final = 1e-6
QUANTUM_S: Final = 0.5
"""Correlation time of what lasts of a count's quantisation error in motion: at steady speed it
beats with the samples."""
_LATER: Final = 4.0
_SURELY: Final = 1.0
"""A rate by counts of less of its standard deviations may be that of a wheel at rest."""
_FINER: Final = 0.5
_AROUND: Final = 5
"""Blocks, a quarter of a second."""
_HARMONIC: Final = math.sqrt(2.0) * math.pi
INEXACT_S: Final = 2.0
"""Correlation time of the share by which an effect of the contact is larger than on average: a turn
of a robot lasts for so long."""


@dataclass(frozen=True)
class Course:
    """What the filter must know of the motion, per block: float64[m] each.

    *quantum_m* is the standard deviation of one reading of a wheel's way, *beat_m* that of its part
    which beats with the samples: of a rounding error after noise of sigma counts, the first
    harmonic has the variance exp(-(2 pi sigma)^2) / (2 pi^2) (Widrow and Kollar 2008, chapter 4).
    """

    dt_s: Floats
    step_x_m: Floats
    step_y_m: Floats
    left_path_m: Floats
    right_path_m: Floats
    left_moved: Floats
    right_moved: Floats
    left_kept: Floats
    right_kept: Floats
    left_scatter_m2: Floats
    right_scatter_m2: Floats
    left_astray_m: Floats
    right_astray_m: Floats
    cosine: Floats
    sine: Floats
    quantum_m: float
    beat_m: float
    wheelbase_m: float
    samples: Floats
    gyro_floor_rad: Floats
    gyro_unsure_rad2: Floats

    def beside(self, left_m: Floats, right_m: Floats) -> Course:
        """Return the course of wheels that effects lead astray by so much in each block."""
        return replace(self, left_astray_m=left_m, right_astray_m=right_m)

    def scattered(self, nodes: Nodes, left: Floats, right: Floats) -> Course:
        """Return the course whose counts vary by chance too, by counts² per tick, float64[n]."""
        metres2 = (nodes.motion.radius_m * nodes.motion.rad_per_count) ** 2
        left_m2, right_m2 = (nodes.mean(np.cumsum(wheel)) * metres2 for wheel in (left, right))
        return replace(
            self,
            left_scatter_m2=self.left_scatter_m2 + np.diff(left_m2, prepend=left_m2[0]),
            right_scatter_m2=self.right_scatter_m2 + np.diff(right_m2, prepend=right_m2[0]),
        )

    def jumping(self, nodes: Nodes, turn_rad2: Floats) -> Course:
        """Return the course whose gyro varies by chance too, by rad² per tick, float64[n]."""
        summed = nodes.mean(np.cumsum(turn_rad2))
        more = np.diff(summed, prepend=0.0)
        return replace(self, gyro_unsure_rad2=self.gyro_unsure_rad2 + more)


def course_of(nodes: Nodes, noise_ticks: float) -> Course:
    """Return the motion between the blocks' middles; *noise_ticks* is the described jitter."""
    motion = nodes.motion
    x_m, y_m = nodes.mean(motion.x_m), nodes.mean(motion.y_m)
    t_s = nodes.mean(motion.t_s)
    block_s = np.diff(t_s, prepend=t_s[0])
    radius = motion.radius_m
    # A wheel that is not counted slips as much as the other one.
    signed = np.array([motion.left_step_rad, motion.right_step_rad])
    steps = np.abs(signed)
    dead = dead_ticks(motion)
    steps[:, dead] = steps[:, dead].max(axis=0)
    paths = [nodes.mean(np.cumsum(step) * radius) for step in steps]
    samples = np.zeros(nodes.count)
    samples[nodes.sample_node] = nodes.samples
    per_count_m = radius * motion.rounding_rad
    heading = nodes.mean(motion.heading_rad)
    left_path, right_path = (np.diff(path, prepend=path[0]) for path in paths)
    moved = [path / per_count_m for path in (left_path, right_path)]
    slow = [nodes.mean(_creep(motion, step)) * block_s for step in signed]
    if noise_ticks > 0:
        creeps = [nodes.mean(_creep_beside_jitter(motion, step)) * block_s for step in signed]
        # What settles goes on for a while, ever more slowly.
        creeps = [np.maximum(one, 0.5 * np.append(0.0, one[:-1])) for one in creeps]
        slow = [np.maximum(one, creep) for one, creep in zip(slow, creeps, strict=True)]
    if _is_finer(nodes, per_count_m):
        slow = [np.maximum(one, seen) for one, seen in zip(slow, _seen(nodes), strict=True)]
    unsure = [nodes.mean(np.cumsum(one)) * radius**2 for one in motion.wheel_unsure_rad2]
    scatter = [np.diff(one, prepend=one[0]) for one in unsure]
    return Course(
        dt_s=block_s,
        step_x_m=np.diff(x_m, prepend=x_m[0]),
        step_y_m=np.diff(y_m, prepend=y_m[0]),
        left_path_m=left_path,
        right_path_m=right_path,
        left_moved=moved[0],
        right_moved=moved[1],
        left_kept=_kept(moved[0], slow[0]),
        right_kept=_kept(moved[1], slow[1]),
        left_scatter_m2=scatter[0],
        right_scatter_m2=scatter[1],
        left_astray_m=np.zeros(nodes.count),
        right_astray_m=np.zeros(nodes.count),
        cosine=np.cos(heading),
        sine=np.sin(heading),
        quantum_m=per_count_m * math.sqrt(1 / 12 + noise_ticks**2),
        beat_m=per_count_m * math.exp(-0.5 * (math.tau * noise_ticks) ** 2) / _HARMONIC,
        wheelbase_m=motion.wheelbase_m,
        samples=samples,
        gyro_floor_rad=_gyro_floor(nodes),
        gyro_unsure_rad2=np.diff(nodes.mean(np.cumsum(motion.gyro_unsure_rad2)), prepend=0.0),
    )


def _is_finer(nodes: Nodes, per_count_m: float) -> bool:
    """Tell whether the reference sees a wheel move between two counts."""
    if not nodes.has_heading or len(nodes.sample_t_s) < 3:
        return False
    x_m, y_m, heading_rad = nodes.reference_noise
    return max(x_m, y_m, 0.5 * nodes.motion.wheelbase_m * heading_rad) < _FINER * per_count_m


def _seen(nodes: Nodes) -> list[Floats]:
    """Return how many counts each wheel goes in a block by the estimated motion, float64[m]."""
    motion = nodes.motion
    x_m, y_m, heading = (nodes.mean(one) for one in (motion.x_m, motion.y_m, motion.heading_rad))
    along_m = np.cos(heading) * np.diff(x_m, prepend=x_m[0])
    along_m += np.sin(heading) * np.diff(y_m, prepend=y_m[0])
    around_m = 0.5 * motion.wheelbase_m * np.diff(heading, prepend=heading[0])
    per_count_m = motion.radius_m * motion.rounding_rad
    return [
        np.abs(uniform_filter1d(along_m + side * around_m, _AROUND)) / per_count_m
        for side in (-1.0, 1.0)
    ]


def _kept(moved: Floats, slow: Floats) -> Floats:
    """Return which share of a count's error stays from block to block, float64[m].

    *moved* is how many counts came, *slow* how many the wheel went between them. A sawtooth's
    correlation after a share m of its period is 1 - 6 m (1 - m).
    """
    share = np.minimum(slow, 0.5)
    return np.asarray(np.clip(np.minimum(1.0 - moved, 1.0 - 6.0 * share * (1 - share)), 0.0, 1.0))


def _creep(motion: Motion, step_rad: Floats) -> Floats:
    """Return how fast a wheel goes between two counts [counts/s], float64[n].

    Its count stands meanwhile, but the wheel does not, unless the next count is one back: a wheel
    that stands on an edge of its encoder counts to and fro, and one that rested for a moment comes
    by its next count much later than by those around. Where it came to a stop, or turned round, it
    went on for some part of a count, and did so before the first.
    """
    count = np.rint(np.cumsum(step_rad) / motion.rounding_rad)
    change = np.diff(count, prepend=count[0])
    at = np.flatnonzero(change)
    rate = np.zeros(len(count))
    if len(at) < 2:
        return rate
    apart_s = np.diff(motion.t_s[at])
    around_s = np.maximum(np.append(apart_s[1:], 0.0), np.append(0.0, apart_s[:-1]))
    goes = (np.sign(change[at[1:]]) == np.sign(change[at[:-1]])) & (
        apart_s < np.minimum(STANDS_S, _LATER * around_s)
    )
    between = np.where(goes, np.abs(change[at[1:]]) / apart_s, 0.0)
    rate[at[0] + 1 : at[-1] + 1] = np.repeat(between, np.diff(at))
    tick_s = motion.tick_s
    for one in np.flatnonzero(~goes):
        first, last = at[one] + 1, at[one + 1] + 1
        for known, part in ((one - 1, slice(first, last)), (one + 1, slice(last, first, -1))):
            if 0 <= known < len(goes) and goes[known]:
                ticks = math.ceil(1 / (between[known] * tick_s))
                rate[part][:ticks] = 0.5 * between[known]
    return rate


def _creep_beside_jitter(motion: Motion, step_rad: Floats) -> Floats:
    """Return how fast a wheel goes by its counts over a while [counts/s], float64[n].

    Where readings jitter, a wheel that comes to a stop counts to and fro before, and tells as
    little by its next count whether it still goes as one that stands on an edge.
    """
    width = max(USUAL_S / motion.tick_s, 0.5)
    rate = np.abs(gaussian_filter1d(step_rad / motion.rounding_rad, width)) / motion.tick_s
    noise = math.sqrt(counting_slope(width)) / motion.tick_s
    return np.asarray(np.where(rate > _SURELY * noise, rate, 0.0))


def _gyro_floor(nodes: Nodes) -> Floats:
    """Return white noise of the gyro's turn beside the wheels', float64[m].

    What stands in one row of a table was not measured at one instant, but within a row's time.
    """
    floor = np.full(nodes.count, _LEAST_TURN_RAD)
    if nodes.motion.has_counters:
        return floor
    row_s = nodes.motion.tick_s / np.sqrt(12.0)
    return np.asarray(floor + row_s * np.abs(nodes.mean(nodes.smooth.turn_rate_rad_s)))


def whiten(columns: Floats, course: Course, levels: Floats, ticks: Floats) -> tuple[Floats, Floats]:
    """Whiten residual columns float64[4, m, c]; return float64[rows, c] and the logarithm of each
    row's variance before, float64[rows] (their sum is that of the covariance's determinant)."""
    result: tuple[Floats, Floats] = _whiten(
        columns,
        course.dt_s,
        course.step_x_m,
        course.step_y_m,
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
        course.samples,
        course.gyro_floor_rad,
        course.gyro_unsure_rad2,
        QUANTUM_S,
        INEXACT_S,
        levels,
        ticks,
    )
    return result


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
    left_kept: Floats,
    right_kept: Floats,
    left_scatter: Floats,
    right_scatter: Floats,
    left_astray: Floats,
    right_astray: Floats,
    cosine: Floats,
    sine: Floats,
    quantum_m: float,
    beat_m: float,
    wheelbase_m: float,
    samples: Floats,
    gyro_floor: Floats,
    gyro_unsure: Floats,
    quantum_s: float,
    inexact_s: float,
    levels: Floats,
    ticks: Floats,
) -> tuple[Floats, Floats]:
    nodes, width = columns.shape[1], columns.shape[2]
    # States: heading, x, y, gyro angle, gyro bias, quantum left, right, slow x, y, heading, share
    # of effects left, right. The covariance is one flat row of 12 × 12 numbers:
    # with sizes known, its loops are vectorised.
    contact, lateral, gyro_noise, walk = levels[0], levels[1], levels[2], levels[3]
    inexact, position, heading = levels[4], levels[5], levels[6]
    slow_position, slow_heading, slow_s = levels[7], levels[8], levels[9]
    covariance = np.zeros(144)
    state = np.zeros((12, width))
    for i in range(4):
        covariance[13 * i] = 25.0
    covariance[52] = 1e-12
    covariance[91] = slow_position**2
    covariance[104] = slow_position**2
    covariance[117] = slow_heading**2
    covariance[130] = inexact**2
    covariance[143] = inexact**2
    quantum_variance = quantum_m**2
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
            if left_astray[k] != 0.0 or right_astray[k] != 0.0:
                for q in range(10, 12):
                    turned = -left_astray[k] if q == 10 else right_astray[k]
                    went = 0.5 * (left_astray[k] if q == 10 else right_astray[k])
                    astray = (turned / wheelbase_m, c * went, s * went)
                    for i in range(3):
                        for j in range(width):
                            state[i, j] += astray[i] * state[q, j]
                        for j in range(12):
                            covariance[12 * i + j] += astray[i] * covariance[12 * q + j]
                        for j in range(12):
                            covariance[12 * j + i] += astray[i] * covariance[12 * j + q]
            decay = np.exp(-dt / inexact_s)
            for q in range(10, 12):
                for j in range(width):
                    state[q, j] *= decay
                _scale_state(covariance, q, decay)
                covariance[13 * q] += (1.0 - decay * decay) * inexact**2
            decay = np.exp(-dt / slow_s)
            for i in range(7, 10):
                for j in range(width):
                    state[i, j] *= decay
                _scale_state(covariance, i, decay)
            fresh = 1.0 - decay * decay
            covariance[91] += fresh * slow_position**2
            covariance[104] += fresh * slow_position**2
            covariance[117] += fresh * slow_heading**2
            left = contact * contact * left_path[k] + left_scatter[k]
            right = contact * contact * right_path[k] + right_scatter[k]
            along = 0.25 * (left + right)
            cross = 0.5 * (right - left) / wheelbase_m
            side = lateral * lateral * 0.5 * (left_path[k] + right_path[k])
            turn = (left + right) / (wheelbase_m * wheelbase_m)
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
            # In motion a block averages its readings' errors. At one speed in so many as a block
            # has ticks, they beat more slowly than blocks follow each other.
            averaged = min(max(moved, 1.0), ticks[k])
            mean_variance = quantum_variance / averaged
            in_step = stays * min(beat_m * beat_m / mean_variance, 1.0) / ticks[k]
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
                left_share, right_share = 1.0 / wheelbase_m, -1.0 / wheelbase_m
                noise = heading * heading / samples[k] + few / (wheelbase_m * wheelbase_m) + 1e-12
            else:
                first, second = 0, 3
                left_share, right_share = 1.0 / wheelbase_m, -1.0 / wheelbase_m
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
