"""The frames of a whole log as columns: what the array codec works on."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from can_bus.frames import MICROSECONDS_PER_S, timestamp_us
from can_bus.logs.frame_block import (
    CLASSIC_BYTES,
    ERROR,
    EXTENDED,
    FD_BYTES,
    REMOTE,
    SENT,
    FrameBlock,
)
from can_bus.specs import MessageSpec

BUS_START = 2166136261
BUS_PRIME = 16777619


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
        bus: uint32[frames]: equal where the log says the same channel; what it is, `bus_of` says.
    """

    timestamp_us: NDArray[np.int64]
    frame_id: NDArray[np.uint32]
    is_extended: NDArray[np.bool_]
    data: NDArray[np.uint8]
    length: NDArray[np.uint8]
    is_rx: NDArray[np.bool_]
    is_data: NDArray[np.bool_]
    bus: NDArray[np.uint32]

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


def empty_columns(frames: int, width: int) -> dict[str, NDArray[Any]]:
    """Return columns to be filled: data frames without data, received at 0."""
    return {
        "timestamp_us": np.zeros(frames, dtype=np.int64),
        "frame_id": np.zeros(frames, dtype=np.uint32),
        "is_extended": np.zeros(frames, dtype=np.bool_),
        "data": np.zeros((frames, width), dtype=np.uint8),
        "length": np.zeros(frames, dtype=np.uint8),
        "is_rx": np.ones(frames, dtype=np.bool_),
        "is_data": np.ones(frames, dtype=np.bool_),
        "bus": np.zeros(frames, dtype=np.uint32),
    }


def bus_of(channel: object) -> int:
    """Return a number that stands for a channel: its own, or of its name (FNV-1a)."""
    if isinstance(channel, int):
        return channel & 0xFFFFFFFF
    number = BUS_START
    for byte in str(channel).encode():
        number = (number ^ byte) * BUS_PRIME & 0xFFFFFFFF
    return number


def joined(parts: list[LogColumns]) -> LogColumns:
    """Return the frames of all parts, in order."""
    longest = max((int(part.length.max(initial=0)) for part in parts), default=0)
    width = CLASSIC_BYTES if longest <= CLASSIC_BYTES else FD_BYTES
    if len(parts) == 1 and parts[0].data.shape[1] == width:
        return parts[0]
    columns = empty_columns(sum(map(len, parts)), width)
    stop = 0
    for part in parts:
        start, stop = stop, stop + len(part)
        for name, column in columns.items():
            if name == "data":
                column[start:stop, : part.data.shape[1]] = part.data[:, :width]
            else:
                column[start:stop] = getattr(part, name)
    return LogColumns(**columns)


def columns_of_block(block: FrameBlock) -> LogColumns:
    """Return a block's frames as columns."""
    stamps_us: NDArray[Any] = np.rint(block.timestamp_s * MICROSECONDS_PER_S)
    return LogColumns(
        timestamp_us=stamps_us.astype(np.int64),
        frame_id=block.frame_id,
        is_extended=block.flags & EXTENDED != 0,
        data=block.data,
        length=block.length,
        is_rx=block.flags & SENT == 0,
        is_data=block.flags & (REMOTE | ERROR) == 0,
        bus=block.channel.astype(np.uint32),
    )


def columns_of(messages: Iterable[can.Message]) -> LogColumns:
    """Return frames from anywhere as columns, in their order."""
    stamps, identifiers = array("q"), array("I")
    buses = array("I")
    known: dict[object, int] = {}
    flags, lengths = bytearray(), bytearray()
    payload = bytearray()
    width = CLASSIC_BYTES
    for message in messages:
        data = message.data
        size = len(data)
        if size > width:
            payload = _widened(payload, width, FD_BYTES)
            width = FD_BYTES
        stamps.append(timestamp_us(message))
        identifiers.append(message.arbitration_id)
        flags.append(
            message.is_extended_id
            | message.is_rx << 1
            | (not (message.is_remote_frame or message.is_error_frame)) << 2
        )
        lengths.append(size)
        channel = message.channel
        buses.append(
            known[channel] if channel in known else known.setdefault(channel, bus_of(channel))
        )
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
        bus=np.array(buses, dtype=np.uint32),
    )


def _widened(payload: bytearray, old_width: int, width: int) -> bytearray:
    rows = np.frombuffer(bytes(payload), dtype=np.uint8).reshape(-1, old_width)
    return bytearray(np.pad(rows, ((0, 0), (0, width - old_width))).tobytes())
