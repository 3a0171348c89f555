"""A whole log as columns: what the array codec works on."""

from __future__ import annotations

import io
from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from can_bus.frames import timestamp_us
from can_bus.logs.candump_columns import parse_plain, text_blocks
from can_bus.logs.reader import log_format, read_candump_lines, read_log
from can_bus.specs import MessageSpec

_CLASSIC_BYTES: Final = 8
_FD_BYTES: Final = 64


@dataclass(frozen=True)
class LogColumns:
    """The frames of a log in its order, one row each; arrays are read-only.

    Attributes:
        timestamp_us: int64[frames].
        frame_id: uint32[frames].
        is_extended: bool[frames].
        data: uint8[frames, 8], or [frames, 64] where the log has CAN FD frames; zero padded.
        length: uint8[frames]: bytes of data in the frame.
        is_rx: bool[frames]: received by the logging node, not sent.
        is_data: bool[frames]: False for remote and error frames.
    """

    timestamp_us: NDArray[np.int64]
    frame_id: NDArray[np.uint32]
    is_extended: NDArray[np.bool_]
    data: NDArray[np.uint8]
    length: NDArray[np.uint8]
    is_rx: NDArray[np.bool_]
    is_data: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for column in vars(self).values():
            column.setflags(write=False)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.timestamp_us)

    def rows_of(self, spec: MessageSpec) -> NDArray[np.intp]:
        """Return the row numbers of the data frames of a message that have its length."""
        return np.flatnonzero(
            (self.frame_id == spec.frame_id)
            & (self.is_extended == spec.is_extended)
            & self.is_data
            & (self.length == spec.length_bytes)
        )


def read_log_columns(path: str | Path) -> LogColumns:
    """Read a whole log (candump, ASC or BLF) into columns.

    Raises CanBusError as `read_log` does.
    """
    path = Path(path)
    if log_format(path) != "candump":
        return columns_of(read_log(path))
    parts = []
    line = 1
    for block in text_blocks(path):
        plain = parse_plain(block)
        if plain is None:
            text = io.StringIO(block.decode("ascii", errors="replace"), newline="\n")
            parts.append(columns_of(read_candump_lines(path, text, line)))
        else:
            every = np.ones(len(plain.length), dtype=np.bool_)
            parts.append(LogColumns(**vars(plain), is_data=every))
        line += block.count(b"\n")
    return _joined(parts)


def _joined(parts: list[LogColumns]) -> LogColumns:
    if len(parts) == 1:
        return parts[0]
    width = max((part.data.shape[1] for part in parts), default=_CLASSIC_BYTES)
    empty = columns_of(())
    columns = {
        name: np.concatenate([getattr(part, name) for part in (empty, *parts)])
        for name in vars(empty)
        if name != "data"
    }
    data = [np.pad(part.data, ((0, 0), (0, width - part.data.shape[1]))) for part in parts]
    return LogColumns(**columns, data=np.concatenate([np.empty((0, width), np.uint8), *data]))


def columns_of(messages: Iterable[can.Message]) -> LogColumns:
    """Return frames from anywhere as columns, in their order."""
    stamps, identifiers = array("q"), array("I")
    flags, lengths = bytearray(), bytearray()
    payload = bytearray()
    width = _CLASSIC_BYTES
    for message in messages:
        data = message.data
        size = len(data)
        if size > width:
            payload = _widened(payload, width, _FD_BYTES)
            width = _FD_BYTES
        stamps.append(timestamp_us(message))
        identifiers.append(message.arbitration_id)
        flags.append(
            message.is_extended_id
            | message.is_rx << 1
            | (not (message.is_remote_frame or message.is_error_frame)) << 2
        )
        lengths.append(size)
        payload += data.ljust(width, b"\0")
    bits = np.frombuffer(bytes(flags), dtype=np.uint8)
    return LogColumns(
        timestamp_us=np.array(stamps, dtype=np.int64),
        frame_id=np.array(identifiers, dtype=np.uint32),
        is_extended=(bits & 1).astype(np.bool_),
        data=np.frombuffer(bytes(payload), dtype=np.uint8).reshape(-1, width),
        length=np.frombuffer(bytes(lengths), dtype=np.uint8),
        is_rx=(bits >> 1 & 1).astype(np.bool_),
        is_data=(bits >> 2 & 1).astype(np.bool_),
    )


def _widened(payload: bytearray, old_width: int, width: int) -> bytearray:
    rows = np.frombuffer(bytes(payload), dtype=np.uint8).reshape(-1, old_width)
    return bytearray(np.pad(rows, ((0, 0), (0, width - old_width))).tobytes())
