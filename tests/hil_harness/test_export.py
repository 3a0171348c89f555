"""Trajectories for others: MCAP read back by the readers of ROS 2, TUM by ours, numbers as laws."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from gap_diagnosis.reading.reference_file import read_reference
from hil_harness import HarnessError, RunConfig, RunResult, load_robot, load_wire, run, scenario
from hil_harness.export import Trajectory, logged_trajectories, tum_text, with_truth, write_mcap
from hil_harness.se2 import propagate_covariance

ROBOT, WIRE = load_robot(None), load_wire()
NOISE = 2e-3


@dataclass(frozen=True)
class Exported:
    result: RunResult
    odometry: Trajectory
    twin: Trajectory
    truth: Trajectory
    mcap: Path


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    folder = tmp_path_factory.mktemp("export")
    log = folder / "bus.log"
    result = run(RunConfig(scenario=scenario("figure8"), robot=ROBOT, duration_s=6.0, log=log))
    odometry, twin = logged_trajectories(log, ROBOT, WIRE, NOISE)
    truth = with_truth(result.stamp_us / 1e6, result.truth, ROBOT.plant.wheels.wheelbase_m)
    path = folder / "run.mcap"
    write_mcap(path, (odometry, twin, truth))
    return Exported(result, odometry, twin, truth, path)


def test_the_trajectories_are_those_of_the_run(exported: Exported) -> None:
    result = exported.result
    np.testing.assert_array_equal(exported.odometry.time_s, result.time_s)
    np.testing.assert_allclose(exported.odometry.poses[:, :2], result.firmware[:, :2], atol=2e-9)
    np.testing.assert_allclose(exported.odometry.poses[:, 2], result.firmware[:, 2], atol=2e-9)
    np.testing.assert_array_equal(exported.twin.poses, result.float_twin)
    np.testing.assert_array_equal(exported.truth.poses, result.truth)


def test_twists_add_up_to_the_poses(exported: Exported) -> None:
    # The kernel goes along the heading before each step, the twist along the middle one: half the
    # turn apart.
    way = exported.twin
    step_s = np.diff(way.time_s)
    heading = way.poses[0, 2] + np.concatenate([[0], np.cumsum(way.twist[1:, 1] * step_s)])
    np.testing.assert_allclose(heading, way.poses[:, 2], atol=1e-12)
    along = heading[:-1] + np.diff(heading) / 2
    steps_m = way.twist[1:, 0] * step_s
    x_m = np.cumsum(steps_m * np.cos(along))
    apart_m = np.cumsum(np.abs(steps_m * np.diff(heading) / 2))
    assert np.all(np.abs(x_m - (way.poses[1:, 0] - way.poses[0, 0])) <= apart_m + 1e-9)


def test_covariances_are_those_of_the_recursion(exported: Exported) -> None:
    way, wheelbase_m = exported.twin, ROBOT.plant.wheels.wheelbase_m
    step_s = np.diff(way.time_s)
    forward_m, turn_rad = way.twist[1:, 0] * step_s, way.twist[1:, 1] * step_s
    expected = propagate_covariance(
        forward_m - turn_rad * wheelbase_m / 2,
        forward_m + turn_rad * wheelbase_m / 2,
        wheelbase_m,
        NOISE**2,
    )
    assert way.poses[0, 2] == 0
    np.testing.assert_allclose(way.pose_covariance, expected, rtol=1e-9, atol=1e-18)
    # A heading's variance grows by that of the two wheels over the wheelbase, whatever the way.
    covered = np.sum(np.abs(forward_m - turn_rad * wheelbase_m / 2)) + np.sum(
        np.abs(forward_m + turn_rad * wheelbase_m / 2)
    )
    assert way.pose_covariance[-1, 2, 2] == pytest.approx(NOISE**2 * covered / wheelbase_m**2)
    assert not exported.truth.pose_covariance.any()


def test_ros_2_reads_odometry_and_transforms(exported: Exported) -> None:
    by_topic: dict[str, list[object]] = {}
    with exported.mcap.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            by_topic.setdefault(channel.topic, []).append(message)
    assert set(by_topic) == {"/odom", "/odom/float", "/odom/truth", "/tf"}
    for topic, way in (("/odom", exported.odometry), ("/odom/truth", exported.truth)):
        assert len(by_topic[topic]) == len(way.time_s)
        for row, message in enumerate(by_topic[topic]):
            check_odometry(message, way, row)
    for row, message in enumerate(by_topic["/tf"]):
        (stamped,) = message.transforms  # type: ignore[attr-defined]
        assert (stamped.header.frame_id, stamped.child_frame_id) == ("odom", "base_link")
        at, pose = stamped.transform.translation, exported.odometry.poses[row]
        assert (at.x, at.y, at.z) == (pose[0], pose[1], 0.0)


def check_odometry(message: object, way: Trajectory, row: int) -> None:
    odometry: Any = message
    header, pose, twist = odometry.header, odometry.pose, odometry.twist
    assert (header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert header.stamp.sec * 10**9 + header.stamp.nanosec == round(way.time_s[row] * 1e6) * 1000
    at, turn = pose.pose.position, pose.pose.orientation
    assert (at.x, at.y, at.z) == (*way.poses[row, :2], 0.0)
    assert (turn.x, turn.y) == (0.0, 0.0)
    heading = 2 * np.arctan2(turn.z, turn.w)
    assert np.remainder(heading - way.poses[row, 2] + 1, 2 * np.pi) == pytest.approx(1)
    assert (twist.twist.linear.x, twist.twist.angular.z) == tuple(way.twist[row])
    for covariance, part, axes in (
        (pose.covariance, way.pose_covariance[row], [0, 1, 5]),
        (twist.covariance, way.twist_covariance[row], [0, 5]),
    ):
        full = np.array(covariance).reshape(6, 6)
        np.testing.assert_array_equal(full[np.ix_(axes, axes)], part)
        others = [axis for axis in range(6) if axis not in axes]
        np.testing.assert_array_equal(full[np.ix_(others, others)], 1e6 * np.eye(len(others)))
        assert not full[np.ix_(axes, others)].any()


def test_another_reader_of_the_container_finds_every_message(exported: Exported) -> None:
    with AnyReader([exported.mcap]) as recording:
        counts = {one.topic: one.msgcount for one in recording.connections}
    rows = len(exported.odometry.time_s)
    assert counts == {"/odom": rows, "/tf": rows, "/odom/float": rows, "/odom/truth": rows}


def test_a_tum_file_gives_every_pose_back(exported: Exported, tmp_path: Path) -> None:
    path = tmp_path / "way.tum"
    path.write_text(tum_text(exported.twin.time_s, exported.twin.poses))
    read = read_reference(path)
    np.testing.assert_array_equal(read.t_s, exported.twin.time_s)
    np.testing.assert_array_equal(read.x_m, exported.twin.poses[:, 0])
    assert read.heading_rad is not None
    np.testing.assert_allclose(read.heading_rad, exported.twin.poses[:, 2], atol=1e-12)


def test_a_log_without_odometry_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(0.000000) vcan0 123#00\n")
    with pytest.raises(HarnessError, match=r"bus.log: no odometry frames: expected ODOMETRY_X"):
        logged_trajectories(path, ROBOT, WIRE)
