"""Reading logs, frame by frame: candump, ASC and BLF, ours and those of others."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal, TextIO

import can

from can_bus.errors import CanBusError, one_line
from can_bus.frames import QuickMessage

LogFormat = Literal["candump", "asc", "blf"]

_FORMATS: Final[dict[str, LogFormat]] = {".log": "candump", ".asc": "asc", ".blf": "blf"}
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
_MAX_CLASSIC_LENGTH: Final = 8
_MAX_FD_LENGTH: Final = 64
_LENGTHS: Final = "a CAN FD length (0 to 8, 12, 16, 20, 24, 32, 48, 64)"
_MAX_STAMP_S: Final = 1e12
"""As for candump lines; in whole microseconds such a stamp fits 64 bits."""

# Layout as in python-can's reader: signature, header size; signature, sizes, object type.
_BLF_FILE_HEADER: Final = struct.Struct("<4sL")
_BLF_OBJECT_HEADER: Final = struct.Struct("<4sHHLL")
_BLF_CONTAINER: Final = 10
_BLF_CONTAINER_HEADER_BYTES: Final = 16
_BLF_SIGNATURE: Final = b"LOBJ"
_BLF_STORED: Final = b"\x00\x00"
_BLF_DEFLATED: Final = b"\x02\x00"
_MAX_CONTAINER_BYTES: Final = 64 * 1024 * 1024
# A CAN FD frame takes some 100 bytes: no object that matters here comes near this.
_MAX_OBJECT_BYTES: Final = 1 << 20
_FD_LENGTHS: Final = frozenset((*range(9), 12, 16, 20, 24, 32, 48, _MAX_FD_LENGTH))


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
    by_suffix = _FORMATS.get(path.suffix.lower())
    if by_suffix is not None:
        return by_suffix
    text = head.decode("ascii", errors="replace")
    if text.startswith("("):
        return "candump"
    if re.match(r"\s*date\s", text):
        return "asc"
    raise CanBusError(f"{path}: not a log that can be read here: candump .log, .asc or .blf")


def read_log(path: str | Path) -> Iterator[can.Message]:
    """Yield the frames of a log in its order; stamps in seconds as in the file.

    Streams: memory does not grow with the log. Raises CanBusError `file:line: …` (BLF: `file: …`)
    for a file that is missing, truncated or corrupt; the frames before that place were yielded.
    """
    path = Path(path)
    kind = log_format(path)
    if kind == "candump":
        return _read_candump(path)
    return _read_asc(path) if kind == "asc" else _read_blf(path)


def _read_candump(path: Path) -> Iterator[can.Message]:
    with path.open(encoding="ascii", errors="replace", newline="\n") as file:
        yield from read_candump_lines(path, file)


def read_candump_lines(path: Path, file: TextIO, first_line: int = 1) -> Iterator[can.Message]:
    """Yield the frames of candump text that begins with that line of a log.

    Raises CanBusError naming file and line.
    """
    for number, line in enumerate(_bounded_lines(path, file, first_line), start=first_line):
        if line.strip():
            message = parse_candump(line, path, number)
            if not line.endswith("\n"):
                # Fewer digits are a shorter frame: nobody can tell what is missing.
                raise _bad_line(path, number, line, "an end of line: the log breaks off here")
            yield message


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
    if message.dlc not in _FD_LENGTHS:
        raise _bad_line(path, number, line, _LENGTHS)
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
            if expected := _fault(message):
                raise _bad_line(path, lines.number, lines.line, expected)
            yield message


def _read_blf(path: Path) -> Iterator[can.Message]:
    _refuse_blf_bomb(path)
    count = 0
    with path.open("rb") as file:
        size = path.stat().st_size
        try:
            frames = can.BLFReader(file)
            for message in frames:
                if expected := _fault(message):
                    raise CanBusError(
                        f"{path}: frame {count + 1}: identifier {message.arbitration_id:X}, "
                        f"length {message.dlc}, {len(message.data)} bytes, "
                        f"{message.timestamp:g} s: expected {expected}"
                    )
                yield message
                count += 1
        except CanBusError:
            raise
        except Exception as error:  # zlib.error, struct.error, BLFParseError, …
            raise CanBusError(
                f"{path}: truncated or corrupt BLF file after {count} frames: {one_line(error)}"
            ) from error
        if size < frames.file_size:
            raise CanBusError(
                f"{path}: truncated BLF file after {count} frames: "
                f"{size} of {frames.file_size} bytes"
            )


def _fault(message: can.Message) -> str | None:
    """Return what a frame would need to be one that a bus carries; None for a good frame."""
    if not 0 <= message.timestamp < _MAX_STAMP_S:
        return f"a stamp from 0 up to {_MAX_STAMP_S:g} s"
    if message.is_error_frame:
        return None
    if message.is_extended_id:
        if not 0 <= message.arbitration_id <= _IDENTIFIER_MASK:
            return f"an extended identifier up to {_IDENTIFIER_MASK:X}"
    elif not 0 <= message.arbitration_id < 1 << 11:
        return "a standard identifier up to 7FF"
    if message.is_remote_frame:
        return (
            None if 0 <= message.dlc <= _MAX_CLASSIC_LENGTH else "a remote frame's length, 0 to 8"
        )
    if len(message.data) != message.dlc:
        return "as many data bytes as its length says"
    if message.dlc not in _FD_LENGTHS:
        return _LENGTHS
    return None


def _refuse_blf_bomb(path: Path) -> None:
    """Raise CanBusError for a container or an object that would fill the memory.

    python-can inflates any container, and joins containers until the object in them is complete.

    Anything else that is wrong is left to the reader, which comes to it after the good frames.
    """
    unfinished = b""
    with path.open("rb") as file:
        head = file.read(_BLF_FILE_HEADER.size)
        if len(head) < _BLF_FILE_HEADER.size:
            return
        file.seek(_BLF_FILE_HEADER.unpack(head)[1])
        while len(head := file.read(_BLF_OBJECT_HEADER.size)) == _BLF_OBJECT_HEADER.size:
            _, _, _, size, kind = _BLF_OBJECT_HEADER.unpack(head)
            content = file.read(max(0, size - _BLF_OBJECT_HEADER.size))
            file.read(size % 4)
            if kind != _BLF_CONTAINER or content[:2] not in (_BLF_STORED, _BLF_DEFLATED):
                continue
            objects = content[_BLF_CONTAINER_HEADER_BYTES:]
            if content[:2] == _BLF_DEFLATED:
                inflate = zlib.decompressobj()
                try:
                    objects = inflate.decompress(objects, _MAX_CONTAINER_BYTES)
                except zlib.error:
                    return
                if inflate.unconsumed_tail:
                    raise CanBusError(
                        f"{path}: a container of over {_MAX_CONTAINER_BYTES >> 20} MiB: "
                        "not a BLF file that can be read here"
                    )
            rest = _unfinished_blf_object(path, unfinished + objects)
            if rest is None:
                return
            unfinished = rest


def _unfinished_blf_object(path: Path, objects: bytes) -> bytes | None:
    """Return what the reader keeps of these objects until the next container; None: it stops here.

    Raises CanBusError for an object so large that it would keep one container after the other, and
    for one so small that it would never get past it.
    """
    start = 0
    while True:
        # Up to three bytes of padding, and then some that python-can lets pass.
        found = objects.find(_BLF_SIGNATURE, start, start + 2 * len(_BLF_SIGNATURE))
        if found < 0 and start + 2 * len(_BLF_SIGNATURE) <= len(objects):
            return None
        if found < 0 or found + _BLF_OBJECT_HEADER.size > len(objects):
            return objects[start:]
        size = _BLF_OBJECT_HEADER.unpack_from(objects, found)[3]
        if not _BLF_OBJECT_HEADER.size <= size <= _MAX_OBJECT_BYTES:
            raise CanBusError(
                f"{path}: an object of {size} bytes: "
                f"expected {_BLF_OBJECT_HEADER.size} to {_MAX_OBJECT_BYTES}"
            )
        if found + size > len(objects):
            return objects[start:]
        start = found + size


def _bounded_lines(path: Path, file: TextIO, first_line: int = 1) -> Iterator[str]:
    """Yield lines; a file without line ends must not fill the memory."""
    number = first_line - 1
    while line := file.readline(_MAX_LINE_CHARACTERS):
        number += 1
        if len(line) == _MAX_LINE_CHARACTERS:
            raise CanBusError(
                f"{path}:{number}: a line of over {_MAX_LINE_CHARACTERS} characters: not a CAN log"
            )
        yield line


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
