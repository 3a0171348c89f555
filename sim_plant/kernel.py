"""One tick as machine code: the motion part and the sensor part, used by `Plant` and `simulate`.

Both parts read one parameter record; each owns a state record; a sample record lies between them,
so that many runs can share one motion. All floats are IEEE double without fast-math: the same call
gives the same bits one by one and in a batch.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_plant import accelerometer, actuation, adc, contact, encoder, environment, gyro
from sim_plant.accelerometer import accel_code
from sim_plant.actuation import drive
from sim_plant.contact import move, radii_m
from sim_plant.description import PlantDescription
from sim_plant.encoder import count
from sim_plant.environment import supply_code, temperature_code
from sim_plant.gyro import sample_gyro
from sim_plant.mechanisms import Mechanisms
from sim_plant.streams import MOTION_STREAMS, Stream

DriveModel = Literal["motor", "ideal"]
EncoderModel = Literal["counter", "lesson_counter"]

_MOTION_STAGES = (actuation, contact)
_SENSOR_STAGES = (adc, environment, encoder, gyro, accelerometer)

_COMMON = [("tick_s", "f8"), ("ideal", "i8")]
_MOTION_PARAMETERS = _COMMON + [item for stage in _MOTION_STAGES for item in stage.PARAMETERS]
PARAMETERS = np.dtype(
    _MOTION_PARAMETERS + [item for stage in _SENSOR_STAGES for item in stage.PARAMETERS]
)
MOTION_STATE = np.dtype([("tick", "i8"), *actuation.STATE, *contact.STATE])
SENSOR_STATE = np.dtype([("tick", "i8"), *encoder.STATE, *gyro.STATE])
SAMPLE = np.dtype(contact.SAMPLE)

# Columns of a row of codes, in the order of SensorCounts.
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
    for stage in _MOTION_STAGES + _SENSOR_STAGES:
        values |= stage.parameters(description, mechanisms, tick_s)
    record = np.zeros(1, PARAMETERS)
    for name in PARAMETERS.names or ():
        record[name] = values[name]
    return record


def motion_key(parameters: NDArray[Any]) -> bytes:
    """Return bytes that are equal for two records exactly when their motion without noise is."""
    names = [name for name, _ in _MOTION_PARAMETERS]
    return np.array([parameters[name][0] for name in names], np.float64).tobytes()


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


def has_motion_noise(parameters: NDArray[Any]) -> bool:
    """Return whether two seeds give two motions."""
    return bool(active_streams(parameters) & MOTION_STREAMS)


def _sources_digest() -> int:
    digest = hashlib.sha256()
    for module in (*_MOTION_STAGES, *_SENSOR_STAGES):
        digest.update(Path(str(module.__file__)).read_bytes())
    return int.from_bytes(digest.digest()[:7], "little")


@njit()
def _advance(
    p: Any, s: Any, out: Any, normals: Any, k: int, v0: float, w0: float, v1: float, w1: float
) -> None:
    """Move one tick: the older command (v0, w0) until the delay's rest is over, then (v1, w1)."""
    s.tick += 1
    time_s = s.tick * p.tick_s
    rate_before = (s.rate_left_rad_s, s.rate_right_rad_s)
    if p.ideal != 0:
        radius_left_m, radius_right_m = radii_m(p, time_s - 0.5 * p.tick_s)
        turn_m_s = 0.5 * w1 * p.wheelbase_m
        rolled = ((v1 - turn_m_s) * p.tick_s, (v1 + turn_m_s) * p.tick_s)
        step = (rolled[0] / radius_left_m, rolled[1] / radius_right_m)
        s.rate_left_rad_s = step[0] / p.tick_s
        s.rate_right_rad_s = step[1] / p.tick_s
        if s.tick == 1:  # an ideal drive is in motion from the start
            rate_before = (s.rate_left_rad_s, s.rate_right_rad_s)
    else:
        step = (0.0, 0.0)
        if p.delay_rest_s > 0.0:
            step = drive(p, s, v0, w0, p.delay_rest_s)
        later = drive(p, s, v1, w1, p.tick_s - p.delay_rest_s)
        step = (step[0] + later[0], step[1] + later[1])
        radius_left_m, radius_right_m = radii_m(p, time_s - 0.5 * p.tick_s)
        rolled = (step[0] * radius_left_m, step[1] * radius_right_m)
    rate = (s.rate_left_rad_s, s.rate_right_rad_s)
    move(p, s, out, normals, k, time_s, p.tick_s, rolled, step, rate_before, rate)


