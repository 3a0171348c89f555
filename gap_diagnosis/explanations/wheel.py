"""Stage wheel: from the wheels' turns to steps over ground."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.explanations.gyro import sharp_turn_rate
from gap_diagnosis.explanations.reference import (
    SHARP_S,
    USUAL_S,
    counting_slope,
    likely_signal,
    with_details,
)
from gap_diagnosis.prediction import Motion, Prediction, told_once
from gap_diagnosis.recording import Floats

_SURELY: Final = 3.0
"""Standard deviations."""


def radius_scale(p: Prediction, *, scale: float) -> None:
    """Make both wheels larger."""
    p.left_m = p.left_m * (1 + scale)
    p.right_m = p.right_m * (1 + scale)


def radius_mismatch(p: Prediction, *, mismatch: float) -> None:
    """Make the right wheel larger and the left one smaller."""
    p.left_m = p.left_m * (1 - 0.5 * mismatch)
    p.right_m = p.right_m * (1 + 0.5 * mismatch)


def payload(p: Prediction, *, compression_left: float, compression_right: float) -> None:
    """Press the tyres."""
    p.left_m = p.left_m * (1 - compression_left)
    p.right_m = p.right_m * (1 - compression_right)


def tyre_drift(p: Prediction, *, rate: float) -> None:
    """Let both radii grow with time."""
    growth = 1 + rate * p.motion.elapsed_s
    p.left_m = p.left_m * growth
    p.right_m = p.right_m * growth


def wheelbase_scale(p: Prediction, *, scale: float) -> None:
    """Set the wheels farther apart."""
    p.wheelbase_m = p.wheelbase_m * (1 + scale)


def turn_scrub(p: Prediction, *, scrub: float) -> None:
    """Widen the effective wheelbase the more, the tighter the turn."""
    p.wheelbase_m = p.wheelbase_m * (1 + scrub * _spin(p.motion))


def exact_turn_scrub(p: Prediction, *, scrub: float) -> None:
    """Widen it as sharply as turns begin and end, and as a wheel goes through a stand."""
    p.wheelbase_m = p.wheelbase_m * (1 + scrub * _sharp_spin(p.motion))


@told_once
def _spin(m: Motion) -> Floats:
    """Return which share of the wheels' motion turns the body on the spot, float64[n]."""
    return _share_of_spin(m, *_across_and_along(m))


@told_once
def _sharp_spin(m: Motion) -> Floats:
    """Return the same as sharply as turns begin and end."""
    noise = _counting_rad_s(m) ** 2
    across, along = (
        with_details(one, USUAL_S / m.tick_s, noise, m.tick_s) for one in _across_and_along(m)
    )
    if m.has_counters:
        left, right = m.left_angle_rad, m.right_angle_rad
        across, along = _as_sharp(m, across, right - left), _as_sharp(m, along, right + left)
    return _share_of_spin(m, across, along)


def _as_sharp(motion: Motion, rate_rad_s: Floats, angle_rad: Floats) -> Floats:
    """Return a rate with as much of what is counted beyond it as is no counting error.

    Where a wheel turns back it sticks for less time than rates are averaged over, and the spin has
    its peak there: of a turn of 0.8 rad with a scrub of -0.4 it told 3 mrad wrong.
    """
    tick_s = motion.tick_s
    width = SHARP_S / tick_s
    counted = gaussian_filter1d(np.diff(angle_rad, prepend=angle_rad[0]), width) / tick_s
    noise = 2.0 * counting_slope(width) * (motion.rounding_rad / tick_s) ** 2
    beyond = with_details(counted, width, noise, tick_s) - rate_rad_s
    return np.asarray(rate_rad_s + likely_signal(beyond, noise, tick_s) * beyond)


def _across_and_along(motion: Motion) -> tuple[Floats, Floats]:
    """Return difference and sum of the wheels' rates [rad/s], float64[n] each."""
    left, right = motion.left_rate_rad_s, motion.right_rate_rad_s
    return right - left, right + left


def _share_of_spin(m: Motion, across_rad_s: Floats, along_rad_s: Floats) -> Floats:
    across, along = (_size(m, one) for one in (across_rad_s, along_rad_s))
    return np.asarray(across / np.maximum(across + along, 1e-9))


def scrub_of_line(straight: float) -> float:
    """Return the scrub that turns a robot on the spot as a straight line about none would.

    1 / (1 + scrub) = 1 - straight: of a scrub of -0.54 that line is one of -1.2, and there a robot
    would turn the other way.
    """
    return straight / (1.0 - straight) if straight < 1.0 else straight


