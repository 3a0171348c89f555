"""Candump logs at array speed: data frames many at a time, all other lines one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from can_bus.frames import timestamp_us
from can_bus.logs.frame_block import CLASSIC_BYTES, FD_BYTES
from can_bus.logs.log_columns import LogColumns, bus_of, empty_columns, joined
from can_bus.logs.reader import read_candump_line

_BLOCK_BYTES: Final = 1 << 20
SCANNED: Final = ("timestamp_us", "frame_id", "is_extended", "data", "length", "is_rx", "bus")
"""The columns that the pass over data frames fills, in the order in which it takes them."""


def read_candump_columns(
    path: Path, refuse_beyond: Callable[[int], None], *, leave_out_cut: bool = False
) -> LogColumns:
    """Read a candump log. Raises CanBusError naming file and line, as `read_log` does.

    Args:
        refuse_beyond: is told after each block how many frames there are, and may raise.
        leave_out_cut: leave out a last line that has no line end.
    """
    parts: list[LogColumns] = []
    line = frames = 0
    for block in _text_blocks(path):
        if leave_out_cut and not block.endswith(b"\n") and len(block) < _BLOCK_BYTES:
            break  # the last line: blocks end with a line but for it
        parts.append(_columns(path, block, line + 1))
        frames += len(parts[-1])
        refuse_beyond(frames)
        line += block.count(b"\n")
    return joined(parts)


def _text_blocks(path: Path) -> Iterator[bytes]:
    """Yield a file in blocks of whole lines; the last may lack its line end."""
    rest = b""
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            block = rest + block
            end = block.rfind(b"\n") + 1
            rest = block[end:]
            if end:
                yield block[:end]
            elif len(rest) > _BLOCK_BYTES:
                yield rest  # a line of this length is none: whoever reads it line by line says so
                rest = b""
    if rest:
        yield rest


def _columns(path: Path, block: bytes, line: int) -> LogColumns:
    """Return the frames of whole lines; `line` is the number of the first."""
    # numba takes a quarter of a second to import: only who reads whole logs pays for it.
    from can_bus.logs.candump_lines import read_lines  # noqa: PLC0415

    text = np.frombuffer(block, dtype=np.uint8)
    columns = empty_columns(block.count(b"\n") + 1, FD_BYTES if b"##" in block else CLASSIC_BYTES)
    arrays = [columns[name] for name in SCANNED]
    at = row = 0
    while True:
        before = row
        at, row = read_lines(text, at, row, *arrays)
        if at == len(block):
            return LogColumns(**{name: column[:row] for name, column in columns.items()})
        line += row - before
        end = block.find(b"\n", at) + 1 or len(block)
        message = read_candump_line(path, block[at:end].decode("ascii", errors="replace"), line)
        if message is not None:
            content = message.data
            columns["timestamp_us"][row] = timestamp_us(message)
            columns["frame_id"][row] = message.arbitration_id
            columns["is_extended"][row] = message.is_extended_id
            columns["data"][row, : len(content)] = np.frombuffer(content, dtype=np.uint8)
            columns["length"][row] = len(content)
            columns["is_rx"][row] = message.is_rx
            columns["bus"][row] = bus_of(message.channel)
            columns["is_data"][row] = not (message.is_remote_frame or message.is_error_frame)
            row += 1
        line += 1
        at = end
