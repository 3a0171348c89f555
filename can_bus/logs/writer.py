"""Writing a log while the bus runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from copy import copy
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol

import can

from can_bus.errors import CanBusError

LOG_SUFFIXES: Final = (".log", ".asc", ".blf")
"""File-name endings of the formats that can be written: candump, Vector ASC, Vector BLF."""

LOG_CHANNEL: Final = "vcan0"
"""Channel name in candump logs: the same for every run, so that equal runs are equal bytes."""

_FLUSH_PERIOD_S: Final = 1.0
# Only whole records go to the disk, so that a log whose writer was killed ends with one: the buffer
# holds all frames between two flushes. The longest, a CAN FD frame in ASC, takes 400 bytes.
_MOST_UNFLUSHED: Final = 2048
_BUFFER_BYTES: Final = 1 << 20
# BLF keeps a container in memory until it is full: 16 KiB are some 300 frames.
_BLF_CONTAINER_BYTES: Final = 16 * 1024
_FIRST_WALL_CLOCK_S: Final = 631152000.0  # 1990: what is earlier is no wall clock, as in BLF
_ERROR_FRAME_ID: Final = "20000080"  # CAN_ERR_FLAG | CAN_ERR_BUSERROR, as candump prints it


class LogWriter(Protocol):
    """Takes frames in the order in which a node received and sent them."""

    def write(self, message: can.Message, received: bool) -> None:
        """Append one frame; `received` is False for a frame that the node sent."""

    def close(self) -> None:
        """Complete the file; may be called twice."""

    def __enter__(self) -> LogWriter:
        """Use as a context manager: the file is complete after it, whatever happened."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""


def open_log_writer(path: str | Path) -> LogWriter:
    """Create a log whose format is given by its suffix: `.log` (candump), `.asc` or `.blf`.

    What was written is on disk after each second of the frames' own time, and all of it after
    `close`: a process that is killed loses the frames of its last second at most, and the file ends
    with a whole one. Raises CanBusError for another suffix or a file that cannot be created.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in LOG_SUFFIXES:
        raise CanBusError(f"{path}: a log ends in {', '.join(LOG_SUFFIXES)}, not {suffix!r}")
    try:
        if suffix == ".log":
            return CandumpWriter(path)
        if suffix == ".asc":
            text = path.open("w", encoding="ascii", newline="\n", buffering=_BUFFER_BYTES)
            return _LibraryWriter(path, can.ASCWriter(text))
        file = path.open("wb", buffering=_BUFFER_BYTES)
        return _LibraryWriter(path, can.BLFWriter(file, max_container_size=_BLF_CONTAINER_BYTES))
    except OSError as error:
        raise CanBusError(f"{path}: cannot create this log: {error.strerror}") from error


def _cannot_write(path: Path, error: OSError) -> CanBusError:
    return CanBusError(f"{path}: cannot write this log: {error.strerror}")


class CandumpWriter:
    """Writes `(seconds.microseconds) channel id#data R|T`, as `candump -L -x` does."""

    def __init__(self, path: Path) -> None:
        """Create the file. Raises OSError when it cannot be."""
        self._path = path
        self._file = path.open("w", encoding="ascii", newline="\n", buffering=_BUFFER_BYTES)
        self._write: Callable[[str], int] = self._file.write
        self._flush_at_s = -1.0
        self._unflushed = 0
        self._stamp_s = math.nan
        self._start = ""  # of each line with that stamp: the frames of a tick share it

    def write(self, message: can.Message, received: bool) -> None:
        """Append one frame. Raises CanBusError when the disk takes no more."""
        stamp_s = message.timestamp
        if stamp_s != self._stamp_s:
            self._stamp_s = stamp_s
            self._start = f"({stamp_s:.6f}) {LOG_CHANNEL} "
        direction = "R" if received else "T"
        if (
            message.is_extended_id
            or message.is_fd
            or message.is_remote_frame
            or message.is_error_frame
        ):
            frame = _other_frame(message)
        else:
            frame = f"{message.arbitration_id:03X}#{message.data.hex().upper()}"
        try:
            self._write(f"{self._start}{frame} {direction}\n")
            self._unflushed += 1
            if stamp_s >= self._flush_at_s or self._unflushed == _MOST_UNFLUSHED:
                self._file.flush()
                self._flush_at_s = stamp_s + _FLUSH_PERIOD_S
                self._unflushed = 0
        except OSError as error:
            raise _cannot_write(self._path, error) from error

    def close(self) -> None:
        """Complete the file; may be called twice."""
        try:
            self._file.close()
        except OSError as error:
            raise _cannot_write(self._path, error) from error

    def __enter__(self) -> CandumpWriter:
        """Use as a context manager."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()


def _other_frame(message: can.Message) -> str:
    """Return `id#content` of a frame that is not a standard data frame."""
    width = 8 if message.is_extended_id else 3
    identifier = f"{message.arbitration_id:0{width}X}"
    content = message.data.hex().upper()
    if message.is_error_frame:
        identifier, content = _ERROR_FRAME_ID, "0" * 16
    elif message.is_remote_frame:
        content = f"R{message.dlc}" if message.dlc else "R"
    elif message.is_fd:
        flags = int(message.bitrate_switch) | int(message.error_state_indicator) << 1
        content = f"#{flags:X}{content}"
    return f"{identifier}#{content}"


class _LibraryWriter:
    """Writes through one of python-can's writers."""

    def __init__(self, path: Path, writer: can.ASCWriter | can.BLFWriter) -> None:
        self._path = path
        self._writer = writer
        self._flush_at_s = -1.0
        self._unflushed = 0
        self._is_open = True
        self._is_started = False

    def write(self, message: can.Message, received: bool) -> None:
        try:
            self._append(message, received)
        except OSError as error:
            raise _cannot_write(self._path, error) from error

    def _append(self, message: can.Message, received: bool) -> None:
        if not self._is_started:
            self._start(message.timestamp)
        twin = copy(message)
        twin.is_rx = received
        twin.channel = None
        self._unflushed += 1
        is_due = message.timestamp >= self._flush_at_s or self._unflushed == _MOST_UNFLUSHED
        if is_due and isinstance(self._writer, can.BLFWriter):
            self._end_container(self._writer)
        self._writer.on_message_received(twin)
        if is_due:
            self._writer.file.flush()
            self._flush_at_s = message.timestamp + _FLUSH_PERIOD_S
            self._unflushed = 0
        if isinstance(self._writer, can.BLFWriter):
            self._writer.max_container_size = _BLF_CONTAINER_BYTES

    @staticmethod
    def _end_container(writer: can.BLFWriter) -> None:
        """Let the container end with the next frame, of which the first byte is still in it."""
        pending = writer.file_size() - writer.file.tell()
        writer.max_container_size = pending + 1

    def close(self) -> None:
        if self._is_open:
            self._is_open = False
            try:
                self._writer.stop()
            except OSError as error:
                raise _cannot_write(self._path, error) from error
            finally:
                with suppress(OSError):  # python-can leaves the file open when its end fails
                    self._writer.file.close()

    def _start(self, first_stamp_s: float) -> None:
        """Keep simulated time counting from 0; python-can starts both formats at the first frame.

        In real time the start is the first frame's wall clock, which the file's header carries.
        """
        self._is_started = True
        if first_stamp_s >= _FIRST_WALL_CLOCK_S:
            return
        if isinstance(self._writer, can.BLFWriter):
            self._writer.start_timestamp = 0.0
        else:
            self._writer.log_event("Start of measurement", 0.0)

    def __enter__(self) -> _LibraryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
