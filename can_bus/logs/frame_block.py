"""Some frames of a log as arrays, with all that a frame says: between a file and its reader."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError
from can_bus.frames import QuickMessage

EXTENDED: Final = 1
SENT: Final = 2
REMOTE: Final = 4
ERROR: Final = 8
FD: Final = 16
BITRATE_SWITCH: Final = 32
ERROR_STATE: Final = 64

CLASSIC_BYTES: Final = 8
FD_BYTES: Final = 64
STANDARD_IDS: Final = 1 << 11
EXTENDED_IDS: Final = 1 << 29
FD_LENGTHS: Final = (*range(9), 12, 16, 20, 24, 32, 48, FD_BYTES)
"""Bytes of data by data length code."""

MAX_STAMP_S: Final = 1e12
"""As for candump lines; in whole microseconds such a stamp fits 64 bits."""


@dataclass(frozen=True)
class FrameBlock:
    """Frames, one row each, in the file's order.

    Attributes:
        timestamp_s: float64[frames].
        frame_id: uint32[frames].
        flags: uint8[frames], sums of `EXTENDED` to `ERROR_STATE`.
        dlc: uint8[frames]: the length that the frame states, in bytes.
        length: uint8[frames]: bytes of data that are there.
        channel: int32[frames], counted from 0.
        data: uint8[frames, 8 or 64], zero padded.
    """

    timestamp_s: NDArray[np.float64]
    frame_id: NDArray[np.uint32]
    flags: NDArray[np.uint8]
    dlc: NDArray[np.uint8]
    length: NDArray[np.uint8]
    channel: NDArray[np.int32]
    data: NDArray[np.uint8]

    @classmethod
    def empty(cls, frames: int, width: int) -> FrameBlock:
        """Return a block to be filled: zeros."""
        return cls(
            np.zeros(frames),
            np.zeros(frames, dtype=np.uint32),
            np.zeros(frames, dtype=np.uint8),
            np.zeros(frames, dtype=np.uint8),
            np.zeros(frames, dtype=np.uint8),
            np.zeros(frames, dtype=np.int32),
            np.zeros((frames, width), dtype=np.uint8),
        )

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.timestamp_s)

    def rows(self, start: int, stop: int) -> FrameBlock:
        """Return some of the frames."""
        return FrameBlock(*(column[start:stop] for column in vars(self).values()))

    def widened(self, width: int) -> FrameBlock:
        """Return the frames with room for so many bytes, no fewer than now."""
        missing = width - self.data.shape[1]
        return replace(self, data=np.pad(self.data, ((0, 0), (0, missing)))) if missing else self

    def messages(self) -> Iterator[can.Message]:
        """Yield the frames one by one."""
        columns = (column.tolist() for name, column in vars(self).items() if name != "data")
        payload, width = self.data.tobytes(), self.data.shape[1]
        for row, (stamp_s, frame_id, flags, dlc, length, channel) in enumerate(
            zip(*columns, strict=True)
        ):
            message = QuickMessage(
                timestamp=stamp_s,
                arbitration_id=frame_id,
                is_extended_id=bool(flags & EXTENDED),
                is_remote_frame=bool(flags & REMOTE),
                is_error_frame=bool(flags & ERROR),
                channel=channel,
                is_fd=bool(flags & FD),
                is_rx=not flags & SENT,
                bitrate_switch=bool(flags & BITRATE_SWITCH),
                error_state_indicator=bool(flags & ERROR_STATE),
                dlc=dlc,
            )
            if not flags & REMOTE:
                message.data = bytearray(payload[row * width : row * width + length])
            yield message


def fault_of(message: can.Message) -> str | None:
    """Return what a frame would need to be one that a bus carries; None for a good frame."""
    if not 0 <= message.timestamp < MAX_STAMP_S:
        return f"a stamp from 0 up to {MAX_STAMP_S:g} s"
    if message.is_error_frame:
        return None
    if message.is_extended_id:
        if not 0 <= message.arbitration_id < EXTENDED_IDS:
            return f"an extended identifier up to {EXTENDED_IDS - 1:X}"
    elif not 0 <= message.arbitration_id < STANDARD_IDS:
        return f"a standard identifier up to {STANDARD_IDS - 1:X}"
    if message.is_remote_frame:
        return None if 0 <= message.dlc <= CLASSIC_BYTES else "a remote frame's length, 0 to 8"
    if len(message.data) != message.dlc:
        return "as many data bytes as its length says"
    return None if message.dlc in FD_LENGTHS else LENGTHS


LENGTHS: Final = "a CAN FD length (0 to 8, 12, 16, 20, 24, 32, 48, 64)"


def faults(block: FrameBlock) -> NDArray[np.bool_]:
    """Return which frames `fault_of` finds a fault in."""
    is_error = block.flags & ERROR != 0
    limit = np.where(block.flags & EXTENDED, EXTENDED_IDS, STANDARD_IDS)
    is_length = np.zeros(256, dtype=np.bool_)
    is_length[list(FD_LENGTHS)] = True
    bad_length = np.where(
        block.flags & REMOTE != 0,
        block.dlc > CLASSIC_BYTES,
        (block.length != block.dlc) | ~is_length[block.dlc],
    )
    in_time = (block.timestamp_s >= 0) & (block.timestamp_s < MAX_STAMP_S)
    return np.asarray(~in_time | (~is_error & ((block.frame_id >= limit) | bad_length)))


def refusal(path: Path, block: FrameBlock, row: int, before: int) -> CanBusError:
    """Return the error for a frame with a fault, which comes after so many good ones."""
    message = next(block.rows(row, row + 1).messages())
    return CanBusError(
        f"{path}: frame {before + 1}: identifier {message.arbitration_id:X}, "
        f"length {message.dlc}, {len(message.data)} bytes, {message.timestamp:g} s: "
        f"expected {fault_of(message)}"
    )
