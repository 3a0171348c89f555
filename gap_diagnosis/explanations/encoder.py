"""Stage encoder: from what was counted back to what the wheels really turned."""

import math
from typing import Final

import numpy as np

from gap_diagnosis.prediction import Motion, Prediction, told_once
from gap_diagnosis.recording import Floats
from gap_diagnosis.wheel_speeds import OwnSpeed

_TURNS: Final = 5
"""So often an angle is put right by the error at it: of 0.1 rad there remains a millionth."""


def ticks_per_rev(p: Prediction, *, scale: float) -> None:
    """Count more per turn than described: each count is a smaller turn."""
    p.left_rad = p.left_rad / (1 + scale)
    p.right_rad = p.right_rad / (1 + scale)


def _true_steps(angle: Floats, step: Floats, sine: float, cosine: float) -> Floats:
    """Undo measured = phi + A sin(phi + phase), with A cos(phase) = sine's coefficient.

    Angles are counted from where the log begins, at phi = 0; there the encoder shows *cosine*.
    """

    return np.asarray(step - _error_at(angle, sine, cosine) + _error_at(angle - step, sine, cosine))


def _error_at(counted: Floats, sine: float, cosine: float) -> Floats:
    """Return the error that the encoder shows where it has counted so far."""
    amplitude, phase = math.hypot(sine, cosine), math.atan2(cosine, sine)
    phi = measured = counted + (cosine + phase)
    for _ in range(_TURNS):
        off = amplitude * np.sin(phi)
        phi = measured - off
    return np.asarray(off)


def _without_errors(angle: Floats, step: Floats, sine: float, cosine: float) -> Floats:
    """Undo the same in steps that are not those of the angles, which are as counted.

    The error is that of the angle counted: of a smooth one what wobbles is less by what smoothing
    takes of a turn, and a large eccentricity is told off by its square.
    """
    error = _error_at(angle, sine, cosine)
    return np.asarray(step - np.diff(error, prepend=error[0]))


def encoder_eccentricity_left(p: Prediction, *, sine: float, cosine: float) -> None:
    """Read the left angle with an error once per turn: sine*sin(phi) + cosine*cos(phi)."""
    p.left_rad = _true_steps(p.motion.left_angle_rad, p.left_rad, sine, cosine)


def encoder_eccentricity_right(p: Prediction, *, sine: float, cosine: float) -> None:
    """Read the right angle with an error once per turn: sine*sin(phi) + cosine*cos(phi)."""
    p.right_rad = _true_steps(p.motion.right_angle_rad, p.right_rad, sine, cosine)


def exact_encoder_eccentricity_left(p: Prediction, *, sine: float, cosine: float) -> None:
    """Read the left angle with an error once per turn as counted."""
    p.left_rad = _without_errors(p.motion.left_angle_rad, p.left_rad, sine, cosine)


def exact_encoder_eccentricity_right(p: Prediction, *, sine: float, cosine: float) -> None:
    """Read the right angle with an error once per turn as counted."""
    p.right_rad = _without_errors(p.motion.right_angle_rad, p.right_rad, sine, cosine)


def missed_ticks_left(
    p: Prediction, *, probability: float, threshold: float, about: float | None = None
) -> None:
    """Lose left counts above a wheel speed: the wheel turned farther.

    *about*: where it is too fast if they are lost with this probability.
    """
    own = own_speed(p.motion, "left", probability if about is None else about, threshold)
    p.left_rad = p.left_rad / (1 - own.share_above * probability)


def missed_ticks_right(
    p: Prediction, *, probability: float, threshold: float, about: float | None = None
) -> None:
    """Lose right counts above a wheel speed: the wheel turned farther.

    *about*: where it is too fast if they are lost with this probability.
    """
    own = own_speed(p.motion, "right", probability if about is None else about, threshold)
    p.right_rad = p.right_rad / (1 - own.share_above * probability)


def own_speed(motion: Motion, side: str, probability: float, threshold_rad_s: float) -> OwnSpeed:
    """Return how fast a wheel turns if it loses counts above a threshold."""
    known = motion.wheel_speeds.both[0 if side == "left" else 1]
    return known.losing(threshold_rad_s, probability)


def extra_ticks_left(p: Prediction, *, rate: float) -> None:
    """Count without motion on the left: in the mean, so many counts are taken off."""
    p.left_rad = p.left_rad - rate * p.motion.dt_s * p.motion.rad_per_count


def extra_ticks_right(p: Prediction, *, rate: float) -> None:
    """Count without motion on the right: in the mean, so many counts are taken off."""
    p.right_rad = p.right_rad - rate * p.motion.dt_s * p.motion.rad_per_count


def encoder_dead_left(p: Prediction, *, start_s: float, stop_s: float) -> None:
    """Count nothing on the left: the gyro, or else the reference, and the right wheel tell what it
    did."""
    inside = (p.motion.t_s > start_s) & (p.motion.t_s <= stop_s)
    p.left_rad = np.where(inside, p.right_rad - _turn_meanwhile_rad(p.motion), p.left_rad)


def encoder_dead_right(p: Prediction, *, start_s: float, stop_s: float) -> None:
    """Count nothing on the right: the gyro, or else the reference, and the left wheel tell what it
    did."""
    inside = (p.motion.t_s > start_s) & (p.motion.t_s <= stop_s)
    p.right_rad = np.where(inside, p.left_rad + _turn_meanwhile_rad(p.motion), p.right_rad)


@told_once
def turn_by_gyro_rad(motion: Motion) -> Floats:
    """Return right - left wheel turn of each tick as the gyro tells it; zeros without one."""
    if motion.gyro_turn_rad is None:
        return np.zeros(len(motion.t_s))
    turn = np.diff(motion.gyro_turn_rad, prepend=motion.gyro_turn_rad[0])
    return np.asarray(turn * motion.wheelbase_m / motion.radius_m)


def _turn_meanwhile_rad(motion: Motion) -> Floats:
    """Return the same of a wheel that is not counted; without a gyro as the estimated motion has
    it, which a reference with headings tells: along a straight guess a robot that turns by rounds
    is nowhere near."""
    if motion.gyro_turn_rad is not None:
        return turn_by_gyro_rad(motion)
    turn = np.diff(motion.heading_rad, prepend=motion.heading_rad[0])
    return np.asarray(turn * motion.wheelbase_m / motion.radius_m)


def encoder_wrap(p: Prediction, *, bits: int) -> None:
    """Undo the jumps of a counter that is narrower than described."""
    if bits == p.motion.wrap_bits:
        p.left_rad = p.left_rad - p.motion.left_jump_rad
        p.right_rad = p.right_rad - p.motion.right_jump_rad


def wheels_swapped(p: Prediction) -> None:
    """Exchange left and right."""
    p.left_rad, p.right_rad = p.right_rad, p.left_rad


def left_factor(p: Prediction, *, factor: float) -> None:
    """Read the left counts wrong by a factor."""
    p.left_rad = p.left_rad / factor


def right_factor(p: Prediction, *, factor: float) -> None:
    """Read the right counts wrong by a factor."""
    p.right_rad = p.right_rad / factor
