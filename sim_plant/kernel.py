"""One tick as machine code, used by `Plant` and `simulate`: the motion part and the sensor part.

The motion part moves the body and observes it as ideal sensors would; the sensor part adds noise
and rounds to counts and codes. Both read one parameter record, each owns a state record, and a
sample record lies between them, so that many runs can share one motion. Where the robot
changes in a run there is a parameter record for each piece in time. All floats are IEEE double
without fast-math: the same call gives the same bits one by one and in a batch.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from numba import njit

from sim_plant import compiled, generators, streams
from sim_plant.accelerometer import accel_code, observe_accelerometer
from sim_plant.actuation import drive, drive_train
from sim_plant.compiled import inlined
from sim_plant.contact import move, radii_m
from sim_plant.encoder import change_encoders, observe_encoders, read_encoders
from sim_plant.environment import observe_environment, supply_code, temperature_code
from sim_plant.gyro import observe_gyro, read_gyro
from sim_plant.records import STAGES
from sim_plant.streams import BLOCK_TICKS, fill_block


def _sources_digest() -> int:
    digest = hashlib.sha256()
    for module in (*STAGES, compiled, generators, streams):
        digest.update(Path(str(module.__file__)).read_bytes())
    return int.from_bytes(digest.digest()[:7], "little")


@inlined
def _piece(p: Any, tick: int) -> int:
    """Return which record holds for a tick."""
    index: int = p.size - 1
    while index > 0 and tick < p[index].from_tick:
        index -= 1
    return index


@inlined
def _change(p: Any, s: Any, index: int) -> None:
    """Go over to another record."""
    if index != s.piece:
        change_encoders(p[s.piece], p[index], s)
        s.piece = index


@njit(error_model="numpy")
def _advance(p: Any, s: Any, n: Any, v0: float, w0: float, v1: float, w1: float) -> None:
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
        drive_train(p, s, step)
        if s.tick == 1:  # an ideal drive is in motion from the start
            rate_before = (s.rate_left_rad_s, s.rate_right_rad_s)
    else:
        step = (0.0, 0.0)
        if p.delay_rest_s > 0.0:
            step = drive(p, s, v0, w0, p.delay_rest_s)
        later = drive(p, s, v1, w1, p.tick_s - p.delay_rest_s)
        step = drive_train(p, s, (step[0] + later[0], step[1] + later[1]))
        radius_left_m, radius_right_m = radii_m(p, time_s - 0.5 * p.tick_s)
        rolled = (step[0] * radius_left_m, step[1] * radius_right_m)
    rate = (s.rate_left_rad_s, s.rate_right_rad_s)
    move(p, s, n, time_s, p.tick_s, rolled, step, rate_before, rate)


@njit(error_model="numpy")
def _observe(p: Any, s: Any, out: Any) -> None:
    """Write the sample of the state's tick."""
    time_s = s.tick * p.tick_s
    out.x_m = s.x_m
    out.y_m = s.y_m
    out.heading_rad = s.heading_rad
    observe_environment(p, out, time_s)
    observe_encoders(p, s, out, time_s)
    observe_gyro(p, s, out, time_s, p.tick_s)
    observe_accelerometer(p, s, out)


@inlined
def _read(p: Any, s: Any, m: Any, n: Any) -> None:
    """Read encoders and gyro of a sample; the first call is tick 0."""
    read_encoders(p, s, m, n, s.tick > 0)
    read_gyro(p, s, m, n, s.tick > 0)
    s.tick += 1


@inlined
def _read_all(p: Any, s: Any, m: Any, n: Any, codes: Any) -> None:
    """Read all sensors of a sample into a row of codes."""
    _read(p, s, m, n)
    codes[0] = s.left_count
    codes[1] = s.right_count
    codes[2] = s.gyro_code
    codes[3] = accel_code(p, m.accel_x_m_s2, n.accel_x)
    codes[4] = accel_code(p, m.accel_y_m_s2, n.accel_y)
    codes[5] = temperature_code(p, m, n)
    codes[6] = supply_code(p, m, n)


@inlined
def _move_to(p: Any, s: Any, n: Any, commands: Any, tick: int) -> None:
    """Move to a tick under the rows of `commands`, over and over; row j drives (t_j, t_j+1].

    Before the first row takes effect, the robot was told to rest.
    """
    if tick == 0:
        return
    after = tick - 1 - (0 if p.ideal != 0 else p.delay_ticks)
    v0 = w0 = v1 = w1 = 0.0
    if after >= 0:
        row = after % commands.shape[0]
        v1, w1 = commands[row, 0], commands[row, 1]
    if after >= 1:
        row = (after - 1) % commands.shape[0]
        v0, w0 = commands[row, 0], commands[row, 1]
    _advance(p, s, n, v0, w0, v1, w1)


