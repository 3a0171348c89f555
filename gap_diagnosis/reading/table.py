"""From a table to a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.lattice import lattice_step
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.reading.fixes import reference_of
from gap_diagnosis.reading.rows import Rows, hold, rows_of_ticks
from gap_diagnosis.reading.said_again import with_news_only
from gap_diagnosis.reading.speeds import AddedUp, integrated_speed
from gap_diagnosis.reading.stamp_jitter import sampled_at
from gap_diagnosis.reading.table_clock import TableClock, table_clock
from gap_diagnosis.reading.table_file import read_columns, read_header
from gap_diagnosis.reading.wheels import (
    fastest_ticks,
    gyro_code_and_rate,
    refuse_impossible_codes,
    running_count,
    ticks_per_unit,
)
from gap_diagnosis.recording import Recording, Reference
from hil_harness.robot import Robot
from hil_harness.sensor_frames import code_scale
from hil_harness.signal_map import load_table_map
from hil_harness.signal_roles import Role
from hil_harness.table_map import ColumnRole, MappedColumn, TableMap, named_table_map

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_LEAST_ROWS: Final = 20
_OUTER_JOIN: Final = 0.2
"""With more rows than this without wheels, the table joins sensors of several rates."""
_TURN_RAD: Final = 2 * math.pi
_ROUNDED_UP: Final = 5e-3
"""An angle in a turn is written as 6.2832, or as 6.3."""


class _Table:
    """One table under way to a recording."""

    def __init__(self, path: Path, robot: Robot, table_map: TableMap) -> None:
        self.path, self.plant, self.map = path, robot.plant, table_map
        columns = read_columns(path, [m.column for m in table_map.columns.values()])
        self.values = {role: columns[m.column] for role, m in table_map.columns.items()}
        self._refuse_empty()
        self.group = self._groups()
        anchors = np.flatnonzero(np.diff(self.group, append=self.group[-1] + 1))
        self.clock = self._clock(anchors)
        self.rows: Rows = rows_of_ticks(
            self.clock.tick,
            np.zeros(len(self.clock.tick), dtype=np.int64),
            self.clock.period_s,
            str(path),
        )
        self.t_s = np.interp(self.rows.tick, self.clock.tick, self.clock.t_s)

    def _refuse_empty(self) -> None:
        rows = len(self.values["left_count"])
        if rows < _LEAST_ROWS:
            raise DiagnosisError(f"{self.path}: {rows} rows: expected at least {_LEAST_ROWS}")
        for role in ("left_count", "right_count"):
            if not np.isfinite(self.values[role]).any():
                raise DiagnosisError(
                    f"{self.path}: column {self.map.columns[role].column} has no number: expected "
                    "the wheel's counts"
                )

    def _groups(self) -> Ints:
        """Return which tick's row each row of the file belongs to.

        Every row is its own, unless many have no wheel reading: then those lead up to the next
        row that has one.
        """
        rows = len(self.values["left_count"])
        has_wheel = np.isfinite(self.values["left_count"]) | np.isfinite(self.values["right_count"])
        if np.count_nonzero(~has_wheel) <= _OUTER_JOIN * rows:
            return np.arange(rows)
        last = int(np.flatnonzero(has_wheel)[-1])
        group = np.cumsum(np.concatenate(([False], has_wheel[:-1])))
        return np.asarray(group[: last + 1], dtype=np.int64)

    def _clock(self, anchors: Ints) -> TableClock:
        clocks: list[Floats | None] = []
        for role in ("time", "ecu_time"):
            mapped = self.map.get(role)
            clocks.append(
                None if mapped is None else self.values[mapped.role][anchors] * mapped.si_factor
            )
        ecu = self.map.get("ecu_time")
        wrap_s = None if ecu is None or ecu.wrap is None else ecu.wrap * ecu.si_factor
        columns = [value[anchors] for value in self.values.values()]
        return table_clock(str(self.path), clocks[0], clocks[1], wrap_s, columns)

    def missing(self) -> tuple[str, ...]:
        """Say how many values were missing, empty or not finite; nothing where none was.

        Of a table that joins sensors of several rates a tick without a value, not an empty cell.
        """
        ticks = int(self.group[-1]) + 1
        told = []
        for role, mapped in self.map.columns.items():
            valid = np.isfinite(self.values[role][: len(self.group)])
            lost = ticks - len(np.unique(self.group[valid]))
            if lost:
                told.append(f"{lost:,} of {ticks:,} of {mapped.column}")
        if not told:
            return ()
        return (f"Values empty or not finite were taken as missing: {', '.join(told)}.",)

    def last(self, role: ColumnRole) -> Floats:
        """Return the last reading of each tick on the rows, NaN where there is none."""
        value = self.values[role][: len(self.group)]
        valid = np.flatnonzero(np.isfinite(value))
        groups = int(self.group[-1]) + 1
        found = np.full(groups, np.nan)
        found[self.group[valid]] = value[valid]
        return self.rows.place(self.clock.tick, found[self.clock.order])

    def mean(self, role: ColumnRole) -> Floats:
        """Return the mean of the readings of each tick on the rows."""
        value = self.values[role][: len(self.group)]
        valid = np.isfinite(value)
        groups = int(self.group[-1]) + 1
        count = np.bincount(self.group[valid], minlength=groups)
        total = np.bincount(self.group[valid], value[valid], groups)
        found = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        return self.rows.place(self.clock.tick, found[self.clock.order])

    def held(self, role: ColumnRole) -> Floats:
        """Return the newest reading on each row."""
        value = self.last(role)
        known = np.isfinite(value)
        return hold(self.rows.tick[known], value[known], self.rows.tick)


def read_table_recording(
    path: Path, robot: Robot, signals: Path | None
) -> tuple[Recording, Reference | None]:
    """Read a table, by the names of its columns or by the ``[columns]`` of a map.toml.

    Returns the recording without a reference, and the reference its own columns hold, if any.
    Raises DiagnosisError or HarnessError in one line for what cannot be diagnosed.
    """
    header = read_header(path)
    table_map = (
        named_table_map(path.name, header) if signals is None else load_table_map(signals, header)
    )
    table = _Table(path, robot, table_map)
    clock, rows = table.clock, table.rows
    stamp_role: ColumnRole = "time" if table_map.get("time") is not None else "ecu_time"
    stamps = table.last(stamp_role) * table_map.columns[stamp_role].si_factor
    t_s, unsure, half_row, late_s = table.t_s, None, None, 0.0
    if _is_speed(table):
        left = _speed(table, "left_count", "right_count")
        right = _speed(table, "right_count", "left_count")
        left_ticks, right_ticks = left.ticks, right.ticks
        if not (left.is_counted and right.is_counted):
            unsure = np.stack([left.unsure_ticks2, right.unsure_ticks2])
            half_row = np.stack([left.half_row_ticks, right.half_row_ticks])
    else:
        left_ticks, right_ticks = _wheel(table, "left_count"), _wheel(table, "right_count")
        if table.map.get("ecu_time") is None:
            wheels = left_ticks, right_ticks
            t_s, late_s = sampled_at(t_s, rows.tick, wheels, clock.period_s)
    gyro = _gyro(table)
    heading = _quantity(table, "odom_heading")
    recording = Recording(
        name=path.name,
        tick_period_s=clock.period_s,
        t_s=t_s,
        stamp_s=stamps,
        tick=rows.tick,
        left_ticks=left_ticks,
        right_ticks=right_ticks,
        gyro_code=None if gyro is None else gyro[0],
        gyro_rate_rad_s=None if gyro is None else gyro[1],
        temperature_k=_slow(table, "temperature"),
        supply_v=_slow(table, "supply"),
        v_command_m_s=_quantity(table, "v_command", held=True),
        w_command_rad_s=_quantity(table, "w_command", held=True),
        odometry_x_m=_quantity(table, "odom_x"),
        odometry_y_m=_quantity(table, "odom_y"),
        odometry_heading_rad=None if heading is None else unwrapped(heading),
        counter_bits=_counter_bits(table, robot),
        clock_skew=clock.skew,
        clock_skew_sd=clock.skew_sd,
        counts_per_step=(1.0, 1.0)
        if _is_speed(table)
        else (lattice_step(left_ticks), lattice_step(right_ticks)),
        speed_cycle_s=clock.period_s if _is_speed(table) else 0.0,
        unsure_ticks2=unsure,
        half_row_ticks=half_row,
        stamps_late_s=late_s,
        stamped_by_host=table_map.get("ecu_time") is None,
        notes=table.missing(),
    )
    if not _is_speed(table):
        recording = with_news_only(recording)
    return recording, _reference(table, t_s)


def _wheel(table: _Table, role: Role) -> Floats:
    mapped = table.map.columns[role]
    reading, tick = table.last(role), table.rows.tick
    return running_count(
        reading,
        tick,
        wrap=_wrap(mapped, reading, table),
        scale=ticks_per_unit(mapped.quantity, table.plant) * mapped.si_factor,
        fastest_per_tick=fastest_ticks(table.plant, table.clock.period_s),
    )


def _speed(table: _Table, role: Role, other: Role) -> AddedUp:
    mapped = table.map.columns[role]
    scale = ticks_per_unit(mapped.quantity, table.plant) * mapped.si_factor
    return integrated_speed(table.last(role), table.t_s, scale=scale, other=table.last(other))


def _is_speed(table: _Table) -> bool:
    """Tell wheels that say how fast they are, not how far they have come."""
    return table.map.columns["left_count"].quantity in ("speed", "turn rate")


def _wrap(mapped: MappedColumn, reading: Floats, table: _Table) -> float | None:
    """Return where a wheel's readings begin again: as the map says, or as they look.

    Counts that stay inside the described counter may have wrapped at it; others are unwrapped
    already. An angle that stays within a turn and jumps by more than half of one wraps at the turn.
    """
    if mapped.wrap is not None:
        return mapped.wrap
    valid = reading[np.isfinite(reading)]
    low, high = float(valid.min()), float(valid.max())
    if mapped.kind == "counts":
        period = 1 << table.plant.encoder.counter_bits
        return float(period) if low >= 0 and high < period else None
    if mapped.quantity == "angle":
        turn = _TURN_RAD / abs(mapped.si_factor)
        jumps = float(np.max(np.abs(np.diff(valid)), initial=0.0))
        if high - low <= turn * (1 + _ROUNDED_UP) and jumps > turn / 2:
            return turn
    return None


def _counter_bits(table: _Table, robot: Robot) -> int:
    mapped = table.map.columns["left_count"]
    if mapped.kind == "counts" and mapped.wrap is not None:
        return max(1, (round(mapped.wrap) - 1).bit_length())
    return robot.plant.encoder.counter_bits


def _gyro(table: _Table) -> tuple[Floats, Floats] | None:
    mapped = table.map.get("gyro")
    if mapped is None:
        return None
    reading = table.mean("gyro")
    if not np.isfinite(reading).any():
        return None
    if mapped.kind == "physical":
        reading = reading * mapped.si_factor + mapped.si_offset
    return gyro_code_and_rate(reading, mapped.kind, table.plant, f"{table.path}: {mapped.column}")


def _quantity(table: _Table, role: Role, *, held: bool = False) -> Floats | None:
    mapped = table.map.get(role)
    if mapped is None:
        return None
    reading = table.held(role) if held else table.last(role)
    if not np.isfinite(reading).any():
        return None
    return reading * mapped.si_factor + mapped.si_offset


def _slow(table: _Table, role: Role) -> Floats | None:
    mapped = table.map.get(role)
    if mapped is None:
        return None
    reading = table.held(role)
    known = np.flatnonzero(np.isfinite(reading))
    if len(known) == 0:
        return None
    reading[: known[0]] = reading[known[0]]  # what changes this slowly was the same just before
    if mapped.kind == "physical":
        return reading * mapped.si_factor + mapped.si_offset
    refuse_impossible_codes(reading, table.plant, f"{table.path}: {mapped.column}")
    per_code, at_zero = code_scale(role, table.plant)
    return reading * per_code + at_zero


def _reference(table: _Table, t_s: Floats) -> Reference | None:
    x, y = _quantity(table, "reference_x"), _quantity(table, "reference_y")
    if x is None or y is None:
        return None
    heading = _quantity(table, "reference_heading")
    of_x, of_y = (table.map.columns[role].quantity for role in ("reference_x", "reference_y"))
    mapped = table.map.get("reference_heading")
    return reference_of(
        t_s,
        (x, of_x),
        (y, of_y),
        None if heading is None else unwrapped(heading),
        str(table.path),
        is_turned_round=mapped is not None and mapped.si_factor < 0,
    )
