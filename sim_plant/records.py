"""The records that the compiled tick works on, put together from what each stage declares."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim_plant import accelerometer, actuation, adc, contact, encoder, environment, gyro
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms
from sim_plant.streams import Stream

DriveModel = Literal["motor", "ideal"]
EncoderModel = Literal["counter", "lesson_counter"]

# In the order in which data flows.
STAGES = (actuation, contact, adc, environment, encoder, gyro, accelerometer)

PARAMETERS = np.dtype(
    [
        ("tick_s", "f8"),
        ("ideal", "i8"),
        *(item for stage in STAGES for item in stage.PARAMETERS),
    ]
)
MOTION_STATE = np.dtype([("tick", "i8"), *actuation.STATE, *contact.STATE, *gyro.FILTER_STATE])
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

# The codes of one tick, in the order of SensorCounts.
CODES = 7


def build_parameters(
    description: PlantDescription,
    mechanisms: Mechanisms,
    *,
    tick_s: float,
    drive_model: DriveModel,
    encoder_model: EncoderModel,
) -> NDArray[Any]:
    """Return the one-element record of `PARAMETERS` that every stage reads."""
    values: dict[str, float] = {
        "tick_s": tick_s,
        "ideal": drive_model == "ideal",
        "lesson_counter": encoder_model == "lesson_counter",
    }
    for stage in STAGES:
        values |= stage.parameters(description, mechanisms, tick_s)
    record = np.zeros(1, PARAMETERS)
    for name in PARAMETERS.names or ():
        record[name] = values[name]
    return record


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
        Stream.ACCEL_X: "accel_noise_m_s2",
        Stream.ACCEL_Y: "accel_noise_m_s2",
        Stream.TEMPERATURE: "temperature_noise_k",
        Stream.SUPPLY: "supply_noise_v",
    }
    return frozenset(stream for stream, name in levels.items() if parameters[name][0] != 0.0)
