"""The records that the compiled tick works on, put together from what each stage declares."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim_plant import accelerometer, actuation, adc, contact, encoder, environment, gyro
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms, MechanismSchedule
from sim_plant.streams import Stream

DriveModel = Literal["motor", "ideal"]
EncoderModel = Literal["counter", "lesson_counter"]

# In the order in which data flows.
STAGES = (actuation, contact, adc, environment, encoder, gyro, accelerometer)

PARAMETERS = np.dtype(
    [
        ("from_tick", "i8"),
        ("tick_s", "f8"),
        ("ideal", "i8"),
        *(item for stage in STAGES for item in stage.PARAMETERS),
    ]
)
MOTION_STATE = np.dtype(
    [
        ("tick", "i8"),
        ("piece", "i8"),
        *actuation.STATE,
        *contact.STATE,
        *encoder.MOTION_STATE,
        *gyro.FILTER_STATE,
    ]
)
# What a tick leaves for the sensors: the true pose, and their readings before noise and rounding.
SAMPLE = np.dtype(
    [
        ("x_m", "f8"),
        ("y_m", "f8"),
        ("heading_rad", "f8"),
        *environment.SAMPLE,
        *encoder.SAMPLE,
        *gyro.SAMPLE,
        *accelerometer.SAMPLE,
    ]
)
SENSOR_STATE = np.dtype([("tick", "i8"), *encoder.STATE, *gyro.STATE])

_NEVER = 2**53  # ticks

# The codes of one tick, in the order of SensorCounts.
CODES = 7


def build_parameters(
    description: PlantDescription,
    mechanisms: Mechanisms | MechanismSchedule,
    *,
    tick_s: float,
    drive_model: DriveModel,
    encoder_model: EncoderModel,
) -> NDArray[Any]:
    """Return the records of `PARAMETERS` that every stage reads, one for each piece in time."""
    if isinstance(mechanisms, MechanismSchedule):
        pieces = mechanisms.pieces
    else:
        pieces = ((-math.inf, mechanisms),)
    records = np.zeros(len(pieces), PARAMETERS)
    for index, (start_s, piece) in enumerate(pieces):
        true_tick_s = tick_s / (1.0 + piece.clock_skew)
        values = _values(description, piece, true_tick_s, drive_model, encoder_model)
        values["from_tick"] = _first_tick(start_s, true_tick_s) if index else -_NEVER
        for name in PARAMETERS.names or ():
            records[index][name] = values[name]
    return records


def _first_tick(start_s: float, tick_s: float) -> int:
    """Return the first tick whose middle, half a tick before its end, is not before a time."""
    return math.ceil(min(max(start_s / tick_s + 0.5, -_NEVER), _NEVER))


def _values(
    description: PlantDescription,
    mechanisms: Mechanisms,
    tick_s: float,
    drive_model: DriveModel,
    encoder_model: EncoderModel,
) -> dict[str, float]:
    values: dict[str, float] = {
        "tick_s": tick_s,
        "ideal": drive_model == "ideal",
        "lesson_counter": encoder_model == "lesson_counter",
    }
    for stage in STAGES:
        values |= stage.parameters(description, mechanisms, tick_s)
    return values


def active_streams(parameters: NDArray[Any]) -> frozenset[Stream]:
    """Return the streams whose level is not zero: the others draw nothing."""
    levels = {
        Stream.ENCODER_LEFT: "noise_ticks",
        Stream.ENCODER_RIGHT: "noise_ticks",
        Stream.GYRO_NOISE: "gyro_noise_rad_s",
        Stream.GYRO_BIAS_WALK: "gyro_walk_step_rad_s",
        Stream.MICRO_SLIP_LEFT: "noise_left_m_per_sqrt_m",
        Stream.MICRO_SLIP_RIGHT: "noise_right_m_per_sqrt_m",
        Stream.MICRO_SLIP_STEP_LEFT: "step_noise_left_m",
        Stream.MICRO_SLIP_STEP_RIGHT: "step_noise_right_m",
        Stream.SLIP_WANDER_LEFT: "wander_left",
        Stream.SLIP_WANDER_RIGHT: "wander_right",
        Stream.ACCEL_X: "accel_noise_m_s2",
        Stream.ACCEL_Y: "accel_noise_m_s2",
        Stream.TEMPERATURE: "temperature_noise_k",
        Stream.SUPPLY: "supply_noise_v",
        Stream.MISSED_LEFT: "missed_left",
        Stream.MISSED_RIGHT: "missed_right",
        Stream.EXTRA_LEFT: "extra_left_per_s",
        Stream.EXTRA_RIGHT: "extra_right_per_s",
    }
    return frozenset(stream for stream, name in levels.items() if parameters[name].any())
