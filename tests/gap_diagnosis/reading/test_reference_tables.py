"""A table of its own as the reference: a receiver's fixes, or positions in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pymap3d
import pytest

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording, read_reference
from gap_diagnosis.recording import Floats
from hil_harness.robot import load_robot

FIX_HZ, SECONDS = 5, 20


def way_m() -> tuple[Floats, Floats, Floats]:
    """Return stamps and where the receiver is then, metres to the east and to the north."""
    t_s = np.arange(SECONDS * FIX_HZ) / FIX_HZ
    return t_s, 100 * np.sin(t_s / 10), 100 * (1 - np.cos(t_s / 10))


def fixes(
    folder: Path, header: str = "time_s,latitude,longitude", stamp: str = "{:.3f}", per_s: float = 1
) -> Path:
    """Write the fixes of a drive near Munich, by pymap3d."""
    t_s, east_m, north_m = way_m()
    latitude, longitude, _ = pymap3d.enu2geodetic(east_m, north_m, 0.0, 48.1, 11.5, 0.0)
    rows = zip(t_s, latitude, longitude, strict=True)
    lines = [f"{stamp.format(t * per_s)},{lat:.9f},{lon:.9f}" for t, lat, lon in rows]
    return written(folder, header, lines)


def written(folder: Path, header: str, lines: list[str]) -> Path:
    path = folder / "gps.csv"
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


@pytest.mark.parametrize(
    "header", ["time_s,latitude,longitude", "timestamp,lat,lon", "t,gps.lat_deg,gps.lon_deg"]
)
def test_latitude_and_longitude_of_a_file_of_their_own_are_a_reference(
    header: str, tmp_path: Path
) -> None:
    reference = read_reference(fixes(tmp_path, header))
    t_s, east_m, north_m = way_m()
    assert reference.heading_rad is None
    np.testing.assert_allclose(reference.t_s, t_s)
    np.testing.assert_allclose(reference.x_m, east_m, atol=1e-3)
    np.testing.assert_allclose(reference.y_m, north_m, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "stamp", "per_s"),
    [("stamp_ms", "{:.0f}", 1e3), ("timestamp", "{:.0f}", 1e3), ("%time", "{:.0f}", 1e9)],
)
def test_a_receivers_clock_may_count_parts_of_a_second(
    name: str, stamp: str, per_s: float, tmp_path: Path
) -> None:
    reference = read_reference(fixes(tmp_path, f"{name},lat,lon", stamp, per_s))
    np.testing.assert_allclose(reference.t_s, way_m()[0])


def test_milliseconds_of_one_fix_a_second_are_no_microseconds(tmp_path: Path) -> None:
    lines = [f"{1000 * k},{48 + 1e-5 * k},{11 + 2e-5 * k}" for k in range(20)]
    reference = read_reference(written(tmp_path, "timestamp,lat,lon", lines))
    np.testing.assert_allclose(reference.t_s, np.arange(20.0))


def test_positions_and_a_heading_in_their_units_are_a_reference(tmp_path: Path) -> None:
    t_s, east_m, north_m = way_m()
    rows = zip(t_s, east_m, north_m, strict=True)
    lines = [f"{t},{100 * x},{100 * y},0.5,{(175 + 5 * t) % 360}" for t, x, y in rows]
    names = "time_s,pos_x_cm,pos_y_cm,heading_std_deg,heading_deg"
    reference = read_reference(written(tmp_path, names, lines))
    np.testing.assert_allclose(reference.x_m, east_m)
    np.testing.assert_allclose(reference.y_m, north_m)
    assert reference.heading_rad is not None
    np.testing.assert_allclose(np.diff(reference.heading_rad), np.radians(1.0))


@pytest.mark.parametrize(
    "names",
    [
        "time_s,x_m,y_m,qx,qy,qz,qw",
        "#timestamp [s],p_RS_R_x [m],p_RS_R_y [m],q_RS_x [],q_RS_y [],q_RS_z [],q_RS_w []",
        "stamp_s,pose.position.x_m,pose.position.y_m,"
        + ",".join(f"pose.orientation.{part}" for part in "xyzw"),
    ],
)
def test_a_quaternion_in_columns_is_a_heading(names: str, tmp_path: Path) -> None:
    """They were left out, and a reference with headings had none."""
    t_s, east_m, north_m = way_m()
    rows = zip(t_s, east_m, north_m, strict=True)
    lines = [f"{t},{x},{y},0,0,{np.sin(2 + t / 20)},{np.cos(2 + t / 20)}" for t, x, y in rows]
    reference = read_reference(written(tmp_path, names, lines))
    assert reference.heading_rad is not None
    np.testing.assert_allclose(np.diff(reference.heading_rad), 0.1 / FIX_HZ)


def test_columns_that_hold_no_quaternion_are_an_error_and_one_for_all_is_no_heading(
    tmp_path: Path,
) -> None:
    t_s, east_m, north_m = way_m()
    rows = list(zip(t_s, east_m, north_m, strict=True))
    names = "time_s,x_m,y_m,qx,qy,qz,qw"
    with pytest.raises(DiagnosisError, match="row 1: the quaternion is not of length 1"):
        read_reference(written(tmp_path, names, [f"{t},{x},{y},0,0,0,2" for t, x, y in rows]))
    still = read_reference(written(tmp_path, names, [f"{t},{x},{y},0,0,0,1" for t, x, y in rows]))
    assert still.heading_rad is None


def test_rows_before_a_tracker_has_found_its_robot_are_left_out(tmp_path: Path) -> None:
    """Their quaternions are 0, and for these the whole table was refused."""
    rows = list(zip(*way_m(), strict=True))
    lines = [f"{t},0,0,0,0,0,0" for t, _, _ in rows[:5]]
    lines += [f"{t},{x},{y},0,0,{np.sin(t / 20)},{np.cos(t / 20)}" for t, x, y in rows[5:]]
    reference = read_reference(written(tmp_path, "time_s,x_m,y_m,qx,qy,qz,qw", lines))
    assert reference.heading_rad is not None
    assert len(reference.t_s) == len(rows) - 5


def test_east_and_north_in_metres_are_x_and_y(tmp_path: Path) -> None:
    t_s, east_m, north_m = way_m()
    lines = [f"{t},{y},{x}" for t, x, y in zip(t_s, east_m, north_m, strict=True)]
    reference = read_reference(written(tmp_path, "time_s,northing_m,easting_m", lines))
    np.testing.assert_allclose(reference.x_m, east_m)
    np.testing.assert_allclose(reference.y_m, north_m)


def test_rows_without_a_fix_are_left_out_and_told(tmp_path: Path) -> None:
    reference = fixes(tmp_path)
    rows = reference.read_text().splitlines()
    rows[1:5] = [f"{row.split(',')[0]},0,0" for row in rows[1:5]]
    rows[10] = f"{rows[10].split(',')[0]},,"
    reference.write_text("\n".join(rows) + "\n")
    log = tmp_path / "log.csv"
    ticks = "".join(f"{k / 50},{40 * k},{41 * k}\n" for k in range(SECONDS * 50))
    log.write_text("t_s,left_ticks,right_ticks\n" + ticks)
    recording = read_recording(log, robot=load_robot(), reference=reference)
    assert recording.reference is not None
    assert len(recording.reference.t_s) == SECONDS * FIX_HZ - 5
    assert "gps.csv: 4 of 99 messages have no fix and are left out." in recording.notes


def test_a_row_that_was_cut_off_is_left_out_and_told(tmp_path: Path) -> None:
    reference = fixes(tmp_path)
    reference.write_text(reference.read_text() + "20.0,48.1")
    log = tmp_path / "log.csv"
    ticks = "".join(f"{k / 50},{40 * k},{41 * k}\n" for k in range(SECONDS * 50))
    log.write_text("t_s,left_ticks,right_ticks\n" + ticks)
    recording = read_recording(log, robot=load_robot(), reference=reference)
    assert recording.reference is not None
    assert recording.reference.t_s[-1] == pytest.approx(SECONDS - 1 / FIX_HZ)
    assert any("of gps.csv was cut off" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("header", "row", "says"),
    [
        ("time_s,speed_m_s,altitude_m", "{t},1,{t}", "no positions among the columns time_s, "),
        ("time_s,x,y", "{t},{t},1{t}", "x says no unit: expected it in the column's name, as in x"),
        ("row,lat,lon", "{t},48.{k:03},11.{k:03}", "no clock among the columns"),
        ("time_s,lat,lon", "1.5,48.{k:03},11.{k:03}", "time_s says the same in row 1 and in the"),
        ("time_s,a_x_m,b_x_m,y_m", "{t},{t},2{t},3{t}", "reference_x could be a_x_m as well as b"),
    ],
)
def test_a_table_that_is_no_reference_is_refused(
    header: str, row: str, says: str, tmp_path: Path
) -> None:
    lines = [row.format(t=k / 10, k=k) for k in range(30)]
    with pytest.raises(DiagnosisError, match=says):
        read_reference(written(tmp_path, header, lines))
