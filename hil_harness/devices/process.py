"""A device under test that is a program of its own.

In lockstep the harness talks with it over its standard input and output, one line a frame, in the
format of candump's logs. Each tick the harness writes the frames received since the last tick and
then the time; the program answers with the frames that it sends and then ``done``:

    harness:  (0.010000) can0 100#00C1000000000000      zero or more frames; ID of 3 or 8 hex digits
              step 10000                                the tick's time in microseconds
    program:  200#A3C10000D4000000                      zero or more frames; stamp and bus optional
              done

The program must flush after ``done``, and has standard error for whatever else it wants to say. It
should end when its standard input ends.

On a real-time bus the harness only starts the program: it then speaks on the bus by itself, and the
command line may say ``{interface}``, ``{channel}`` and ``{bitrate}`` to be told which bus that is.
"""

from __future__ import annotations

import contextlib
import os
import re
import selectors
import shlex
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from typing import IO, Final

import can

from hil_harness.devices.device import Device, DeviceSetup, at_time, not_stepped
from hil_harness.errors import HarnessError

ANSWER_WITHIN_S: Final = 10.0
"""How long a program may take for one tick before it counts as hung."""

_MAX_ANSWER_BYTES: Final = 1 << 20
_END_WITHIN_S: Final = 2.0
_FRAME: Final = re.compile(
    rb"(?:\(\d+\.\d+\)\s+\S+\s+)?([0-9A-Fa-f]{8}|[0-9A-Fa-f]{3})#((?:[0-9A-Fa-f]{2}){0,8})"
    rb"(?:\s+[RT])?"
)


