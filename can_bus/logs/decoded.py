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

_STANDARD: Final = 1 << 11
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
    width = log.data.shape[1]
    known = [spec for spec in database.messages.values() if spec.length_bytes <= width]
    standard = np.zeros(_STANDARD, dtype=np.uint16)  # its number from 1; 0: unknown
    extended = {}
    for place, spec in enumerate(known, start=1):
        if spec.is_extended:
            extended[spec.frame_id] = place
        else:
            standard[spec.frame_id] = place
    number = standard[log.frame_id & np.uint32(_STANDARD - 1)]
    is_extended = np.flatnonzero(log.is_extended)
    if len(is_extended):
        number[is_extended] = 0
        if extended:
            ids = np.array(sorted(extended), dtype=np.uint32)
            places = np.array([extended[one] for one in ids.tolist()], dtype=np.uint16)
            wanted = log.frame_id[is_extended]
            at = np.minimum(np.searchsorted(ids, wanted), len(ids) - 1)
            number[is_extended] = np.where(ids[at] == wanted, places[at], 0)
    least = np.array([0, *(spec.length_bytes for spec in known)], dtype=np.uint8)
    number[~log.is_data | (log.length < least[number])] = 0
    order = np.argsort(number, kind="stable")
    stops = np.cumsum(np.bincount(number, minlength=len(known) + 1)).tolist()
    return [
        (spec, order[start:stop])
        for spec, start, stop in zip(known, stops[:-1], stops[1:], strict=True)
        if stop > start
    ]
