"""The log in blocks of a twentieth of a second: residuals of reference and gyro, averaged.

A prediction is compared with the log to first order about the estimated motion (Kelly 2004: the
linearised error recursion of odometry), so a deviation stays small where the prediction is right,
however far dead reckoning has drifted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.bends import noise_by_bends
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.motion.course import dead_reckoned
from gap_diagnosis.motion.smoothing import sharpened, smoothed
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats, Reference

_BLOCK_S: Final = 0.05
_MOST_NODES: Final = 12_000
_SHARP_S: Final = 0.005
"""Rounds the corners where a wheel's turn is told by its counts again."""

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Nodes:
    """Where each block begins, and what lies in it.

    Attributes:
        motion: at tick level.
        smooth: the same with smooth wheel turns, for the effects' columns.
        starts: int64[m], first tick of each block.
        ticks: float64[m], ticks in each block.
        sample_tick: int64[s], the tick at each reference sample that is used, ascending.
        sample_t_s, sample_x_m, sample_y_m, sample_heading_rad: those samples.
        sample_starts: int64[r], first sample of each block that has samples.
        sample_node: int64[r], which block that is.
        samples: float64[r], how many it has.
        has_gyro, has_reference, has_heading: which channels there are.
        described: float64[3, n], x, y [m] and heading [rad] along which delays move, hardly
            smoothed: the described wheels' way on the estimated headings, and their own heading.
        described_t_s: float64[n], the ticks' times, as smooth.
        gyro_kept: bool[m], blocks whose gyro is used.
    """

    motion: Motion
    smooth: Motion
    starts: Ints
    ticks: Floats
    sample_tick: Ints
    sample_t_s: Floats
    sample_x_m: Floats
    sample_y_m: Floats
    sample_heading_rad: Floats
    sample_starts: Ints
    sample_node: Ints
    samples: Floats
    described: Floats
    described_t_s: Floats
    gyro_kept: NDArray[np.bool_]
    has_gyro: bool
    has_reference: bool
    has_heading: bool

    @cached_property
    def described_at_samples(self) -> tuple[Floats, ...]:
        """The motion at each sample used, moved along the description from its tick to its time:
        x, y [m] and heading [rad], float64[s] each."""
        return self.at_samples(self.sample_t_s)

    @cached_property
    def beyond_described(self) -> tuple[Floats, ...]:
        """What each sample used says beyond that, float64[s] each."""
        return self.samples_beyond(self.described_at_samples)

    def samples_beyond(self, described: Sequence[Floats]) -> tuple[Floats, ...]:
        """Return what each sample used says beyond x, y [m] and heading [rad], float64[s] each."""
        samples = (self.sample_x_m, self.sample_y_m, self.sample_heading_rad)
        return tuple(said - known for said, known in zip(samples, described, strict=True))

    @cached_property
    def described_directions(self) -> tuple[Floats, Floats]:
        """Cosine and sine of that heading."""
        heading = self.described_at_samples[2]
        return np.cos(heading), np.sin(heading)

    @cached_property
    def gyro_beyond_rad(self) -> Floats | None:
        """The gyro's turn less the estimated one, float64[n]; None without a gyro."""
        gyro_turn, heading = self.motion.gyro_turn_rad, self.motion.heading_rad
        return None if gyro_turn is None else gyro_turn - (heading - heading[0])

    @cached_property
    def estimated_steps(self) -> Steps:
        """The estimated motion's steps."""
        return steps_of(self.motion)

    def at_samples(self, true_t_s: Floats) -> tuple[Floats, ...]:
        """Return the same for samples that were taken at other times."""
        # The noise of a count must not depend on where between two ticks a delay comes to lie.
        motion, tick = self.motion, self.sample_tick
        known = (motion.x_m, motion.y_m, motion.heading_rad)
        moved = self._way_beyond(true_t_s) - self._way_at_ticks
        return tuple(path[tick] + change for path, change in zip(known, moved, strict=True))

    def _way_beyond(self, true_t_s: Floats) -> Floats:
        """Return the described way, float64[3, s]; where a log begins or ends in motion, the robot
        goes on as it did: one that stood still there would tell a delay by a leap."""
        inside = np.clip(true_t_s, *self.motion.t_s[[0, -1]])
        way = _along(self._way.c, self._way.x, inside)
        outside = inside != true_t_s
        if outside.any():
            ahead_s = (true_t_s - inside)[outside]
            way[:, outside] += ahead_s * self._way(inside[outside], 1)
        return way

    @cached_property
    def sharp(self) -> Motion:
        """The smooth motion with those details of the wheels' turns that are no counting errors,
        and where the wheels are in their turns as counted."""
        left, right = self.motion.left_angle_rad, self.motion.right_angle_rad
        granted = tuple((variant.in_detail, sizes) for variant, sizes in self.smooth.granted)
        return replace(
            sharpened(self.smooth), left_angle_rad=left, right_angle_rad=right, granted=granted
        )

    def granting(self, settings: Sequence[Setting]) -> Nodes:
        """Return the same with these effects known."""
        granted = tuple(settings)
        motion, smooth = (replace(one, granted=granted) for one in (self.motion, self.smooth))
        return replace(self, motion=motion, smooth=smooth)

    def of_late_rows(self) -> Nodes:
        """Return the same of rows that were read at other times than they say: along a way that is
        smooth from row to row.

        What they are off by would go along with every delay, which meets them between two rows and
        was told because it makes them smoother there.
        """
        described = gaussian_filter1d(self.described, 1.0, axis=1, mode="nearest")
        return replace(self, described=np.asarray(described))

    @cached_property
    def _way(self) -> CubicSpline:
        """The described way over time: no straight line where a robot turns in and out."""
        # As smooth in time as in place: stamps that jitter would bend the way from row to row.
        t_s = self.described_t_s
        later = np.diff(np.maximum.accumulate(t_s), prepend=-np.inf) > 0
        return CubicSpline(t_s[later], self.described[:, later], axis=1)

    @cached_property
    def _way_at_ticks(self) -> Floats:
        """The same at each sample's tick, float64[3, s]."""
        return _along(self._way.c, self._way.x, self.motion.t_s[self.sample_tick])

    @cached_property
    def reference_noise(self) -> tuple[float, ...]:
        """The reference's white noise in x, y [m] and heading [rad]."""
        samples = (self.sample_x_m, self.sample_y_m, self.sample_heading_rad)
        return tuple(
            _white(measured - described[self.sample_tick])
            for measured, described in zip(samples, self.described, strict=True)
        )

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.starts)

    def mean(self, values: Floats) -> Floats:
        """Return the block means of a tick-level array."""
        return _means(np.ascontiguousarray(values, dtype=np.float64), self.starts)

    def sampled_beyond(self, values: Floats) -> Floats:
        """Return by how much more a tick-level array is at a block's samples than its mean over the
        block, float64[m]; 0 where there are none."""
        beyond = np.zeros(self.count)
        if self.has_reference:
            at_samples = _means(values[self.sample_tick], self.sample_starts)
            beyond[self.sample_node] = at_samples - self.mean(values)[self.sample_node]
        return beyond


