"""Small drives as tables, and what may happen to their logs on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.reading.encode import encode_table
from hil_harness import Robot, load_robot, load_wire

TICK_S = 0.01
ROBOT = load_robot()


@dataclass
class Drive:
    """Columns of a table by their plain names; NaN is an empty cell."""

    columns: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def write(self, path: Path, names: Mapping[str, str] | None = None) -> Path:
        """Write the table as CSV, its columns renamed where *names* says so."""
        renamed = [(names or {}).get(name, name) for name in self.columns]
        rows = zip(*(column.tolist() for column in self.columns.values()), strict=True)
        lines = [",".join("" if isnan(value) else repr(value) for value in row) for row in rows]
        path.write_text("\n".join([",".join(renamed), *lines]) + "\n", encoding="utf-8")
        return path


def drive(ticks: int = 400, *, seed: int = 0, counts_per_tick: int = 60) -> Drive:
    """Return a drive with both wheels going back and forth, its gyro and its commands."""
    random = np.random.default_rng(seed)
    k = np.arange(ticks)
    speed = counts_per_tick * np.sin(k / 120 + random.uniform(0, 6))
    left = np.rint(np.cumsum(speed + random.normal(0, 3, ticks)))
    right = np.rint(np.cumsum(speed * 0.9 + random.normal(0, 3, ticks)))
    return Drive(
        {
            "t_s": np.round(5.0 + k * TICK_S, 6),
            "left_ticks": left,
            "right_ticks": right,
            "gyro_code": np.rint(32768 + 2000 * np.cos(k / 70) + random.normal(0, 5, ticks)),
            "v_command_m_s": np.repeat(np.round(np.sin(k[::16] / 100), 3), 16)[:ticks],
            "w_command_rad_s": np.repeat(np.round(np.cos(k[::16] / 90), 3), 16)[:ticks],
        }
    )


def encoded(table: Drive, folder: Path, robot: Robot = ROBOT) -> Path:
    """Return the table's log."""
    log = folder / "bus.log"
    encode_table(table.write(folder / "table.csv"), log, robot, load_wire())
    return log


@dataclass(frozen=True)
class Line:
    """One frame of a candump log."""

    stamp_s: float
    rest: str

    def __str__(self) -> str:
        return f"({self.stamp_s:.6f}) {self.rest}"

    @property
    def message(self) -> str:
        """The identifier."""
        return self.rest.split()[1].partition("#")[0]


def read_lines(log: Path) -> list[Line]:
    """Return the frames of a candump log."""
    found = []
    for text in log.read_text().splitlines():
        stamp, rest = text.split(") ", 1)
        found.append(Line(float(stamp[1:]), rest))
    return found


def write_lines(log: Path, lines: list[Line]) -> Path:
    """Write a candump log."""
    log.write_text("".join(f"{line}\n" for line in lines))
    return log
