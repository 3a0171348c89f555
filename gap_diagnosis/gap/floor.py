"""The gap that noise alone leaves: the metrics on errors drawn from the noise model.

Errors are small against the path, so the error of a path is linear in its noise. Walks are drawn
at nodes 50 ms apart and the reference is read at the nodes nearest after its samples; what it
does between two nodes is far below the other noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.gap.metrics import Path, known_by_way
from gap_diagnosis.gap.windows import Window
from gap_diagnosis.recording import Floats

DRAWS: Final = 200
_NODE_S: Final = 0.05
_SEED: Final = 50_200


@dataclass(frozen=True)
class NoiseLevels:
    """How large each noise is; the names are those of the motion block's levels.

    Attributes:
        contact_m_per_sqrt_m: random walk of each wheel over its way.
        lateral_m_per_sqrt_m: likewise to the side.
        gyro_noise_rad_per_sqrt_s: angle random walk.
        gyro_bias_walk_rad_s_per_sqrt_s: random walk of the gyro's bias.
        reference_position_m, reference_heading_rad: white, per sample.
        reference_stamp_s: by which its stamp is off, likewise.
        reference_slow_position_m, reference_slow_heading_rad: correlated over `slow_s`.
        slow_s: that correlation time.
        quantum_rad: quantisation and noise of one reading of a wheel's angle, standard deviation.
        slip_wander: share of its way by which a wheel slips, correlated over `slip_s`.
        slip_s: that correlation time.
        speed_noise: of wheels' speeds, over what is told.
        wheels_late_s, gyro_late_s: by which they were read too late, correlated over
            `late_lasts_s`.
        late_lasts_s: that correlation time.
        are_speeds_late: wheels say speeds: what one that is read late is off by stays.
    """

    contact_m_per_sqrt_m: float
    lateral_m_per_sqrt_m: float
    gyro_noise_rad_per_sqrt_s: float
    gyro_bias_walk_rad_s_per_sqrt_s: float
    reference_position_m: float
    reference_heading_rad: float
    reference_stamp_s: float = 0.0
    reference_slow_position_m: float = 0.0
    reference_slow_heading_rad: float = 0.0
    slow_s: float = 1.0
    quantum_rad: float = 0.0
    slip_wander: float = 0.0
    slip_s: float = 1.0
    speed_noise: float = 1.0
    wheels_late_s: float = 0.0
    gyro_late_s: float = 0.0
    late_lasts_s: float = 1.0
    are_speeds_late: bool = False


@dataclass(frozen=True)
class Floor:
    """Mean squares that noise alone leaves, float64[draws, w] each, one column per window."""

    position: Floats
    heading: Floats
    turn_difference: Floats


def noise_floor(
    path: Path,
    wheel_way_m: tuple[Floats, Floats],
    wheel_unsure_m2: Floats,
    measured_t_s: Floats,
    windows: Sequence[Window],
    levels: NoiseLevels,
    *,
    radius_m: float,
    wheelbase_m: float,
    gyro_share: float,
    offset_time_s: Floats,
    has_heading: bool = True,
    draws: int = DRAWS,
) -> Floor:
    """Return the metrics on noise alone.

    *path* is the explained path at the ticks; *wheel_way_m* the way that each wheel has rolled
    until each tick, less what it rolled back, float64[n] each, and *wheel_unsure_m2*, float64[2,
    n], the variance that its reading has gathered until then beside its counting (of speeds that
    were added up, as loud as their noise is). *gyro_share* is how much of the odometry's heading
    comes from the gyro, whose offset at each tick was averaged over *offset_time_s*, float64[n] (∞:
    no offset was taken off). Without *has_heading* the start heading is estimated
    from positions as in `metrics.path_errors`. The same input gives the same draws.
    """
    generator = np.random.default_rng(_SEED)
    rows = [
        _window_floor(
            generator, path, wheel_way_m, wheel_unsure_m2, measured_t_s, window, levels,
            radius_m, wheelbase_m, gyro_share, offset_time_s, has_heading, draws,
        )
        for window in windows
    ]  # fmt: skip
    columns = np.array(rows).reshape(len(windows), 3, draws)
    return Floor(columns[:, 0].T, columns[:, 1].T, columns[:, 2].T)


def _window_floor(
    generator: np.random.Generator,
    path: Path,
    wheel_way_m: tuple[Floats, Floats],
    wheel_unsure_m2: Floats,
    measured_t_s: Floats,
    window: Window,
    levels: NoiseLevels,
    radius_m: float,
    wheelbase_m: float,
    gyro_share: float,
    offset_time_s: Floats,
    has_heading: bool,
    draws: int,
) -> tuple[Floats, Floats, Floats]:
    count = max(int((window.stop_s - window.start_s) / _NODE_S) + 1, 8)
    at_s = np.linspace(window.start_s, window.stop_s, count)
    node_s = float(at_s[1] - at_s[0])
    x_m, y_m = np.interp(at_s, path.t_s, path.x_m), np.interp(at_s, path.t_s, path.y_m)

    def gained(sums: Floats) -> Floats:
        """Return what a sum that never falls gains from node to node."""
        at = np.interp(at_s, path.t_s, sums)
        return np.maximum(np.diff(at, prepend=at[0]), 0.0)

    paths = [gained(np.cumsum(np.abs(np.diff(way, prepend=way[0])))) for way in wheel_way_m]
    unsure_m2 = [gained(sums) for sums in wheel_unsure_m2]

    def walk(sd: Floats) -> Floats:
        return np.cumsum(sd * generator.standard_normal((draws, count)), axis=1)

    rolling_m = radius_m * levels.quantum_rad
    left, right = (
        walk(np.sqrt(levels.contact_m_per_sqrt_m**2 * length + unsure))
        + rolling_m * generator.standard_normal((draws, count))
        for length, unsure in zip(paths, unsure_m2, strict=True)
    )
    if levels.slip_wander:
        # A share of a way: it turns round with that.
        ways = [np.interp(at_s, path.t_s, way) for way in wheel_way_m]
        slips = levels.slip_wander * _slow_walks(generator, 2, draws, count, node_s, levels.slip_s)
        left, right = (
            off_m + np.cumsum(slip * np.diff(way, prepend=way[0]), axis=1)
            for off_m, slip, way in zip((left, right), slips, ways, strict=True)
        )
    sideways = levels.lateral_m_per_sqrt_m * np.sqrt(0.5 * (paths[0] + paths[1]))
    after_start = np.full(count, math.sqrt(node_s))
    after_start[0] = 0.0
    bias = walk(levels.gyro_bias_walk_rad_s_per_sqrt_s * after_start)
    gyro_rad = walk(levels.gyro_noise_rad_per_sqrt_s * after_start)
    gyro_rad += np.cumsum(bias, axis=1) * node_s
    offset_sd = levels.gyro_noise_rad_per_sqrt_s / np.sqrt(
        offset_time_s[np.searchsorted(path.t_s, window.start_s)]
    )
    offset_rad = offset_sd * generator.standard_normal((draws, 1)) * (at_s - at_s[0])
    wheel_rad = (right - left) / wheelbase_m
    # In complex positions: a heading error turns each later step about its start.
    steps = np.diff(x_m + 1j * y_m, prepend=x_m[0] + 1j * y_m[0])
    course = _course(path, at_s)
    turns_rad_s = np.gradient(np.unwrap(np.angle(course))) / node_s
    late_m = np.zeros((draws, count))
    if levels.wheels_late_s or levels.gyro_late_s:
        late = _slow_walks(generator, 2, draws, count, node_s, levels.late_lasts_s)
        wheels_s, gyro_s = levels.wheels_late_s * late[0], levels.gyro_late_s * late[1]
        goes_m_s = (steps * course.conj()).real / node_s
        late_m = _missed(wheels_s, goes_m_s, stays=levels.are_speeds_late)
        wheel_rad -= _missed(wheels_s, turns_rad_s, stays=levels.are_speeds_late)
        gyro_rad -= _missed(gyro_s, turns_rad_s, stays=True)
    heading_rad = gyro_share * (gyro_rad + offset_rad) + (1 - gyro_share) * wheel_rad

    forward = np.diff(0.5 * (left + right) - late_m, axis=1, prepend=0.0)
    lateral = sideways * generator.standard_normal((draws, count))
    off = np.cumsum(1j * heading_rad * steps + (forward + 1j * lateral) * course, axis=1)

    first, stop = np.searchsorted(measured_t_s, [window.start_s, window.stop_s])
    slow = _slow_walks(generator, 3, draws, count, node_s, levels.slow_s)
    off -= levels.reference_slow_position_m * (slow[0] + 1j * slow[1])
    seen_rad = heading_rad - levels.reference_slow_heading_rad * slow[2]
    stamps = measured_t_s[first:stop] if stop > first else at_s
    points = np.interp(stamps, path.t_s, path.x_m) + 1j * np.interp(stamps, path.t_s, path.y_m)
    samples = max(int(np.searchsorted(stamps, window.align_s, side="right")), 1)
    if not has_heading:
        samples = min(known_by_way(points, samples), len(points))
    nodes = np.minimum(np.searchsorted(at_s, stamps), count - 1)
    told, used = nodes[:samples], np.unique(np.append(nodes[samples:], count - 1))

    def normal() -> Floats:
        return generator.standard_normal(draws)

    white_m, white_rad = levels.reference_position_m, levels.reference_heading_rad
    # By how much the robot goes on while a stamp is off.
    gone_m = levels.reference_stamp_s * steps / node_s
    gone_rad = levels.reference_stamp_s * turns_rad_s
    early = normal() / math.sqrt(samples)
    start = off[:, told].mean(1) + white_m * (normal() + 1j * normal()) / math.sqrt(samples)
    start += gone_m[told].mean() * early
    middle = points[:samples].mean()
    away = (x_m + 1j * y_m) - middle
    if has_heading:
        start_rad = seen_rad[:, told].mean(1) + white_rad * normal() / math.sqrt(samples)
        start_rad += gone_rad[told].mean() * early
    else:
        start_rad = _turn_by_positions(off[:, told], points[:samples] - middle, white_m, normal())
    left_over = off - start[:, np.newaxis] - 1j * start_rad[:, np.newaxis] * away
    position = (np.abs(left_over[:, used]) ** 2).mean(1) + 2 * white_m**2
    position += (np.abs(gone_m[used]) ** 2).mean()
    heading = ((seen_rad - start_rad[:, np.newaxis])[:, used] ** 2).mean(1) + white_rad**2
    heading += (gone_rad[used] ** 2).mean()
    known = max(int(np.searchsorted(at_s, window.align_s, side="right")), 1)
    difference = wheel_rad - gyro_rad
    difference = difference - difference[:, :known].mean(1, keepdims=True)
    return position, heading, (difference[:, known:] ** 2).mean(1)


def _missed(late_s: Floats, rate: Floats, *, stays: bool) -> Floats:
    """Return what sums lack that were read so late, float64[draws, count], of what goes on at a
    *rate*, float64[count]; what sums of rates lack *stays*."""
    if stays:
        return np.asarray(np.cumsum(late_s * np.diff(rate, prepend=rate[0]), axis=1))
    return np.asarray(late_s * rate)


def _course(path: Path, at_s: Floats) -> Floats:
    """Return the unit vector (complex) of the body's x axis at each time."""
    if path.heading_rad is None:
        raise ValueError("the explained path has headings")
    return np.asarray(np.exp(1j * np.interp(at_s, path.t_s, path.heading_rad)))


def _slow_walks(
    generator: np.random.Generator,
    series: int,
    draws: int,
    count: int,
    node_s: float,
    slow_s: float,
) -> Floats:
    """Return first-order Gauss-Markov series of variance 1, float64[series, draws, count]."""
    decay = math.exp(-node_s / slow_s)
    fresh = math.sqrt(1 - decay * decay)
    slow = generator.standard_normal((count, series, draws))
    slow[1:] *= fresh
    for k in range(1, count):
        slow[k] += decay * slow[k - 1]
    return np.moveaxis(slow, 0, -1)


def _turn_by_positions(off: Floats, arm: Floats, white_m: float, normal: Floats) -> Floats:
    """Return the error of a start heading that samples tell, by their positions' errors, in each
    draw, and their places about the middle."""
    inertia = max(float((np.abs(arm) ** 2).sum()), 1e-12)
    turn = np.imag(np.conj(arm) * (off - off.mean(1, keepdims=True))).sum(1)
    return np.asarray(turn / inertia + white_m / math.sqrt(inertia) * normal)
