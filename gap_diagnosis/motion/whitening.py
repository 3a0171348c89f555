"""One Kalman filter that turns residuals of any colour into independent ones of unit variance.

The noise of a log, in the terms of docs/explanation: the contact of each wheel is a random walk
over distance, the gyro's angle a random walk over time on a walking bias, each count is off by a
quantum that stays while the wheel stands and is averaged over what it counts while it turns, the
reference is off by white and by slow noise and each of its stamps by some time, in which the robot
goes on, what stands in a row of a table was read at some other time than it says, and each wheel
slips by a share of its way that wanders, and by a share more or less than an effect of its tyre has
it. Because the filter is linear, one pass whitens the data and every effect's column alike, with
the same gains; what comes out is a plain least-squares problem.
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
    "speed_noise",
    "speed_noise_s",
    "wheels_late_s",
    "gyro_late_s",
    "late_lasts_s",
    "reference_position_m",
    "reference_heading_rad",
    "reference_stamp_s",
    "reference_slow_position_m",
    "reference_slow_heading_rad",
    "reference_slow_s",
)
"""Levels of noise, in the order of a vector of levels."""
CONTACT: Final = LEVELS.index("contact_m_per_sqrt_m")
LATERAL: Final = LEVELS.index("lateral_m_per_sqrt_m")
INEXACT: Final = LEVELS.index("inexact")
SLIP_WANDER: Final = LEVELS.index("slip_wander")
SPEED_NOISE: Final = LEVELS.index("speed_noise")
SPEED_NOISE_S: Final = LEVELS.index("speed_noise_s")
WHEELS_LATE: Final = LEVELS.index("wheels_late_s")
LATE_LASTS: Final = LEVELS.index("late_lasts_s")
STAMP: Final = LEVELS.index("reference_stamp_s")
SLOW: Final = LEVELS.index("reference_slow_s")
OF_ROWS: Final = ("wheels_late_s", "gyro_late_s", "late_lasts_s")
"""Levels of how a log's rows were read."""
IS_OF_ROBOT: Final = np.array(
    [name not in OF_ROWS and not name.startswith("reference") for name in LEVELS]
)

QUANTUM_S: Final = 0.5
"""Correlation time of what lasts of a count's quantisation error in motion: at steady speed it
beats with the samples."""
SLIP_S: Final = 2.0
"""Correlation time of the share of its way by which a wheel slips more than on average, with or
without an effect of the contact: a turn of a robot lasts for so long."""

UNKNOWN: Final = 1e-2
"""What a channel says is not known beforehand where its variance is beyond this [m² or rad²] and
far beyond its noise."""


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
        course.turn_rad,
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
        course.left_told_m2,
        course.right_told_m2,
        course.lost_m2,
        course.left_astray_m,
        course.right_astray_m,
        course.cosine,
        course.sine,
        course.quantum_m,
        course.beat_m,
        course.wheelbase_m,
        course.count_base_m,
        course.samples,
        course.sampled_x_m,
        course.sampled_y_m,
        course.gyro_floor_rad,
        course.gyro_unsure_rad2,
        course.are_rows_late,
        course.are_speeds_late,
        course.goes_x_m_s,
        course.goes_y_m_s,
        course.turns_rad_s,
        course.faster_m_s,
        course.turns_faster_rad_s,
        QUANTUM_S,
        SLIP_S,
        levels,
        ticks,
    )
    return white, log_variance + course.log_more


