"""What is in a log or a table: each signal with its rate, range, unit and how it behaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus import Database
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.clock_names import by_name, has_times_word, time_unit
from gap_diagnosis.reading.frames import checked_frames
from gap_diagnosis.reading.log_columns import load_columns
from gap_diagnosis.reading.table_file import is_of_numbers, read_columns, read_header

Floats = NDArray[np.float64]

_US: Final = 1e-6
_LEAST_SAMPLES: Final = 10
_MOST_COLUMNS: Final = 200


@dataclass(frozen=True)
class FoundSignal:
    """One signal of a log, or one column of a table.

    Attributes:
        path: ``MESSAGE.signal``, or the column's name.
        unit: as the DBC gives it; empty for a column.
        time_s: float64[n], stamps of its valid values; for a table the row's clock.
        value: float64[n], in its unit.
        wrap: in its unit, where its range ends and begins again; None where it has no range.
        rate_hz: valid values per second.
    """

    path: str
    unit: str
    time_s: Floats
    value: Floats
    wrap: float | None
    rate_hz: float

    @property
    def low(self) -> float:
        """The smallest value."""
        return float(self.value.min())

    @property
    def high(self) -> float:
        """The largest value."""
        return float(self.value.max())

    @property
    def is_constant(self) -> bool:
        """Whether it never changes."""
        return self.low == self.high

    def unwrapped(self) -> Floats:
        """Return the values without the jumps at the ends of the range."""
        return self.value if self.wrap is None else np.unwrap(self.value, period=self.wrap)

    @property
    def wraps(self) -> bool:
        """Whether it jumps by more than half its range, as a counter does at its end."""
        return self.wrap is not None and bool(np.any(np.abs(np.diff(self.value)) > self.wrap / 2))


def signals_of_log(log: Path, database: Database) -> dict[str, FoundSignal]:
    """Return the signals of *database* that a log holds, constants included.

    Raises DiagnosisError for a log in which the DBC knows no frame, CanBusError for one that cannot
    be read.
    """
    frames, rejected = checked_frames(load_columns(log), database)
    found = {}
    for message in frames.values():
        start_us = int(message.stamp_us[0])
        stamps = np.asarray((message.stamp_us - start_us) * _US + start_us * _US)
        for signal in message.spec.payload:
            raw = message.raw[signal.name]
            known = np.isfinite(raw)
            if np.count_nonzero(known) < _LEAST_SAMPLES:
                continue
            wrap = None
            if not signal.is_float:
                wrap = (signal.high_raw - signal.low_raw + 1) * abs(signal.factor)
            found[signal.path] = FoundSignal(
                path=signal.path,
                unit=signal.unit,
                time_s=stamps[known],
                value=raw[known] * signal.factor + signal.offset,
                wrap=wrap,
                rate_hz=_rate(stamps[known]),
            )
    if not found:
        refused = ", ".join(f"{why} {count}" for why, count in rejected.items() if count)
        raise DiagnosisError(
            f"{log}: no frames that {database.path.name} knows ({refused or 'the log is empty'}): "
            "expected the DBC of this log"
        )
    return found


def signals_of_table(table: Path) -> dict[str, FoundSignal]:
    """Return the columns of numbers that a table has, constants included.

    The clock is the first column with a time's name that ascends throughout. Raises DiagnosisError
    for a table without one, for a row of too few cells, and for a word in a column of numbers.
    """
    header = read_header(table)
    if len(header) > _MOST_COLUMNS:
        raise DiagnosisError(
            f"{table}: {len(header)} columns: at most {_MOST_COLUMNS} can be looked at"
        )
    columns: dict[str, Floats] = {}
    for name in header:
        try:
            columns |= read_columns(table, [name])
        except DiagnosisError:
            if is_of_numbers(table, name):
                raise  # without a word the map would do without a sensor that the table has
            continue  # a column of words is nothing to map
    clock = clock_of_table(table, columns)
    time_s = columns[clock] * time_unit(columns[clock], clock)[1]
    found = {}
    for name, values in columns.items():
        known = np.isfinite(values) & np.isfinite(time_s)
        if np.count_nonzero(known) < _LEAST_SAMPLES:
            continue
        found[name] = FoundSignal(
            path=name,
            unit="",
            time_s=time_s[known],
            value=values[known],
            wrap=_visible_wrap(values[known]),
            rate_hz=_rate(time_s[known]),
        )
    if not found:
        raise DiagnosisError(
            f"{table}: no column with {_LEAST_SAMPLES} numbers: expected a table of a drive"
        )
    return found


def clock_of_table(table: Path, columns: Mapping[str, Floats]) -> str:
    """Return the first of a table's *columns*, float64[rows], with a time's name that ascends.

    Raises DiagnosisError where there is none.
    """
    for name in by_name(columns):
        values = columns[name]
        if np.isfinite(values).all() and np.all(np.diff(values) >= 0):
            return name
    for name, values in columns.items():
        back = np.flatnonzero(np.diff(values) < 0)
        if has_times_word(name) and np.isfinite(values).all() and len(back) > 0:
            row = int(back[0]) + 1
            raise DiagnosisError(
                f"{table}: {name} goes back, from {values[row - 1]:.16g} in row {row} to "
                f"{values[row]:.16g} in the next: expected rows in the order of time, of one "
                "recording"
            )
    raise DiagnosisError(
        f"{table}: no clock among the columns: expected one with time, stamp, t or a unit of time "
        "in its name whose values ascend"
    )


def _visible_wrap(values: Floats) -> float | None:
    """Return the power of two, or the turn, at which whole numbers seem to begin again."""
    jump = float(np.max(np.abs(np.diff(values)), initial=0.0))
    low, high = float(values.min()), float(values.max())
    for period in (256.0, 4096.0, 65536.0, 2.0**24, 2.0**32):
        if low >= 0 and high < period and jump > 0.9 * period:
            return period
    for turn in (2 * np.pi, 360.0):
        if high - low <= turn and jump > 0.9 * turn:
            return turn
    return None


def _rate(time_s: Floats) -> float:
    span = float(time_s[-1] - time_s[0])
    return (len(time_s) - 1) / span if span > 0 else 0.0
