"""References from ROS recordings: MCAP and rosbag2 say what the same TUM file says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.reference_file import read_reference
from hil_harness import load_robot
from hil_harness.export import tum_text, with_truth, write_mcap

TIME_S = np.arange(200) / 100 + 1_700_000_000
POSES = np.column_stack(
    [np.cos(TIME_S - TIME_S[0]), np.sin(TIME_S - TIME_S[0]), 3 * (TIME_S - TIME_S[0])]
)


def pose_stamped(store: Any, row: int) -> Any:
    types, heading = store.types, POSES[row, 2]
    nanoseconds = round(TIME_S[row] * 1e6) * 1000
    stamp = types["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](POSES[row, 0], POSES[row, 1], 0.0),
        types["geometry_msgs/msg/Quaternion"](
            0.0, 0.0, float(np.sin(heading / 2)), float(np.cos(heading / 2))
        ),
    )
    header = types["std_msgs/msg/Header"](stamp, "world")
    return types["geometry_msgs/msg/PoseStamped"](header, pose)


@pytest.fixture(params=[StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["sqlite3", "mcap"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a rosbag2 folder that rosbags wrote."""
    store, name = get_typestore(Stores.ROS2_HUMBLE), "geometry_msgs/msg/PoseStamped"
    with Writer(tmp_path / "bag", version=9, storage_plugin=request.param) as writer:
        connection = writer.add_connection("/mocap/robot", name, typestore=store)
        for row in range(len(TIME_S)):
            data = store.serialize_cdr(pose_stamped(store, row), name)
            writer.write(connection, round(TIME_S[row] * 1e9), data)
    return tmp_path / "bag"


def check_same(path: str | Path, folder: Path) -> None:
    tum = folder / "same.tum"
    tum.write_text(tum_text(TIME_S, POSES))
    expected, read = read_reference(tum), read_reference(path)
    np.testing.assert_allclose(read.t_s, expected.t_s, atol=1e-6)
    np.testing.assert_allclose(read.x_m, expected.x_m, atol=1e-12)
    np.testing.assert_allclose(read.y_m, expected.y_m, atol=1e-12)
    assert read.heading_rad is not None
    assert expected.heading_rad is not None
    np.testing.assert_allclose(read.heading_rad, expected.heading_rad, atol=1e-9)


def test_a_rosbag2_folder_is_a_reference(bag: Path, tmp_path: Path) -> None:
    check_same(bag, tmp_path)
    check_same(f"{bag}:/mocap/robot", tmp_path)


def test_an_mcap_file_is_a_reference(tmp_path: Path) -> None:
    truth = with_truth(TIME_S, POSES, 0.3)
    write_mcap(tmp_path / "one.mcap", [truth])
    check_same(tmp_path / "one.mcap", tmp_path)


def test_of_several_topics_one_must_be_chosen(tmp_path: Path) -> None:

    truth = with_truth(TIME_S, POSES, 0.3)
    path = tmp_path / "two.mcap"
    write_mcap(path, [replace(truth, name="odometry"), truth])
    with pytest.raises(DiagnosisError, match=r"poses on /odom, /odom/truth: expected one of them"):
        read_reference(path)
    check_same(f"{path}:/odom/truth", tmp_path)
    with pytest.raises(DiagnosisError, match=r"no poses on /tf: they are on /odom, /odom/truth"):
        read_reference(f"{path}:/tf")


def test_what_is_no_recording_is_one_line(tmp_path: Path) -> None:
    for name, content in (("a.mcap", b"no"), ("a.bag", b"#ROSBAG V2.0\n"), ("a.db3", b"")):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(DiagnosisError, match=name) as caught:
            read_reference(path)
        assert "\n" not in str(caught.value)
    with pytest.raises(DiagnosisError, match=r"gone.mcap: cannot read this reference"):
        read_reference(tmp_path / "gone.mcap")


EQUATOR_M, ECCENTRICITY_SQUARED = 6_378_137.0, 6.694_379_990_14e-3
"""Semi-major axis and first eccentricity squared of WGS 84 (NGA.STND.0036, table 3.1)."""
FIRST_DEG = (59.0, 11.0)
UNKNOWN, NO_FIX, FIX = -2, -1, 0


