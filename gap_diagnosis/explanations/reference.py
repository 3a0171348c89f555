"""Stages reference and bus: what the outside measurement and the stamps add to the true pose."""

from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats

_SHARP_S: Final = 0.015


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


def late_gyro(p: Prediction, *, delay: float) -> None:
    """Stamp the gyro so late that every detail of a turn shows it."""
    _move_in_detail(p, -delay)


def late_counts(p: Prediction, *, delay: float) -> None:
    """Stamp the counts so late that every detail of a turn shows it."""
    encoder_latency(p, delay=delay)
    _move_in_detail(p, delay)


def _move_in_detail(p: Prediction, by_s: float) -> None:
    t_s, rate = p.motion.t_s, detailed_turn_rate(p.motion)
    p.gyro_rad_s = p.gyro_rad_s + np.interp(t_s + by_s, t_s, rate) - rate


def detailed_turn_rate(motion: Motion) -> Floats:
    """Return the mean turn rate of each tick, smoothed by no more than the rounding of counts."""
    step_s = float(np.median(motion.dt_s[1:]))
    heading = gaussian_filter1d(motion.heading_rad, _SHARP_S / step_s, mode="nearest")
    turn = np.diff(heading, prepend=heading[0])
    return np.asarray(turn / np.maximum(motion.dt_s, 1e-9))


def _move_gyro(p: Prediction, by_s: float) -> None:
    """Let the gyro show the rate of another moment."""
    t_s, rate = p.motion.t_s, p.motion.turn_rate_rad_s
    p.gyro_rad_s = p.gyro_rad_s + np.interp(t_s + by_s, t_s, rate) - rate