def _size(motion: Motion, rate_rad_s: Floats) -> Floats:
    """Return the size of a sum of two wheels' rates, float64[n]; none within the noise of counting.

    The mean size of noise is not zero: a robot that turned on the spot would seem to go along by a
    thousandth, and its scrub be told short by as much.
    """
    size = np.abs(rate_rad_s)
    return np.where(size > _SURELY * _counting_rad_s(motion), size, 0.0)


def _counting_rad_s(motion: Motion) -> float:
    """Return the noise that counting leaves in the smoothed rates of two wheels together."""
    tick_s = motion.tick_s
    return math.sqrt(2.0 * counting_slope(USUAL_S / tick_s)) * motion.rounding_rad / tick_s


def longitudinal_slip(p: Prediction, *, compliance: float) -> None:
    """Let the wheels over-read when speeding up: c * a_wheel * sign(v_wheel)."""
    m = p.motion
    _lag_behind(p, compliance, m.left_acceleration_rad_s2, m.right_acceleration_rad_s2)


def creep_in_turns(p: Prediction, *, compliance: float) -> None:
    """Let the wheels over-read against each other when a turn speeds up, and not in common.

    Tyres creep with the force on them. A body's mass asks for one, its inertia about the vertical
    for another; where no motor turns it but steered wheels do, for none.
    """
    m = p.motion
    apart = 0.5 * (m.right_acceleration_rad_s2 - m.left_acceleration_rad_s2)
    _lag_behind(p, compliance, -apart, apart)


def _lag_behind(
    p: Prediction, compliance: float, left_rad_s2: Floats, right_rad_s2: Floats
) -> None:
    m = p.motion
    left = m.radius_m * left_rad_s2 * np.sign(m.left_rate_rad_s)
    right = m.radius_m * right_rad_s2 * np.sign(m.right_rate_rad_s)
    p.left_m = p.left_m * (1 - compliance * left)
    p.right_m = p.right_m * (1 - compliance * right)


def creep_of_the_body(p: Prediction, *, compliance: float) -> None:
    """Let both wheels over-read alike when the body speeds up: steered wheels turn a car, so that
    the turn asks its axle for no force along the way."""
    m = p.motion
    mean = 0.5 * (m.left_acceleration_rad_s2 + m.right_acceleration_rad_s2)
    _lag_behind(p, compliance, mean, mean)


def exact_longitudinal_slip(p: Prediction, *, compliance: float) -> None:
    """Let the wheels over-read when speeding up as sharply as they do.

    By speeds, which are told better than accelerations: over a while c * a * |v| dt adds up to
    c * v * |v| / 2. Not by those that wheels say: their noise is none of the way.
    """
    m = p.motion
    if _say_speeds(m):
        longitudinal_slip(p, compliance=compliance)
        return
    _lag_behind_exactly(p, compliance, m.left_step_rad, m.right_step_rad)


def exact_creep_of_the_body(p: Prediction, *, compliance: float) -> None:
    """Let both wheels over-read alike when the body speeds up as sharply as it does."""
    m = p.motion
    if _say_speeds(m):
        creep_of_the_body(p, compliance=compliance)
        return
    mean = 0.5 * (m.left_step_rad + m.right_step_rad)
    _lag_behind_exactly(p, compliance, mean, mean)


def _say_speeds(motion: Motion) -> bool:
    return bool(np.any(motion.wheel_unsure_rad2))


def _lag_behind_exactly(
    p: Prediction, compliance: float, left_step_rad: Floats, right_step_rad: Floats
) -> None:
    m = p.motion
    left, right = (
        compliance * _growth_of_half_square(m.radius_m * step / m.tick_s)
        for step in (left_step_rad, right_step_rad)
    )
    p.left_m = p.left_m - left
    p.right_m = p.right_m - right


def _growth_of_half_square(mean: Floats) -> Floats:
    """Return by how much half the signed square of a speed, told as each tick's mean, grows from
    end to end; the ends by the cubic through the way at four ticks about each."""
    around = np.concatenate((mean[:1], mean, mean[-1:], mean[-1:]))
    at_end = (7.0 * (around[1:-2] + around[2:-1]) - around[:-3] - around[3:]) / 12.0
    half = 0.5 * at_end * np.abs(at_end)
    return np.diff(half, prepend=half[:1])  # a log may begin in motion