def degrees_of(x_m: float, y_m: float) -> tuple[float, float]:
    """Return the place so far to the east and north of the first, by the ellipsoid's two radii."""
    latitude_rad = np.deg2rad(FIRST_DEG[0])
    flat = 1 - ECCENTRICITY_SQUARED * np.sin(latitude_rad) ** 2
    east_m = EQUATOR_M / np.sqrt(flat)
    north_m = EQUATOR_M * (1 - ECCENTRICITY_SQUARED) / flat**1.5
    return (
        float(FIRST_DEG[0] + np.rad2deg(y_m / north_m)),
        float(FIRST_DEG[1] + np.rad2deg(x_m / (east_m * np.cos(latitude_rad)))),
    )


def write_fixes(folder: Path, fixes: list[tuple[float, int, float, float]]) -> Path:
    """Write a rosbag2 of what a receiver says: stamp [s], status, latitude and longitude [deg]."""
    store, name = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/NavSatFix"
    types = store.types
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/gps/fix", name, typestore=store)
        for time_s, status, latitude_deg, longitude_deg in fixes:
            nanoseconds = round(time_s * 1e6) * 1000
            stamp = types["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            fix = types[name](
                types["std_msgs/msg/Header"](stamp, "gps"),
                types["sensor_msgs/msg/NavSatStatus"](status, 1),
                latitude_deg,
                longitude_deg,
                float("nan"),
                np.zeros(9),
                0,
            )
            writer.write(connection, nanoseconds, store.serialize_cdr(fix, name))
    return folder


def test_fixes_of_a_gps_are_metres_to_the_east_and_north_and_no_headings(tmp_path: Path) -> None:
    way_m = np.column_stack([10 * np.sin(np.arange(100) / 10), np.arange(100) / 10])
    fixes = [(100.0 + k, FIX, *degrees_of(x, y)) for k, (x, y) in enumerate(way_m)]
    read = read_reference(write_fixes(tmp_path / "bag", fixes))
    # The plane through the first place leaves the radii's by x y tan(latitude) / R, 27 µm at most.
    np.testing.assert_allclose(read.x_m, way_m[:, 0], atol=3e-5)
    np.testing.assert_allclose(read.y_m, way_m[:, 1], atol=3e-5)
    np.testing.assert_allclose(read.t_s, 100.0 + np.arange(100))
    assert read.heading_rad is None


def test_a_straight_way_of_fixes_has_no_headings_either(tmp_path: Path) -> None:
    fixes = [(float(k), FIX, *degrees_of(k, 0.0)) for k in range(20)]
    assert read_reference(write_fixes(tmp_path / "bag", fixes)).heading_rad is None


def test_messages_without_a_fix_are_left_out_and_told(tmp_path: Path) -> None:
    nowhere = float("nan")
    fixes = [(0.0, UNKNOWN, 0.0, 0.0), *((k, NO_FIX, nowhere, nowhere) for k in (1.0, 2.0))]
    fixes += [(float(k), FIX, *degrees_of(k, 0.0)) for k in range(3, 10)]
    bag = write_fixes(tmp_path / "bag", fixes)
    table = tmp_path / "table.csv"
    rows = [f"{k / 10},{40 * k},{40 * k}" for k in range(100)]
    table.write_text("\n".join(["t_s,left_ticks,right_ticks", *rows]))
    for reference in (bag, f"{bag}:/gps/fix"):
        recording = read_recording(table, robot=load_robot(), reference=reference)
        assert recording.reference is not None
        np.testing.assert_allclose(recording.reference.t_s, np.arange(3, 10))
        assert "bag: 3 of 10 messages have no fix and are left out." in recording.notes


def test_a_receiver_that_had_no_fix_is_no_reference(tmp_path: Path) -> None:
    bag = write_fixes(tmp_path / "bag", [(float(k), NO_FIX, 0.0, 0.0) for k in range(5)])
    with pytest.raises(DiagnosisError, match=r"bag: 5 messages have no fix, 0 have one: expected"):
        read_reference(bag)


def test_a_fix_beyond_the_poles_is_refused(tmp_path: Path) -> None:
    bag = write_fixes(tmp_path / "bag", [(0.0, FIX, 59.0, 11.0), (1.0, FIX, 910.0, 11.0)])
    with pytest.raises(DiagnosisError, match=r"a fix at latitude 910°, longitude 11°: expected"):
        read_reference(bag)
