"""The kernel over a recording's inputs, under any program: what the odometry should have been."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.batch import pose_m_rad
from firmware_model.compiled import compiled_batch
from firmware_model.kernel import config_record, initial_state
from firmware_model.state import STATE_DTYPE, STATE_FIELDS, State
from firmware_model.twin import TWIN_CONFIG_DTYPE, TWIN_DTYPE
from gap_diagnosis.firmware.inputs import Odometry, ReplayInputs, recorded_odometry, replay_inputs
from gap_diagnosis.recording import Floats, Ints, Recording
from hil_harness.assembly import Wire
from hil_harness.robot import Robot

_TURN_RAD: Final = 2.0 * np.pi


@dataclass(frozen=True)
class Program:
    """One program that the ECU may have run.

    Attributes:
        config: its integers.
        offset_lsb: from tick `offset_tick` on the gyro's offset in use is this, until the kernel
            learns another; None leaves it to the kernel.
        skipped: ticks that were not executed; None or bool[m].
    """

    config: KernelConfig
    offset_lsb: float | None = None
    offset_tick: int = 0
    skipped: tuple[int, ...] = ()


@dataclass(frozen=True)
class Start:
    """Where the replay begins: at power-on, or at a row whose recorded pose is taken over.

    Attributes:
        tick: the first tick that is replayed.
        pose: x, y, heading there; None: power-on.
    """

    tick: int = 0
    pose: tuple[float, float, float] | None = None


def replay(inputs: ReplayInputs, program: Program, start: Start, stop: int | None = None) -> Floats:
    """Return the pose after each tick from the start's to *stop*: float64[m, 3] (NaN before)."""
    stop = inputs.ticks if stop is None else stop
    config = program.config
    pose = np.full((stop, 3), np.nan)
    kept = np.ones(stop, np.bool_)
    kept[: start.tick] = False
    if program.skipped:
        skipped = np.array(program.skipped)
        kept[skipped[skipped < stop]] = False
    at = np.flatnonzero(kept)
    state = _state_at(config, start)
    pose_q = np.empty((stop, 3), np.int64)
    cut = int(np.searchsorted(at, program.offset_tick)) if program.offset_lsb is not None else 0
    for part in (at[:cut], at[cut:]):
        if len(part) == 0:
            continue
        if program.offset_lsb is not None and part[0] >= program.offset_tick:
            state["gyro_offset_q"] = round(program.offset_lsb * (1 << config.offset_frac_bits))
            state["offset_is_valid"] = 1
        pose_q[_picked(part)] = _run(inputs, config, state, part)
    pose[_picked(at)] = _as_floats(config, pose_q[_picked(at)], start)
    if len(at) and program.skipped:
        last = np.maximum.accumulate(np.where(kept, np.arange(stop), -1))
        pose = np.where((last >= 0)[:, None], pose[np.maximum(last, 0)], np.nan)
    return pose


def _run(inputs: ReplayInputs, config: KernelConfig, state: NDArray[np.void], at: Ints) -> Ints:
    """Step the kernel through the ticks *at* and return its poses; *state* moves on."""
    pick = _picked(at)
    pose_q = np.empty((1, len(at), 3), np.int64)
    compiled_batch()(
        state,
        config_record(config),
        np.array(config.table, np.int64),
        np.ascontiguousarray(inputs.left_count[pick])[None],
        np.ascontiguousarray(inputs.right_count[pick])[None],
        np.ascontiguousarray(inputs.encoder_validity[pick])[None],
        np.ascontiguousarray(inputs.gyro_code[pick])[None],
        np.ascontiguousarray(inputs.gyro_validity[pick])[None],
        np.zeros(0, TWIN_DTYPE),
        np.zeros(0, TWIN_CONFIG_DTYPE),
        pose_q,
        np.empty((1, len(at)), np.int32),
        np.empty((1, len(at)), np.int8),
        np.empty((0, len(at), 3), np.float64),
    )
    return np.asarray(pose_q[0])


def _picked(at: Ints) -> slice | Ints:
    """Return an index for rising ticks: a slice, which copies nothing, where none is left out."""
    if len(at) == 0:
        return slice(0)
    whole = slice(int(at[0]), int(at[-1]) + 1)
    return whole if len(at) == whole.stop - whole.start else at


def _state_at(config: KernelConfig, start: Start) -> NDArray[np.void]:
    state: State = initial_state(config)
    if start.pose is not None:
        x_m, y_m, heading_rad = start.pose
        one_turn = 1 << config.heading_frac_bits
        turn_q = round(heading_rad / _TURN_RAD * one_turn) % one_turn
        state.x_m_q = round(x_m * (1 << config.position_frac_bits))
        state.y_m_q = round(y_m * (1 << config.position_frac_bits))
        state.heading_turn_q = turn_q - (one_turn if turn_q >= one_turn >> 1 else 0)
    record = np.zeros(1, STATE_DTYPE)
    for name in STATE_FIELDS:
        if value := getattr(state, name):
            record[name] = value
    return record


def _as_floats(config: KernelConfig, pose_q: Ints, start: Start) -> Floats:
    pose = pose_m_rad(config, pose_q)
    if start.pose is not None and len(pose):
        pose[:, 2] += _TURN_RAD * round((start.pose[2] - pose[0, 2]) / _TURN_RAD)
    return pose


def resolution(config: KernelConfig) -> Floats:
    """Return one digit of a kernel's x, y [m] and heading [rad], float64[3]."""
    digit_m = math.ldexp(1.0, -config.position_frac_bits)
    return np.array([digit_m, digit_m, math.ldexp(_TURN_RAD, -config.heading_frac_bits)])


def find_start(inputs: ReplayInputs, odometry: Odometry, described: Floats) -> Start:
    """Return power-on where the first recorded pose is what it gives, else the first row's pose.

    *described* is the replay from power-on on the recording's rows.
    """
    rows = np.flatnonzero(np.isfinite(odometry.pose[:, 0]))
    first = int(rows[0])
    difference = np.abs(odometry.pose[first] - described[first])
    if np.all(difference <= [odometry.quantum_m, odometry.quantum_m, odometry.quantum_rad]):
        return Start()
    x_m, y_m, heading_rad = (float(value) for value in odometry.pose[first])
    return Start(int(inputs.at_row[first]), (x_m, y_m, heading_rad))


def replayed_pose(recording: Recording, robot: Robot, wire: Wire) -> Floats:
    """Return the odometry that the described firmware computes from this recording's inputs.

    float64[n, 3], one row per row of the recording: x [m], y [m], heading [rad, unwrapped]. It
    begins where the recorded odometry does; rows before that are NaN. Without recorded odometry
    it begins at zero.
    """
    inputs = replay_inputs(recording, robot, wire)
    described = replay(inputs, Program(inputs.config), Start())[inputs.at_row]
    odometry = recorded_odometry(recording, wire)
    if odometry is None:
        return described
    start = find_start(inputs, odometry, described)
    if start.pose is None:
        return described
    return replay(inputs, Program(inputs.config), start)[inputs.at_row]
