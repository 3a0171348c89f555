"""A last line that was cut off while it was written: what is whole is read, and a note says so."""

from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, drive, encoded

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.reference_file import read_reference
from gap_diagnosis.recording import Recording

NOTE = "The last line was cut off while it was written: it was left out."


def cut(path: Path, characters: int) -> Path:
    """Take so many characters from the end of a file, its last line end among them."""
    path.write_bytes(path.read_bytes()[:-characters])
    return path


def same(found: Recording, whole: Recording, rows: int) -> bool:
    return np.array_equal(found.left_ticks[:rows], whole.left_ticks[:rows], equal_nan=True)


@pytest.mark.parametrize("power_off", [b"", b"\0" * 300])
def test_of_a_table_the_whole_rows_are_read(power_off: bytes, tmp_path: Path) -> None:
    path = drive(400).write(tmp_path / "table.csv")
    whole = read_recording(path, robot=ROBOT)
    row = len(path.read_text().splitlines()[-1])
    cut(path, row // 2)
    path.write_bytes(path.read_bytes() + power_off)
    found = read_recording(path, robot=ROBOT)
    assert len(found.tick) == 399
    assert same(found, whole, 399)
    assert found.notes == (*whole.notes, NOTE)


def test_a_table_that_only_lacks_its_last_line_end_is_whole(tmp_path: Path) -> None:
    path = cut(drive(400).write(tmp_path / "table.csv"), 1)
    found = read_recording(path, robot=ROBOT)
    assert len(found.tick) == 400
    assert found.notes == ()


@pytest.mark.parametrize("characters", [1, 2, 9, 20])
def test_of_a_log_the_whole_lines_are_read(characters: int, tmp_path: Path) -> None:
    log = encoded(drive(400), tmp_path)
    whole = read_recording(log, robot=ROBOT)
    found = read_recording(cut(log, characters), robot=ROBOT)
    assert same(found, whole, 399)
    assert NOTE in found.notes


@pytest.mark.parametrize("characters", [2, 3, 15])
def test_of_a_reference_the_whole_poses_are_read(characters: int, tmp_path: Path) -> None:
    lines = [f"{5 + k / 50:.3f} {k / 100:.3f} 0 0 0 0 0.6 0.8" for k in range(200)]
    tum = tmp_path / "way.tum"
    tum.write_text("\n".join(lines) + "\n")
    assert len(read_reference(cut(tum, characters)).t_s) == 199
    table = drive(400).write(tmp_path / "table.csv")
    found = read_recording(table, robot=ROBOT, reference=tum)
    assert found.notes == (NOTE.replace("line", "line of way.tum"),)


def test_a_line_that_breaks_off_before_the_last_is_still_refused(tmp_path: Path) -> None:
    tum = tmp_path / "way.tum"
    tum.write_text("0 0 0 0 0 0 0 1\n1 0 0 0\n2 0 0 0 0 0 0 1\n")
    with pytest.raises(DiagnosisError, match=r"way.tum:2: "):
        read_reference(tum)
