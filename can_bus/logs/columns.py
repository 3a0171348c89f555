"""Whole logs of every format as columns, bounded in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import can

from can_bus.errors import CanBusError
from can_bus.logs.blf import read_blf_blocks
from can_bus.logs.candump_columns import read_candump_columns
from can_bus.logs.frame_block import FrameBlock
from can_bus.logs.log_columns import LogColumns, columns_of, columns_of_block, joined
from can_bus.logs.mf4 import read_mf4_blocks
from can_bus.logs.reader import log_format, read_log

MAX_FRAMES: Final = 20_000_000
"""Frames that are read of one log, some ten hours of ours; each takes 25 bytes here."""


def read_log_columns(
    path: str | Path, max_frames: int = MAX_FRAMES, *, leave_out_cut: bool = False
) -> LogColumns:
    """Read a whole log (candump, ASC, BLF, MF4) into columns.

    With *leave_out_cut* a last line of a candump log without a line end is no frame, and no error.

    Raises CanBusError as `read_log` does, and for a log of more than `max_frames` frames.
    """
    path = Path(path)

    def refuse_beyond(frames: int) -> None:
        if frames > max_frames:
            raise CanBusError(
                f"{path}: more than {max_frames} frames: expected a shorter log, or a part of it"
            )

    kind = log_format(path)
    if kind == "candump":
        return read_candump_columns(path, refuse_beyond, leave_out_cut=leave_out_cut)
    if kind == "asc":
        return columns_of(_counted(read_log(path), refuse_beyond))
    blocks = read_blf_blocks(path) if kind == "blf" else read_mf4_blocks(path, refuse_beyond)
    return joined(list(_columns(blocks, refuse_beyond)))


def _columns(
    blocks: Iterable[FrameBlock], refuse_beyond: Callable[[int], None]
) -> Iterator[LogColumns]:
    frames = 0
    for block in blocks:
        frames += len(block)
        refuse_beyond(frames)
        yield columns_of_block(block)


def _counted(
    messages: Iterable[can.Message], refuse_beyond: Callable[[int], None]
) -> Iterator[can.Message]:
    for number, message in enumerate(messages, start=1):
        refuse_beyond(number)
        yield message
