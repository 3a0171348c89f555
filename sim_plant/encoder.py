"""Stage encoder: wheel angles to wrapping counters.

`counter` is real hardware: floor(true cumulative ticks + n_k), n_k white. `lesson_counter` carries
the lesson's increments on a counter: half-even rounding of the running sum of
(round(increment) + n_k).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

# Four edges make one electrical turn.
_TICKS_PER_ELECTRICAL_RAD = 4.0 / (2.0 * math.pi)
# More spurious counts in one tick than this are not told apart.
_MOST_STRAYS = 10_000

PARAMETERS = [
    ("lesson_counter", "i8"),
    ("ticks_per_rad", "f8"),
    ("counter_mask", "i8"),
    ("noise_ticks", "f8"),
    ("encoder_eccentricity_left_rad", "f8"),
    ("encoder_eccentricity_right_rad", "f8"),
    ("encoder_eccentricity_phase_left_rad", "f8"),
    ("encoder_eccentricity_phase_right_rad", "f8"),
    ("dead_left_s", "f8"),
    ("dead_right_s", "f8"),
    ("missed_left", "f8"),
    ("missed_right", "f8"),
    ("missed_step_ticks", "f8"),
    ("extra_left_per_s", "f8"),
    ("extra_right_per_s", "f8"),
    ("quadrature_left_ticks", "f8"),
    ("quadrature_right_ticks", "f8"),
]

# Of the motion part: what keeps the counts going on where the encoder changes in a run.
MOTION_STATE = [("left_offset_ticks", "f8"), ("right_offset_ticks", "f8")]

# Without noise: cumulative ticks, how far each encoder turned in the tick [ticks], the lesson's
# whole-tick increment, and whether a count is held.
SAMPLE = [
    ("left_ticks", "f8"),
    ("right_ticks", "f8"),
    ("left_turned_ticks", "f8"),
    ("right_turned_ticks", "f8"),
    ("left_increment", "f8"),
    ("right_increment", "f8"),
    ("left_dead", "i8"),
    ("right_dead", "i8"),
]

STATE = [
    ("left_sum_ticks", "f8"),
    ("right_sum_ticks", "f8"),
    ("left_count", "i8"),
    ("right_count", "i8"),
    ("left_last_ticks", "f8"),
    ("right_last_ticks", "f8"),
    ("left_stray_ticks", "f8"),
    ("right_stray_ticks", "f8"),
]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS` but for `lesson_counter`, which the caller chooses."""
    encoder = description.encoder
    m = mechanisms
    ticks_per_rad = encoder.ticks_per_rev * (1.0 + m.ticks_scale) / (2.0 * math.pi)
    bits = min(m.encoder_wrap_bits or encoder.counter_bits, encoder.counter_bits)
    return {
        "ticks_per_rad": ticks_per_rad,
        "counter_mask": (1 << bits) - 1,
        "noise_ticks": encoder.noise_ticks,
        "encoder_eccentricity_left_rad": m.encoder_eccentricity_left_rad,
        "encoder_eccentricity_right_rad": m.encoder_eccentricity_right_rad,
        "encoder_eccentricity_phase_left_rad": m.encoder_eccentricity_phase_left_rad,
        "encoder_eccentricity_phase_right_rad": m.encoder_eccentricity_phase_right_rad,
        "dead_left_s": m.encoder_dead_left_s,
        "dead_right_s": m.encoder_dead_right_s,
        "missed_left": m.missed_ticks_left,
        "missed_right": m.missed_ticks_right,
        "missed_step_ticks": m.missed_ticks_threshold_rad_s * tick_s * ticks_per_rad,
        "extra_left_per_s": m.extra_ticks_left_per_s,
        "extra_right_per_s": m.extra_ticks_right_per_s,
        "quadrature_left_ticks": m.quadrature_left_rad * _TICKS_PER_ELECTRICAL_RAD,
        "quadrature_right_ticks": m.quadrature_right_rad * _TICKS_PER_ELECTRICAL_RAD,
    }


@inlined
def measured_angle_rad(angle_rad: float, amplitude_rad: float, phase_rad: float) -> float:
    """Return the angle an eccentric disc or magnet shows: φ + A·sin(φ + phase)."""
    if amplitude_rad == 0.0:
        return angle_rad
    return angle_rad + amplitude_rad * math.sin(angle_rad + phase_rad)


@inlined
def ideal_ticks(
    p: Any, angle_rad: float, amplitude_rad: float, phase_rad: float
) -> tuple[float, float]:
    """Return the angle that an encoder without noise shows [rad], and its ticks."""
    shown_rad = measured_angle_rad(angle_rad, amplitude_rad, phase_rad)
    return shown_rad, shown_rad * p.ticks_per_rad


@inlined
def change_encoders(before: Any, after: Any, s: Any) -> None:
    """Let the counts go on from where they are when the encoders change."""
    for p, sign in ((before, 1.0), (after, -1.0)):
        _, left = ideal_ticks(
            p,
            s.motor_left_rad,
            p.encoder_eccentricity_left_rad,
            p.encoder_eccentricity_phase_left_rad,
        )
        _, right = ideal_ticks(
            p,
            s.motor_right_rad,
            p.encoder_eccentricity_right_rad,
            p.encoder_eccentricity_phase_right_rad,
        )
        s.left_offset_ticks += sign * left
        s.right_offset_ticks += sign * right


