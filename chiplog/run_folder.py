"""The folder that a run writes: which files are ours, and that nobody else's are touched."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from chiplog.errors import CommandError
from hil_harness.export.tum import tum_text
from hil_harness.results import SUMMARY_SCHEMA, RunResult

BUS_LOG = "bus.log"
REFERENCE = "reference.tum"
STATE = "state.json"
SUMMARY = "summary.json"
REPORT = "report.html"
OUR_FILES = (BUS_LOG, REFERENCE, STATE, SUMMARY, REPORT)
_EARLIER = ".earlier"


class RunFolder:
    """A folder for one run's files: an earlier run is replaced, other files are left alone."""

    def __init__(self, path: Path) -> None:
        """Take `path`, new or of an earlier run; nothing is written yet.

        Raises CommandError if it is a file, or holds files of our names that no run wrote.
        """
        self.path = path
        if path.exists() and not path.is_dir():
            raise CommandError(
                f"{path}: is a file: --out expects a folder, new or of an earlier run"
            )
        present = self._present()
        if present and not _is_a_run(path / SUMMARY):
            raise CommandError(
                f"{path / present[0]}: no run of chiplog wrote this folder (it has no {SUMMARY} of "
                "ours), so nothing is overwritten; name another folder with --out"
            )

    @contextmanager
    def recording(self, scenario: str, seed: int) -> Iterator[None]:
        """Make room for a run and mark it as begun; inside this context it is recorded.

        A run that is killed leaves its log and a summary that says it was not finished, never the
        summary of the run before. A run that fails before its first frame (no such interface, say)
        leaves the folder as it was.
        """
        is_new = not self.path.exists()
        aside = self.path / _EARLIER
        shutil.rmtree(aside, ignore_errors=True)  # of a run that was killed
        aside.mkdir(parents=True)
        for name in self._present():
            self.file(name).rename(aside / name)
        self._write_json(
            SUMMARY,
            {"schema": SUMMARY_SCHEMA, "scenario": scenario, "seed": seed, "interrupted": True},
        )
        try:
            yield
        except BaseException:
            if not self._has_frames():
                self._put_back(aside)
            shutil.rmtree(aside, ignore_errors=True)
            if is_new and not any(self.path.iterdir()):
                self.path.rmdir()
            raise
        shutil.rmtree(aside, ignore_errors=True)

    def _present(self) -> list[str]:
        return [name for name in OUR_FILES if self.file(name).exists()]

    def _has_frames(self) -> bool:
        log = self.file(BUS_LOG)
        return log.exists() and log.stat().st_size > 0

    def _put_back(self, aside: Path) -> None:
        for name in self._present():
            self.file(name).unlink()
        for file in aside.iterdir():
            file.rename(self.file(file.name))

    def file(self, name: str) -> Path:
        """Return the path of one of `OUR_FILES`."""
        return self.path / name

    def write(self, result: RunResult) -> None:
        """Write the data; the log was written while the run went on."""
        self.file(REFERENCE).write_text(reference_tum(result), encoding="ascii")
        self._write_json(STATE, dict(result.kernel_state))
        self._write_json(SUMMARY, result.summary())

    def write_report(self, page: str) -> Path:
        """Write the page, last: drawing it takes longest, and all it shows is safe by then."""
        self.file(REPORT).write_text(page, encoding="utf-8")
        return self.file(REPORT)

    def _write_json(self, name: str, content: dict[str, Any]) -> None:
        text = json.dumps(content, indent=2, allow_nan=False)
        self.file(name).write_text(text + "\n", encoding="utf-8")


def reference_tum(result: RunResult) -> str:
    """Return truth (or reference) as `t x y z qx qy qz qw` rows, on the clock of the log."""
    stamps_s, poses = result.stamp_us / 1e6, result.truth
    if result.reference is not None:
        stamps_s, poses = result.reference
    return tum_text(stamps_s, poses)


def _is_a_run(summary: Path) -> bool:
    try:
        with summary.open(encoding="utf-8") as file:
            content = json.loads(file.read(1 << 20))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and {"schema", "scenario", "interrupted"} <= content.keys()
