"""What stands in a table's cells: decimal commas, dates, words, and rows of another length."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.map_text import propose_map, signals_of
from gap_diagnosis.reading.table_file import read_columns

HEAD = "time;left_wheel_rad;right_wheel_rad;gyro_rad_s;state"
ROWS = tuple(f"{k / 50:.2f};{k / 10:.3f};{k / 9:.4e};{-k / 450:.4f};ok" for k in range(60))


def table(folder: Path, *lines: str) -> Path:
    path = folder / "drive.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("between", [";", "\t"])
def test_decimal_commas_are_read_where_cells_are_apart_by_something_else(
    between: str, tmp_path: Path
) -> None:
    names = HEAD.split(";")[:4]
    plain = read_columns(table(tmp_path, HEAD, *ROWS), names)
    lines = [line.replace(".", ",").replace(";", between) for line in (HEAD, *ROWS)]
    commas = read_columns(table(tmp_path, *lines), names)
    for name in names:
        np.testing.assert_array_equal(commas[name], plain[name])
    assert signals_of(tmp_path / "drive.csv", None).keys() == set(names)


@pytest.mark.parametrize(
    ("said", "since_s"),
    [
        ("2026-05-01T12:00:00.250", 0.25),
        ("2026-05-01 12:00:01.5Z", 1.5),
        ("2026-05-01 14:00:02.000001+02:00", 2.000001),
    ],
)
def test_a_date_and_time_of_day_is_a_clock(said: str, since_s: float, tmp_path: Path) -> None:
    rows = [f"{said};{k}" for k in range(3)]
    found = read_columns(table(tmp_path, "time;n", *rows), ["time"])["time"]
    assert found - 1_777_636_800 == pytest.approx(since_s, abs=1e-6)


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("0.8;4;4.4;ERROR;ok", "42: gyro_rad_s = 'ERROR': expected a number, or nothing"),
        ("0.8;4;4.4", "42: 3 cells: expected 5, as in the header"),
    ],
)
def test_a_map_does_not_leave_a_sensor_out_for_one_bad_cell(
    row: str, told: str, tmp_path: Path
) -> None:
    lines = [HEAD, *ROWS]
    lines[41] = row
    with pytest.raises(DiagnosisError, match=told):
        propose_map(table(tmp_path, *lines), None)


def test_a_second_line_with_units_is_told(tmp_path: Path) -> None:
    with pytest.raises(DiagnosisError, match=r"csv:2: time = 's': expected a number"):
        propose_map(table(tmp_path, HEAD, "s;rad;rad;rad/s;-", *ROWS), None)


def test_a_table_without_rows_is_told_in_one_line(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(DiagnosisError, match="no column with 10 numbers"):
            propose_map(table(tmp_path, HEAD, ""), None)


def test_wheels_that_never_turn_are_told_as_such(tmp_path: Path) -> None:
    rows = [f"{k / 50};7;7;{k % 3}e-3;ok" for k in range(60)]
    with pytest.raises(DiagnosisError, match=r"left_wheel_rad .* never changes \(7\): expected a"):
        propose_map(table(tmp_path, HEAD, *rows), None)


def test_rows_out_of_the_order_of_time_are_told_with_the_first(tmp_path: Path) -> None:
    lines = [HEAD, *ROWS]
    lines[20], lines[30] = lines[30], lines[20]
    with pytest.raises(DiagnosisError, match=r"time goes back, from 0\.58 in row 20 to 0\.4 in"):
        propose_map(table(tmp_path, *lines), None)


def test_utf_16_is_told_as_such(tmp_path: Path) -> None:
    path = tmp_path / "drive.csv"
    path.write_text("\n".join((HEAD, *ROWS)), encoding="utf-16")
    with pytest.raises(DiagnosisError, match="expected UTF-8"):
        propose_map(path, None)
