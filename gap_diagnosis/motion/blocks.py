"""What the filter must know of the motion, block by block: ways, counts, what is unsure of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from gap_diagnosis.explanations.reference import USUAL_S, counting_slope
from gap_diagnosis.explanations.standstill import dead_ticks
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats
from gap_diagnosis.standing import STANDS_S

_LEAST_TURN_RAD: Final = 1e-6
_LATER: Final = 4.0
_SURELY: Final = 1.0
"""A rate by counts of less of its standard deviations may be that of a wheel at rest."""
_FINER: Final = 0.5
_AROUND: Final = 5
"""Blocks, a quarter of a second."""
_NARROWEST: Final = 0.1
"""A step of a fit may lead to wheels that stand on one another."""
_LEAST: Final = 0.05
"""Of a wheel's moving blocks: as quiet as the quietest of so many its speeds are at all times."""
_HARMONIC: Final = math.sqrt(2.0) * math.pi


@dataclass(frozen=True)
class Course:
    """What the filter must know of the motion, per block: float64[m] each.

    *quantum_m* float64[2] is the standard deviation of one reading of each wheel's way, *beat_m*
    that of its part which beats with the samples: of a rounding error after noise of sigma counts,
    the first harmonic has the variance exp(-(2 pi sigma)^2) / (2 pi^2) (Widrow and Kollar 2008,
    chapter 4). What counts are off by turns a robot about *count_base_m*. By as much as *log_more*
    the log variance of each row is less than if counts turned the robot as described. A wheel's
    way is negative where it turns back: a share of it that is slip is then the other way round. Its
    path is its length, longer where its contact is rougher. Of each block's way *told_m2* is the
    variance by noise of speeds as told, *scatter_m2* that by what else speeds leave unsure, or by
    counts that vary by chance. Where no counts are known the robot may be anywhere by *lost_m2*. A
    block's samples of a reference lie on average *sampled_x_m* and *sampled_y_m* beyond its ticks'
    mean. *are_rows_late*: what stands in a row was read before or after its stamp. Meanwhile the
    robot goes on by *goes_x_m_s* and *goes_y_m_s* and turns by *turns_rad_s*, told by the blocks
    around: a block's own step is longer where its row is late. A rate that was read a block's time
    late lacks *faster_m_s* and *turns_faster_rad_s*. *are_speeds_late*: wheels say such rates.
    """

    dt_s: Floats
    step_x_m: Floats
    step_y_m: Floats
    turn_rad: Floats
    left_way_m: Floats
    right_way_m: Floats
    left_path_m: Floats
    right_path_m: Floats
    left_moved: Floats
    right_moved: Floats
    left_kept: Floats
    right_kept: Floats
    left_scatter_m2: Floats
    right_scatter_m2: Floats
    left_told_m2: Floats
    right_told_m2: Floats
    lost_m2: Floats
    left_astray_m: Floats
    right_astray_m: Floats
    cosine: Floats
    sine: Floats
    quantum_m: Floats
    beat_m: Floats
    wheelbase_m: float
    count_base_m: float
    log_more: float
    samples: Floats
    sampled_x_m: Floats
    sampled_y_m: Floats
    gyro_floor_rad: Floats
    gyro_unsure_rad2: Floats
    are_rows_late: bool
    are_speeds_late: bool
    goes_x_m_s: Floats
    goes_y_m_s: Floats
    turns_rad_s: Floats
    faster_m_s: Floats
    turns_faster_rad_s: Floats

    def beside(self, left_m: Floats, right_m: Floats) -> Course:
        """Return the course of wheels that effects lead astray by so much more in each block."""
        return replace(
            self,
            left_astray_m=self.left_astray_m + left_m,
            right_astray_m=self.right_astray_m + right_m,
        )

    def wider(self, scale: float) -> Course:
        """Return the course of wheels that turn the robot as if they stood farther apart by this
        share: errors of counting turn it by less."""
        return replace(self, count_base_m=self.wheelbase_m * max(abs(1.0 + scale), _NARROWEST))

    def longer(self, times: Floats) -> Course:
        """Return the course of wheels whose counts are so many times as long, float64[2]."""
        left, right = times**2
        return replace(
            self,
            quantum_m=times * self.quantum_m,
            beat_m=times * self.beat_m,
            left_scatter_m2=left * self.left_scatter_m2,
            right_scatter_m2=right * self.right_scatter_m2,
            left_told_m2=left * self.left_told_m2,
            right_told_m2=right * self.right_told_m2,
        )

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


