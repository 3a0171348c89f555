"""What of a foreign DBC file cannot be right, and can be left out where a log is only read.

Files that go round for cars describe thousands of signals that somebody guessed. A message whose
signals overlap says nothing against the ones beside it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from can_bus.errors import one_line

if TYPE_CHECKING:
    import cantools.database.can

_MOST_STANDARD: Final = 0x7FF
_MOST_EXTENDED: Final = 0x1FFF_FFFF
EXTENDED: Final = 1 << 31
"""The bit of a DBC that marks an identifier of 29 bits."""
_MOST_DIGITS: Final = 10
# No quantifier gives back what it took: scans stay linear. Strings and comments are stepped over.
_STRING: Final = r'"(?:\\"|[^"\\]|\\(?!"))*+"'
_OVER: Final = rf"{_STRING}|//[^\n]*+"
_MESSAGE = re.compile(rf"{_OVER}|(?<!\w)BO_\s++(\d++)\s++(\w++)(?=\s*+:)")
_VALUES = re.compile(
    rf"{_OVER}|(?<!\w)(?:VAL_|SIG_VALTYPE_)\s++(\d++)\s++(\w++)(?:{_STRING}|[^\";])*+;"
)
_UNUSED = re.compile(r"(?:VAL_|SIG_VALTYPE_) (\d+) (\w+)")


def with_free_identifiers(text: str) -> tuple[str, dict[int, tuple[int, str]]]:
    """Return a DBC's text with identifiers of 29 bits that no other message has for those of too
    many bits, as cantools reads no file that has one; and by each such identifier its line and what
    was wrong with its message."""
    taken = {int(one[1]) for one in _MESSAGE.finditer(text) if one[1] and _is_short(one[1])}
    free = _MOST_EXTENDED
    wrong: dict[int, tuple[int, str]] = {}
    line, counted_to = 1, 0

    def replaced(match: re.Match[str]) -> str:
        nonlocal free, line, counted_to
        if match[1] is None or (_is_short(match[1]) and _is_right(int(match[1]))):
            return match[0]
        while EXTENDED | free in taken:
            free -= 1
        line += text.count("\n", counted_to, match.start())
        counted_to = match.start()
        wrong[free] = (line, f"{match[2]}: identifier {match[1][:20]} has too many bits")
        number = str(EXTENDED | free)
        free -= 1
        before, after = match.start(1) - match.start(), match.end(1) - match.start()
        return match[0][:before] + number + match[0][after:]

    return _MESSAGE.sub(replaced, text), wrong


def _is_short(digits: str) -> bool:
    return len(digits) <= _MOST_DIGITS


def _is_right(identifier: int) -> bool:
    if identifier < EXTENDED:
        return identifier <= _MOST_STANDARD
    return identifier - EXTENDED <= _MOST_EXTENDED


def without_unused(text: str, problem: str) -> str:
    """Return a DBC's text without the values that *problem*, of cantools, says belong to no
    signal."""
    unused = {(int(identifier), signal) for identifier, signal in _UNUSED.findall(problem)}

    def kept(match: re.Match[str]) -> str:
        if match[1] is None or not _is_short(match[1]) or (int(match[1]), match[2]) not in unused:
            return match[0]
        return "\n" * match[0].count("\n")

    return _VALUES.sub(kept, text)


def what_is_wrong(message: cantools.database.can.Message) -> str | None:
    """Return what cantools would refuse of a message that it was told to take; None of a right
    one."""
    try:
        message.refresh(strict=True)
    except Exception as error:  # its own, and what corrupt sizes make it run into
        return one_line(error)
    return None
