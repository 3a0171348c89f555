"""Stages reference and bus: what the outside measurement and the stamps add to the true pose."""

import math
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from gap_diagnosis.prediction import Motion, Prediction, told_once
from gap_diagnosis.recording import Floats

SHARP_S: Final = 0.015
USUAL_S: Final = 0.05
"""Of the Gaussian that a turn rate is smoothed by."""
_AROUND_S: Final = 0.1
_COUNT_SD: Final = 0.5
"""Of one reading of a counter, in counts: more than rounding makes."""
_STANDS_OUT: Final = 4.0
_GROWING: Final = 12.0
"""Where a turn begins sharply the second term is some times as large as the first; at an edge that
smoothing itself has made, a hundred times."""


def reference_yaw(p: Prediction, *, angle: float) -> None:
    """Report a heading that is too high."""
    p.reference_heading_rad = p.reference_heading_rad + angle


def reference_lever_arm(p: Prediction, *, x: float, y: float) -> None:
    """Track a point off the axle's middle."""
    p.reference_forward_m = p.reference_forward_m + x
    p.reference_left_m = p.reference_left_m + y


def reference_time_offset(p: Prediction, *, offset: float) -> None:
    """Stamp the reference late."""
    p.reference_delay_s = p.reference_delay_s + offset


def reference_clock_skew(p: Prediction, *, skew: float) -> None:
    """Let the reference's clock run fast."""
    # A stamp is (1 + skew) times the true time; what is at hand is the time of the stamp.
    p.reference_delay_s = p.reference_delay_s + skew / (1 + skew) * p.motion.elapsed_s


def reference_scale(p: Prediction, *, scale: float) -> None:
    """Report distances that are too long."""
    p.reference_scale += scale


def smoothed_reference(p: Prediction, *, spread: float) -> None:
    """Let the reference report a mean of poses around the one that it stamps, of *spread* [s²] half
    the variance of when they are of: of a filter with time constant T, beside its delay, T²/2.

    A mean of x(t) over times of variance V is x + V/2 · x'' (its expansion in moments).
    """
    m = p.motion
    speeding_up = np.gradient(m.turn_rate_rad_s, m.t_s)
    p.reference_forward_m = p.reference_forward_m + spread * m.acceleration_m_s2
    p.reference_left_m = p.reference_left_m + spread * m.speed_m_s * m.turn_rate_rad_s
    p.reference_heading_rad = p.reference_heading_rad + spread * speeding_up


def encoder_latency(p: Prediction, *, delay: float) -> None:
    """Stamp the counts late: they show where the wheels were before."""
    p.encoder_delay_s = p.encoder_delay_s + delay


def gyro_latency(p: Prediction, *, delay: float) -> None:
    """Stamp the gyro late: it shows the rate of a moment ago."""
    _move_gyro(p, -delay)


def sensors_latency(p: Prediction, *, delay: float) -> None:
    """Stamp counts and gyro late by the same."""
    encoder_latency(p, delay=delay)


def counts_latency(p: Prediction, *, delay: float) -> None:
    """Stamp the counts late, the gyro not: against the counts' clock the gyro is early."""
    encoder_latency(p, delay=delay)
    _move_gyro(p, delay)


def right_later_than_left(p: Prediction, *, delay: float) -> None:
    """Read the right wheel's counts later than the left's by *delay*, each by half of it."""
    m = p.motion
    left, right = (
        0.5 * delay * m.radius_m * np.diff(rate, prepend=rate[0])
        for rate in (m.left_rate_rad_s, m.right_rate_rad_s)
    )
    p.left_m = p.left_m + left
    p.right_m = p.right_m - right


def exact_gyro_latency(p: Prediction, *, delay: float) -> None:
    """Stamp the gyro late, with those details of the rate that are no counting errors."""
    _move(p, -delay, turn_rate_with_details(p.motion))