def _compile(sources_digest: int) -> tuple[Any, Any, Any, Any, Any]:
    """Return the compiled entry points.

    numba's cache on disk looks at this file alone. The digest of the other files is part of the
    closure and so of the cache key: editing a stage never meets stale machine code.
    """

    @njit(cache=True, nogil=True, error_model="numpy")
    def fill_noise(
        sources: Any, raws: Any, seed: Any, active: Any, columns: Any, block: int
    ) -> int:
        fill_block(sources, raws, seed, active, columns, block)
        return sources_digest

    @njit(cache=True, nogil=True, error_model="numpy")
    def read(p: Any, sensor_state: Any, sample: Any, normals: Any, k: int, codes: Any) -> int:
        """Read every sensor of one sample with the normals of row k."""
        now = p[_piece(p, sensor_state[0].tick)]
        _read_all(now, sensor_state[0], sample[0], normals[k], codes)
        return sources_digest

    @njit(cache=True, nogil=True, error_model="numpy")
    def step(
        p: Any,
        motion_state: Any,
        sensor_state: Any,
        sample: Any,
        normals: Any,
        k: int,
        codes: Any,
        v0: float,
        w0: float,
        v1: float,
        w1: float,
    ) -> int:
        """Move and read one tick with the normals of row k."""
        index = _piece(p, motion_state[0].tick + 1)
        now = p[index]
        _change(p, motion_state[0], index)
        _advance(now, motion_state[0], normals[k], v0, w0, v1, w1)
        _observe(now, motion_state[0], sample[0])
        _read_all(now, sensor_state[0], sample[0], normals[k], codes)
        return sources_digest

    @njit(cache=True, nogil=True, error_model="numpy")
    def run_motion(
        p: Any, motion_state: Any, samples: Any, normals: Any, commands: Any, start: int
    ) -> int:
        """Sample a motion without noise from a tick on; all normals are zero."""
        for k in range(samples.size):
            tick = start + k
            index = _piece(p, tick)
            _change(p, motion_state[0], index)
            _move_to(p[index], motion_state[0], normals[0], commands, tick)
            _observe(p[index], motion_state[0], samples[k])
        return sources_digest

    @njit(cache=True, nogil=True, error_model="numpy")
    def run(
        p: Any,
        motion_states: Any,
        sensor_states: Any,
        commands: Any,
        samples: Any,
        sources: Any,
        raws: Any,
        seeds: Any,
        active: Any,
        columns: Any,
        normals: Any,
        first_run: int,
        truth: Any,
        left: Any,
        right: Any,
        gyro_code: Any,
        gyro_rate: Any,
        accel_x: Any,
        accel_y: Any,
        temperature: Any,
        supply: Any,
    ) -> int:
        """Read runs, one per seed (a row of two words), into rows `first_run` and on of the arrays.

        Each run has its states, at zero when it begins, and its generators; it goes on from the
        tick that they are at, a whole number of blocks of noise from its beginning. Where `truth`
        is empty, `samples` is the shared motion; otherwise each run moves on its own, with room for
        a block of samples, and its pose goes to `truth`. Where `gyro_rate` is empty, only counters
        and gyro code are written.
        """
        ticks = left.shape[1]
        everything = gyro_rate.size > 0
        for index in range(seeds.shape[0]):
            run = first_run + index
            state = sensor_states[index]
            start = state.tick
            for first in range(0, ticks, BLOCK_TICKS):
                block = (start + first) // BLOCK_TICKS
                fill_block(sources[index], raws, seeds[index], active, columns, block)
                count = min(BLOCK_TICKS, ticks - first)
                span = samples[first : first + count] if truth.size == 0 else samples
                if truth.size > 0:
                    poses = truth[run, first : first + count]
                    for k in range(count):
                        tick = start + first + k
                        now = _piece(p, tick)
                        _change(p, motion_states[index], now)
                        _move_to(p[now], motion_states[index], normals[k], commands, tick)
                        _observe(p[now], motion_states[index], span[k])
                        poses[k, 0] = span[k].x_m
                        poses[k, 1] = span[k].y_m
                        poses[k, 2] = span[k].heading_rad
                lefts, rights = left[run, first:], right[run, first:]
                codes = gyro_code[run, first:]
                for k in range(count):
                    _read(p[_piece(p, start + first + k)], state, span[k], normals[k])
                    lefts[k] = state.left_count
                    rights[k] = state.right_count
                    codes[k] = state.gyro_code
                    if everything:
                        gyro_rate[run, first + k] = state.gyro_rate_rad_s
                if everything:
                    for k in range(count):
                        q, m, n = p[_piece(p, start + first + k)], span[k], normals[k]
                        accel_x[run, first + k] = accel_code(q, m.accel_x_m_s2, n.accel_x)
                        accel_y[run, first + k] = accel_code(q, m.accel_y_m_s2, n.accel_y)
                        temperature[run, first + k] = temperature_code(q, m, n)
                        supply[run, first + k] = supply_code(q, m, n)
        return sources_digest

    return fill_noise, read, step, run_motion, run


fill_noise, read, step, run_motion, run = _compile(_sources_digest())
