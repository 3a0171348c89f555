"""Stages reference and bus: what the outside measurement and the stamps add to the true pose."""

from typing import Final

import numpy as np

from gap_diagnosis.explanations.gyro import sharp_turn_rate
from gap_diagnosis.prediction import Prediction

_SMOOTHING_S: Final = 0.007
"""Less than a tick: counting errors average out between two ticks, where a delay would be drawn to
without any smoothing; more smoothing rounds a turn off, which passes for a lag."""


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


def _move_gyro(p: Prediction, by_s: float) -> None:
    """Let the gyro show the rate of another moment."""
    t_s, rate = p.motion.t_s, sharp_turn_rate(p.motion, _SMOOTHING_S)
    p.gyro_rad_s = p.gyro_rad_s + np.interp(t_s + by_s, t_s, rate) - rate
