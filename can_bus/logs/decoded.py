"""Whole logs by DBC: each message's frames, and each signal as a column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus.columns import Column, decode_columns, decode_columns_scaled
from can_bus.database import Database
from can_bus.logs.columns import read_log_columns
from can_bus.logs.log_columns import LogColumns
from can_bus.specs import MessageSpec

_STANDARD_IDS: Final = 1 << 11
_WORD_BYTES: Final = 8


@dataclass(frozen=True)
class MessageColumns:
    """The frames of one message in a log, in the log's order.

    Attributes:
        spec: the message.
        rows: intp[f], which frames of the log they are.
        timestamp_us: int64[f].
        data: uint8[f, bytes], as the log has them.
        values: per signal float64[f], scaled, in its unit; NaN where it is not available (SNA) or,
            in a multiplexed message, not in the frame.
    """

    spec: MessageSpec
    rows: NDArray[np.intp]
    timestamp_us: NDArray[np.int64]
    data: NDArray[np.uint8]
    values: Mapping[str, Column]

    def raw(self) -> dict[str, Column]:
        """Return the raw values, per signal int64[f], uint64[f] (64 bits) or float64[f]."""
        return decode_columns(self.spec, self.data)


def decode_log(path: str | Path, database: Database) -> dict[str, MessageColumns]:
    """Read a log (candump, ASC, BLF, MF4) and decode all that the DBC knows in it.

    Raises CanBusError for a log that cannot be read.
    """
    return decode_log_columns(read_log_columns(path), database)


def decode_log_columns(log: LogColumns, database: Database) -> dict[str, MessageColumns]:
    """Decode the frames that the DBC knows, by message; messages without a frame are left out.

    As in cantools, bytes beyond a message's length are ignored. Frames that are shorter, remote or
    error frames are left out: nobody says what is missing.
    """
    decoded = {}
    for spec, rows in _rows_by_message(log, database):
        data = _rows_of(log.data, rows)
        decoded[spec.name] = MessageColumns(
            spec, rows, log.timestamp_us[rows], data, decode_columns_scaled(spec, data)
        )
    return decoded


def _rows_of(data: NDArray[np.uint8], rows: NDArray[np.intp]) -> NDArray[np.uint8]:
    if data.shape[1] == _WORD_BYTES:  # as words, numpy takes them four times as fast
        return data.view("<u8")[rows].view(np.uint8).reshape(-1, _WORD_BYTES)
    return data[rows]


def _rows_by_message(
    log: LogColumns, database: Database
) -> list[tuple[MessageSpec, NDArray[np.intp]]]:
    """Return the messages that have frames in the log, and which ones."""
    # numba takes a quarter of a second to import: only who decodes whole logs pays for it.
    from can_bus.field_words import number_frames, sort_rows  # noqa: PLC0415

    width = log.data.shape[1]
    known = [spec for spec in database.messages.values() if spec.length_bytes <= width]
    standard = np.zeros(_STANDARD_IDS, dtype=np.uint16)
    extended = {}
    for place, spec in enumerate(known, start=1):
        if spec.is_extended:
            extended[spec.frame_id] = place
        else:
            standard[spec.frame_id] = place
    number = np.empty(len(log), dtype=np.uint16)
    counts = number_frames(
        log.frame_id,
        log.is_extended,
        log.is_data,
        log.length,
        standard,
        np.array(sorted(extended), dtype=np.uint32),
        np.array([extended[one] for one in sorted(extended)], dtype=np.uint16),
        np.array([0, *(spec.length_bytes for spec in known)], dtype=np.uint8),
        number,
    )
    stops = np.cumsum(counts)
    rows = np.empty(len(log), dtype=np.intp)
    sort_rows(number, stops - counts, rows)
    return [
        (spec, rows[stop - count : stop])
        for spec, count, stop in zip(known, counts[1:].tolist(), stops[1:].tolist(), strict=True)
        if count
    ]
