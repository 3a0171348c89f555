"""Where each key of a TOML document stands: what tomllib parses but does not tell.

The scanner reads text that ``tomllib`` has already accepted, so it needs to find the ends of
strings, arrays and tables and nothing more; it never decides whether a document is valid.
"""

import re
import tomllib
from typing import Final

Path = tuple[str | int, ...]
"""Keys and list positions from the root to a value, such as ("segments", 2, "v_m_s")."""

_BARE_KEY: Final = re.compile(r"[^\s=.\]\[{},\"'#]+")
_STRING: Final = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}(?!")'
    r"|'''.*?'{3,5}(?!')"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
_PLAIN_VALUE: Final = re.compile(r"[^,\]}\n#]+")
_BLANK: Final = re.compile(r"(?:[ \t\r\n]|#[^\n]*)+")
_SPACES: Final = re.compile(r"[ \t]+")


def key_lines(text: str) -> dict[Path, int]:
    """Return the line (counted from 1) on which each key, table and list item of *text* starts.

    *text* must be a valid TOML document. The root has no line and no entry.
    """
    return _Scanner(text).document()


class _Scanner:
    def __init__(self, text: str) -> None:
        self._text = text.replace("\r\n", "\n")
        self._at = 0
        self._line = 1
        self._counted_to = 0
        self._lines: dict[Path, int] = {}
        self._array_lengths: dict[Path, int] = {}

    def document(self) -> dict[Path, int]:
        table: Path = ()
        while self._skip(_BLANK):
            if self._text.startswith("[[", self._at):
                self._at += 2
                line = self._current_line()
                array = self._resolve(self._key())
                index = self._array_lengths.get(array, 0)
                self._array_lengths[array] = index + 1
                table = (*array, index)
                self._note_parents(array, line)
                self._note(array, line)
                self._note(table, line)
                self._at = self._text.index("]]", self._at) + 2
            elif self._text.startswith("[", self._at):
                self._at += 1
                line = self._current_line()
                table = self._resolve(self._key())
                self._lines[table] = line
                self._note_parents(table, line)
                self._at = self._text.index("]", self._at) + 1
            else:
                self._pair(table)
        return self._lines

    def _pair(self, table: Path) -> None:
        line = self._current_line()
        path = (*table, *self._key())
        self._note_parents(path, line)
        self._note(path, line)
        self._skip(_SPACES)
        self._at += 1  # the equals sign
        self._value(path)

    def _value(self, path: Path) -> None:
        self._skip(_SPACES)
        opening = self._text[self._at]
        if opening == "[":
            self._items(path)
        elif opening == "{":
            self._inline_table(path)
        else:
            pattern = _STRING if opening in "\"'" else _PLAIN_VALUE
            self._skip(pattern)

    def _items(self, path: Path) -> None:
        self._at += 1
        index = 0
        while self._skip(_BLANK) and self._text[self._at] != "]":
            item = (*path, index)
            self._note(item, self._current_line())
            self._value(item)
            index += 1
            self._skip(_BLANK)
            if self._text[self._at] == ",":
                self._at += 1
        self._at += 1

    def _inline_table(self, path: Path) -> None:
        self._at += 1
        while self._skip(_BLANK) and self._text[self._at] != "}":
            self._pair(path)
            self._skip(_BLANK)
            if self._text[self._at] == ",":
                self._at += 1
        self._at += 1

    def _key(self) -> tuple[str, ...]:
        parts: list[str] = []
        while True:
            self._skip(_SPACES)
            quoted = self._text[self._at] in "\"'"
            match = (_STRING if quoted else _BARE_KEY).match(self._text, self._at)
            assert match is not None, "tomllib accepted a document that the scanner cannot read"
            self._at = match.end()
            parts.append(_unquote(match.group()) if quoted else match.group())
            self._skip(_SPACES)
            if self._text[self._at] != ".":
                return tuple(parts)
            self._at += 1

    def _resolve(self, key: tuple[str, ...]) -> Path:
        """Return the path that a header means: below a list of tables, its latest one."""
        path: Path = ()
        for position, part in enumerate(key):
            path = (*path, part)
            if position < len(key) - 1 and path in self._array_lengths:
                path = (*path, self._array_lengths[path] - 1)
        return path

    def _note(self, path: Path, line: int) -> None:
        self._lines.setdefault(path, line)

    def _note_parents(self, path: Path, line: int) -> None:
        for length in range(len(path) - 1, 0, -1):
            if path[:length] in self._lines:
                break
            self._lines[path[:length]] = line

    def _skip(self, pattern: re.Pattern[str]) -> bool:
        """Go past *pattern* if it is next; return whether any text is left."""
        match = pattern.match(self._text, self._at)
        if match is not None:
            self._at = match.end()
        return self._at < len(self._text)

    def _current_line(self) -> int:
        self._line += self._text.count("\n", self._counted_to, self._at)
        self._counted_to = self._at
        return self._line


def _unquote(quoted: str) -> str:
    key: str = tomllib.loads(f"key = {quoted}")["key"]
    return key
