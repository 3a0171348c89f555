"""A run replaces an earlier run's files and never anybody else's."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from run_samples import run_result

from chiplog.errors import CommandError
from chiplog.run_folder import OUR_FILES, RunFolder, reference_tum

FRAME = "(0.000000) vcan0 100#00 R\n"


def finished(path: Path) -> RunFolder:
    folder = RunFolder(path)
    with folder.recording("lesson", 7):
        folder.file("bus.log").write_text(FRAME)
    folder.write(run_result(ticks=10))
    folder.write_report("<html>")
    return folder


def fail_after(folder: RunFolder, log: str) -> None:
    with folder.recording("square", 1):
        folder.file("bus.log").write_text(log)
        raise CommandError("the bus is not there")


def test_a_new_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    finished(tmp_path / "a" / "b")
    assert {file.name for file in (tmp_path / "a" / "b").iterdir()} == set(OUR_FILES)


def test_an_earlier_run_is_replaced_and_other_files_are_kept(tmp_path: Path) -> None:
    finished(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    folder = RunFolder(tmp_path)
    with folder.recording("square", 1):
        folder.file("bus.log").write_text(FRAME)
    assert {file.name for file in tmp_path.iterdir()} == {"bus.log", "notes.txt", "summary.json"}
    assert json.loads((tmp_path / "summary.json").read_text())["scenario"] == "square"
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_run_that_fails_before_its_first_frame_leaves_the_earlier_one(tmp_path: Path) -> None:
    finished(tmp_path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    folder = RunFolder(tmp_path)
    with pytest.raises(CommandError):
        fail_after(folder, "")
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_run_that_fails_before_its_first_frame_leaves_no_new_folder(tmp_path: Path) -> None:
    with pytest.raises(CommandError):
        fail_after(RunFolder(tmp_path / "out"), "")
    assert not (tmp_path / "out").exists()


def test_a_run_that_fails_later_keeps_what_it_recorded(tmp_path: Path) -> None:
    finished(tmp_path)
    folder = RunFolder(tmp_path)
    with pytest.raises(CommandError):
        fail_after(folder, 2 * FRAME)
    assert folder.file("bus.log").read_text() == 2 * FRAME
    assert {file.name for file in tmp_path.iterdir()} == {"bus.log", "summary.json"}
    assert json.loads((tmp_path / "summary.json").read_text())["interrupted"] is True


@pytest.mark.parametrize("name", OUR_FILES)
def test_a_file_of_our_name_that_no_run_wrote_is_not_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("[1, 2, 3]")
    with pytest.raises(CommandError, match=f"{name}: no run of chiplog wrote this folder"):
        RunFolder(tmp_path)
    assert (tmp_path / name).read_text() == "[1, 2, 3]"


def test_a_file_is_not_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(CommandError, match="is a file"):
        RunFolder(tmp_path / "out")


def test_a_killed_run_does_not_look_finished_and_can_be_run_again(tmp_path: Path) -> None:
    recording = RunFolder(tmp_path).recording("lesson", 7)
    recording.__enter__()
    (tmp_path / "bus.log").write_text(FRAME)
    assert json.loads((tmp_path / "summary.json").read_text())["interrupted"] is True
    finished(tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["interrupted"] is False
    assert {file.name for file in tmp_path.iterdir()} == set(OUR_FILES)


def test_the_reference_gives_time_and_position_back_bit_for_bit() -> None:
    result = run_result(ticks=500)
    rows = np.array([line.split() for line in reference_tum(result).splitlines()], dtype=float)
    assert np.array_equal(rows[:, 0], result.time_s)
    assert np.array_equal(rows[:, 1:3], result.truth[:, :2])
    assert not rows[:, 3:6].any()


def test_the_reference_holds_the_heading_as_a_unit_quaternion() -> None:
    result = run_result(ticks=500)
    rows = np.array([line.split() for line in reference_tum(result).splitlines()], dtype=float)
    heading_rad = 2 * np.arctan2(rows[:, 6], rows[:, 7])
    rounding = 4 * np.finfo(float).eps
    assert heading_rad == pytest.approx(result.truth[:, 2], abs=rounding)
    assert np.hypot(rows[:, 6], rows[:, 7]) == pytest.approx(1.0, abs=rounding)