def make_nodes(
    motion: Motion,
    reference: Reference | None,
    keep: NDArray[np.bool_],
    reference_delay_s: Floats | float = 0.0,
) -> Nodes:
    """Cut the ticks into blocks; leave out gyro and reference where *keep* (bool[n]) is false.

    A sample belongs to the tick that it was taken in, *reference_delay_s* before its stamp: what
    wheels and floor did meanwhile it has not seen.
    """
    count = len(motion.t_s)
    step_s = motion.tick_s
    size = max(1, round(_BLOCK_S / step_s), -(-count // _MOST_NODES))
    starts = np.arange(0, count, size)
    ticks = np.diff(np.append(starts, count)).astype(np.float64)
    empty = np.empty(0)
    tick = np.empty(0, dtype=np.int64)
    x_m = y_m = heading = t_s = empty
    has_heading = False
    if reference is not None:
        taken_s = reference.t_s - reference_delay_s
        inside = (reference.t_s >= motion.t_s[0]) & (reference.t_s <= motion.t_s[-1])
        inside &= (taken_s >= motion.t_s[0]) & (taken_s <= motion.t_s[-1])
        t_s, taken_s = reference.t_s[inside], taken_s[inside]
        after = np.clip(np.searchsorted(motion.t_s, taken_s), 1, count - 1)
        nearer = taken_s - motion.t_s[after - 1] < motion.t_s[after] - taken_s
        tick = np.where(nearer, after - 1, after).astype(np.int64)
        x_m, y_m = reference.x_m[inside], reference.y_m[inside]
        has_heading = reference.heading_rad is not None
        heading = (
            np.zeros(len(t_s)) if reference.heading_rad is None else (reference.heading_rad[inside])
        )
        good = keep[tick] & np.isfinite(x_m) & np.isfinite(y_m) & np.isfinite(heading)
        t_s, tick, x_m, y_m, heading = (one[good] for one in (t_s, tick, x_m, y_m, heading))
    node_of = tick // size
    node, sample_starts = np.unique(node_of, return_index=True)
    samples = np.diff(np.append(sample_starts, len(tick))).astype(np.float64)
    smooth = smoothed(motion)
    # Not along raw counts: what they round off stands in what they are compared with as well.
    described = _described(sharpened(smooth), step_s)
    return Nodes(
        motion=motion,
        smooth=smooth,
        starts=starts,
        ticks=ticks,
        sample_tick=tick,
        sample_t_s=t_s,
        sample_x_m=x_m,
        sample_y_m=y_m,
        sample_heading_rad=heading,
        sample_starts=sample_starts.astype(np.int64),
        sample_node=node.astype(np.int64),
        samples=samples,
        described=described[:3],
        described_t_s=described[3],
        gyro_kept=np.logical_and.reduceat(keep, starts),
        has_gyro=motion.gyro_turn_rad is not None,
        has_reference=len(tick) > 0,
        has_heading=has_heading,
    )


def _white(left: Floats) -> float:
    """Return the white noise of a series, by its second differences: what is smooth has none."""
    bends = np.diff(left, 2)
    return noise_by_bends(bends)


CHANNELS: Final = 4
"""x, y and heading of the reference, turn of the gyro."""


def residuals(nodes: Nodes, prediction: Prediction) -> Floats:
    """Return recorded minus predicted, float64[4, m]: x, y [m], heading, gyro turn [rad].

    NaN where a block has no sample of a channel.
    """
    motion = nodes.motion
    out = np.full((CHANNELS, nodes.count), np.nan)
    d_x, d_y, d_heading = _deviations(nodes.estimated_steps, prediction)
    if nodes.gyro_beyond_rad is not None:
        compared = _gyro_beyond(
            nodes.gyro_beyond_rad,
            d_heading,
            prediction.gyro_added_rad_s,
            motion.dt_s,
            nodes.starts,
        )
        out[3] = np.where(nodes.gyro_kept, compared, np.nan)
    if nodes.has_reference:
        _compare_reference(nodes, prediction, d_x, d_y, d_heading, out)
    return out


class Steps(NamedTuple):
    """A motion's steps, float64[n] each: in the room [m], and the direction that each was made in;
    as the body saw them [m], and turns [rad]."""

    x_m: Floats
    y_m: Floats
    cosine: Floats
    sine: Floats
    forward_m: Floats
    lateral_m: Floats
    turn_rad: Floats


def steps_of(motion: Motion) -> Steps:
    """Return the steps of the estimated motion: the same for every prediction."""
    x_m = np.diff(motion.x_m, prepend=motion.x_m[0])
    y_m = np.diff(motion.y_m, prepend=motion.y_m[0])
    before = np.append(motion.heading_rad[0], motion.heading_rad[:-1])
    turn_rad = motion.heading_rad - before
    middle = before + 0.5 * turn_rad
    cosine, sine = np.cos(middle), np.sin(middle)
    return Steps(
        x_m, y_m, cosine, sine, cosine * x_m + sine * y_m, -sine * x_m + cosine * y_m, turn_rad
    )


def _deviations(known: Steps, prediction: Prediction) -> tuple[Floats, Floats, Floats]:
    """Return how far a prediction leaves the estimated motion: x, y, heading, float64[n] each."""
    p = prediction
    return _deviation(*known, p.left_m, p.right_m, p.wheelbase_m, p.lateral_m, p.yaw_rad)


def _described(motion: Motion, step_s: float) -> Floats:
    """Return x, y, heading by the description's wheels, and time, float64[4, n], hardly smoothed.

    Where the way leads is the estimated heading's: the wheels' own may have drifted by turns.
    """
    forward_m = 0.5 * motion.radius_m * (motion.left_step_rad + motion.right_step_rad)
    heading = (
        motion.heading_rad + _deviations(steps_of(motion), Prediction(without_jumps(motion)))[2]
    )
    places = np.array([*dead_reckoned(forward_m, motion.heading_rad), heading, motion.t_s])
    return np.asarray(gaussian_filter1d(places, _SHARP_S / step_s, mode="nearest"))


def without_jumps(motion: Motion) -> Motion:
    """Return the motion as a counter tells it that does not jump."""
    none = np.zeros_like(motion.left_jump_rad)
    return replace(motion, left_jump_rad=none, right_jump_rad=none)


def _compare_reference(
    nodes: Nodes, p: Prediction, d_x: Floats, d_y: Floats, d_heading: Floats, out: Floats
) -> None:
    tick = nodes.sample_tick
    # Counts that are stamped late see a reference that is early by as much.
    delay_s = _at_stamps(p.reference_delay_s, nodes) - _at(p.encoder_delay_s, tick)
    is_timely = _is_none(delay_s)
    if is_timely:
        beyond_x, beyond_y, beyond_heading = nodes.beyond_described
    else:
        at_samples = nodes.at_samples(nodes.sample_t_s - delay_s)
        beyond_x, beyond_y, beyond_heading = nodes.samples_beyond(at_samples)
    if not all(map(_is_none, (p.reference_forward_m, p.reference_left_m, p.reference_scale))):
        # Where the tracked point lies follows from the estimated pose: dead reckoning has drifted.
        cosine, sine = (
            nodes.described_directions
            if is_timely
            else (np.cos(at_samples[2]), np.sin(at_samples[2]))
        )
        forward, left = _at(p.reference_forward_m, tick), _at(p.reference_left_m, tick)
        point_x = forward * cosine - left * sine
        point_y = forward * sine + left * cosine
        # A room's scale stretches the way that the wheels went: in the estimated pose stands the
        # reference's own noise, and a large room about small wheels would take that away.
        way_x, way_y = nodes.smooth.x_m[tick], nodes.smooth.y_m[tick]
        beyond_x = beyond_x - point_x - p.reference_scale * (way_x + point_x)
        beyond_y = beyond_y - point_y - p.reference_scale * (way_y + point_y)
    beyond_heading = beyond_heading - _at(p.reference_heading_rad, tick)
    said, deviations = (beyond_x, beyond_y, beyond_heading), (d_x, d_y, d_heading)
    means = _means_beyond(*said, *deviations, tick, nodes.sample_starts)
    seen = 3 if nodes.has_heading else 2
    out[:seen, nodes.sample_node] = means[:seen]


def _at_stamps(delay_s: Floats | float, nodes: Nodes) -> Floats | float:
    """Return a delay at the samples' stamps, however far from these they were taken."""
    if isinstance(delay_s, np.ndarray):
        return np.asarray(np.interp(nodes.sample_t_s, nodes.motion.t_s, delay_s))
    return delay_s


def _is_none(value: Floats | float) -> bool:
    """Tell whether nothing is added, at any time."""
    return isinstance(value, float) and value == 0.0


def _at(value: Floats | float, tick: Ints) -> Floats | float:
    """Return a value that may change with time, at these ticks."""
    return value[tick] if isinstance(value, np.ndarray) else value


@numba.njit(cache=True, nogil=True)
def _along(coefficients: Floats, knots: Floats, t_s: Floats) -> Floats:
    """Return a cubic spline of coefficients float64[4, k - 1, c] between knots float64[k] at times
    that hardly ever go back: float64[c, s], as SciPy's `PPoly` to the last digit."""
    channels = coefficients.shape[2]
    places = np.empty((channels, len(t_s)))
    piece = 0
    for k in range(len(t_s)):
        while piece > 0 and t_s[k] < knots[piece]:
            piece -= 1
        while piece < len(knots) - 2 and t_s[k] >= knots[piece + 1]:
            piece += 1
        since_s = t_s[k] - knots[piece]
        for channel in range(channels):
            place, power = 0.0, 1.0
            for term in range(3, -1, -1):
                place += coefficients[term, piece, channel] * power
                power *= since_s
            places[channel, k] = place
    return places


@numba.njit(cache=True, nogil=True)
def _means(values: Floats, starts: Ints) -> Floats:
    """Return the means of values from each start to the next one."""
    means = np.empty(len(starts))
    for block in range(len(starts)):
        stop = starts[block + 1] if block + 1 < len(starts) else len(values)
        total = 0.0
        for k in range(starts[block], stop):
            total += values[k]
        means[block] = total / (stop - starts[block])
    return means


@numba.njit(cache=True, nogil=True)
def _means_beyond(
    x: Floats,
    y: Floats,
    angle: Floats,
    d_x: Floats,
    d_y: Floats,
    d_angle: Floats,
    tick: Ints,
    starts: Ints,
) -> Floats:
    """Return the same of samples less deviations at their ticks, float64[3, starts]."""
    means = np.empty((3, len(starts)))
    for block in range(len(starts)):
        stop = starts[block + 1] if block + 1 < len(starts) else len(x)
        total_x = total_y = total_angle = 0.0
        for k in range(starts[block], stop):
            total_x += x[k] - d_x[tick[k]]
            total_y += y[k] - d_y[tick[k]]
            total_angle += angle[k] - d_angle[tick[k]]
        count = stop - starts[block]
        means[0, block] = total_x / count
        means[1, block] = total_y / count
        means[2, block] = total_angle / count
    return means


@numba.njit(cache=True, nogil=True)
def _gyro_beyond(
    beyond: Floats, d_angle: Floats, added: Floats, dt_s: Floats, starts: Ints
) -> Floats:
    """Return the means, from the first tick on, of a gyro's turn less a deviation and what rates
    *added* have turned it by so far."""
    means = np.empty(len(starts))
    extra = 0.0
    for block in range(len(starts)):
        stop = starts[block + 1] if block + 1 < len(starts) else len(beyond)
        total = 0.0
        for k in range(starts[block], stop):
            extra += added[k] * dt_s[k]
            total += beyond[k] - d_angle[k] - extra
        means[block] = total / (stop - starts[block])
    return means


@numba.njit(cache=True, nogil=True)
def _deviation(
    step_x: Floats,
    step_y: Floats,
    cosine: Floats,
    sine: Floats,
    known_forward: Floats,
    known_lateral: Floats,
    known_turn: Floats,
    left: Floats,
    right: Floats,
    wheelbase: Floats,
    lateral: Floats,
    yaw: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Add up what predicted steps differ from the estimated motion by, to first order."""
    count = len(step_x)
    x, y, angle = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(1, count):
        d_forward = 0.5 * (left[k] + right[k]) - known_forward[k]
        d_lateral = lateral[k] - known_lateral[k]
        d_turn = (right[k] - left[k]) / wheelbase[k] + yaw[k] - known_turn[k]
        d_middle = angle[k - 1] + 0.5 * d_turn
        x[k] = x[k - 1] + cosine[k] * d_forward - sine[k] * d_lateral - step_y[k] * d_middle
        y[k] = y[k - 1] + sine[k] * d_forward + cosine[k] * d_lateral + step_x[k] * d_middle
        angle[k] = angle[k - 1] + d_turn
    return x, y, angle
