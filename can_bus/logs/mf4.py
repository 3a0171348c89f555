"""MF4 logs (ASAM MDF 4 with bus logging), read by asammdf, which is an extra.

Its C code trusts what a file says and a damaged one can end the process: it runs in one of its own.
"""

from __future__ import annotations

import gc
import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError, one_line, quiet
from can_bus.logs.apart import Reading, read_apart
from can_bus.logs.frame_block import (
    BITRATE_SWITCH,
    CLASSIC_BYTES,
    ERROR,
    ERROR_STATE,
    EXTENDED,
    FD,
    FD_BYTES,
    FD_LENGTHS,
    REMOTE,
    SENT,
    FrameBlock,
    faults,
    refusal,
)

_EVENTS: Final = {"CAN_DataFrame": 0, "CAN_RemoteFrame": REMOTE, "CAN_ErrorFrame": ERROR}
_BITS: Final = {
    "IDE": EXTENDED,
    "Dir": SENT,
    "EDL": FD,
    "BRS": BITRATE_SWITCH,
    "ESI": ERROR_STATE,
}
_IDENTIFIER: Final = np.uint32(0x1FFFFFFF)
_MAGIC: Final = b"MDF     4"
_HEAD_BYTES: Final = 64
_FRAMES_AT_ONCE: Final = 1 << 18


def read_mf4_blocks(
    path: Path, refuse_beyond: Callable[[int], None] | None = None
) -> Iterator[FrameBlock]:
    """Yield the frames of an MF4 file, of all its channels, ordered by their stamps.

    Args:
        path: the file.
        refuse_beyond: is told how many frames there are before they are read, and may raise.

    Raises CanBusError in one line where asammdf is not installed, for a file that it cannot read,
    and for a frame that no bus carries; the frames before that one were yielded.
    """
    asammdf = _asammdf(path)
    with quiet("asammdf"), _no_complaints_of_the_dead():
        blocks = read_apart(lambda: _read(asammdf, path, refuse_beyond))
        if isinstance(blocks, str):
            gc.collect()  # where it was read here: they hold each other
    if isinstance(blocks, str):
        raise CanBusError(f"{path}: not an MF4 file that can be read: {blocks}")
    yield from _good_frames(path, _by_time(blocks))


def _asammdf(path: Path) -> Any:
    # asammdf takes half a second to import, and only who reads MF4 needs it. The command line bars
    # it, as python-can would import it for everybody.
    if "asammdf" in sys.modules and sys.modules["asammdf"] is None:
        del sys.modules["asammdf"]
    try:
        return importlib.import_module("asammdf")
    except ImportError:
        raise CanBusError(
            f'{path}: reading MF4 needs asammdf: pip install "chiplog[mf4]", '
            "or convert it: can_logconvert LOG.mf4 LOG.blf"
        ) from None


@contextmanager
def _no_complaints_of_the_dead() -> Iterator[None]:
    """Keep quiet what asammdf's half-made objects say when they are deleted."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = hook


def _read(asammdf: Any, path: Path, refuse_beyond: Callable[[int], None] | None) -> Reading:
    """Return the frames of each channel group, or what is wrong with the file."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if len(head) < _HEAD_BYTES or not head.startswith(_MAGIC):
        return f"its first {_HEAD_BYTES} bytes are not those of one"
    try:
        with asammdf.MDF(path) as recording:
            groups = list(enumerate(recording.groups))
            if refuse_beyond is not None:
                refuse_beyond(sum(group.channel_group.cycles_nr for _, group in groups))
            start_s = recording.header.start_time.timestamp()
            return [
                _block(recording.get(event, group=number, raw=True), event, flag, start_s)
                for number, group in groups
                if group.channel_group.cycles_nr
                for event, flag in _EVENTS.items()
                if any(channel.name == event for channel in group.channels)
            ]
    except CanBusError:
        raise
    except Exception as error:  # asammdf raises what parsing happens to raise
        return one_line(error)


def _block(signal: Any, event: str, flag: int, start_s: float) -> FrameBlock:
    """Return the frames of one channel group: asammdf's signal with a structure per frame."""
    samples = signal.samples
    names = samples.dtype.names or ()
    field = f"{event}.DataBytes"
    is_short = field not in names or samples.dtype[field].shape[0] <= CLASSIC_BYTES
    block = FrameBlock.empty(len(samples), CLASSIC_BYTES if is_short else FD_BYTES)

    def values(name: str) -> NDArray[Any] | None:
        field = f"{event}.{name}"
        return np.asarray(samples[field]) if field in names else None

    block.timestamp_s[:] = signal.timestamps + start_s
    identifier = values("ID")
    if identifier is not None:
        identifier = identifier.astype(np.uint32)
        block.frame_id[:] = identifier & _IDENTIFIER
        block.flags[identifier >> np.uint32(31) != 0] |= EXTENDED
    block.flags[:] |= flag
    for name, bit in _BITS.items():
        column = values(name)
        if column is not None:
            block.flags[column != 0] |= bit
    channel = values("BusChannel")
    if channel is not None:
        block.channel[:] = channel
    code, length, data = values("DLC"), values("DataLength"), values("DataBytes")
    if code is not None:
        block.dlc[:] = np.asarray(FD_LENGTHS, dtype=np.uint8)[np.minimum(code, 15)]
    if flag == REMOTE or data is None:
        return block
    length = block.dlc if length is None else length
    room = block.data.shape[1]
    width = min(data.shape[1], room)
    block.length[:] = np.minimum(length, room)
    block.data[:, :width] = data[:, :width]
    block.data[np.arange(room) >= block.length[:, np.newaxis]] = 0
    if code is None or flag == ERROR:
        block.dlc[:] = block.length
    return block


def _by_time(blocks: list[FrameBlock]) -> FrameBlock:
    if not blocks:
        return FrameBlock.empty(0, CLASSIC_BYTES)
    room = max(block.data.shape[1] for block in blocks)
    blocks = [block.widened(room) for block in blocks]
    columns = [
        np.concatenate(column) for column in zip(*(vars(b).values() for b in blocks), strict=True)
    ]
    order = np.argsort(columns[0], kind="stable")
    return FrameBlock(*(column[order] for column in columns))


def _good_frames(path: Path, block: FrameBlock) -> Iterator[FrameBlock]:
    bad = np.flatnonzero(faults(block))
    good = int(bad[0]) if len(bad) else len(block)
    for start in range(0, good, _FRAMES_AT_ONCE):
        yield block.rows(start, min(start + _FRAMES_AT_ONCE, good))
    if good < len(block):
        raise refusal(path, block, good, good)
