"""Cases in processes of their own that need not load anew what all of them need."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Final

_THREADS: Final = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


class Worker:
    """Runs each case in a process of its own: a fork of one that has loaded what all need.

    Where processes cannot fork, each begins anew. *said* is a file for what they complain of;
    *is_many*: enough diagnoses are to come that machine code is worth loading beforehand.
    """

    def __init__(self, said: IO[str], *, is_many: bool) -> None:
        """Begin to load."""
        self._said = said
        self._words = [sys.executable, "-m", "gap_diagnosis.trials.worker"]
        self._environment = {**os.environ, **dict.fromkeys(_THREADS, "1")}
        self._server: subprocess.Popen[str] | None = None
        if hasattr(os, "fork"):  # not on Windows
            self._server = subprocess.Popen(
                [*self._words, "load" if is_many else "serve"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said,
                text=True,
                env=self._environment,
            )

    def close(self) -> None:
        """Let the process that forks end: its input has."""
        if self._server is not None:
            self._server.communicate()

    def work(self, words: Sequence[Path]) -> tuple[int, str]:
        """Run the worker with these words; return its exit code and what it complained of."""
        self._said.seek(0)
        self._said.truncate()
        code = self._anew(words) if self._server is None else self._forked(self._server, words)
        self._said.seek(0)
        return code, self._said.read()

    def _anew(self, words: Sequence[Path]) -> int:
        return subprocess.run(
            [*self._words, *map(str, words)],
            stdout=subprocess.DEVNULL,
            stderr=self._said,
            env=self._environment,
            check=False,
        ).returncode

    @staticmethod
    def _forked(server: subprocess.Popen[str], words: Sequence[Path]) -> int:
        """Have one forked; a server that has ended itself answers with its own exit code."""
        if server.stdin is None or server.stdout is None:
            raise ValueError("expected a process with pipes")
        try:
            server.stdin.write(json.dumps([str(word) for word in words]) + "\n")
            server.stdin.flush()
        except BrokenPipeError:
            return server.wait()
        answer = server.stdout.readline()
        return int(answer) if answer else server.wait()
