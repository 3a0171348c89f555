"""Wheel and gyro signals of any kind as the robot's counts and codes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.counts import unwrap_counts
from hil_harness.signal_roles import Kind, Quantity
from sim_plant import PlantDescription

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_TURN_RAD = 2 * math.pi


def ticks_per_unit(quantity: Quantity | None, plant: PlantDescription) -> float:
    """Return the encoder ticks of one count, rad or m of wheel by the description.

    Of a speed: the ticks a second of one rad/s or m/s.
    """
    ticks_per_rad = plant.encoder.ticks_per_rev / _TURN_RAD
    match quantity:
        case None:
            return 1.0
        case "length" | "speed":
            return ticks_per_rad / plant.wheels.radius_m
        case _:
            return ticks_per_rad


def fastest_ticks(plant: PlantDescription, period_s: float) -> float:
    """Return how many ticks the described drive's fastest wheel makes in a tick period."""
    rate = plant.drive.max_wheel_rate_rad_s
    return rate * period_s * plant.encoder.ticks_per_rev / _TURN_RAD


def running_count(
    reading: Floats,
    tick: Ints,
    *,
    wrap: float | None,
    scale: float,
    fastest_per_tick: float,
) -> Floats:
    """Return readings as unwrapped encoder ticks from the first valid one.

    Args:
        reading: float64[n], NaN where there is none.
        tick: int64[n], ascending.
        wrap: where the readings begin again; None where they do not.
        scale: encoder ticks per unit of the reading, negative where it counts backwards.
        fastest_per_tick: encoder ticks that the fastest wheel makes in a tick.
    """
    if wrap is not None:
        return unwrap_counts(reading, tick, wrap, fastest_per_tick / abs(scale)) * scale
    valid = np.flatnonzero(np.isfinite(reading))
    return (reading - reading[valid[0]]) * scale if len(valid) else reading.copy()


def gyro_code_and_rate(
    reading: Floats, kind: Kind, plant: PlantDescription, path: str
) -> tuple[Floats, Floats]:
    """Return the gyro's codes and what they mean by the description, from codes or SI rates.

    Raises DiagnosisError for codes that the described converter cannot give.
    """
    gyro = plant.gyro
    if kind == "physical":
        return reading * gyro.sensitivity_lsb_per_rad_s + gyro.zero_rate_code, reading
    refuse_impossible_codes(reading, plant, path)
    return reading, (reading - gyro.zero_rate_code) / gyro.sensitivity_lsb_per_rad_s


def refuse_impossible_codes(code: Floats, plant: PlantDescription, path: str) -> None:
    """Raise DiagnosisError for codes beyond the described converter's."""
    beyond = np.flatnonzero((code > plant.adc.max_code) | (code < 0))
    if len(beyond):
        raise DiagnosisError(
            f"{path} = {code[beyond[0]]:.0f}: the robot description's adc.bits = {plant.adc.bits} "
            f"gives codes from 0 to {plant.adc.max_code}: expected the robot that made this log"
        )