class ProcessDevice(Device):
    """Starts a command line, without a shell, and speaks with it or watches it.

    Raises HarnessError if it cannot be started; from `step` or `check` if it ended, hung or said
    something that is no frame, with the last line of its standard error.
    """

    def __init__(
        self, command: str, setup: DeviceSetup, *, answer_within_s: float = ANSWER_WITHIN_S
    ) -> None:
        """Start *command*."""
        words = _words(command, setup)
        self.name = words[0]
        self.in_loop = setup.in_lockstep
        self._answer_within_s = answer_within_s
        self._unread = b""
        self._stderr: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  closed by close()
        pipe = subprocess.PIPE if self.in_loop else subprocess.DEVNULL
        try:
            # A session of its own: Ctrl-C reaches the harness, which then ends the program.
            self._process = subprocess.Popen(
                words,
                stdin=pipe,
                stdout=pipe,
                stderr=self._stderr,
                cwd=setup.folder,
                start_new_session=True,
            )
        except OSError as error:
            self._stderr.close()
            raise HarnessError(
                f"device process:{command}: cannot be started: {error.strerror or error}"
            ) from error
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                os.set_blocking(stream.fileno(), False)

    def step(self, now_us: int, frames: Sequence[can.Message]) -> Sequence[can.Message]:
        """Write the frames and the time; return the frames of the answer."""
        if not self.in_loop:
            raise HarnessError(not_stepped(self.name, now_us))
        lines = [_line(frame) for frame in frames]
        lines.append(b"step %d\n" % now_us)
        sent: list[can.Message] = []
        for line in self._exchange(b"".join(lines), now_us):
            match = _FRAME.fullmatch(line)
            if match is None:
                said = line[:60].decode("utf-8", "backslashreplace")
                raise HarnessError(
                    f"device {self.name}: said {said!r} {at_time(now_us)}; expected a frame "
                    "like 200#A3C10000D4000000, or done (other output belongs on standard error)"
                )
            sent.append(_message(match, now_us))
        return sent

    def check(self) -> None:
        """Raise HarnessError if the program has ended."""
        status = self._process.poll()
        if status is not None:
            raise HarnessError(f"device {self.name}: {_ended(status)}{self._last_words()}")

    def close(self) -> None:
        """End the program: its input ends, then it is asked, then it is killed."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        # A program that only listens to a bus does not notice its input ending.
        patience_s = _END_WITHIN_S if self.in_loop else 0.0
        for how in (None, signal.SIGTERM, signal.SIGKILL):
            if how is not None:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(self._process.pid, how)
                patience_s = _END_WITHIN_S
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(patience_s)
                break
        self._stderr.close()

    def _exchange(self, request: bytes, now_us: int) -> list[bytes]:
        """Write the request while reading, until `done`; return the lines before it."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        give_up_at_s = time.monotonic() + self._answer_within_s
        lines: list[bytes] = []
        read_bytes = 0
        with selectors.DefaultSelector() as selector:
            selector.register(stdout, selectors.EVENT_READ)
            selector.register(stdin, selectors.EVENT_WRITE)
            while True:
                while b"\n" in self._unread:
                    line, _, self._unread = self._unread.partition(b"\n")
                    if line.strip() == b"done":
                        if request:
                            raise HarnessError(
                                f"device {self.name}: said done {at_time(now_us)} before it had "
                                "read the tick's frames from its standard input"
                            )
                        return lines
                    lines.append(line.strip())
                if read_bytes > _MAX_ANSWER_BYTES:
                    raise HarnessError(
                        f"device {self.name}: answered more than {_MAX_ANSWER_BYTES} bytes "
                        f"{at_time(now_us)} without the line done"
                    )
                left_s = give_up_at_s - time.monotonic()
                events = selector.select(left_s) if left_s > 0 else []
                if not events:
                    raise HarnessError(
                        f"device {self.name}: did not answer within {self._answer_within_s:g} s "
                        f"{at_time(now_us)}; a tick ends with the line done, flushed"
                        f"{self._last_words()}"
                    )
                for key, _ in events:
                    if key.fileobj is stdout:
                        chunk = os.read(stdout.fileno(), 65536)
                        if not chunk:
                            raise HarnessError(self._gone(now_us))
                        read_bytes += len(chunk)
                        self._unread += chunk
                    else:
                        with contextlib.suppress(BrokenPipeError):  # reading tells of its end
                            request = request[os.write(stdin.fileno(), request) :]
                            if request:
                                continue
                        selector.unregister(stdin)

    def _gone(self, now_us: int) -> str:
        try:
            status = self._process.wait(_END_WITHIN_S)
        except subprocess.TimeoutExpired:
            what = "closed its standard output"
        else:
            what = _ended(status)
        return f"device {self.name}: {what} {at_time(now_us)}{self._last_words()}"

    def _last_words(self) -> str:
        """Return the last line of standard error, ready to append to a message."""
        self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(0, self._stderr.tell() - 2000))
        said = self._stderr.read().decode("utf-8", "replace").split("\n")
        last = next((line.strip() for line in reversed(said) if line.strip()), "")
        return f"; its last words: {last[:200]}" if last else ""


def _words(command: str, setup: DeviceSetup) -> list[str]:
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise HarnessError(f"device process:{command}: {error}") from error
    if not words:
        raise HarnessError(
            "device process: needs a command line, for example process:./node --fast"
        )
    if setup.in_lockstep:
        return words
    known = {
        "{interface}": setup.interface,
        "{channel}": setup.channel,
        "{bitrate}": "" if setup.bitrate is None else str(setup.bitrate),
    }
    for placeholder, value in known.items():
        words = [word.replace(placeholder, value) for word in words]
    return words


def _line(frame: can.Message) -> bytes:
    digits = 8 if frame.is_extended_id else 3
    text = f"({frame.timestamp:.6f}) can0 {frame.arbitration_id:0{digits}X}#"
    data = "R" if frame.is_remote_frame else frame.data.hex().upper()
    return f"{text}{data}\n".encode("ascii")


def _message(match: re.Match[bytes], now_us: int) -> can.Message:
    identifier, data = match.groups()
    return can.Message(
        timestamp=now_us * 1e-6,
        arbitration_id=int(identifier, 16),
        is_extended_id=len(identifier) == 8,
        data=bytes.fromhex(data.decode("ascii")),
    )


def _ended(status: int) -> str:
    if status >= 0:
        return f"ended with exit status {status}"
    try:
        return f"was ended by {signal.Signals(-status).name}"
    except ValueError:
        return f"was ended by signal {-status}"
