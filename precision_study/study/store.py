"""The results of a study on disk: a line per block of runs, appended as it is done.

A process that is killed at any moment loses nothing that was appended: a line is written whole by
one call, and half a line (a full disk, a lost battery) is cut off when the file is read again.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from precision_study.errors import StudyError

FILE: Final = "runs.jsonl"
_SYNC_S: Final = 0.5


class Store:
    """Blocks of runs by their unit; a unit is one configuration on one scenario and course.

    Results stay on disk: in memory is only where they are.

    Attributes:
        path: the file.
    """

    def __init__(self, folder: Path) -> None:
        """Read what *folder* holds; it is made when the first block is appended.

        Raises:
            StudyError: the folder is a file, or holds lines that no study wrote.
        """
        if folder.exists() and not folder.is_dir():
            raise StudyError(f"{folder}: is a file: --out expects a folder, new or of a study")
        self.path = folder / FILE
        self._places: dict[str, list[tuple[int, tuple[int, ...]]]] = {}
        self._blocks: dict[tuple[int, ...], tuple[int, ...]] = {}
        self._file: int | None = None
        self._synced_s = 0.0
        if self.path.exists():
            self._read()

    def _read(self) -> None:
        whole = 0
        with self.path.open("rb") as lines:
            for number, line in enumerate(lines, 1):
                if not line.endswith(b"\n"):
                    break  # cut off by whatever ended the process
                start, whole = whole, whole + len(line)
                try:
                    record = json.loads(line)
                    unit, seeds = record["unit"], record["seeds"]
                except (ValueError, KeyError, TypeError):
                    raise StudyError(
                        f"{self.path}:{number}: no line of a study: expected the file as it was "
                        "written, or another --out"
                    ) from None
                if not set(seeds) & self.seeds(unit):
                    self._keep(unit, start, seeds)
        if whole < self.path.stat().st_size:
            os.truncate(self.path, whole)

    def seeds(self, unit: str) -> set[int]:
        """Return the seeds of a unit that are done."""
        return {seed for _, seeds in self._places.get(unit, ()) for seed in seeds}

    def records(self, unit: str) -> list[dict[str, Any]]:
        """Return the blocks of a unit that are done, from disk."""
        found: list[dict[str, Any]] = []
        with self.path.open("rb") as lines:
            for start, _ in self._places[unit]:
                lines.seek(start)
                found.append(json.loads(lines.readline()))
        return found

    def _keep(self, unit: str, start: int, seeds: Sequence[int]) -> None:
        """Remember where a block is; equal seeds of many units are held once."""
        block = tuple(seeds)
        block = self._blocks.setdefault(block, block)
        self._places.setdefault(unit, []).append((start, block))

    def append(self, record: Mapping[str, Any]) -> None:
        """Keep a block: safe from a killed process now, from a lost battery within a second."""
        if self._file is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
            self._file = os.open(self.path, flags, 0o666)
        line = json.dumps(record, allow_nan=False, separators=(",", ":")) + "\n"
        size = os.write(self._file, line.encode())
        end = os.lseek(self._file, 0, os.SEEK_CUR)
        now_s = time.monotonic()
        if now_s - self._synced_s > _SYNC_S:
            os.fsync(self._file)
            self._synced_s = now_s
        self._keep(record["unit"], end - size, record["seeds"])

    def __enter__(self) -> Self:
        """Return the store."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file, everything on disk."""
        if self._file is not None:
            os.fsync(self._file)
            os.close(self._file)
            self._file = None
