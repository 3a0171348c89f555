"""Commands as processes of their own, without paying for their imports each time.

A server process imports Chiplog once and forks for each command. In the virtual machine of
`scripts/vcan.sh`, where an import takes fifteen times as long, that is the difference between a
second and half a minute; there the test's own process, which has half of it already, is the one
that forks.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Final

from on_vcan import VCAN_ENV

GENEROUS_S: Final = 600.0
"""Not a deadline: only what never comes is waited for so long."""

_ENOUGH_BYTES: Final = 40_000  # of a log: so many frames say that both sides hear each other

_PRELOADED: Final = ("lean", "chiplog.cli", "hil_harness.standalone", "chiplog.commands.node")
_IS_IN_MACHINE: Final = VCAN_ENV in os.environ
_SERVER: Final = multiprocessing.get_context("fork" if _IS_IN_MACHINE else "forkserver")
_SERVER.set_forkserver_preload(list(_PRELOADED))


class Command:
    """A command that runs beside the test; killed at the end of the context if it still does."""

    def __init__(
        self, function: str, arguments: Sequence[str], folder: Path, *, terminal: str | None = None
    ) -> None:
        """Start `function` (module:name), the program of a command line, with these arguments.

        Its output goes to files in *folder*, or with all else to the terminal of that path.
        """
        self._stdout = folder / "stdout"
        self._stderr = folder / "stderr"
        folder.mkdir(parents=True, exist_ok=True)
        for file in (self._stdout, self._stderr):
            file.touch()
        if _IS_IN_MACHINE:
            for name in _PRELOADED:
                import_module(name)
        streams = (os.devnull, str(self._stdout), str(self._stderr))
        self._process = _SERVER.Process(
            target=_run,
            args=(function, list(arguments), (terminal,) * 3 if terminal else streams),
            daemon=True,
        )
        self._process.start()

    @property
    def stdout(self) -> str:
        return self._stdout.read_text(encoding="utf-8")

    @property
    def stderr(self) -> str:
        return self._stderr.read_text(encoding="utf-8")

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait until something holds; fails where this command ends before."""
        end_s = time.monotonic() + GENEROUS_S
        while not holds():
            said = f"{self.stdout}\n{self.stderr}"
            assert self._process.is_alive(), f"it ended:\n{said}"
            assert time.monotonic() < end_s, f"it never came:\n{said}"
            time.sleep(0.02)

    def stop(self) -> int | None:
        """Ask it to end, as `kill` does; return its exit status."""
        self._signal(signal.SIGTERM)
        return self.wait()

    def kill(self) -> None:
        """End it at once, as a crash or a lost supply does."""
        self._signal(signal.SIGKILL)
        self.wait()

    def wait(self) -> int | None:
        """Wait until it ends; return its exit status."""
        self._process.join()
        return self._process.exitcode

    def __enter__(self) -> Command:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._process.is_alive():
            self.kill()

    def _signal(self, number: int) -> None:
        assert self._process.pid is not None
        os.kill(self._process.pid, number)


def under_way(log: Path) -> Callable[[], bool]:
    """Return what tells whether the loop is under way by the log that one of its nodes writes.

    Its first frame does not: it may be the other side's, which has heard nothing yet.
    """
    return lambda: log.exists() and log.stat().st_size > _ENOUGH_BYTES


def chiplog(*arguments: str, folder: Path) -> Command:
    """Start `chiplog` with these arguments."""
    return Command("chiplog.entry:main", ["chiplog", *arguments], folder)


def _run(function: str, arguments: list[str], streams: tuple[str, str, str]) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a fork server ignores it
    os.setsid()
    for descriptor, path in enumerate(streams):
        flags = os.O_RDWR if path.startswith("/dev/") else os.O_WRONLY | os.O_APPEND
        opened = os.open(path, flags)
        os.dup2(opened, descriptor)
        os.close(opened)
    sys.stdin, sys.stdout, sys.stderr = os.fdopen(0), os.fdopen(1, "w"), os.fdopen(2, "w", 1)
    sys.argv = arguments
    module, _, name = function.partition(":")
    try:
        status = getattr(import_module(module), name)()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    sys.exit(status)
