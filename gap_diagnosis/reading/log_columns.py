"""Bus logs of every format as columns, bounded in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from can_bus import LogColumns, read_log_columns
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.cut_off import unfinished_line

MAX_BYTES: Final = 1 << 30
"""Size of a log as text; a line of it takes less memory than text."""

_TEXT: Final = (".log", ".asc")


def load_columns(path: Path) -> LogColumns:
    """Read a whole log: candump, ASC, BLF, or MF4 where asammdf is installed.

    The last line of a candump log that was cut off while it was written is left out.

    Raises CanBusError for a log that cannot be read or has too many frames, DiagnosisError for one
    that is too long as text.
    """
    is_text = path.suffix.lower() in _TEXT
    if is_text and path.is_file() and path.stat().st_size > MAX_BYTES:
        raise DiagnosisError(
            f"{path}: over {MAX_BYTES >> 30} GiB: expected a shorter log, or a part of it"
        )
    return read_log_columns(path, leave_out_cut=True)


def is_cut_off(path: Path) -> bool:
    """Tell a candump log whose last line has no end: nobody can tell what is missing of it."""
    with path.open("rb") as file:
        is_candump = file.read(1) == b"("
    return is_candump and bool((unfinished_line(path) or "").strip())
