"""Ctrl-C and kill: status 130, one line, and everything recorded so far complete and readable."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import Chiplog

from can_bus import read_log

_LOG_LINE = re.compile(r"\(\d+\.\d{6}\) \S+ [0-9A-F]{3}#[0-9A-F]{16} [RT]")
_ENOUGH_BYTES = 20_000  # a log of so many bytes says that the loop is under way


@pytest.fixture(params=[signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def interrupted(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, int, str]:
    """Start a run that would last for minutes, stop it under way: its folder, status and stderr."""
    out = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, "-m", "chiplog", "run", "--duration-s", "3600", "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        log = out / "bus.log"
        while process.poll() is None and not (log.exists() and log.stat().st_size > _ENOUGH_BYTES):
            time.sleep(0.05)
        process.send_signal(request.param)
        _, err = process.communicate()
    return out, process.returncode, err


def test_an_interrupted_run_is_whole_up_to_there(
    interrupted: tuple[Path, int, str], chiplog: Chiplog
) -> None:
    out, status, err = interrupted
    assert status == 130
    summary = json.loads((out / "summary.json").read_text())
    ticks = summary["ticks"]
    assert summary["interrupted"] is True
    assert ticks > 0
    assert err == f"chiplog: interrupted after {ticks} ticks; {out} holds what ran\n"

    lines = (out / "bus.log").read_text().splitlines()
    assert all(_LOG_LINE.fullmatch(line) for line in lines)
    assert sum(1 for _ in read_log(out / "bus.log")) == len(lines)
    assert len((out / "reference.tum").read_text().splitlines()) == ticks
    assert json.loads((out / "state.json").read_text())
    assert "Interrupted after" in (out / "report.html").read_text()
    assert chiplog("replay", str(out / "bus.log")).status == 0
