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
]

# Without noise: cumulative ticks, the lesson's whole-tick increment, and whether a count is held.
SAMPLE = [
    ("left_ticks", "f8"),
    ("right_ticks", "f8"),
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
]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS` but for `lesson_counter`, which the caller chooses."""
    del tick_s
    encoder = description.encoder
    m = mechanisms
    return {
        "ticks_per_rad": encoder.ticks_per_rev * (1.0 + m.ticks_scale) / (2.0 * math.pi),
        "counter_mask": (1 << encoder.counter_bits) - 1,
        "noise_ticks": encoder.noise_ticks,
        "encoder_eccentricity_left_rad": m.encoder_eccentricity_left_rad,
        "encoder_eccentricity_right_rad": m.encoder_eccentricity_right_rad,
        "encoder_eccentricity_phase_left_rad": m.encoder_eccentricity_phase_left_rad,
        "encoder_eccentricity_phase_right_rad": m.encoder_eccentricity_phase_right_rad,
        "dead_left_s": m.encoder_dead_left_s,
        "dead_right_s": m.encoder_dead_right_s,
    }


@inlined
def measured_angle_rad(angle_rad: float, amplitude_rad: float, phase_rad: float) -> float:
    """Return the angle an eccentric disc or magnet shows: φ + A·sin(φ + phase)."""
    if amplitude_rad == 0.0:
        return angle_rad
    return angle_rad + amplitude_rad * math.sin(angle_rad + phase_rad)


@inlined
def observe_encoders(p: Any, s: Any, out: Any, time_s: float) -> None:
    """Write what ideal encoders show at the end of a tick."""
    left_rad = measured_angle_rad(
        s.angle_left_rad, p.encoder_eccentricity_left_rad, p.encoder_eccentricity_phase_left_rad
    )
    right_rad = measured_angle_rad(
        s.angle_right_rad, p.encoder_eccentricity_right_rad, p.encoder_eccentricity_phase_right_rad
    )
    left_step_rad, right_step_rad = s.step_left_rad, s.step_right_rad
    if p.encoder_eccentricity_left_rad != 0.0:
        left_step_rad = left_rad - measured_angle_rad(
            s.angle_left_rad - left_step_rad,
            p.encoder_eccentricity_left_rad,
            p.encoder_eccentricity_phase_left_rad,
        )
    if p.encoder_eccentricity_right_rad != 0.0:
        right_step_rad = right_rad - measured_angle_rad(
            s.angle_right_rad - right_step_rad,
            p.encoder_eccentricity_right_rad,
            p.encoder_eccentricity_phase_right_rad,
        )
    out.left_ticks = left_rad * p.ticks_per_rad
    out.right_ticks = right_rad * p.ticks_per_rad
    out.left_increment = np.rint(left_step_rad * p.ticks_per_rad)
    out.right_increment = np.rint(right_step_rad * p.ticks_per_rad)
    out.left_dead = time_s >= p.dead_left_s
    out.right_dead = time_s >= p.dead_right_s


@inlined
def read_encoders(p: Any, s: Any, m: Any, n: Any) -> None:
    """Read both counters of a sample into the state."""
    if p.lesson_counter != 0:
        s.left_sum_ticks += m.left_increment + p.noise_ticks * n.encoder_left
        s.right_sum_ticks += m.right_increment + p.noise_ticks * n.encoder_right
        left = np.rint(s.left_sum_ticks)
        right = np.rint(s.right_sum_ticks)
    else:
        left = np.floor(m.left_ticks + p.noise_ticks * n.encoder_left)
        right = np.floor(m.right_ticks + p.noise_ticks * n.encoder_right)
    if m.left_dead == 0:
        s.left_count = int(left) & p.counter_mask
    if m.right_dead == 0:
        s.right_count = int(right) & p.counter_mask
