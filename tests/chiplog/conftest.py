"""The command line as a test calls it, in this process for speed, in its own where it matters; and
a real browser.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import NAMES, Browser, find_browser, running
from command_line import Chiplog, Outcome
from markupsafe import Markup

from chiplog.cli import main
from chiplog.pages.drawing import Picture


@pytest.fixture
def chiplog(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Chiplog:
    """Run `chiplog WORDS…` in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*words: str) -> Outcome:
        capsys.readouterr()
        status = main(words)
        out, err = capsys.readouterr()
        return Outcome(int(status), out, err)

    return call


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the pictures of a run's page out: they take most of a short run, and nobody looks."""

    def said(name: str, title: str, caption: str, *_: Any, **__: Any) -> Picture:
        return Picture(title, caption, Markup(""))

    monkeypatch.setattr("chiplog.pages.pictures.picture", said)


@pytest.fixture
def chiplog_process(tmp_path: Path) -> Chiplog:
    """Run `chiplog WORDS…` as a process of its own, in an empty folder."""

    def call(*words: str) -> Outcome:
        done = subprocess.run(
            [sys.executable, "-m", "chiplog", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return call


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Start a real browser for the tests of a module."""
    program = find_browser()
    if program is None:
        pytest.skip(f"none of {', '.join(NAMES)} here; scripts/setup.sh test installs the first")
    with running(program) as started:
        yield started
