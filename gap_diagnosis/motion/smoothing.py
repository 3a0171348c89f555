"""Wheel turns without the noise of counting: what effects are computed from."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from gap_diagnosis.bends import NORMAL_MAD
from gap_diagnosis.explanations.reference import (
    SHARP_S,
    USUAL_S,
    averaged,
    counting_slope,
    likely_signal,
    with_details,
)
from gap_diagnosis.motion.course import dead_reckoned
from gap_diagnosis.prediction import USUAL_CONTACT_M_PER_SQRT_M, Motion
from gap_diagnosis.recording import Floats

_SLOW_S: Final = 1.0
_NOISE_COUNTS_PER_S: Final = 25.0
"""A rate below this is hardly more than the noise of counting."""
FINE_RAD: Final = math.tau / 65_536
"""Wheels that say how fast they are do not round what they went to counts."""
_NOISY: Final = 0.07
_MOST_SMOOTHING_S: Final = 0.3
_BETWEEN: Final = 1.5 - math.sqrt(1.6)
"""Of the variance of white noise that a Gaussian leaves so much is not in one twice as wide."""
_HEARD_S: Final = 0.1
"""Over so long noise of speeds is heard beside a gyro: from row to row it may change by little."""
_LOUDEST: Final = 30.0
"""Of what is told: more is no noise, but a gyro of another unit."""
_LASTING_S: Final = 0.5
"""What smooth turns are behind the counted ones for longer than this is no rounding."""


def turn_smoothing_s(
    heading: Floats,
    speeds_m_s: Floats,
    wheelbase_m: float,
    step_s: float,
    told_rad2_per_s: float = 0.0,
) -> float:
    """Return over how long a turn rate is averaged, so that its change is that of the body.

    Wheels on a road slip to and fro, a random walk over the way, and a heavy body turns smoothly:
    where the slope of what they say is mostly their own noise, a late or lagging gyro would be
    told from it. It is a Gaussian that leaves of the noise 7 % of the slope. *speeds_m_s*:
    float64[2, n], each wheel's. *told_rad2_per_s*: what noise of their speeds adds to the heading's
    variance.
    """
    walk_rad2_per_s = USUAL_CONTACT_M_PER_SQRT_M**2 * float(speeds_m_s.sum(axis=0).mean())
    walk_rad2_per_s = walk_rad2_per_s / wheelbase_m**2 + told_rad2_per_s
    turn_rate = np.diff(heading, prepend=heading[0]) / step_s
    width_s = USUAL_S
    while width_s < _MOST_SMOOTHING_S:
        bends = np.gradient(gaussian_filter1d(turn_rate, max(width_s / step_s, 0.5)), step_s)
        noise = math.sqrt(walk_rad2_per_s / (4.0 * math.sqrt(math.pi) * width_s**3))
        if noise <= _NOISY * float(bends.std()):
            break
        width_s *= 1.1
    return width_s


def heard_rad2_per_s(
    told_rad2_per_s: float,
    beyond_rad_s: Floats,
    moves: NDArray[np.bool_],
    gyro_rad2_per_s: float,
    step_s: float,
) -> float:
    """Return what noise of speeds adds to a turn's variance [rad²/s], as the gyro shows it where
    that is more than told.

    A row tells noise from its neighbours by what changes between them; what lasts for some rows is
    a motion to them, and none to the gyro. *beyond_rad_s*: float64[n], turn rates of the wheels
    less the gyro's, of which those count that *move*, bool[n]; *gyro_rad2_per_s* is its own noise.
    """
    if told_rad2_per_s == 0.0 or not moves.any():
        return told_rad2_per_s
    width_s = max(_HEARD_S, step_s)
    less, more = (
        gaussian_filter1d(beyond_rad_s, width / step_s) for width in (width_s, 2.0 * width_s)
    )
    heard = (float(np.median(np.abs((less - more)[moves]))) / NORMAL_MAD) ** 2
    per_rad2_per_s = _BETWEEN * averaged(1.0, width_s)
    louder = heard / per_rad2_per_s - gyro_rad2_per_s
    return float(np.clip(louder, told_rad2_per_s, _LOUDEST * told_rad2_per_s))


def sharp_smoothing_s(turning_s: float) -> float:
    """Return what details of a turn rate are smoothed by, the more the more noise there is."""
    sharp_s = SHARP_S * (turning_s / USUAL_S) ** 2
    return sharp_s if sharp_s < turning_s else math.inf


def smoothed(motion: Motion) -> Motion:
    """Return the motion with smooth wheel turns: what effects are computed from.

    A column made of raw counts would carry the same quantisation noise as the data that it is
    compared with (errors in variables), and large amplitudes could cancel that noise.
    """
    tick_s = motion.tick_s
    left, right = motion.left_steady_rad, motion.right_steady_rad
    # Counts that are hardly more than noise are smoothed more anyway. Both sums by as much: of a
    # wheel that stands nothing must be left.
    is_speed = motion.rounding_rad == FINE_RAD
    least_s = motion.turning_s if is_speed else USUAL_S
    told_rad2_per_s = motion.told_rad2_per_s * (motion.wheelbase_m / motion.radius_m) ** 2
    # Rows that are uneven have uneven steps, which are no change of speed.
    long = motion.dt_s / tick_s if is_speed else np.ones_like(left)
    long[long <= 0.0] = 1.0
    ahead, turning = (
        _denoised(_begun(steps / long), tick_s, motion.rounding_rad, least_s, told_rad2_per_s)
        for steps in (right + left, right - left)
    )
    left, right = 0.5 * (ahead - turning) * long, 0.5 * (ahead + turning) * long
    left[0] = right[0] = 0.0
    x_m, y_m = dead_reckoned(0.5 * motion.radius_m * (left + right), motion.heading_rad)
    # What one wheel speeds up more than the other is the noise of counting on a straight.
    together = 0.5 * (motion.left_acceleration_rad_s2 + motion.right_acceleration_rad_s2)
    apart = gaussian_filter1d(np.gradient(turning / tick_s, tick_s), max(USUAL_S / tick_s, 0.5))
    geometry = motion.radius_m / motion.wheelbase_m
    turn = motion.turn_rate_rad_s * tick_s / geometry
    if is_speed:
        turn = _calm_where_it_lasts(turn, tick_s)
    else:
        turn = _denoised(turn, tick_s, motion.rounding_rad, USUAL_S, is_counted=False)
    rates = motion.left_rate_rad_s, motion.right_rate_rad_s
    if is_speed:
        rates = left / long / tick_s, right / long / tick_s
        together = gaussian_filter1d(
            np.gradient(0.5 * ahead / tick_s, tick_s), max(USUAL_S / tick_s, 0.5)
        )
    return replace(
        motion,
        x_m=x_m,
        y_m=y_m,
        turn_rate_rad_s=turn * geometry / tick_s,
        even_turn_rate_rad_s=gaussian_filter1d(
            motion.turn_rate_rad_s, max(USUAL_S / tick_s, 0.5), mode="nearest"
        ),
        # Smoother than the wheels by so much.
        turning_s=USUAL_S if is_speed else motion.turning_s,
        left_step_rad=left,
        right_step_rad=right,
        left_angle_rad=_within_its_turn(left, motion.left_angle_rad, tick_s),
        right_angle_rad=_within_its_turn(right, motion.right_angle_rad, tick_s),
        left_rate_rad_s=rates[0],
        right_rate_rad_s=rates[1],
        left_acceleration_rad_s2=together - 0.5 * apart,
        right_acceleration_rad_s2=together + 0.5 * apart,
    )


def _within_its_turn(step_rad: Floats, counted_rad: Floats, tick_s: float) -> Floats:
    """Return where a wheel is by smooth steps, as counted in what lasts.

    Of steps of eight counts smoothing lost one in six hundred: after three hundred turns a wheel
    out of round was looked for half a turn from where it is.
    """
    angle = np.cumsum(step_rad)
    return np.asarray(angle + gaussian_filter1d(counted_rad - angle, _LASTING_S / tick_s))


def sharpened(smooth: Motion) -> Motion:
    """Return smoothed wheel turns with as much of what smoothing rounded off as is no counting
    error: what large effects make of them is compared with counts that begin a turn more sharply.
    """
    if smooth.rounding_rad == FINE_RAD:
        return smooth
    tick_s = smooth.tick_s
    left, right = smooth.left_step_rad, smooth.right_step_rad
    width = USUAL_S / tick_s
    # Of the sum of two counters.
    noise = 2.0 * counting_slope(width) * smooth.rounding_rad**2
    ahead, turning = (
        with_details(_begun(steps), width, noise, tick_s) for steps in (right + left, right - left)
    )
    left, right = 0.5 * (ahead - turning), 0.5 * (ahead + turning)
    left[0] = right[0] = 0.0
    turning_s = math.hypot(smooth.turning_s, USUAL_S)
    return replace(smooth, left_step_rad=left, right_step_rad=right, turning_s=turning_s)


def _begun(step_rad: Floats) -> Floats:
    """Return steps with a first one: a log that begins in motion has none, but that is no stop."""
    return np.append(step_rad[1:2], step_rad[1:])


def _denoised(
    step_rad: Floats,
    tick_s: float,
    rad_per_count: float,
    least_s: float,
    told_rad2_per_s: float = 0.0,
    *,
    is_counted: bool = True,
) -> Floats:
    """Smooth steps a little where they are large, and much where they are hardly more than noise.

    On a straight the difference of two counts is nothing but their noise.
    """

    def smooth(width_s: float, values: Floats = step_rad) -> Floats:
        return np.asarray(gaussian_filter1d(values, max(width_s / tick_s, 0.5), mode="nearest"))

    rate = smooth(3 * USUAL_S) / tick_s
    noise = _NOISE_COUNTS_PER_S * rad_per_count
    size = np.abs(rate)
    if is_counted:
        # Where a turn only changes sides its rate is low for a moment, and nothing is calm. Details
        # are sought in what is left: a mean over the calm around would stand out of the turn.
        half = max(round(1.5 * USUAL_S / tick_s), 1)
        before, after = (maximum_filter1d(size, 2 * half + 1, origin=way) for way in (half, -half))
        size = np.minimum(before, after)
    calm = np.exp(-((size / noise) ** 2))
    # A mean over what is calm as well: a turn on the spot must not leak into the straight before.
    slow = smooth(_SLOW_S, calm * step_rad) / np.maximum(smooth(_SLOW_S, calm), 1e-9)
    return np.asarray(
        (1 - calm) * _followed(step_rad, tick_s, least_s, told_rad2_per_s) + calm * slow
    )


def _followed(step_rad: Floats, tick_s: float, least_s: float, told_rad2_per_s: float) -> Floats:
    """Smooth steps by a Gaussian of *least_s*, and by wider ones where what that takes away is
    likelier noise than a wheel's: white noise that adds so much to the variance of their sum."""

    def smooth(width_s: float) -> Floats:
        return np.asarray(gaussian_filter1d(step_rad, max(width_s / tick_s, 0.5), mode="nearest"))

    if told_rad2_per_s == 0.0:
        return smooth(least_s)
    widths_s = [least_s]
    while widths_s[-1] < _MOST_SMOOTHING_S:
        widths_s.append(2.0 * widths_s[-1])
    found = smooth(widths_s[-1])
    for narrow_s, wide_s in zip(widths_s[-2::-1], widths_s[:0:-1], strict=True):
        detail = smooth(narrow_s) - smooth(wide_s)
        noise = _BETWEEN * averaged(told_rad2_per_s, max(narrow_s, 0.5 * tick_s)) * tick_s**2
        found += likely_signal(detail, noise, tick_s) * detail
    return found


def _calm_where_it_lasts(step_rad: Floats, tick_s: float) -> Floats:
    """Smooth turns [rad per tick] of wheels that say speeds: a little, and much on long straights.

    Where a turn only changes sides its rate is low for a moment, and nothing is calm. Details are
    sought in what is left, to the fourth derivative: the passage from turn to straight must be as
    smooth as all else. Of a car, steps of 0.0005 rad/s at each change of sides had details of 0.06.
    """

    def smooth(values: Floats, width_s: float) -> Floats:
        return np.asarray(gaussian_filter1d(values, max(width_s / tick_s, 0.5), mode="nearest"))

    noise = _NOISE_COUNTS_PER_S * FINE_RAD
    calm = np.exp(-((smooth(step_rad, 3 * USUAL_S) / tick_s / noise) ** 2))
    lasting = minimum_filter1d(calm, 2 * max(round(1.5 * USUAL_S / tick_s), 1) + 1)
    slow = smooth(lasting * step_rad, _SLOW_S) / np.maximum(smooth(lasting, _SLOW_S), 1e-9)
    passage = smooth(lasting, USUAL_S)
    return np.asarray((1 - passage) * smooth(step_rad, USUAL_S) + passage * slow)
