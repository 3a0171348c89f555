"""Files whose last line was cut off while it was written, as where power was lost.

What is whole is read, and a note says that the rest was left out.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final

_LAST_BYTES: Final = 1 << 16
_LINE_ENDS: Final = ("\n", "\r")


def last_line_note(of: str = "") -> str:
    """Return the sentence for a file whose last line was left out, *of* one beside the log."""
    whose = f" of {of}" if of else ""
    return f"The last line{whose} was cut off while it was written: it was left out."


def unfinished_line(path: Path) -> str | None:
    """Return the last line of a text file where it has no line end; None where it has one.

    Of a very long line only its end. Raises OSError for a file that cannot be read.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _LAST_BYTES))
        text = file.read().decode("utf-8", errors="replace")
    if not text or text.endswith(_LINE_ENDS):
        return None
    return text.splitlines()[-1]


def is_cut_row(line: str, delimiter: str, cells: int) -> bool:
    """Tell a table's line, *line* with its end, that breaks off before its last of *cells*.

    One that has them all is taken as it is: many programs end a file without a line end.
    """
    if line.endswith(_LINE_ENDS):
        return False
    found = next(csv.reader([line.replace("\0", "")], delimiter=delimiter), [])
    return len(found) < cells
