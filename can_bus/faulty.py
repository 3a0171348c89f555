"""What of a foreign DBC file cannot be right, and can be left out where a log is only read.

Files that go round for cars describe thousands of signals that somebody guessed. A message whose
signals overlap says nothing against the ones beside it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import cantools.database.can

_MOST_STANDARD: Final = 0x7FF
_EXTENDED: Final = 1 << 31
_MESSAGE = re.compile(r"^BO_[ \t]+(\d{1,10})[ \t]+(\w+)[ \t]*:[^\n]*(?:\n[ \t]+SG_[^\n]*)*", re.M)
_UNUSED = re.compile(r"(VAL_|SIG_VALTYPE_) (\d+) (\w+)")


def without_wrong_identifiers(text: str) -> tuple[str, dict[str, str]]:
    """Return a DBC's text without messages of 11 bits whose identifier has more, line by line where
    it was, and what is wrong with each of them by name: cantools reads no file that has one."""
    wrong: dict[str, str] = {}

    def kept(match: re.Match[str]) -> str:
        identifier, name = int(match[1]), match[2]
        if identifier >= _EXTENDED or identifier <= _MOST_STANDARD:
            return match[0]
        wrong[name] = (
            f"{name}: identifier {identifier:#x} has more than 11 bits: expected bit 31 set, "
            "which marks one of 29"
        )
        return "\n" * match[0].count("\n")

    return _MESSAGE.sub(kept, text), wrong


def without_unused(text: str, problem: str) -> str:
    """Return a DBC's text without the values that *problem*, of cantools, says belong to no
    signal."""
    for keyword, identifier, signal in _UNUSED.findall(problem):
        statement = rf'{keyword}\s+{identifier}\s+{signal}\b(?:"(?:\\"|[^"])*"|[^";])*;'
        text = re.sub(statement, lambda match: "\n" * match[0].count("\n"), text)
    return text


def what_is_wrong(message: cantools.database.can.Message) -> str | None:
    """Return what cantools would refuse of a message that it was told to take; None of a right
    one."""
    try:
        message.refresh(strict=True)
    except Exception as error:  # its own, and what corrupt sizes make it run into
        return str(error)
    return None
