"""Reference trajectories: what a file says, what is refused, and in which line."""

from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, drive, encoded
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording, read_reference
from gap_diagnosis.reading.reference_file import refuse_no_overlap
from gap_diagnosis.recording import Reference

Floats = NDArray[np.float64]


def write(folder: Path, t_s: Floats, x_m: Floats, y_m: Floats, heading_rad: Floats) -> Path:
    rows = zip(t_s, x_m, y_m, np.sin(heading_rad / 2), np.cos(heading_rad / 2), strict=True)
    path = folder / "reference.tum"
    lines = [f"{t:.17g} {x:.17g} {y:.17g} 0 0 0 {s:.17g} {c:.17g}" for t, x, y, s, c in rows]
    path.write_text("# a comment\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_headings_come_back_unwrapped(tmp_path: Path) -> None:
    t_s = np.linspace(0, 60, 1200)
    heading = 0.4 * t_s - 3
    found = read_reference(write(tmp_path, t_s, np.cos(t_s), np.sin(t_s), heading))
    assert np.array_equal(found.t_s, t_s)
    assert found.heading_rad is not None
    turns = np.rint((found.heading_rad[0] - heading[0]) / (2 * np.pi))
    assert found.heading_rad - 2 * np.pi * turns == pytest.approx(heading, abs=1e-12)


def test_positions_with_one_quaternion_on_a_bent_path_have_no_heading(tmp_path: Path) -> None:
    t_s = np.linspace(0, 10, 100)
    still = np.zeros(100)
    bent = read_reference(write(tmp_path, t_s, np.cos(t_s), np.sin(t_s), still))
    assert bent.heading_rad is None
    straight = read_reference(write(tmp_path, t_s, t_s, still, still))
    assert straight.heading_rad is not None


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0.5 nan 0 0 0 0 0 1", r":4: not a number"),
        ("0.5 1 2 3", r":4: '0.5 1 2 3': expected t x y z qx qy qz qw"),
        ("0.5 a 0 0 0 0 0 1", r":4: '0.5 a 0"),
        ("0.05 0 0 0 0 0 0 1", r":4: the stamp does not come after the one before"),
        ("0.5 0 0 0 0 0 0 0", r":4: the quaternion is not of length 1"),
    ],
)
def test_a_bad_row_is_named_by_its_line(line: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(f"# heading\n0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n{line}\n", encoding="utf-8")
    with pytest.raises(DiagnosisError, match=said):
        read_reference(path)


def test_an_empty_or_missing_reference_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "empty.tum").write_text("# nothing\n", encoding="utf-8")
    with pytest.raises(DiagnosisError, match="0 rows: expected at least two"):
        read_reference(tmp_path / "empty.tum")
    with pytest.raises(DiagnosisError, match="cannot read this reference: No such file"):
        read_reference(tmp_path / "none.tum")


def test_a_reference_of_another_time_is_one_sentence(tmp_path: Path) -> None:
    log = encoded(drive(400), tmp_path)
    t_s = np.linspace(1000, 1060, 100)
    path = write(tmp_path, t_s, t_s, t_s, t_s)
    with pytest.raises(DiagnosisError, match=r"lasts from 1000.000 .* overlap by 2 s"):
        read_recording(log, robot=ROBOT, reference=path)


def test_a_clock_that_begins_at_zero_is_not_told_as_less(tmp_path: Path) -> None:
    recording = read_recording(encoded(drive(400), tmp_path), robot=ROBOT)
    t_s = np.array([-1e-17, 1.0])
    with pytest.raises(DiagnosisError, match=r"none\.tum lasts from 0\.000 to 1\.000 s"):
        refuse_no_overlap(Reference(t_s, t_s, t_s, None), recording, "none.tum", ROBOT)


def test_a_reference_file_is_laid_beside_the_log(tmp_path: Path) -> None:
    log = encoded(drive(400), tmp_path)
    t_s = np.linspace(4, 10, 100)
    found = read_recording(log, robot=ROBOT, reference=write(tmp_path, t_s, t_s, t_s, t_s))
    assert found.reference is not None
    assert np.array_equal(found.reference.t_s, t_s)
