"""Recordings of commands and wheels from the simulated robot, for the drive's tests."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gap_diagnosis.drive import DriveBlock, drive_block
from gap_diagnosis.recording import FrameTimes, Recording
from hil_harness.assembly import commands_on_the_wire, load_wire
from hil_harness.batch import simulate_batch
from hil_harness.effects import EffectSetting
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios import Scenario
from hil_harness.scenarios.named import random as random_scenario

WIRE = load_wire()
ROBOT = load_robot()
DURATION_S = 40.0
ACTUATION = (
    "drive_acceleration_limit",
    "drive_deadband",
    "drive_delay",
    "drive_gain",
    "drive_lag",
    "drive_saturation",
)


def drive_scenario(seed: int, duration_s: float = DURATION_S) -> Scenario:
    """Return a random drive."""
    return replace(random_scenario(seed), duration_s=duration_s)


def recording_of(commands: np.ndarray, left: np.ndarray, right: np.ndarray) -> Recording:
    """Return a recording of commands float64[n, 2] and running counts."""
    ticks = np.arange(len(left), dtype=np.int64)
    time_s = np.asarray(ticks * 0.01, dtype=np.float64)
    return Recording(
        name="made",
        tick_period_s=0.01,
        t_s=time_s,
        stamp_s=time_s,
        tick=ticks,
        left_ticks=left - left[0],
        right_ticks=right - right[0],
        v_command_m_s=commands[:, 0].copy(),
        w_command_rad_s=commands[:, 1].copy(),
    )


def simulated(
    effects: Mapping[str, Mapping[str, float | str]] | None = None,
    *,
    seed: int = 1,
    duration_s: float = DURATION_S,
    robot: Robot = ROBOT,
) -> Recording:
    """Return a random drive of the simulated robot with these effects."""
    scenario = drive_scenario(seed, duration_s)
    settings = tuple(
        EffectSetting(name, tuple(values.items())) for name, values in (effects or {}).items()
    )
    runs = simulate_batch(scenario, robot, WIRE, [seed], effects=settings, outputs="odometry")
    commands = commands_on_the_wire(scenario, runs.left_count.shape[1], WIRE)
    counts = [
        np.unwrap(one[0].astype(np.float64), period=65536.0)
        for one in (runs.left_count, runs.right_count)
    ]
    made = recording_of(commands, *counts)
    # A log: of its frames the stamps tell when a command was in force, of a table's rows nothing.
    none = np.full(len(made.t_s), -1, dtype=np.int64)
    payload = np.arange(len(made.t_s), dtype=np.uint64)
    return replace(made, frames={"COMMAND": FrameTimes(made.t_s, none, 0, 0.01, payload)})


def block_of(recording: Recording) -> DriveBlock:
    block = drive_block(recording, ROBOT)
    assert block is not None
    return block


def evidence(block: DriveBlock, *effects: str) -> float:
    return block.fit(frozenset(effects)).log_evidence