def _as_if_counted(steps: Floats, dead: NDArray[np.bool_]) -> Floats:
    """Return the steps of two wheels, float64[2, n], where a wheel that is not counted goes, and
    slips, as far as the other one."""
    longer = np.abs(steps).argmax(axis=0)
    return np.where(dead, np.take_along_axis(steps, longer[np.newaxis], axis=0), steps)


def course_of(nodes: Nodes, noise_ticks: float) -> Course:
    """Return the motion between the blocks' middles; *noise_ticks* is the described jitter."""
    motion = nodes.motion
    x_m, y_m = nodes.mean(motion.x_m), nodes.mean(motion.y_m)
    t_s = nodes.mean(motion.t_s)
    block_s = np.diff(t_s, prepend=t_s[0])
    radius = motion.radius_m
    signed = np.array([motion.left_step_rad, motion.right_step_rad])
    steps = _as_if_counted(signed, dead_ticks(motion))
    ways = [nodes.mean(np.cumsum(step) * radius) for step in steps]
    paths = [nodes.mean(np.cumsum(np.abs(step)) * radius) for step in steps]
    samples = np.zeros(nodes.count)
    samples[nodes.sample_node] = nodes.samples
    sampled_x, sampled_y = (nodes.sampled_beyond(one) for one in (motion.x_m, motion.y_m))
    per_count_m = radius * motion.wheel_rounding_rad
    heading = nodes.mean(motion.heading_rad)
    left_path, right_path = (np.diff(path, prepend=path[0]) for path in paths)
    moved = [path / one for path, one in zip((left_path, right_path), per_count_m, strict=True)]
    counted = list(zip(signed, motion.wheel_rounding_rad, strict=True))
    slow = [nodes.mean(_creep(motion, *one)) * block_s for one in counted]
    if noise_ticks > 0:
        creeps = [nodes.mean(_creep_beside_jitter(motion, *one)) * block_s for one in counted]
        # What settles goes on for a while, ever more slowly.
        creeps = [np.maximum(one, 0.5 * np.append(0.0, one[:-1])) for one in creeps]
        slow = [np.maximum(one, creep) for one, creep in zip(slow, creeps, strict=True)]
    if _is_finer(nodes, float(per_count_m.min())):
        slow = [np.maximum(one, seen) for one, seen in zip(slow, _seen(nodes), strict=True)]
    unsure = [nodes.mean(np.cumsum(one)) * radius**2 for one in motion.wheel_unsure_rad2]
    unsure = [np.diff(one, prepend=one[0]) for one in unsure]
    told = [
        noise_at_all_times(one, block_s, path > 0.0)
        for one, path in zip(unsure, (left_path, right_path), strict=True)
    ]
    return Course(
        dt_s=block_s,
        step_x_m=np.diff(x_m, prepend=x_m[0]),
        step_y_m=np.diff(y_m, prepend=y_m[0]),
        turn_rad=np.diff(heading, prepend=heading[0]),
        left_way_m=np.diff(ways[0], prepend=ways[0][0]),
        right_way_m=np.diff(ways[1], prepend=ways[1][0]),
        left_path_m=left_path,
        right_path_m=right_path,
        left_moved=moved[0],
        right_moved=moved[1],
        left_kept=_kept(moved[0], slow[0]),
        right_kept=_kept(moved[1], slow[1]),
        left_scatter_m2=unsure[0] - told[0],
        right_scatter_m2=unsure[1] - told[1],
        left_told_m2=told[0],
        right_told_m2=told[1],
        lost_m2=np.diff(nodes.mean(np.cumsum(motion.lost_m2)), prepend=0.0),
        left_astray_m=np.zeros(nodes.count),
        right_astray_m=np.zeros(nodes.count),
        cosine=np.cos(heading),
        sine=np.sin(heading),
        quantum_m=per_count_m * math.sqrt(1 / 12 + noise_ticks**2),
        beat_m=per_count_m * math.exp(-0.5 * (math.tau * noise_ticks) ** 2) / _HARMONIC,
        wheelbase_m=motion.wheelbase_m,
        count_base_m=motion.wheelbase_m,
        log_more=0.0,
        samples=samples,
        sampled_x_m=sampled_x,
        sampled_y_m=sampled_y,
        gyro_floor_rad=_gyro_floor(nodes),
        gyro_unsure_rad2=np.diff(nodes.mean(np.cumsum(motion.gyro_unsure_rad2)), prepend=0.0),
        are_rows_late=motion.are_rows_late,
        are_speeds_late=motion.has_speeds,
        goes_x_m_s=np.gradient(x_m, t_s),
        goes_y_m_s=np.gradient(y_m, t_s),
        turns_rad_s=np.gradient(heading, t_s),
        faster_m_s=np.gradient(nodes.mean(_forward_m_s(nodes.smooth))),
        turns_faster_rad_s=np.gradient(nodes.mean(nodes.smooth.turn_rate_rad_s)),
    )


