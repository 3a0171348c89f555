"""Stage encoder: wheel angles to wrapping counters.

`counter` is real hardware: floor(true cumulative ticks + n_k), n_k white. `lesson_counter` carries
the lesson's increments on a counter: half-even rounding of the running sum of
(round(increment) + n_k).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms
from sim_plant.streams import Stream

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

STATE = [
    ("sum_left_ticks", "f8"),
    ("sum_right_ticks", "f8"),
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


@njit()
def measured_angle_rad(angle_rad: float, amplitude_rad: float, phase_rad: float) -> float:
    """Return the angle an eccentric disc or magnet shows: φ + A·sin(φ + phase)."""
    if amplitude_rad == 0.0:
        return angle_rad
    return angle_rad + amplitude_rad * math.sin(angle_rad + phase_rad)


@njit()
def rounded_increment(p: Any, angle_rad: float, step_rad: float, ecc: float, phase: float) -> float:
    """Return the lesson's whole-tick increment for a step that ends at an angle."""
    if ecc != 0.0:
        before_rad = measured_angle_rad(angle_rad - step_rad, ecc, phase)
        step_rad = measured_angle_rad(angle_rad, ecc, phase) - before_rad
    increment: float = np.rint(step_rad * p.ticks_per_rad)
    return increment


@njit()
def count(p: Any, s: Any, m: Any, normals: Any, k: int, time_s: float, moved: bool) -> None:
    """Read both counters at `time_s` into the state; `moved` is false at tick 0."""
    noise_left = p.noise_ticks * normals[Stream.ENCODER_LEFT, k]
    noise_right = p.noise_ticks * normals[Stream.ENCODER_RIGHT, k]
    ecc_left = p.encoder_eccentricity_left_rad
    ecc_right = p.encoder_eccentricity_right_rad
    phase_left = p.encoder_eccentricity_phase_left_rad
    phase_right = p.encoder_eccentricity_phase_right_rad
    if p.lesson_counter != 0:
        if moved:
            s.sum_left_ticks += (
                rounded_increment(p, m.angle_left_rad, m.step_left_rad, ecc_left, phase_left)
                + noise_left
            )
            s.sum_right_ticks += (
                rounded_increment(p, m.angle_right_rad, m.step_right_rad, ecc_right, phase_right)
                + noise_right
            )
        left = np.rint(s.sum_left_ticks)
        right = np.rint(s.sum_right_ticks)
    else:
        angle_left = measured_angle_rad(m.angle_left_rad, ecc_left, phase_left)
        angle_right = measured_angle_rad(m.angle_right_rad, ecc_right, phase_right)
        left = math.floor(angle_left * p.ticks_per_rad + noise_left)
        right = math.floor(angle_right * p.ticks_per_rad + noise_right)
    if time_s < p.dead_left_s:
        s.left_count = int(left) & p.counter_mask
    if time_s < p.dead_right_s:
        s.right_count = int(right) & p.counter_mask