@njit()
def _sense(p: Any, s: Any, m: Any, normals: Any, k: int) -> None:
    """Read encoders and gyro at the end of the sampled tick; the first call is tick 0."""
    time_s = s.tick * p.tick_s
    moved = s.tick > 0
    count(p, s, m, normals, k, time_s, moved)
    sample_gyro(p, s, m, normals, k, time_s, p.tick_s, moved)
    s.tick += 1


@njit()
def _write_codes(p: Any, s: Any, m: Any, normals: Any, k: int, codes: Any) -> None:
    time_s = (s.tick - 1) * p.tick_s
    codes[0] = s.left_count
    codes[1] = s.right_count
    codes[2] = s.gyro_code
    codes[3] = accel_code(p, m.accel_x_m_s2, p.accel_bias_x_m_s2, normals[Stream.ACCEL_X, k])
    codes[4] = accel_code(p, m.accel_y_m_s2, p.accel_bias_y_m_s2, normals[Stream.ACCEL_Y, k])
    codes[5] = temperature_code(p, normals, k, time_s)
    codes[6] = supply_code(p, normals, k, time_s)


def _compile(sources: int) -> tuple[Any, Any, Any, Any]:
    """Return the compiled loops.

    numba's cache on disk looks at this file alone. `sources`, a digest of the stages' files, is
    part of the closure and so of the cache key: editing a stage never meets stale machine code.
    """

    @njit(cache=True, nogil=True, error_model="numpy")
    def sense_first(p: Any, sensor_state: Any, sample: Any, normals: Any, codes: Any) -> int:
        _sense(p[0], sensor_state[0], sample[0], normals, 0)
        _write_codes(p[0], sensor_state[0], sample[0], normals, 0, codes)
        return sources

    @njit(cache=True, nogil=True, error_model="numpy")
    def step(
        p: Any,
        motion_state: Any,
        sensor_state: Any,
        sample: Any,
        normals: Any,
        codes: Any,
        k: int,
        v0: float,
        w0: float,
        v1: float,
        w1: float,
    ) -> int:
        _advance(p[0], motion_state[0], sample[0], normals, k, v0, w0, v1, w1)
        _sense(p[0], sensor_state[0], sample[0], normals, k)
        _write_codes(p[0], sensor_state[0], sample[0], normals, k, codes)
        return sources

    @njit(cache=True, nogil=True, error_model="numpy")
    def run_motion(p: Any, motion_state: Any, samples: Any, normals: Any, commands: Any) -> int:
        """Move through the ticks of `samples`, the first of which may be tick 0."""
        n = p[0].delay_ticks
        first = motion_state[0].tick
        for k in range(samples.size):
            if first == 0 and k == 0:
                continue  # samples are zeros at tick 0
            # Command row j drives (t_j, t_j+1]; before the first row the robot was told to rest.
            now = motion_state[0].tick - n
            v1 = commands[now, 0] if now >= 0 else 0.0
            w1 = commands[now, 1] if now >= 0 else 0.0
            v0 = commands[now - 1, 0] if now >= 1 else 0.0
            w0 = commands[now - 1, 1] if now >= 1 else 0.0
            if p[0].ideal != 0:
                v1 = commands[motion_state[0].tick, 0]
                w1 = commands[motion_state[0].tick, 1]
            _advance(p[0], motion_state[0], samples[k], normals, k, v0, w0, v1, w1)
        return sources

    @njit(cache=True, nogil=True, error_model="numpy")
    def run_sensors(
        p: Any,
        sensor_state: Any,
        samples: Any,
        normals: Any,
        left: Any,
        right: Any,
        gyro_code: Any,
        gyro_rate: Any,
        accel_x: Any,
        accel_y: Any,
        temperature: Any,
        supply: Any,
        run: int,
        first: int,
    ) -> int:
        """Read the sensors of the ticks of `samples` into [run, first…] of the arrays.

        Where `gyro_rate` is empty, only both counters and the gyro's code are written.
        """
        codes = np.empty(CODES, np.int64)
        everything = gyro_rate.size > 0
        for k in range(samples.size):
            _sense(p[0], sensor_state[0], samples[k], normals, k)
            column = first + k
            left[run, column] = sensor_state[0].left_count
            right[run, column] = sensor_state[0].right_count
            gyro_code[run, column] = sensor_state[0].gyro_code
            if everything:
                gyro_rate[run, column] = sensor_state[0].gyro_rate_rad_s
                _write_codes(p[0], sensor_state[0], samples[k], normals, k, codes)
                accel_x[run, column] = codes[3]
                accel_y[run, column] = codes[4]
                temperature[run, column] = codes[5]
                supply[run, column] = codes[6]
        return sources

    return sense_first, step, run_motion, run_sensors


sense_first, step, run_motion, run_sensors = _compile(_sources_digest())
