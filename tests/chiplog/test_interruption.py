"""Ctrl-C and kill: status 130, one line, and everything recorded so far complete and readable."""

from __future__ import annotations

import json
import os
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


@pytest.mark.parametrize("how", ["from chiplog.entry import main; exit(main())", None])
def test_ctrl_c_during_the_imports_is_one_line_too(how: str | None, tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt\n")
    words = ["-m", "chiplog"] if how is None else ["-c", how]
    done = subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 130
    assert done.stderr == "chiplog: interrupted\n"


def test_an_interrupted_node_says_after_how_many_ticks(tmp_path: Path) -> None:
    log = tmp_path / "plant.log"
    words = ["node", "plant", "--interface", "udp_multicast", "--channel", "239.74.163.61"]
    with subprocess.Popen(
        [sys.executable, "-m", "chiplog", *words, "--log", str(log)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        while process.poll() is None and not (log.exists() and log.stat().st_size > 0):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate()
    assert process.returncode == 130
    assert re.fullmatch(r"chiplog: interrupted after \d+ ticks\n", err)
