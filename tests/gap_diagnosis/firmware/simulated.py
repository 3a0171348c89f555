"""Recordings made by the batch path: a plant, a firmware that may differ, and no bus."""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from can_bus import load_database
from firmware_model import FirmwareChanges, run_batch
from firmware_model.batch import pose_m_rad
from gap_diagnosis.recording import Floats, Recording
from hil_harness import Robot, load_robot
from hil_harness.assembly import Wire
from hil_harness.batch import simulate_batch
from hil_harness.firmware_program import FirmwareProgram, run_program
from hil_harness.nodes.firmware import firmware_config
from hil_harness.scenarios.named import random
from hil_harness.signal_map import default_map
from sim_plant import PlantRuns

PERIOD_S = 0.01


@cache
def robot() -> Robot:
    return load_robot()


@cache
def wire() -> Wire:
    database = load_database()
    return Wire(database, default_map(database))


@cache
def plant_runs(ticks: int, seed: int = 1) -> PlantRuns:
    return simulate_batch(random(), robot(), wire(), [seed], ticks=ticks, outputs="odometry")


def recording_of(runs: PlantRuns, pose: Floats | None, keep: slice = slice(None)) -> Recording:
    """Return the recording of one run whose odometry is *pose*."""
    plant = robot().plant
    ticks = runs.left_count.shape[1]
    code = runs.gyro_code[0].astype(float)
    pose = np.full((ticks, 3), np.nan) if pose is None else pose
    time_s: Floats = np.arange(ticks, dtype=np.float64) * PERIOD_S
    left, right = (
        np.unwrap(one[0].astype(float), period=65536) for one in (runs.left_count, runs.right_count)
    )
    return Recording(
        name="simulated",
        tick_period_s=PERIOD_S,
        t_s=time_s[keep],
        stamp_s=time_s[keep],
        tick=np.arange(ticks)[keep] - np.arange(ticks)[keep][0],
        left_ticks=(left - left[0])[keep],
        right_ticks=(right - right[0])[keep],
        gyro_code=code[keep],
        gyro_rate_rad_s=((code - plant.gyro.zero_rate_code) / plant.gyro.sensitivity_lsb_per_rad_s)[
            keep
        ],
        odometry_x_m=pose[keep, 0],
        odometry_y_m=pose[keep, 1],
        odometry_heading_rad=pose[keep, 2],
        frames={"ODOMETRY_X": None},  # type: ignore[dict-item]  # only whether there are any matters
    )


def kernel_pose(runs: PlantRuns, one: Robot | None = None, **changes: Any) -> Floats:
    """Return the odometry of a firmware with *changes*: float64[ticks, 3]."""
    described = firmware_config(one or robot(), wire().signal_map, round(PERIOD_S * 1e6))
    program = FirmwareChanges(**changes)
    config = program.config(described.description, described.constants)
    batch = run_batch(
        config, runs.left_count, runs.right_count, runs.gyro_code, twin=False, workers=1
    )
    assert batch.pose_q is not None
    return pose_m_rad(config, batch.pose_q[0])


def timed_pose(
    runs: PlantRuns, one: Robot | None = None, *, seed: int = 3, **changes: Any
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the odometry of a program that differs in time, and which ticks it executed."""
    program = FirmwareProgram(
        one or robot(),
        wire().signal_map,
        round(PERIOD_S * 1e6),
        schedule=((-math.inf, FirmwareChanges(**changes)),),
        seed=seed,
    )
    fresh = np.zeros(runs.left_count.shape[1], np.int64)
    columns = (runs.left_count[0], runs.right_count[0], fresh, runs.gyro_code[0], fresh)
    pose_q, _, executed, _ = run_program(program, np.column_stack(columns))
    return pose_m_rad(program.described, pose_q), executed


def float_pose(runs: PlantRuns, source: str, *, radius: float = 1.0) -> Floats:
    """Return midpoint odometry in floats, as someone else would write it."""
    known = robot().plant
    left, right = (
        np.unwrap(one[0].astype(float), period=65536) for one in (runs.left_count, runs.right_count)
    )
    tick_m = 2 * math.pi * known.wheels.radius_m * radius / known.encoder.ticks_per_rev
    left_m, right_m = (
        np.diff(left, prepend=left[0]) * tick_m,
        np.diff(right, prepend=right[0]) * tick_m,
    )
    turn = (right_m - left_m) / known.wheels.wheelbase_m
    if source == "gyro":
        code = runs.gyro_code[0].astype(float)
        offset = np.mean(code[:100])
        turn = (code - offset) / known.gyro.sensitivity_lsb_per_rad_s * PERIOD_S
    x = y = heading = 0.0
    poses = []
    for step, angle in zip((left_m + right_m) / 2, turn, strict=True):
        x += step * math.cos(heading + angle / 2)
        y += step * math.sin(heading + angle / 2)
        heading += angle
        poses.append((x, y, heading))
    return np.array(poses)
