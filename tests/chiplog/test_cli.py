"""The command line itself: help, exit statuses, and what it does not load."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version

import pytest
from command_line import Chiplog

from chiplog import cli

HEAVY = ("numpy", "numba", "can", "cantools", "matplotlib", "pydantic", "scipy", "rich", "jinja2")


def test_help_names_every_command(chiplog: Chiplog) -> None:
    said = chiplog("--help")
    assert said.status == 0
    for name in ("run", "node", "replay", "effects", "schema", "doctor"):
        assert f"  {name} " in said.out


def test_chiplog_alone_shows_the_help(chiplog: Chiplog) -> None:
    assert chiplog() == chiplog("--help")


def test_no_line_of_help_is_cut_short(chiplog: Chiplog) -> None:
    assert "..." not in chiplog("--help").out.replace("[ARGS]...", "")


def test_the_version_is_the_installed_one(chiplog: Chiplog) -> None:
    assert chiplog("--version").out == f"chiplog {version('chiplog')}\n"


def test_the_command_line_loads_no_heavy_library_before_it_must() -> None:
    check = f"import sys, chiplog.cli; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_reader_that_goes_away_is_no_error(chiplog_process: Chiplog) -> None:
    script = f"{sys.executable} -m chiplog effects | head -n 1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0"
    assert done.stderr == ""


def test_an_internal_error_is_one_line_and_debug_shows_where(
    chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: list[str]) -> None:
        raise ZeroDivisionError("a bug of ours")

    monkeypatch.setattr(cli, "_run", broken)
    said = chiplog("run")
    assert said.status == 2
    assert said.err == (
        "chiplog: internal error, please report it: ZeroDivisionError: a bug of ours "
        "(--debug shows where)\n"
    )
    traced = chiplog("run", "--debug").err
    assert "Traceback" in traced
    assert traced.endswith("ZeroDivisionError: a bug of ours\n")


def test_ctrl_c_is_status_130(chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: list[str]) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_run", interrupted)
    said = chiplog("run")
    assert said.status == 130
    assert said.err == "chiplog: interrupted\n"


def test_control_characters_in_a_message_do_not_reach_the_terminal(
    chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hostile(_: list[str]) -> None:
        raise FileNotFoundError(2, "No such file or directory", "\x1b[2J\nrobot.toml")

    monkeypatch.setattr(cli, "_run", hostile)
    said = chiplog("run").err
    assert said == "chiplog: \\x1b[2J robot.toml: no such file or directory\n"