def exact_counts_latency(p: Prediction, *, delay: float) -> None:
    """Stamp the counts late, with those details of the rate that are no counting errors."""
    encoder_latency(p, delay=delay)
    _move(p, delay, turn_rate_with_details(p.motion))


def late_gyro(p: Prediction, *, delay: float) -> None:
    """Stamp the gyro so late that every detail of a turn shows it."""
    _move_in_detail(p, -delay)


def late_counts(p: Prediction, *, delay: float) -> None:
    """Stamp the counts so late that every detail of a turn shows it."""
    encoder_latency(p, delay=delay)
    _move_in_detail(p, delay)


def _move_in_detail(p: Prediction, by_s: float) -> None:
    _move(p, by_s, detailed_turn_rate(p.motion))


@told_once
def detailed_turn_rate(motion: Motion) -> Floats:
    """Return the mean turn rate of each tick, smoothed by no more than its noise asks for."""
    if motion.sharp_s == np.inf:
        return motion.turn_rate_rad_s
    step_s = motion.tick_s
    heading = gaussian_filter1d(motion.heading_rad, motion.sharp_s / step_s, mode="nearest")
    turn = np.diff(heading, prepend=heading[0])
    return np.asarray(turn / np.maximum(motion.dt_s, 1e-9))


@told_once
def turn_rate_with_details(motion: Motion) -> Floats:
    """Return the smooth turn rate with as much of its details as is no counting error.

    Details are what smoothing rounded off. Of finer ones, as they are counted, the counting errors
    are the smooth rate's own: along it they pass for turns that begin more sharply. What is
    likelier signal than noise is told by its power around (the local Wiener filter of Lee 1980,
    IEEE PAMI 2). Of a rate that is smoother on straights they would be the edges where those end:
    where a slow turn changed sides, 0.3 rad/s in one of 0.03.
    """
    smooth = motion.turn_rate_rad_s
    if motion.sharp_s == np.inf:
        return smooth
    even = smooth if motion.even_turn_rate_rad_s is None else motion.even_turn_rate_rad_s
    step_s = motion.tick_s
    width_s = _smoothed_by_s(motion)
    per_count = np.sqrt(2.0) * motion.radius_m / motion.wheelbase_m * motion.rounding_rad
    noise = counting_slope(width_s / step_s) * (per_count / step_s) ** 2
    noise += averaged(motion.told_rad2_per_s, width_s)
    details = with_details(even, width_s / step_s, noise, step_s) - even
    return np.asarray(smooth + details)


def _smoothed_by_s(motion: Motion) -> float:
    """Return over how long the turn rate is smooth: once by more, the more noise there is, and then
    once by the usual."""
    return USUAL_S * math.hypot(1.0, math.sqrt(motion.sharp_s / SHARP_S))


def sharp_turn_rate_by_wheels(p: Prediction) -> Floats:
    """Return the smooth turn rate with those details that the wheels have of it, float64[n].

    Of a wheel whose encoder died nothing but the details is believed: what lasts is estimated.
    """
    motion = p.motion
    if motion.sharp_s == np.inf:
        return motion.turn_rate_rad_s
    by_wheels = wheels_turn_rate(p)
    lasting = gaussian_filter1d(by_wheels, _smoothed_by_s(motion) / motion.tick_s, mode="nearest")
    return np.asarray(motion.turn_rate_rad_s + by_wheels - lasting)


def wheels_turn_rate(p: Prediction) -> Floats:
    """Return the mean turn rate of each tick as the wheels tell it, float64[n].

    The estimated heading is bent onto the reference: of a turn at another time, by another clock,
    an error of a thousandth is as much as a lag is told to. What the description has wrong of the
    wheels is told beside (`constants_beside`). A table's rows, and speeds, are no such counts.
    """
    motion = p.motion
    if not motion.has_counters or motion.sharp_s == np.inf:
        return turn_rate_with_details(motion)
    turn = motion.radius_m * (motion.right_step_rad - motion.left_step_rad) / motion.wheelbase_m
    return np.asarray(turn / motion.tick_s + p.showed_rad_s)


