"""Reading logs, frame by frame: candump, ASC, BLF and MF4, ours and those of others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Literal, TextIO

import can

from can_bus.errors import CanBusError
from can_bus.frames import QuickMessage
from can_bus.logs.blf import read_blf_blocks
from can_bus.logs.frame_block import FD_LENGTHS, LENGTHS, fault_of
from can_bus.logs.mf4 import read_mf4_blocks

LogFormat = Literal["candump", "asc", "blf", "mf4"]

_FORMATS: Final[dict[str, LogFormat]] = {
    ".log": "candump",
    ".asc": "asc",
    ".blf": "blf",
    ".mf4": "mf4",
}
_SNIFFED_BYTES: Final = 4096
_ASC_LINE: Final = re.compile(
    r"\s*(?:$|//|date\b|base\b|(?:no )?internal\b|begin\b|end\b|previous\b|\d+\.\d+\s)",
    re.IGNORECASE,
)
"""How the lines of an ASC log begin: its heading, its blocks, and events at a time."""

_MAX_LINE_CHARACTERS: Final = 1000
_EXCERPT_CHARACTERS: Final = 60

# (1436509052.249713) vcan0 044#2A366C2BBA R
_CANDUMP_LINE: Final = re.compile(
    r"\((\d{1,12}\.\d{1,9})\) +(\S+) +([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(?:(#[0-9A-Fa-f])((?:[0-9A-Fa-f]{2}){0,64})|[Rr]([0-8]?)|((?:[0-9A-Fa-f]{2}){0,8}))"
    r"(?: +([RrTt]))?\s*\Z"
)
_CANDUMP_FORM: Final = (
    "(seconds.microseconds) channel id#data, for example (0.010000) vcan0 123#00FF"
)
_ERROR_FLAG: Final = 0x20000000
_IDENTIFIER_MASK: Final = 0x1FFFFFFF


def log_format(path: Path) -> LogFormat:
    """Return a log's format: by its suffix, else by its first bytes.

    Raises CanBusError for a file that cannot be read or is none of them.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_SNIFFED_BYTES)
    except OSError as error:
        raise CanBusError(f"{path}: cannot read this log: {error.strerror}") from error
    if head.startswith(b"LOGG"):
        return "blf"
    if head.startswith(b"MDF "):
        return "mf4"
    by_suffix = _FORMATS.get(path.suffix.lower())
    if by_suffix is not None:
        return by_suffix
    text = head.decode("ascii", errors="replace")
    if text.startswith("("):
        return "candump"
    if re.match(r"\s*date\s", text):
        return "asc"
    raise CanBusError(f"{path}: not a log that can be read here: candump .log, .asc, .blf or .mf4")


def read_log(path: str | Path) -> Iterator[can.Message]:
    """Yield the frames of a log in its order; stamps in seconds as in the file.

    Streams: memory does not grow with the log. An MF4 log is in memory while it is read. Raises
    CanBusError `file:line: …` (BLF, MF4: `file: …`) for a file that is missing, truncated or
    corrupt; the frames before that place were yielded.
    """
    path = Path(path)
    return _READERS[log_format(path)](path)


def _read_candump(path: Path) -> Iterator[can.Message]:
    with path.open(encoding="ascii", errors="replace", newline="\n") as file:
        for number, line in enumerate(_bounded_lines(path, file), start=1):
            message = read_candump_line(path, line, number)
            if message is not None:
                yield message


def read_candump_line(path: Path, line: str, number: int) -> can.Message | None:
    """Return the frame of one line of a candump log, None for an empty line.

    Raises CanBusError naming file and line.
    """
    if len(line) >= _MAX_LINE_CHARACTERS:
        raise _too_long(path, number)
    if not line.strip():
        return None
    message = parse_candump(line, path, number)
    if not line.endswith("\n"):
        # Fewer digits are a shorter frame: nobody can tell what is missing.
        raise _bad_line(path, number, line, "an end of line: the log breaks off here")
    return message


