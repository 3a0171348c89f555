"""From a table to a log of valid frames: how any simulator can produce our logs.

What becomes of a column:

- wheel counts, codes: in their messages, at the messages' cycles; an empty cell is sent as not
  available (SNA), or, where the DBC has no such value, its frame is left out;
- commands: the value in force at each frame of their message;
- odometry: rounded to the signals' steps;
- a missing column: a message of which the table has no column is left out; other signals of a
  message that it has some of are sent as not available.

The rows are ticks of the ECU's clock: the tick counter counts them, a tick without a row has no
frames. Stamps are the table's ``t_s``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from can_bus import CanBusError, MessageSpec, Raw, make_message, open_log_writer
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.rows import MAX_ROWS
from gap_diagnosis.reading.table_file import read_columns, read_header
from hil_harness.assembly import Wire
from hil_harness.nodes.schedule import cycle_of, encode_frame
from hil_harness.robot import Robot
from hil_harness.sensor_frames import SENSOR_ROLES, SensorFrames
from hil_harness.signal_map import MappedSignal
from hil_harness.signal_roles import Role
from hil_harness.table_map import named_table_map
from sim_plant import SensorCounts

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_US: Final = 1_000_000
_OFF_GRID: Final = 0.25
_WHOLE: Final[tuple[Role, ...]] = ("left_count", "right_count", "gyro", "temperature", "supply")
_QUANTITIES: Final[tuple[Role, ...]] = (
    "v_command",
    "w_command",
    "odom_x",
    "odom_y",
    "odom_heading",
)
_COMMANDS: Final[tuple[Role, ...]] = ("v_command", "w_command")
_ODOMETRY: Final = ("odom_x", "odom_y", "odom_heading")


@dataclass(frozen=True)
class Encoded:
    """What was written.

    Attributes:
        frames: by message name.
        ticks: rows of the table.
        left_out: messages of the map that the table has no column for.
        not_available: signals sent as not available throughout.
        untold: by message of commands, how many changes its cycle has left out: robots that were
            told each of them do otherwise than the log says.
    """

    frames: Mapping[str, int]
    ticks: int
    left_out: tuple[str, ...]
    not_available: tuple[str, ...]
    untold: Mapping[str, int]


def encode_table(table: Path, out: Path, robot: Robot, wire: Wire) -> Encoded:
    """Write the frames that a table's rows would have been on the wire.

    Raises DiagnosisError naming line and column of a count or code that is no whole number or out
    of range, of a row that lies off the tick, of a quantity that its signal cannot hold,
    CanBusError for a log that cannot be written, HarnessError where robot and DBC contradict each
    other.
    """
    return _Encoding(table, robot, wire).write(out)


class _Encoding:
    """One table under way to a log."""

    def __init__(self, table: Path, robot: Robot, wire: Wire) -> None:
        self.path, self.plant, self.wire = table, robot.plant, wire
        table_map = named_table_map(table.name, read_header(table))
        self.names = {role: mapped.column for role, mapped in table_map.columns.items()}
        columns = read_columns(table, list(self.names.values()))
        self.values = {role: columns[name] for role, name in self.names.items()}
        if not len(self.values["left_count"]):
            raise DiagnosisError(f"{table}: no rows: expected one for each tick")
        self.stamp_us, self.tick = self._clock()
        for role in _WHOLE:
            if role in self.values:
                self._refuse_odd_numbers(role)
        # What carries wheel counts across its own wraps needs one in every row.
        self.readings = {role: _filled(self.values[role]) for role in _WHOLE if role in self.values}
        self.sensors = SensorFrames(wire.signal_map, robot.plant)
        self.sent: dict[str, int] = {}

    def _clock(self) -> tuple[Ints, Ints]:
        """Return the stamp and the tick of each row."""
        for role in ("time", "ecu_time"):
            if role in self.values:
                self._refuse_clock(role)
        stamps = self.values.get("time", self.values.get("ecu_time"))
        ecu = self.values.get("ecu_time", self.values.get("time"))
        assert stamps is not None  # the map has at least one clock
        assert ecu is not None
        steps = np.diff(ecu) * _US / self.wire.tick_period_us
        away = np.abs(steps - np.rint(steps))
        if np.any(away > _OFF_GRID) or np.any(np.rint(steps) < 1):
            row = int(np.argmax((away > _OFF_GRID) | (np.rint(steps) < 1))) + 1
            raise DiagnosisError(
                f"{self.path}:{row + 2}: {steps[row - 1]:.3g} ticks after the row before: expected "
                f"whole multiples of {self.wire.tick_period_us / 1000:g} ms, the cycle of "
                f"{self.wire.signal_map['left_count'].message.name}"
            )
        tick = np.concatenate(([0], np.cumsum(np.rint(steps)))).astype(np.int64)
        if tick[-1] >= MAX_ROWS * 10:
            raise DiagnosisError(f"{self.path}: {tick[-1]} ticks: expected a shorter table")
        return np.rint(stamps * _US).astype(np.int64), tick

    def _refuse_clock(self, role: str) -> None:
        name = self.names["time" if role == "time" else "ecu_time"]
        values = self.values["time" if role == "time" else "ecu_time"]
        bad = ~np.isfinite(values) | (values < 0) | (values > 1e11)
        bad[1:] |= np.diff(values) <= 0
        if bad.any():
            row = int(np.argmax(bad))
            raise DiagnosisError(
                f"{self.path}:{row + 2}: {name} = {values[row]:.12g}: expected seconds from 0, "
                "each later than the row before"
            )

    def _refuse_odd_numbers(self, role: Role) -> None:
        values, name = self.values[role], self.names[role]
        known = np.isfinite(values)
        odd = ~known & ~np.isnan(values) | known & (values != np.rint(values))
        highest: float = self.plant.adc.max_code
        if role in ("left_count", "right_count"):
            lowest, highest = -(2.0**53), 2.0**53
        else:
            lowest = 0.0
        beyond = known & ((values < lowest) | (values > highest))
        if (odd | beyond).any():
            row = int(np.argmax(odd | beyond))
            what = "a whole number" if odd[row] else f"{lowest:.0f} to {highest:.0f}"
            raise DiagnosisError(
                f"{self.path}:{row + 2}: {name} = {values[row]:.12g}: expected {what}"
            )

    def write(self, out: Path) -> Encoded:
        """Write the log."""
        schedule = self._schedule()
        with open_log_writer(out) as log:
            for row in range(len(self.tick)):
                for message, received in self._frames(row, schedule):
                    log.write(message, received)
        mapped = {m.message.name for m in self.wire.signal_map.signals.values()}
        given = {spec.name for spec, _, _ in schedule}
        missing = [
            mapped_signal.path
            for role, mapped_signal in self.wire.signal_map.signals.items()
            if mapped_signal.message.name in given and role not in self.values
        ]
        return Encoded(
            self.sent,
            len(self.tick),
            tuple(sorted(mapped - given)),
            tuple(missing),
            self._untold(schedule),
        )

    def _untold(self, schedule: Sequence[tuple[MessageSpec, int, int]]) -> dict[str, int]:
        """Return how many changes of commands fall between two frames of their message."""
        found: dict[str, int] = {}
        for spec, every, phase in schedule:
            changed = np.zeros(len(self.tick), dtype=np.bool_)
            for role in _COMMANDS:
                own = self.wire.signal_map.signals.get(role)
                if own is not None and own.message.name == spec.name and role in self.values:
                    values = _filled(self.values[role])
                    changed[1:] |= np.diff(values) != 0
            lost = int(np.count_nonzero(changed & (self.tick % every != phase)))
            if lost:
                found[spec.name] = lost
        return found

    def _schedule(self) -> Sequence[tuple[MessageSpec, int, int]]:
        roles = [role for role in (*_WHOLE, *_QUANTITIES) if role in self.values]
        result = []
        for spec in self.wire.signal_map.messages(roles):
            cycle = cycle_of(spec, self.wire.tick_period_us)
            result.append((spec, cycle.every, cycle.phase))
        own = {spec.name for spec in self.wire.signal_map.messages(_ODOMETRY)}
        # As the ECU's log has them: what it received by priority, then what it sent.
        return sorted(result, key=lambda entry: (entry[0].name in own, entry[0].frame_id))

    def _frames(
        self, row: int, schedule: Sequence[tuple[MessageSpec, int, int]]
    ) -> Iterator[tuple[can.Message, bool]]:
        tick, stamp_us = int(self.tick[row]), int(self.stamp_us[row])
        counts = self._counts(row)
        own = {self.wire.signal_map[role].message.name for role in _ODOMETRY if role in self.values}
        for spec, every, phase in schedule:
            if tick % every != phase:
                continue
            raw = self._raw(spec, row, counts)
            if raw is None:
                continue
            self.sent[spec.name] = self.sent.get(spec.name, 0) + 1
            yield make_message(spec, encode_frame(spec, raw, tick), stamp_us), spec.name not in own

    def _counts(self, row: int) -> SensorCounts:
        """Return what the sensors read in this row; nothing where the table says nothing."""
        mask = (1 << self.plant.encoder.counter_bits) - 1

        def of(role: Role) -> int:
            readings = self.readings.get(role)
            return 0 if readings is None else int(readings[row])

        wheels = (of("left_count") & mask, of("right_count") & mask)
        return SensorCounts(*wheels, of("gyro"), 0, 0, of("temperature"), of("supply"))

    def _raw(self, spec: MessageSpec, row: int, counts: SensorCounts) -> dict[str, Raw] | None:
        """Return a message's raw values; None where one is missing that the DBC cannot mark."""
        is_sensor = any(spec is message for message in self.sensors.messages)
        raw: dict[str, Raw] = {signal.name: signal.initial_raw for signal in spec.payload}
        if is_sensor:
            raw.update(self._sensor_values(spec, row, counts))
        for role, mapped in self.wire.signal_map.signals.items():
            if mapped.message.name != spec.name:
                continue
            values = self.values.get(role)
            value = math.nan if values is None else float(values[row])
            if math.isnan(value):
                if mapped.signal.invalid_raw is None:
                    if values is None:
                        continue
                    return None
                raw[mapped.signal.name] = mapped.signal.invalid_raw
            elif role not in SENSOR_ROLES:
                raw[mapped.signal.name] = self._quantity(role, mapped, value, row)
        return raw

    def _sensor_values(
        self, spec: MessageSpec, row: int, counts: SensorCounts
    ) -> Mapping[str, Raw]:
        try:
            return self.sensors.raw_values(spec, counts)
        except CanBusError as error:
            raise DiagnosisError(f"{self.path}:{row + 2}: {error}") from None

    def _quantity(self, role: Role, mapped: MappedSignal, value: float, row: int) -> Raw:
        if role == "odom_heading":
            value = _within(mapped, value)
        try:
            return mapped.to_raw(value)
        except CanBusError as error:
            raise DiagnosisError(f"{self.path}:{row + 2}: {self.names[role]}: {error}") from None


def _filled(values: Floats) -> Floats:
    """Return the values with missing ones as the last before them, or the first."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == 0:
        return np.zeros(len(values))
    last = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    return np.asarray(values[known[np.maximum(last, 0)]])


def _within(mapped: MappedSignal, heading_rad: float) -> float:
    """Return the heading in the turn that its signal can hold."""
    signal = mapped.signal
    step = abs(mapped.si_per_lsb)
    ends = (mapped.to_si(signal.low_raw), mapped.to_si(signal.high_raw))
    low, high = min(ends), max(ends)
    if low <= heading_rad <= high:
        return heading_rad
    within = (heading_rad - low) % math.tau + low
    # Half a step below the turn's end the nearest value is its beginning.
    return low if within > high and within - high >= step / 2 else min(within, high)
