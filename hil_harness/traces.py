"""Trajectories after the fact: kernel and twin run again over what the firmware was handed.

The kernel is deterministic, so a second run over the same inputs gives the bits of the first, and
the float twin and other estimators can be laid beside it without slowing the loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import can
import numpy as np
from numpy.typing import NDArray

from can_bus import Database, FrameChecker
from firmware_model import (
    STATE_FIELDS,
    BatchRuns,
    FirmwareError,
    KernelConfig,
    build_config,
    pose_m_rad,
    run_batch,
)
from hil_harness.firmware_program import FirmwareProgram, run_program
from hil_harness.nodes import Inputs
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.results import Estimate, Poses, Reception
from hil_harness.signal_map import SignalMap

LESSON_ESTIMATORS: Mapping[str, Mapping[str, str]] = {
    "wheel only": {"mode": "wheel", "integration": "midpoint"},
    "gyro heading": {"mode": "gyro", "integration": "euler_before"},
}
"""The two estimators that the lesson sets side by side."""


@dataclass(frozen=True)
class Trace:
    """Kernel and twin over one run: poses float64[n, 3], status int64[n], final integer state."""

    firmware: Poses
    float_twin: Poses
    status: NDArray[np.int64]
    state: Mapping[str, int]


@dataclass(frozen=True)
class StatedOdometry:
    """What a foreign firmware's frames state: poses float64[ticks, 3], and what came by message."""

    poses: Poses
    receptions: Mapping[str, Reception]


def run_again(config: KernelConfig, inputs: Inputs) -> BatchRuns:
    """Run kernel and twin over the inputs of one run, as a batch of one."""
    return run_batch(
        config,
        inputs.left_count[np.newaxis],
        inputs.right_count[np.newaxis],
        inputs.gyro_code[np.newaxis],
        encoder_validity=inputs.encoder_validity[np.newaxis],
        gyro_validity=inputs.gyro_validity[np.newaxis],
        twin=True,
        history=True,
    )


def trace(program: FirmwareProgram, inputs: Inputs) -> Trace:
    """Return the trajectories of the firmware's program, which is at power-on."""
    if not program.is_constant:
        return _trace_of_program(program, inputs)
    runs = run_again(program.kernel.config, inputs)
    assert runs.status is not None  # kept: the batch ran with history
    state = dict(zip(STATE_FIELDS, map(int, runs.final_states[0].item()), strict=True))
    estimate = _estimate(runs)
    return Trace(estimate.firmware, estimate.float_twin, runs.status[0].astype(np.int64), state)


def _trace_of_program(program: FirmwareProgram, inputs: Inputs) -> Trace:
    columns = (
        inputs.left_count,
        inputs.right_count,
        inputs.encoder_validity,
        inputs.gyro_code,
        inputs.gyro_validity,
    )
    pose_q, twin_pose, _, status = run_program(program, np.column_stack(columns))
    return Trace(pose_m_rad(program.described, pose_q), twin_pose, status, program.kernel.state())


def lesson_estimates(config: KernelConfig, inputs: Inputs) -> dict[str, Estimate]:
    """Return the lesson's two estimators on the same counts, in the configured formats."""
    estimates = {}
    for name, choice in LESSON_ESTIMATORS.items():
        description = config.description.model_copy(update=dict(choice))
        try:
            estimator = build_config(description, config.constants)
        except FirmwareError:  # its words may overflow where the described ones were forced to
            estimator = build_config(description, config.constants, allow_overflow=True)
        runs = run_again(estimator, inputs)
        estimates[name] = _estimate(runs)
    return estimates


def _estimate(runs: BatchRuns) -> Estimate:
    assert runs.twin_pose is not None  # kept: the batch ran with its twin
    return Estimate(runs.pose_m_rad()[0], runs.twin_pose[0])


def odometry_poses(
    answers: Iterable[tuple[int, Iterable[can.Message]]],
    ticks: int,
    database: Database,
    signal_map: SignalMap,
) -> StatedOdometry:
    """Return the pose that a foreign firmware's frames state at each tick: float64[ticks, 3].

    `answers` are (time in µs, frames) per tick. A pose holds until the next frame and is NaN before
    the first and where the sender says that it has none. The heading is unwrapped. Beside it stands
    what came of each odometry message, refused frames by reason.
    """
    roles = [role for role in ODOMETRY_ROLES if signal_map.get(role) is not None]
    messages = signal_map.messages(roles)
    # Odometry is judged, not obeyed: a frame of any age counts.
    checker = FrameChecker(database, [spec.name for spec in messages], max_age_us=2**62)
    frames_by_message = {spec.name: 0 for spec in messages}
    refused: dict[str, dict[str, int]] = {spec.name: {} for spec in messages}
    poses = np.full((ticks, 3), math.nan)
    now = [math.nan] * 3
    for tick, (now_us, frames) in zip(range(ticks), answers, strict=False):
        for frame in frames:
            spec = database.by_id(frame.arbitration_id, frame.is_extended_id)
            if spec is None or spec.name not in refused or frame.is_error_frame:
                continue
            frames_by_message[spec.name] += 1
            before = dict(checker.rejected)
            accepted = checker.check(frame, now_us)
            if accepted is None:
                why = next(r for r, count in checker.rejected.items() if count > before[r])
                refused[spec.name][why] = refused[spec.name].get(why, 0) + 1
                continue
            for role in roles:
                mapped = signal_map[role]
                name = mapped.signal.name
                if mapped.message.name == accepted.spec.name:
                    is_invalid = name in accepted.invalid
                    value = math.nan if is_invalid else mapped.to_si(accepted.raw[name])
                    now[ODOMETRY_ROLES.index(role)] = value
        poses[tick] = now
    known = np.isfinite(poses[:, 2])
    poses[known, 2] = np.unwrap(poses[known, 2])
    return StatedOdometry(
        poses,
        {name: Reception(frames, refused[name]) for name, frames in frames_by_message.items()},
    )