@inlined
def observe_encoders(p: Any, s: Any, out: Any, time_s: float) -> None:
    """Write what ideal encoders show at the end of a tick."""
    left_rad, left_ticks = ideal_ticks(
        p,
        s.motor_left_rad,
        p.encoder_eccentricity_left_rad,
        p.encoder_eccentricity_phase_left_rad,
    )
    right_rad, right_ticks = ideal_ticks(
        p,
        s.motor_right_rad,
        p.encoder_eccentricity_right_rad,
        p.encoder_eccentricity_phase_right_rad,
    )
    left_step_rad, right_step_rad = s.motor_step_left_rad, s.motor_step_right_rad
    if p.encoder_eccentricity_left_rad != 0.0:
        left_step_rad = left_rad - measured_angle_rad(
            s.motor_left_rad - left_step_rad,
            p.encoder_eccentricity_left_rad,
            p.encoder_eccentricity_phase_left_rad,
        )
    if p.encoder_eccentricity_right_rad != 0.0:
        right_step_rad = right_rad - measured_angle_rad(
            s.motor_right_rad - right_step_rad,
            p.encoder_eccentricity_right_rad,
            p.encoder_eccentricity_phase_right_rad,
        )
    out.left_ticks = left_ticks + s.left_offset_ticks
    out.right_ticks = right_ticks + s.right_offset_ticks
    out.left_turned_ticks = s.motor_step_left_rad * p.ticks_per_rad
    out.right_turned_ticks = s.motor_step_right_rad * p.ticks_per_rad
    out.left_increment = np.rint(left_step_rad * p.ticks_per_rad)
    out.right_increment = np.rint(right_step_rad * p.ticks_per_rad)
    out.left_dead = time_s >= p.dead_left_s
    out.right_dead = time_s >= p.dead_right_s


@inlined
def edge_count(ticks: float, shift_ticks: float) -> float:
    """Return the edges passed when those of channel B, the odd ones, come late by a shift."""
    below: float = np.floor(ticks)
    if shift_ticks == 0.0:
        return below
    is_odd = below % 2.0 == 1.0
    if is_odd and ticks < below + shift_ticks:
        return below - 1.0
    if not is_odd and ticks >= below + 1.0 + shift_ticks:
        return below + 1.0
    return below


@inlined
def binomial(trials: float, probability: float, normal: float) -> float:
    """Return how many of so many trials happen, from one standard normal (inverse of the CDF)."""
    left = 0.5 * math.erfc(-normal / math.sqrt(2.0))
    if probability >= 1.0:
        return trials
    odds = probability / (1.0 - probability)
    chance = (1.0 - probability) ** trials
    happened = 0.0
    while left > chance and happened < trials:
        left -= chance
        chance *= odds * (trials - happened) / (happened + 1.0)
        happened += 1.0
    return happened


@inlined
def poisson(mean: float, normal: float) -> float:
    """Return how many events happen, from one standard normal (inverse of the CDF)."""
    if mean > 500.0:  # as good as normal, and exp(−mean) would underflow
        rounded: float = np.rint(mean + math.sqrt(mean) * normal)
        return max(rounded, 0.0)
    left = 0.5 * math.erfc(-normal / math.sqrt(2.0))
    chance = math.exp(-mean)
    happened = 0.0
    while left > chance and happened < _MOST_STRAYS:
        left -= chance
        happened += 1.0
        chance *= mean / happened
    return happened


@inlined
def stray_ticks(
    p: Any,
    step_ticks: float,
    turned_ticks: float,
    probability: float,
    rate_per_s: float,
    missed_normal: float,
    extra_normal: float,
) -> float:
    """Return the counts that one tick has too many: spurious ones less missed ones.

    Of the whole steps in a tick some are missed, but a wheel's speed is not rounded to any.
    """
    stray = 0.0
    if probability != 0.0 and abs(turned_ticks) > p.missed_step_ticks:
        missed = binomial(abs(step_ticks), probability, missed_normal)
        stray -= math.copysign(missed, step_ticks)
    if rate_per_s != 0.0:
        extra = poisson(abs(rate_per_s) * p.tick_s, extra_normal)
        stray += math.copysign(extra, rate_per_s)
    return stray


@inlined
def read_encoders(p: Any, s: Any, m: Any, n: Any, moved: bool) -> None:
    """Read both counters of a sample into the state; `moved` is false at tick 0."""
    if p.lesson_counter != 0:
        s.left_sum_ticks += m.left_increment + p.noise_ticks * n.encoder_left
        s.right_sum_ticks += m.right_increment + p.noise_ticks * n.encoder_right
        left = np.rint(s.left_sum_ticks)
        right = np.rint(s.right_sum_ticks)
    else:
        left = edge_count(m.left_ticks + p.noise_ticks * n.encoder_left, p.quadrature_left_ticks)
        right = edge_count(
            m.right_ticks + p.noise_ticks * n.encoder_right, p.quadrature_right_ticks
        )
    left_ticks, right_ticks = np.floor(m.left_ticks), np.floor(m.right_ticks)
    if moved:
        s.left_stray_ticks += stray_ticks(
            p,
            left_ticks - s.left_last_ticks,
            m.left_turned_ticks,
            p.missed_left,
            p.extra_left_per_s,
            n.missed_left,
            n.extra_left,
        )
        s.right_stray_ticks += stray_ticks(
            p,
            right_ticks - s.right_last_ticks,
            m.right_turned_ticks,
            p.missed_right,
            p.extra_right_per_s,
            n.missed_right,
            n.extra_right,
        )
    s.left_last_ticks = left_ticks
    s.right_last_ticks = right_ticks
    if m.left_dead == 0:
        s.left_count = int(left + s.left_stray_ticks) & p.counter_mask
    if m.right_dead == 0:
        s.right_count = int(right + s.right_stray_ticks) & p.counter_mask
