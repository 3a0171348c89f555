"""What a run prints: aligned, with units, and nothing but text when piped."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from run_samples import run_result

from chiplog.run_table import show_run
from hil_harness.results import RunResult


def printed(result: RunResult, capsys: pytest.CaptureFixture[str]) -> list[str]:
    show_run(result, Path("out/lesson/report.html"))
    return capsys.readouterr().out.splitlines()


def test_the_answer_comes_first(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(run_result(), capsys)
    assert lines[0].startswith("After 60 s and 36.0 m, the fixed-point firmware is 182.3 nm from")


def test_truth_float_and_firmware_stand_below_each_other(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = printed(run_result(), capsys)
    start = lines.index("final pose       x [m]       y [m]   heading [°]")
    assert [line.split()[0] for line in lines[start + 1 : start + 4]] == [
        "truth",
        "float",
        "firmware",
    ]
    assert len({line.rindex(".") for line in lines[start + 1 : start + 4]}) == 1


def test_the_error_is_split_into_arithmetic_and_model(capsys: pytest.CaptureFixture[str]) -> None:
    text = "\n".join(printed(run_result(), capsys))
    assert re.search(r"^error +arithmetic +model +total$", text, flags=re.M)
    assert re.search(r"^distance +182.3 nm +5.260 m +5.260 m$", text, flags=re.M)


def test_refused_frames_are_named_by_reason(capsys: pytest.CaptureFixture[str]) -> None:
    assert "3 crc, 1 counter refused" in "\n".join(printed(run_result(), capsys))
    clean = run_result()
    clean = replace(clean, bus=replace(clean.bus, rejected={"crc": 0}))
    assert "none refused" in "\n".join(printed(clean, capsys))


def test_a_real_time_run_says_how_late_its_ticks_were(capsys: pytest.CaptureFixture[str]) -> None:
    text = "\n".join(printed(run_result(time="real"), capsys))
    assert "2 missed deadlines, late by 31 µs (median), 120 (99 %), 480 at most" in text


def test_the_last_line_is_the_path_of_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(run_result(), capsys)[-1] == "report   out/lesson/report.html"


def test_no_line_is_wider_than_a_terminal_or_has_trailing_blanks(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for line in printed(run_result(time="real"), capsys):
        assert len(line) <= 80
        assert line == line.rstrip()
        assert "\x1b" not in line
