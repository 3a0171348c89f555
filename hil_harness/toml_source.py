"""TOML files from strangers: bounded when read, and every key knows its line."""

import re
import sys
import tomllib
from dataclasses import dataclass, field
from datetime import date, datetime, time
from pathlib import Path
from typing import Any, Final

from hil_harness.errors import HarnessError
from hil_harness.toml_lines import Path as KeyPath
from hil_harness.toml_lines import key_lines

MAX_BYTES: Final = 256 * 1024
"""Largest configuration file that is read; the largest of ours is under 16 KiB."""

MAX_DEPTH: Final = 32
"""Deepest nesting of tables and lists that is read; the deepest of ours is 4."""

_SHOWN_LENGTH: Final = 48
_ELLIPSIS: Final = re.compile(r"\.{2,}")
_NO_KEY: Final = re.compile(r"[^\w.\"' \t-]+")
_DOTTED_KEY: Final = re.compile(r"\w+(?:\.\w+)*")
_SYNTAX_POSITION: Final = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


@dataclass(frozen=True)
class TomlSource:
    """One TOML document and where its keys stand.

    Attributes:
        path: the file, or None for text that came from nowhere on disk.
        name: how messages call the file: its name without folders.
        data: the parsed document.
        lines: the line (from 1) of every key, table and list item.
    """

    path: Path | None
    name: str
    data: dict[str, Any]
    lines: dict[KeyPath, int] = field(repr=False)

    def line_of(self, key: str | KeyPath) -> int | None:
        """Return the line of *key*, or of the nearest table above it; None for the whole file.

        *key* is dotted (``"encoder.ticks_per_rev"``) or a path (``("segments", 2, "v_m_s")``).
        """
        path: KeyPath = tuple(key.split(".")) if isinstance(key, str) else key
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def value_at(self, path: KeyPath) -> object:
        """Return the value at *path*; raise KeyError when there is none."""
        value: Any = self.data
        for part in path:
            try:
                value = value[part]
            except (KeyError, IndexError, TypeError) as error:
                raise KeyError(path) from error
        return value

    def where(self, key: str | KeyPath = ()) -> str:
        """Return ``file:line`` for *key*, or only the file where no line is known."""
        line = self.line_of(key)
        return self.name if line is None else f"{self.name}:{line}"

    def key_named_in(self, message: str, under: KeyPath = ()) -> KeyPath:
        """Return the first key that *message* names and the file has, *under* a table or anywhere.

        *under* itself when there is none: what several fields have wrong together.
        """
        for word in _DOTTED_KEY.findall(message):
            path = (*under, *word.split("."))
            if path in self.lines:
                return path
            if not under and "_" in word:  # a name without its table
                for key in self.lines:
                    if len(key) == 2 and key[1] == word:
                        return key
        return under

    def error(self, key: str | KeyPath, message: str) -> HarnessError:
        """Return (not raise) an error that puts *message* at the line of *key*."""
        return HarnessError(f"{self.where(key)}: {message}")


def load_toml(path: str | Path) -> TomlSource:
    """Read the TOML file at *path*.

    Raises HarnessError, always in one line, when the file is missing, is a folder, cannot be
    read, is larger than MAX_BYTES, is not UTF-8, or is not TOML.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise HarnessError(f"{file}: no such file: expected a TOML file") from None
    except IsADirectoryError:
        raise HarnessError(f"{file}: is a folder: expected a TOML file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise HarnessError(f"{file}: cannot be read: {reason}") from None
    if len(content) > MAX_BYTES:
        raise HarnessError(
            f"{file}: larger than {MAX_BYTES // 1024} KiB: expected a TOML file written by a person"
        )
    return parse_toml(content, name=file.name, path=file)


def parse_toml(content: str | bytes, *, name: str, path: Path | None = None) -> TomlSource:
    """Parse TOML *content*, which messages will call *name*; raise HarnessError as load_toml."""
    if isinstance(content, bytes):
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            raise HarnessError(
                f"{name}:{line}: byte 0x{content[error.start]:02X} is not UTF-8: "
                "expected a TOML file saved as UTF-8"
            ) from None
    else:
        text = content
    _refuse_endless_keys(name, text)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise HarnessError(_syntax_message(name, text, str(error))) from None
    except RecursionError:
        raise HarnessError(f"{name}: {_TOO_DEEP}") from None
    except ValueError:  # Python agrees to read only so many digits
        most = sys.get_int_max_str_digits()
        raise HarnessError(f"{name}: a number of over {most} digits: expected fewer") from None
    lines = key_lines(text)
    deepest = max(lines, key=len, default=())
    if len(deepest) > MAX_DEPTH:
        raise HarnessError(f"{name}:{lines[deepest]}: {_TOO_DEEP}")
    return TomlSource(path=path, name=name, data=data, lines=lines)


_TOO_DEEP: Final = f"tables or lists are nested too deeply: expected at most {MAX_DEPTH} levels"


def _refuse_endless_keys(name: str, text: str) -> None:
    """Refuse keys of very many parts: tomllib takes a minute for one of twenty thousand."""
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MAX_DEPTH and any(
            part.count(".") > MAX_DEPTH for part in _NO_KEY.split(_ELLIPSIS.sub("", line))
        ):
            raise HarnessError(f"{name}:{number}: {_TOO_DEEP}")


def _syntax_message(name: str, text: str, message: str) -> str:
    position = _SYNTAX_POSITION.search(message)
    line = text.rstrip().count("\n") + 1
    if position is not None:
        message = message[: position.start()]
        line = int(position.group(1) or line)
    lines = text.split("\n")
    shown = shorten(lines[line - 1].strip()) if line <= len(lines) else ""
    found = f" near `{shown}`" if shown else ""
    return f"{name}:{line}: not a TOML file: {message[:1].lower()}{message[1:]}{found}"


def shorten(text: str, length: int = _SHOWN_LENGTH) -> str:
    """Return *text* on one printable line of at most *length* characters."""
    printable = "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text[: length + 1]
    )
    return printable if len(printable) <= length else printable[: length - 1] + "…"


def toml_text(value: object) -> str:
    """Return *value* as it would stand in a TOML file, shortened to fit a message."""
    return shorten(_toml_text(value))


def _toml_text(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            shown = value[: _SHOWN_LENGTH + 1].replace("\\", "\\\\").replace('"', '\\"')
            return f'"{shown}"'
        case dict():
            pairs = (f"{key} = {_toml_text(item)}" for key, item in list(value.items())[:4])
            return f"{{ {', '.join(pairs)} }}" if value else "{}"
        case list() | tuple():
            return f"[{', '.join(_toml_text(item) for item in value[:8])}]"
        case datetime() | date() | time():
            return value.isoformat()
        case int() if abs(value) > 10**30:
            return f"a whole number of {value.bit_length()} bits"
        case _:
            return str(value)
