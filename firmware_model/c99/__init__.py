"""The kernel in C99, for real firmware: one header, one source, and what reads their layout."""

from __future__ import annotations

from importlib.resources import files
from typing import Final

HEADER: Final = "chiplog_firmware.h"
SOURCE: Final = "chiplog_firmware.c"
HOST: Final = "host.c"


def text(name: str) -> str:
    """Return one of this folder's C files."""
    return files(__name__).joinpath(name).read_text(encoding="utf-8")