@numba.njit(
    cache=True,
    nogil=True,
    error_model="numpy",  # else each division asks for nought, and branches
    fastmath={"contract", "reassoc", "arcp", "nsz"},
)
def _whiten(
    columns: NDArray[np.float64],
    dt_s: Floats,
    step_x: Floats,
    step_y: Floats,
    turns: Floats,
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
    left_told: Floats,
    right_told: Floats,
    lost: Floats,
    left_astray: Floats,
    right_astray: Floats,
    cosine: Floats,
    sine: Floats,
    quantum_m: Floats,
    beat_m: Floats,
    wheelbase_m: float,
    count_base_m: float,
    samples: Floats,
    sampled_x: Floats,
    sampled_y: Floats,
    gyro_floor: Floats,
    gyro_unsure: Floats,
    are_rows_late: bool,
    are_speeds_late: bool,
    goes_x: Floats,
    goes_y: Floats,
    turns_by: Floats,
    faster: Floats,
    turns_faster: Floats,
    quantum_s: float,
    slip_s: float,
    levels: Floats,
    ticks: Floats,
) -> tuple[Floats, Floats]:
    nodes, width = columns.shape[1], columns.shape[2]
    # States: heading, x, y, gyro angle, gyro bias, quantum left, right, slow x, y, heading, slip of
    # the wheels left, right in units of what they slip by, by how much the reference's stamp is
    # early, where wheels say speeds how far these are off in units of their noise, and where a host
    # stamped the rows by how much wheels and gyro were read late in units of that. A row of *known*
    # holds a state's covariance with all of them, then its estimate from each column: both are
    # carried on and corrected by the same sums, four numbers at a time.
    contact, lateral, gyro_noise, walk = levels[0], levels[1], levels[2], levels[3]
    inexact, wander, louder, lasts_s = levels[4], levels[5], levels[6], levels[7]
    wheels_late, gyro_late, late_s = levels[8], levels[9], levels[10]
    position, heading, stamp = levels[11], levels[12], levels[13]
    slow_position, slow_heading, slow_s = levels[14], levels[15], levels[16]
    has_told = left_told.any() or right_told.any()
    states = 15 if has_told else 13
    wheels_at = gyro_at = 0
    if are_rows_late:
        wheels_at, gyro_at = states, states + 1
        states += 2
    wide = (states + width + 3) // 4 * 4
    known = np.zeros((states, wide))
    for i in range(4):
        known[i, i] = 25.0
    known[4, 4] = 1e-12
    known[7, 7] = known[8, 8] = slow_position**2
    known[9, 9] = slow_heading**2
    for i in range(10, states):
        if i != 12:
            known[i, i] = 1.0
    # What each state keeps over a block, and the variance that it gains.
    keeps, fresh = np.ones(wide), np.zeros(states)
    keep = keeps[:states]
    keep[12] = 0.0
    fresh_angle = 0.0
    # What the contact adds to the heading from a block's mean to its end, as a row of *known*, and
    # its variance.
    late = np.zeros(wide)
    late_variance = 0.0
    # What is expected of each channel that is seen, as such a row; then its whitened residual. All
    # channels of a block correct the states together: so each state is fetched and kept once.
    seen = np.empty((4, wide))
    out = np.empty((4 * nodes, width))
    variances = np.empty(4 * nodes)
    rows = 0
    for k in range(nodes):
        # States are those at a block's end, what is compared are means over its ticks: for noise
        # that is fresh at each tick, the covariance of end and lateness and the latter's variance.
        together = (ticks[k] - 1.0) / (2.0 * ticks[k])
        spread = (ticks[k] - 1.0) * (2.0 * ticks[k] - 1.0) / (6.0 * ticks[k] ** 2)
        c, s = cosine[k], sine[k]
        stays = 0.0 if k == 0 else np.exp(-dt_s[k] / quantum_s)
        rate_x, rate_y, turn_rate = 0.0, 0.0, 0.0
        fresh[12] = stamp * stamp / max(samples[k], 1.0)
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
            keep[q] = 0.0 if k == 0 else max(kept, in_step)
            fresh[q] = (1.0 - keep[q] * keep[q]) * mean_variance
            # The reference meets fewer readings than the block has: those are averaged less.
            met = min(max(samples[k], 1.0), averaged)
            few += quantum_variance / met - mean_variance
        if k > 0:
            dx, dy, dt = step_x[k], step_y[k], dt_s[k]
            rate_x, rate_y, turn_rate = dx / dt, dy / dt, turns[k] / dt
            if are_rows_late:
                rate_x, rate_y, turn_rate = goes_x[k], goes_y[k], turns_by[k]
            # Both last for as long: an effect that varies and slip of its own are one motion, which
            # goes the effect's way where that is the larger. Next to nothing of an effect changes
            # nothing.
            left_effect, left_own = inexact * left_astray[k], wander * left_way[k]
            right_effect, right_own = inexact * right_astray[k], wander * right_way[k]
            left_slip = np.sqrt(left_effect * left_effect + left_own * left_own)
            right_slip = np.sqrt(right_effect * right_effect + right_own * right_own)
            if left_effect < -left_own:
                left_slip = -left_slip
            if right_effect < -right_own:
                right_slip = -right_slip
            left_turn, right_turn = -left_slip / wheelbase_m, right_slip / wheelbase_m
            left_x, right_x = 0.5 * c * left_slip, 0.5 * c * right_slip
            left_y, right_y = 0.5 * s * left_slip, 0.5 * s * right_slip
            keep[10] = keep[11] = np.exp(-dt / slip_s)
            keep[7] = keep[8] = keep[9] = np.exp(-dt / slow_s)
            if are_rows_late:
                # Whoever reads a rate late errs by what it changed since, and keeps that.
                remains = np.exp(-dt / late_s)
                for i in range(wheels_at, states):
                    for j in range(wide):
                        known[i, j] *= remains
                    for j in range(states):
                        known[j, i] *= remains
                    known[i, i] += 1.0 - remains * remains
                misses = gyro_late * turns_faster[k]
                for j in range(wide):
                    known[3, j] -= misses * known[gyro_at, j]
                for j in range(states):
                    known[j, 3] -= misses * known[j, gyro_at]
                if are_speeds_late:
                    turns_more = wheels_late * turns_faster[k]
                    more_x, more_y = wheels_late * c * faster[k], wheels_late * s * faster[k]
                    for j in range(wide):
                        wheels = known[wheels_at, j]
                        known[0, j] += turns_more * wheels
                        known[1, j] += more_x * wheels
                        known[2, j] += more_y * wheels
                    for j in range(states):
                        wheels = known[j, wheels_at]
                        known[j, 0] += turns_more * wheels
                        known[j, 1] += more_x * wheels
                        known[j, 2] += more_y * wheels
            for j in range(wide):
                turned, bias, left, right = known[0, j], known[4, j], known[10, j], known[11, j]
                known[0, j] += left_turn * left + right_turn * right
                known[1, j] += left_x * left + right_x * right - dy * turned
                known[2, j] += left_y * left + right_y * right + dx * turned
                known[3, j] += dt * bias
            # Of a tick's way half leads along what its own turn adds.
            half_x, half_y = -0.5 * dy / ticks[k], 0.5 * dx / ticks[k]
            left_white, right_white = left_scatter[k], right_scatter[k]
            if has_told:
                # What is over within a block is white.
                keep[13] = keep[14] = remains = np.exp(-dt / lasts_s)
                lasting = 1.0 - (1.0 - remains) ** 4
                left_white += (1.0 - lasting) * louder * louder * left_told[k]
                right_white += (1.0 - lasting) * louder * louder * right_told[k]
                lasting *= (1.0 - remains) / (1.0 + remains)
                left_off = louder * np.sqrt(lasting * left_told[k])
                right_off = louder * np.sqrt(lasting * right_told[k])
                left_yaw, right_yaw = -left_off / count_base_m, right_off / count_base_m
                left_off_x = 0.5 * c * left_off + half_x * left_yaw
                left_off_y = 0.5 * s * left_off + half_y * left_yaw
                right_off_x = 0.5 * c * right_off + half_x * right_yaw
                right_off_y = 0.5 * s * right_off + half_y * right_yaw
                for j in range(wide):
                    left, right = known[13, j], known[14, j]
                    known[0, j] += left_yaw * left + right_yaw * right
                    known[1, j] += left_off_x * left + right_off_x * right
                    known[2, j] += left_off_y * left + right_off_y * right
            for i in range(4):
                turned, bias, left, right = known[i, 0], known[i, 4], known[i, 10], known[i, 11]
                known[i, 0] += left_turn * left + right_turn * right
                known[i, 1] += left_x * left + right_x * right - dy * turned
                known[i, 2] += left_y * left + right_y * right + dx * turned
                known[i, 3] += dt * bias
                if has_told:
                    left, right = known[i, 13], known[i, 14]
                    known[i, 0] += left_yaw * left + right_yaw * right
                    known[i, 1] += left_off_x * left + right_off_x * right
                    known[i, 2] += left_off_y * left + right_off_y * right
            # The other states stay as they were: of theirs with these four the rows above say all.
            for i in range(4, states):
                for j in range(4):
                    known[i, j] = known[j, i]
            for i in range(5):
                for j in range(5, states):
                    known[i, j] *= keep[j]
            for i in range(5, states):
                for j in range(wide):
                    known[i, j] *= keep[i] * keeps[j]
            fresh[7] = fresh[8] = (1.0 - keep[7] * keep[7]) * slow_position**2
            fresh[9] = (1.0 - keep[9] * keep[9]) * slow_heading**2
            for i in range(10, states):
                fresh[i] = 1.0 - keep[i] * keep[i] if i != 12 else fresh[12]
            left, right = contact * contact * left_path[k], contact * contact * right_path[k]
            along = 0.25 * (left + right + left_white + right_white)
            cross = 0.5 * (right - left) / wheelbase_m
            cross += 0.5 * (right_white - left_white) / count_base_m
            side = lateral * lateral * 0.5 * (left_path[k] + right_path[k])
            turn = (left + right) / (wheelbase_m * wheelbase_m)
            turn += (left_white + right_white) / (count_base_m * count_base_m)
            turn_x, turn_y = c * cross + half_x * turn, s * cross + half_y * turn
            fresh[0] = turn
            fresh[1] = c * c * along + s * s * side + lost[k] + half_x * (turn_x + c * cross)
            fresh[2] = s * s * along + c * c * side + lost[k] + half_y * (turn_y + s * cross)
            fresh_angle = gyro_noise * gyro_noise * dt + gyro_unsure[k]
            fresh[3] = fresh_angle
            fresh[4] = walk * walk * dt
            aslant = c * s * (along - side) + half_x * turn_y + half_y * c * cross
            known[1, 2] += aslant
            known[2, 1] += aslant
            known[0, 1] += turn_x
            known[1, 0] += turn_x
            known[0, 2] += turn_y
            known[2, 0] += turn_y
            late[:] = 0.0
            late[0] = together * turn
            late[1] = together * turn_x
            late[2] = together * turn_y
            late_variance = spread * turn
        for i in range(states):
            known[i, i] += fresh[i]
        count = 0
        for channel in range(4):
            if np.isnan(columns[channel, k, 0]):
                continue
            # Every channel is the sum of two states, a share of each wheel's quantum, what the
            # robot goes on by in the time that a stamp is off, and what a heading leads astray
            # from a block's middle to where its samples lie.
            # As a place, not as a view of that row: each view would count its references.
            place = count
            goes_on = astray = 0.0
            if channel == 0:
                goes_on, astray = rate_x, -sampled_y[k]
                first, second, left_share, right_share = 1, 7, -0.5 * c, -0.5 * c
                noise = position * position / samples[k] + 0.25 * c * c * few + 1e-12
            elif channel == 1:
                goes_on, astray = rate_y, sampled_x[k]
                first, second, left_share, right_share = 2, 8, -0.5 * s, -0.5 * s
                noise = position * position / samples[k] + 0.25 * s * s * few + 1e-12
            elif channel == 2:
                goes_on = turn_rate
                first, second = 0, 9
                left_share, right_share = 1.0 / count_base_m, -1.0 / count_base_m
                noise = heading * heading / samples[k] + few / (count_base_m * count_base_m) + 1e-12
            else:
                first, second = 0, 3
                left_share, right_share = 1.0 / count_base_m, -1.0 / count_base_m
                noise = gyro_floor[k] * gyro_floor[k]
            behind = 0.0
            if are_rows_late and not are_speeds_late:
                # Counts that were read late make up for it as soon as they are not.
                behind = wheels_late * (turn_rate if channel == 3 else goes_on)
            for j in range(wide):
                seen[place, j] = (
                    known[first, j]
                    + known[second, j]
                    + left_share * known[5, j]
                    + right_share * known[6, j]
                    + goes_on * known[12, j]
                    + astray * known[0, j]
                )
            if behind != 0.0:
                for j in range(wide):
                    seen[place, j] += behind * known[wheels_at, j]
            for before in range(count):
                gain = seen[before, first] + seen[before, second]
                gain += (
                    left_share * seen[before, 5]
                    + right_share * seen[before, 6]
                    + goes_on * seen[before, 12]
                )
                gain += astray * seen[before, 0]
                if behind != 0.0:
                    gain += behind * seen[before, wheels_at]
                for j in range(wide):
                    seen[place, j] -= gain * seen[before, j]
            late_gain = late[first] + late[second]
            late_gain += left_share * late[5] + right_share * late[6] + goes_on * late[12]
            late_gain += astray * late[0]
            variance = noise + seen[place, first] + seen[place, second]
            variance += (
                left_share * seen[place, 5]
                + right_share * seen[place, 6]
                + goes_on * seen[place, 12]
            )
            variance += astray * seen[place, 0]
            if behind != 0.0:
                late_gain += behind * late[wheels_at]
                variance += behind * seen[place, wheels_at]
            own = noise
            if channel >= 2:
                variance += late_variance - 2.0 * late_gain
                late_gain -= late_variance
                own -= late_gain
                for j in range(wide):
                    seen[place, j] -= late[j]
            if channel == 3:
                variance += fresh_angle * (spread - 2.0 * together)
                own += fresh_angle * (spread - together)
                seen[place, 3] -= fresh_angle * together
            variances[rows] = variance
            scale = 1.0 / np.sqrt(variance)
            late_gain *= scale
            for j in range(states):
                seen[place, j] *= -scale
            for j in range(width):
                seen[place, states + j] = (columns[channel, k, j] - seen[place, states + j]) * scale
                out[rows, j] = seen[place, states + j]
            rows += 1
            if variance > UNKNOWN + 1e4 * noise:
                # Square metres less what is seen of them to a tenth of a millimetre: few digits of
                # what is left are right. In the channel it is what the channel's own noise leaves
                # (the stabilised form of Bucy and Joseph 1968), which hangs together with what a
                # block's end has beyond its mean.
                for i in range(states):
                    for before in range(count):
                        for j in range(wide):
                            known[i, j] -= seen[before, i] * seen[before, j]
                for i in range(states):
                    for j in range(wide):
                        known[i, j] -= seen[place, i] * seen[place, j]
                    wrong = known[i, first] + known[i, second] + own * scale * seen[place, i]
                    wrong += left_share * known[i, 5] + right_share * known[i, 6]
                    wrong += goes_on * known[i, 12] + astray * known[i, 0]
                    if behind != 0.0:
                        wrong += behind * known[i, wheels_at]
                    if channel >= 2:
                        wrong -= late[i]
                    if channel == 3 and i == 3:
                        wrong -= fresh_angle * together
                    for j in range(states):
                        known[i, j] += wrong * scale * seen[place, j]
                count = 0
            else:
                count += 1
            for j in range(wide):
                late[j] += late_gain * seen[place, j]
            late_variance -= late_gain * late_gain
        if count == 4:
            for i in range(states):
                x, y, angle, rate = seen[0, i], seen[1, i], seen[2, i], seen[3, i]
                for j in range(wide):
                    known[i, j] -= x * seen[0, j] + y * seen[1, j]
                    known[i, j] -= angle * seen[2, j] + rate * seen[3, j]
            continue
        for i in range(states):
            for before in range(count):
                for j in range(wide):
                    known[i, j] -= seen[before, i] * seen[before, j]
    return out[:rows], np.log(variances[:rows])
