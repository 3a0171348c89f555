"""One configuration over a block of drives: how far it ends from its float twin and the truth."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig, StatusBit
from precision_study.streaming import stream
from precision_study.study.drives import Drives

Floats = NDArray[np.float64]

_CHUNK: Final = 8192
"""Ticks of all rows together that are held at once: few enough for the processor's cache."""
_FALLEN_BACK: Final = int(StatusBit.WHEEL_FALLBACK)


@dataclass(frozen=True)
class Errors:
    """Errors of each run of a block, at the end of the course and at their largest on the way.

    Attributes:
        arithmetic_position_m, arithmetic_heading_rad: firmware − float, at the end.
        total_position_m, total_heading_rad: firmware − truth, at the end.
        largest_…: the same, where they are largest.
        overflows: how often a word has overflowed.
        fallback_ticks: ticks in which the wheels stood in for the gyro.
    """

    arithmetic_position_m: list[float]
    arithmetic_heading_rad: list[float]
    total_position_m: list[float]
    total_heading_rad: list[float]
    largest_arithmetic_position_m: list[float]
    largest_arithmetic_heading_rad: list[float]
    largest_total_position_m: list[float]
    largest_total_heading_rad: list[float]
    overflows: list[int]
    fallback_ticks: list[int]

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def measure(config: KernelConfig, drives: Drives) -> Errors:
    """Run the configuration over the drives; memory grows with neither runs nor ticks beyond them.

    The errors of a tick are formed in float64 from whole numbers: positions below 2^53 units are
    exact, others right to 2^-53 of themselves.
    """
    rows, last = len(drives.seeds), drives.ticks.tolist()
    final = np.zeros((4, rows))
    largest = np.zeros((4, rows))
    fallback = np.zeros(rows, dtype=np.int64)
    overflows = np.zeros(rows, dtype=np.int64)
    chunk = max(_CHUNK // rows, 64)
    for part in stream(config, drives.left, drives.right, drives.gyro, chunk_ticks=chunk):
        size = part.pose_q.shape[1]
        errors = _errors(
            config, part.pose_q, part.twin_pose, drives.truth[:, part.start : part.start + size]
        )
        for row, ticks in enumerate(last):
            count = min(ticks - part.start, size)
            if count > 0:
                largest[:, row] = np.maximum(largest[:, row], errors[:, row, :count].max(axis=1))
                final[:, row] = errors[:, row, count - 1]
                fallen = part.status[row, :count] & _FALLEN_BACK
                fallback[row] += np.count_nonzero(fallen)
                overflows[row] = part.overflow_count[row]
    return Errors(
        arithmetic_position_m=final[0].tolist(),
        arithmetic_heading_rad=final[1].tolist(),
        total_position_m=final[2].tolist(),
        total_heading_rad=final[3].tolist(),
        largest_arithmetic_position_m=largest[0].tolist(),
        largest_arithmetic_heading_rad=largest[1].tolist(),
        largest_total_position_m=largest[2].tolist(),
        largest_total_heading_rad=largest[3].tolist(),
        overflows=overflows.tolist(),
        fallback_ticks=fallback.tolist(),
    )


def _errors(
    config: KernelConfig, pose_q: NDArray[np.int64], twin_pose: Floats, truth: Floats
) -> Floats:
    """Return float64[4, rows, ticks]: arithmetic position and heading, then total ones."""
    unit = math.ldexp(1.0, -config.position_frac_bits)
    x_m, y_m = pose_q[:, :, 0] * unit, pose_q[:, :, 1] * unit
    heading_rad = pose_q[:, :, 2] * (2.0 * math.pi * math.ldexp(1.0, -config.heading_frac_bits))
    errors = np.empty((4, *x_m.shape))
    for place, pose in ((0, twin_pose), (2, truth)):
        errors[place] = np.hypot(x_m - pose[:, :, 0], y_m - pose[:, :, 1])
        errors[place + 1] = np.abs(_wrapped(heading_rad - pose[:, :, 2]))
    return errors


def _wrapped(angle_rad: Floats) -> Floats:
    """Return angles brought into [−π, π]."""
    turn = 2.0 * math.pi
    return np.asarray(angle_rad - turn * np.rint(angle_rad / turn))