def parse_candump(line: str, path: Path, number: int) -> can.Message:
    """Return the frame of one candump line. Raises CanBusError naming file and line."""
    match = _CANDUMP_LINE.match(line)
    if match is None:
        raise _bad_line(path, number, line, _CANDUMP_FORM)
    stamp, channel, identifier, fd_flags, fd_data, remote_dlc, data, direction = match.groups()
    frame_id = int(identifier, 16)
    is_extended = len(identifier) > 3
    message = QuickMessage(
        timestamp=float(stamp),
        arbitration_id=frame_id & _IDENTIFIER_MASK,
        is_extended_id=is_extended,
        channel=channel,
        is_rx=direction is None or direction in "Rr",
    )
    if is_extended and frame_id & _ERROR_FLAG:
        message.is_error_frame = True
    elif frame_id > _IDENTIFIER_MASK:
        raise _bad_line(path, number, line, _CANDUMP_FORM)
    elif not is_extended and frame_id >= 1 << 11:
        raise _bad_line(path, number, line, "a standard identifier up to 7FF")
    if remote_dlc is not None:
        message.is_remote_frame = True
        message.dlc = int(remote_dlc or 0)
        return message
    if fd_flags is not None:
        flags = int(fd_flags[1], 16)
        message.is_fd = True
        message.bitrate_switch = bool(flags & 1)
        message.error_state_indicator = bool(flags & 2)
    message.data = bytearray.fromhex(fd_data if fd_flags is not None else data)
    message.dlc = len(message.data)
    if message.dlc not in FD_LENGTHS:
        raise _bad_line(path, number, line, LENGTHS)
    return message


def _read_asc(path: Path) -> Iterator[can.Message]:
    with path.open(encoding="utf-8", errors="replace", newline="\n") as file:
        lines = _CountedLines(path, file)
        frames = iter(can.ASCReader(lines, relative_timestamp=True))  # type: ignore[arg-type]
        while True:
            try:
                message = next(frames)
            except StopIteration:
                return
            except CanBusError:
                raise
            except Exception as error:  # python-can raises what parsing happens to raise
                raise _bad_line(path, lines.number, lines.line, "an ASC event") from error
            if expected := fault_of(message):
                raise _bad_line(path, lines.number, lines.line, expected)
            yield message


def _read_blf(path: Path) -> Iterator[can.Message]:
    for block in read_blf_blocks(path):
        yield from block.messages()


def _read_mf4(path: Path) -> Iterator[can.Message]:
    for block in read_mf4_blocks(path):
        yield from block.messages()


def _bounded_lines(path: Path, file: TextIO) -> Iterator[str]:
    """Yield lines; a file without line ends must not fill the memory."""
    number = 0
    while line := file.readline(_MAX_LINE_CHARACTERS):
        number += 1
        if len(line) == _MAX_LINE_CHARACTERS:
            raise _too_long(path, number)
        yield line


def _too_long(path: Path, number: int) -> CanBusError:
    return CanBusError(
        f"{path}:{number}: a line of over {_MAX_LINE_CHARACTERS} characters: not a CAN log"
    )


class _CountedLines:
    """A text file that python-can's reader iterates over, and that knows where it is."""

    def __init__(self, path: Path, file: TextIO) -> None:
        self.number = 0
        self.line = ""
        self._path = path
        self._lines = _bounded_lines(path, file)
        self._in_heading = True
        self._first_event: str | None = None

    def __iter__(self) -> _CountedLines:
        return self

    def __next__(self) -> str:
        if self._first_event is not None:
            first, self._first_event = self._first_event, None
            return first
        self.line = next(self._lines)
        self.number += 1
        if not _ASC_LINE.match(self.line):
            # python-can passes over whatever it does not know.
            raise _bad_line(self._path, self.number, self.line, "a line of an ASC log")
        if self._in_heading and self.line.lstrip()[:1].isdigit():
            # python-can takes the heading's last line for no event, whatever it is: a heading
            # without its last line would cost the first frame.
            self._in_heading = False
            self._first_event = self.line
            return "no internal events logged\n"
        return self.line

    def close(self) -> None:
        """Do nothing: the file is closed where it was opened."""


def _bad_line(path: Path, number: int, line: str, expected: str) -> CanBusError:
    content = line.strip()
    if len(content) > _EXCERPT_CHARACTERS:
        content = content[:_EXCERPT_CHARACTERS] + "…"
    return CanBusError(f"{path}:{number}: {content!r}: expected {expected}")


_READERS: Final[dict[LogFormat, Callable[[Path], Iterator[can.Message]]]] = {
    "candump": _read_candump,
    "asc": _read_asc,
    "blf": _read_blf,
    "mf4": _read_mf4,
}
