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
from gap_diagnosis.reading.reference_file import read_reference
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