def with_details(smooth: Floats, width: float, noise: float, step_s: float) -> Floats:
    """Return what a Gaussian of *width* ticks has smoothed, with as much of what that rounded off
    as is no *noise* (the variance that it left)."""
    once, twice = rounded_off(smooth, width)
    detail = once + twice
    first, second = (_power_around(one, step_s) for one in (once, twice))
    share = likely_signal(detail, noise, step_s)
    # A series whose terms grow tells nothing: there the smooth rate has an edge of its own making.
    is_smooth = second < _GROWING**2 * first
    # Nor do those that are larger than what the rate does around: no Gaussian rounds off so much.
    is_smooth &= _power_around(detail, step_s) < _range_around(smooth, width, step_s) ** 2
    return np.asarray(smooth + np.where(is_smooth, share, 0.0) * detail)


def likely_signal(detail: Floats, noise: float, step_s: float) -> Floats:
    """Return what share of a detail is likelier signal than *noise* (its variance), by its power
    around."""
    power = _power_around(detail, step_s)
    return np.asarray(np.maximum(1.0 - _STANDS_OUT * noise / np.maximum(power, 1e-300), 0.0))


def _power_around(series: Floats, step_s: float) -> Floats:
    """Return the mean square of a series around each of its values."""
    return np.asarray(gaussian_filter1d(series**2, _AROUND_S / step_s, mode="nearest"))


def _range_around(smooth: Floats, width: float, step_s: float) -> Floats:
    """Return between which values a series stays within three Gaussians of *width* ticks of all
    that its power around is of: at a ramp's foot the ramp counts."""
    size = 2 * math.ceil(3.0 * (width + _AROUND_S / step_s)) + 1
    return np.asarray(maximum_filter1d(smooth, size) - minimum_filter1d(smooth, size))


def averaged(rad2_per_s: float, width_s: float) -> float:
    """Return the variance [rad²/s²] of a turn rate whose white noise adds so much to the turn's
    variance in 1 s, smoothed by a Gaussian of *width_s*."""
    return rad2_per_s / (2.0 * math.sqrt(math.pi) * width_s)


def counting_slope(width: float) -> float:
    """Return the variance [counts² per tick²] of the slope of a counter's readings, whose errors
    are independent, smoothed by a Gaussian of *width* ticks."""
    return _COUNT_SD**2 * min(2.0, 1.0 / (4.0 * math.sqrt(math.pi) * width**3))


def rounded_off(smooth: Floats, width: float) -> tuple[Floats, Floats]:
    """Return the first two terms of what a Gaussian of *width* ticks rounded off.

    exp(k²/2) = 1 + k²/2 + k⁴/8 …: of how sharply a turn begins a twenty-fifth was missing, and a
    lag read too long by as much.
    """
    bend = np.gradient(np.gradient(smooth))
    once = -(width**2) / 2.0 * bend
    twice = width**4 / 8.0 * np.gradient(np.gradient(bend))
    return np.asarray(once), np.asarray(twice)


def seen(p: Prediction, rate: Floats) -> Floats:
    """Return the rate that the gyro reads so far, where by the description it turns at *rate*.

    A late gyro shows late what it trails, and the turn of a wider wheelbase as well.
    """
    return np.asarray(rate + (p.gyro_rad_s - p.motion.turn_rate_rad_s))


def _move_gyro(p: Prediction, by_s: float) -> None:
    """Let the gyro show the rate of another moment."""
    _move(p, by_s, p.motion.turn_rate_rad_s)


def _move(p: Prediction, by_s: float, rate: Floats) -> None:
    t_s = p.motion.t_s
    rate = seen(p, rate)
    p.gyro_rad_s = p.gyro_rad_s + np.interp(t_s + by_s, t_s, rate) - rate