def creep_under_load(p: Prediction, *, compliance: float) -> None:
    """Let the wheel that a turn relieves creep the more, and the one it presses the less: a tyre is
    the stiffer along its way, the more it bears."""
    m = p.motion
    wheel = 0.5 * m.radius_m * (m.left_acceleration_rad_s2 + m.right_acceleration_rad_s2)
    share = compliance * wheel * np.sign(m.speed_m_s) * m.speed_m_s * m.turn_rate_rad_s
    p.left_m = p.left_m * (1 - share)
    p.right_m = p.right_m * (1 + share)


def creep_of_driven_wheels(p: Prediction, *, compliance: float) -> None:
    """Let wheels creep more when speeding up, and less when slowing down: few of a car's are
    driven, and all have brakes."""
    m = p.motion
    wheel = 0.5 * m.radius_m * np.abs(m.left_acceleration_rad_s2 + m.right_acceleration_rad_s2)
    p.left_m = p.left_m * (1 - compliance * wheel)
    p.right_m = p.right_m * (1 - compliance * wheel)


def slip_left(p: Prediction, *, ratio: float, start_s: float, stop_s: float) -> None:
    """Let the left wheel slip in a window."""
    inside = _inside(p.motion, start_s, stop_s)
    p.left_m = np.where(inside, p.left_m * (1 - ratio), p.left_m)


def slip_right(p: Prediction, *, ratio: float, start_s: float, stop_s: float) -> None:
    """Let the right wheel slip in a window."""
    inside = _inside(p.motion, start_s, stop_s)
    p.right_m = np.where(inside, p.right_m * (1 - ratio), p.right_m)


def _inside(motion: Motion, start_s: float, stop_s: float) -> NDArray[np.bool_]:
    """Tell which ticks' steps lie in a window for their greater part, bool[n]."""
    middle_s = motion.t_s - 0.5 * motion.dt_s
    return np.asarray((middle_s >= start_s) & (middle_s < stop_s))


def lateral_slip(p: Prediction, *, compliance: float, speed: float) -> None:
    """Slide outward in turns: v_y = -c * v * omega, where c holds at a speed and grows with it, as
    a tyre's slip angle does with the force to the side; at any speed, if that is 0."""
    _slide_outward(p, compliance, speed, p.motion.turn_rate_rad_s)


def exact_lateral_slip(p: Prediction, *, compliance: float, speed: float) -> None:
    """Slide outward in turns as sharp as they are, by the counters where there are any."""
    _slide_outward(p, compliance, speed, sharp_turn_rate(p.motion))


def _slide_outward(p: Prediction, compliance: float, speed: float, turn_rate_rad_s: Floats) -> None:
    share = np.abs(p.motion.speed_m_s) / speed if speed > 0 else 1.0
    p.lateral_m = p.lateral_m - compliance * share * p.forward_m * turn_rate_rad_s


def pressed_outside(p: Prediction, *, compliance: float) -> None:
    """Let the outer wheel roll on a radius smaller by c * |v * omega|, the inner one on a larger: a
    turn moves load from the inner tyre to the outer one."""
    m = p.motion
    share = compliance * m.speed_m_s * m.turn_rate_rad_s
    p.left_m = p.left_m * (1 + share)
    p.right_m = p.right_m * (1 - share)


def cross_slope_drift(p: Prediction, *, north: float, east: float) -> None:
    """Slide downhill: v_y = |v| * ratio * sin(direction - heading), from ratio*(cos, sin)."""
    heading = p.motion.heading_rad
    down = north * -np.sin(heading) + east * np.cos(heading)
    p.lateral_m = p.lateral_m + np.abs(p.forward_m) * down


def grade_slip(p: Prediction, *, north: float, east: float) -> None:
    """Go farther downhill: 1 + ratio * sign(v) * cos(direction - heading)."""
    heading = p.motion.heading_rad
    down = north * np.cos(heading) + east * np.sin(heading)
    p.left_m = p.left_m * (1 + np.sign(p.left_m) * down)
    p.right_m = p.right_m * (1 + np.sign(p.right_m) * down)


def wheel_eccentricity_left(p: Prediction, *, cosine: float, sine: float) -> None:
    """Vary the left radius once per turn: 1 + cosine*cos(phi) + sine*sin(phi)."""
    angle = p.motion.left_angle_rad - 0.5 * p.motion.left_step_rad
    p.left_m = p.left_m * (1 + cosine * np.cos(angle) + sine * np.sin(angle))


def wheel_eccentricity_right(p: Prediction, *, cosine: float, sine: float) -> None:
    """Vary the right radius once per turn: 1 + cosine*cos(phi) + sine*sin(phi)."""
    angle = p.motion.right_angle_rad - 0.5 * p.motion.right_step_rad
    p.right_m = p.right_m * (1 + cosine * np.cos(angle) + sine * np.sin(angle))
