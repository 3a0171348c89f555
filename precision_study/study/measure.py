"""One configuration over a block of drives: how far it ends from its float twin and the truth."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig, StatusBit
from firmware_model.oracle import Integers
from precision_study.streaming import Streams
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
    """Run the configuration over whole drives."""
    one = Measurement(config, len(drives.seeds))
    one.add(drives)
    return one.errors()


class Measurement:
    """One configuration over drives that come some ticks at a time: of these only errors stay.

    The errors of a tick are formed in float64 from whole numbers: positions below 2^53 units are
    exact, others right to 2^-53 of themselves.
    """

    def __init__(self, config: KernelConfig, rows: int) -> None:
        """Put the firmware of every row at power-on."""
        self._config = config
        self._streams = Streams(config, rows)
        self._final = np.zeros((4, rows))
        self._largest = np.zeros((4, rows))
        self._fallback = np.zeros(rows, dtype=np.int64)
        self._overflows = np.zeros(rows, dtype=np.int64)

    def add(self, drives: Drives) -> None:
        """Go on over the next ticks of the same drives."""
        rows, last = len(drives.seeds), drives.ticks.tolist()
        chunk = max(_CHUNK // rows, 64)
        inputs = drives.left, drives.right, drives.gyro
        for part in self._streams.over(*inputs, chunk_ticks=chunk):
            size = part.pose_q.shape[1]
            truth = drives.truth[:, part.start : part.start + size]
            errors = _errors(self._config, part.pose_q, part.twin_pose, truth)
            for row, ticks in enumerate(last):
                count = min(ticks - part.start, size)
                if count > 0:
                    self._largest[:, row] = np.maximum(
                        self._largest[:, row], errors[:, row, :count].max(axis=1)
                    )
                    self._final[:, row] = errors[:, row, count - 1]
                    fallen = part.status[row, :count] & _FALLEN_BACK
                    self._fallback[row] += np.count_nonzero(fallen)
                    self._overflows[row] = part.overflow_count[row]

    def errors(self) -> Errors:
        """Return the errors of all ticks so far."""
        final, largest = self._final.tolist(), self._largest.tolist()
        return Errors(
            arithmetic_position_m=final[0],
            arithmetic_heading_rad=final[1],
            total_position_m=final[2],
            total_heading_rad=final[3],
            largest_arithmetic_position_m=largest[0],
            largest_arithmetic_heading_rad=largest[1],
            largest_total_position_m=largest[2],
            largest_total_heading_rad=largest[3],
            overflows=self._overflows.tolist(),
            fallback_ticks=self._fallback.tolist(),
        )


def _errors(config: KernelConfig, pose_q: Integers, twin_pose: Floats, truth: Floats) -> Floats:
    """Return float64[4, rows, ticks]: arithmetic position and heading, then total ones."""
    unit = math.ldexp(1.0, -config.position_frac_bits)
    turn_unit = 2.0 * math.pi * math.ldexp(1.0, -config.heading_frac_bits)
    x_m, y_m, heading_rad = (
        pose_q[:, :, place].astype(np.float64) * one
        for place, one in enumerate((unit, unit, turn_unit))
    )
    errors = np.empty((4, *x_m.shape))
    for place, pose in ((0, twin_pose), (2, truth)):
        errors[place] = np.hypot(x_m - pose[:, :, 0], y_m - pose[:, :, 1])
        errors[place + 1] = np.abs(_wrapped(heading_rad - pose[:, :, 2]))
    return errors


def _wrapped(angle_rad: Floats) -> Floats:
    """Return angles brought into [−π, π]."""
    turn = 2.0 * math.pi
    return np.asarray(angle_rad - turn * np.rint(angle_rad / turn))
