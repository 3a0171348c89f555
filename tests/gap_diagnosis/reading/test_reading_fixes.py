"""A receiver's latitude and longitude beside a car's wheels: in its table, and on its bus."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from can_bus import load_database
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.fixes import east_north_m
from gap_diagnosis.reading.map_text import propose_map
from gap_diagnosis.recording import Floats
from hil_harness.robot import load_robot

FIRST_DEG = (48.1, 11.5)
SECONDS, RATE_HZ, FIX_HZ = 20, 50, 5
DBC = """VERSION ""
NS_ :
BS_:
BU_: CAR

BO_ 256 WHEELS: 4 CAR
 SG_ RL : 7|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ RR : 23|16@0+ (0.01,0) [0|300] "km/h" CAR

BO_ 512 GNSS: 8 CAR
 SG_ Latitude : 7|32@0- (1E-007,0) [-90|90] "deg" CAR
 SG_ Longitude : 39|32@0- (1E-007,0) [-180|180] "deg" CAR

BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 20;
BA_ "GenMsgCycleTime" BO_ 512 200;
"""


def way_m() -> tuple[Floats, Floats]:
    """Return where the receiver is at each fix, metres to the east and to the north."""
    t_s = np.arange(SECONDS * FIX_HZ) / FIX_HZ
    return 100 * np.sin(t_s / 10), 100 * (1 - np.cos(t_s / 10))


def places_deg() -> tuple[Floats, Floats]:
    """Return its latitudes and longitudes, by pymap3d."""
    latitude, longitude, _ = pymap3d.enu2geodetic(*way_m(), 0.0, *FIRST_DEG, 0.0)
    return latitude, longitude


def table(folder: Path, names: str = "time_s,v_rl_kmh,v_rr_kmh,lat,lon", lost: int = 0) -> Path:
    """Write a car's table with a fix in every tenth row, of which the first *lost* say zero."""
    latitude, longitude = places_deg()
    lines = [names]
    for row in range(SECONDS * RATE_HZ):
        k, rest = divmod(row, RATE_HZ // FIX_HZ)
        fix = "," if rest else f"{latitude[k]:.9f},{longitude[k]:.9f}" if k >= lost else "0,0"
        lines.append(f"{row / RATE_HZ},{36 - 0.28 * (row % 3)},{36.1 + 0.2 * (row % 2)},{fix}")
    path = folder / "car.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_fixes_are_laid_on_the_plane_as_pymap3d_lays_them() -> None:
    draw = np.random.default_rng(1)
    for latitude, longitude, height_m in (
        (48.1, 11.5, 520.0),
        (-33.9, 151.2, 0.0),
        (0.0, -78, 9.0),
    ):
        places = np.array([[latitude], [longitude]]) + np.cumsum(draw.normal(0, 0.01, (2, 500)), 1)
        east_m, north_m, _ = pymap3d.geodetic2enu(*places, height_m, *places[:, 0], height_m)
        found = east_north_m(*np.radians(places), height_m)
        np.testing.assert_allclose(found, (east_m, north_m), atol=1e-6)


def test_latitude_and_longitude_of_a_table_are_found_by_their_names(tmp_path: Path) -> None:
    log = table(tmp_path)
    _, guesses, text = propose_map(log, None)
    assert guesses["reference_x"].signal.path == "lon"
    assert guesses["reference_y"].signal.path == "lat"
    (tmp_path / "map.toml").write_text(text)
    recording = read_recording(log, robot=load_robot(), signals=tmp_path / "map.toml")
    assert recording.reference is not None
    assert recording.reference.heading_rad is None
    np.testing.assert_allclose(recording.reference.x_m, way_m()[0], atol=1e-3)
    np.testing.assert_allclose(recording.reference.y_m, way_m()[1], atol=1e-3)


def test_fixes_of_zero_are_none_and_told(tmp_path: Path) -> None:
    log = table(tmp_path, lost=10)
    (tmp_path / "map.toml").write_text(propose_map(log, None)[2])
    recording = read_recording(log, robot=load_robot(), signals=tmp_path / "map.toml")
    assert recording.reference is not None
    assert recording.reference.t_s[0] == pytest.approx(10 / FIX_HZ)
    assert "car.csv: 10 of 100 messages have no fix and are left out." in recording.notes


@pytest.mark.parametrize(
    "names", ["lat_acc_m_s2,lon_acc_m_s2", "lat,steering_deg", "lat_accuracy,lon_accuracy"]
)
def test_what_is_lateral_or_how_sure_a_fix_is_is_no_place(names: str, tmp_path: Path) -> None:
    log = table(tmp_path, f"time_s,v_rl_kmh,v_rr_kmh,{names}")
    _, guesses, _ = propose_map(log, None)
    assert "reference_x" not in guesses
    assert "reference_y" not in guesses


def mapped(folder: Path, x: str, y: str) -> Path:
    path = folder / "said.toml"
    path.write_text(
        '[columns]\ntime = { column = "time_s", unit = "s" }\n'
        'left_count = { column = "v_rl_kmh", unit = "km/h" }\n'
        'right_count = { column = "v_rr_kmh", unit = "km/h" }\n'
        f"reference_x = {x}\nreference_y = {y}\n"
    )
    return path


def test_a_latitude_beyond_the_poles_says_which_is_which(tmp_path: Path) -> None:
    log = table(tmp_path, "time_s,v_rl_kmh,v_rr_kmh,a,b")
    swapped = mapped(tmp_path, '{ column = "a", unit = "deg" }', '{ column = "b", unit = "turn" }')
    with pytest.raises(DiagnosisError, match="reference_x is the longitude, reference_y the latit"):
        read_recording(log, robot=load_robot(), signals=swapped)


def test_a_longitude_beside_a_length_is_refused(tmp_path: Path) -> None:
    log = table(tmp_path, "time_s,v_rl_kmh,v_rr_kmh,a,b")
    mixed = mapped(tmp_path, '{ column = "b", unit = "deg" }', '{ column = "a", unit = "m" }')
    with pytest.raises(DiagnosisError, match="reference_x measures angle, reference_y length"):
        read_recording(log, robot=load_robot(), signals=mixed)


def test_fixes_on_the_bus_are_a_reference_too(tmp_path: Path) -> None:
    (tmp_path / "car.dbc").write_text(DBC)
    latitude, longitude = places_deg()
    lines = []
    for row in range(SECONDS * RATE_HZ):
        stamp_s = 1_000.0 + row / RATE_HZ
        wheels = struct.pack(">HH", 3600 - 28 * (row % 3), 3610 + 20 * (row % 2))
        lines.append(f"({stamp_s:.6f}) can0 100#{wheels.hex().upper()}")
        k, rest = divmod(row, RATE_HZ // FIX_HZ)
        if rest == 0:
            fix = struct.pack(">ii", round(latitude[k] * 1e7), round(longitude[k] * 1e7))
            lines.append(f"({stamp_s + 1e-3:.6f}) can0 200#{fix.hex().upper()}")
    log = tmp_path / "car.log"
    log.write_text("\n".join(lines) + "\n")
    dbc = tmp_path / "car.dbc"
    (tmp_path / "map.toml").write_text(propose_map(log, load_database(dbc))[2])
    recording = read_recording(log, robot=load_robot(), dbc=dbc, signals=tmp_path / "map.toml")
    assert recording.reference is not None
    # A step of 1e-7 degrees is 11 mm to the north, and lies to either side of what it rounds.
    np.testing.assert_allclose(recording.reference.x_m, way_m()[0], atol=0.02)
    np.testing.assert_allclose(recording.reference.y_m, way_m()[1], atol=0.02)


def test_a_compass_beside_fixes_is_their_heading_and_counts_from_north(tmp_path: Path) -> None:
    """It was the odometry's: a healthy robot's firmware was a quarter turn off."""
    t_s = np.arange(1000) / 50
    rate_rad_s = 0.3 * np.sin(t_s)
    heading_rad = 0.5 + np.cumsum(rate_rad_s) / 50
    east_m, north_m = np.cumsum(np.cos(heading_rad)) / 5, np.cumsum(np.sin(heading_rad)) / 5
    latitude, longitude, _ = pymap3d.enu2geodetic(east_m, north_m, 0.0, *FIRST_DEG, 0.0)
    compass_deg = np.degrees(0.5 * np.pi - heading_rad) % 360
    wheels_km_h = (36 - 2.7 * rate_rad_s, 36 + 2.7 * rate_rad_s)
    rows = np.stack([t_s, *wheels_km_h, latitude, longitude, compass_deg], axis=1)
    log = tmp_path / "car.csv"
    names = "time_s,v_rl_kmh,v_rr_kmh,latitude,longitude,heading_deg"
    np.savetxt(log, rows, fmt="%.9f", delimiter=",", header=names, comments="")
    (tmp_path / "map.toml").write_text(propose_map(log, None)[2])
    recording = read_recording(log, robot=load_robot(), signals=tmp_path / "map.toml")
    assert recording.odometry_heading_rad is None
    assert recording.reference is not None
    np.testing.assert_allclose(recording.reference.heading_rad, heading_rad, atol=1e-6)