def _forward_m_s(motion: Motion) -> Floats:
    return 0.5 * motion.radius_m * (motion.left_rate_rad_s + motion.right_rate_rad_s)


def noise_at_all_times(unsure: Floats, block_s: Floats, moves: NDArray[np.bool_]) -> Floats:
    """Return which part of a variance, float64[m], is there however a wheel *moves*: noise of its
    speeds. The rest is where they bend, or what a step rounds off for as long as they are the same.
    """
    told = moves & (unsure > 0.0)
    if not told.any():
        return np.zeros_like(unsure)
    least = float(np.quantile(unsure[told] / block_s[told], _LEAST))
    return np.asarray(np.minimum(unsure, least * block_s))


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
    per_count_m = motion.radius_m * motion.wheel_rounding_rad
    return [
        np.abs(uniform_filter1d(along_m + side * around_m, _AROUND)) / one
        for side, one in zip((-1.0, 1.0), per_count_m, strict=True)
    ]


def _kept(moved: Floats, slow: Floats) -> Floats:
    """Return which share of a count's error stays from block to block, float64[m].

    *moved* is how many counts came, *slow* how many the wheel went between them. A sawtooth's
    correlation after a share m of its period is 1 - 6 m (1 - m).
    """
    share = np.minimum(slow, 0.5)
    return np.asarray(np.clip(np.minimum(1.0 - moved, 1.0 - 6.0 * share * (1 - share)), 0.0, 1.0))


def _creep(motion: Motion, step_rad: Floats, rounding_rad: float) -> Floats:
    """Return how fast a wheel goes between two counts [counts/s], float64[n].

    Its count stands meanwhile, but the wheel does not, unless the next count is one back: a wheel
    that stands on an edge of its encoder counts to and fro, and one that rested for a moment comes
    by its next count much later than by those around. Where it came to a stop, or turned round, it
    went on for some part of a count, and did so before the first.
    """
    count = np.rint(np.cumsum(step_rad) / rounding_rad)
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


def _creep_beside_jitter(motion: Motion, step_rad: Floats, rounding_rad: float) -> Floats:
    """Return how fast a wheel goes by its counts over a while [counts/s], float64[n].

    Where readings jitter, a wheel that comes to a stop counts to and fro before, and tells as
    little by its next count whether it still goes as one that stands on an edge.
    """
    width = max(USUAL_S / motion.tick_s, 0.5)
    rate = np.abs(gaussian_filter1d(step_rad / rounding_rad, width)) / motion.tick_s
    noise = math.sqrt(counting_slope(width)) / motion.tick_s
    return np.asarray(np.where(rate > _SURELY * noise, rate, 0.0))


def _gyro_floor(nodes: Nodes) -> Floats:
    """Return white noise of the gyro's turn beside the wheels', float64[m].

    What stands in one row of a table was not measured at one instant, but within a row's time. How
    far a robot turns in it is no more than wheels say, which may stand farther apart than they are
    said to, nor than a gyro says, which has a bias at rest.
    """
    floor = np.full(nodes.count, _LEAST_TURN_RAD)
    turn_rad = nodes.motion.gyro_turn_rad
    if nodes.motion.has_counters or turn_rad is None:
        return floor
    row_s = nodes.motion.tick_s / np.sqrt(12.0)
    rate_rad_s = np.diff(turn_rad, prepend=turn_rad[0]) / nodes.motion.tick_s
    width = USUAL_S / nodes.motion.tick_s
    by_gyro = nodes.mean(gaussian_filter1d(rate_rad_s, width))
    by_wheels = nodes.mean(nodes.smooth.turn_rate_rad_s)
    return np.asarray(floor + row_s * np.minimum(np.abs(by_gyro), np.abs(by_wheels)))
