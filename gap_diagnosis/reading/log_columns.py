"""Bus logs of every format as columns, bounded in memory."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import can

from can_bus import LogColumns, columns_of, read_log, read_log_columns
from gap_diagnosis.errors import DiagnosisError

MAX_FRAMES: Final = 20_000_000
"""Frames that are read of one log, some ten hours of ours; each takes 23 bytes here."""

MAX_BYTES: Final = 1 << 30
"""Size of a log as text; a line of it takes less memory than text."""

_COMPRESSED: Final = (".blf",)


def load_columns(path: Path) -> LogColumns:
    """Read a whole log: candump, ASC, BLF, or MF4 where asammdf is installed.

    Raises CanBusError for a log that cannot be read, DiagnosisError for one that is too long or an
    MF4 file that nothing here can read.
    """
    if path.suffix.lower() == ".mf4":
        return columns_of(_bounded(path, _read_mf4(path)))
    if path.suffix.lower() in _COMPRESSED:
        return columns_of(_bounded(path, read_log(path)))
    if path.is_file() and path.stat().st_size > MAX_BYTES:
        raise DiagnosisError(
            f"{path}: over {MAX_BYTES >> 30} GiB: expected a shorter log, or a part of it"
        )
    return read_log_columns(path)


def _bounded(path: Path, messages: Iterable[can.Message]) -> Iterator[can.Message]:
    for number, message in enumerate(messages):
        if number >= MAX_FRAMES:
            raise DiagnosisError(
                f"{path}: more than {MAX_FRAMES} frames: expected a shorter log, or a part of it"
            )
        yield message


def _read_mf4(path: Path) -> Iterator[can.Message]:
    if not path.is_file():
        raise DiagnosisError(f"{path}: no such file: expected a log")
    try:
        # asammdf takes half a second to import, and only who reads MF4 needs it.
        importlib.import_module("asammdf")
    except ImportError:
        raise DiagnosisError(
            f"{path}: reading MF4 needs asammdf: pip install asammdf, "
            "or convert it: can_logconvert LOG.mf4 LOG.blf"
        ) from None
    try:
        with can.MF4Reader(path) as frames:
            yield from frames
    except Exception as error:  # asammdf raises what parsing happens to raise
        text = " ".join(str(error).split()) or type(error).__name__
        raise DiagnosisError(f"{path}: not an MF4 file that can be read: {text}") from error
