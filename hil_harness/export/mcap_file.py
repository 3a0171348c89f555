"""Trajectories as MCAP: nav_msgs/Odometry and TF as ROS 2 and Foxglove read them.

Frames as in REP 105 (``odom``, ``base_link``), units and axes as in REP 103: metres, radians, x
forward, y left, z up. The motion is in the plane: what a wheel cannot measure (z, roll, pitch, and
speeds but forward and yaw) has a variance of 10⁶, which ROS's filters take for "not measured".
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil_harness.errors import HarnessError
from hil_harness.export.trajectories import Trajectory

ODOM_FRAME: Final = "odom"
ROBOT_FRAME: Final = "base_link"
TOPICS: Final = {"odometry": "/odom", "float": "/odom/float", "truth": "/odom/truth"}

_NOT_MEASURED: Final = 1e6
_ODOMETRY: Final = "nav_msgs/msg/Odometry"
_TF: Final = "tf2_msgs/msg/TFMessage"
_NS_PER_S: Final = 1_000_000_000


def write_mcap(path: Path, trajectories: Sequence[Trajectory]) -> None:
    """Write trajectories to an MCAP file, and the first one as the transform odom → base_link.

    Raises HarnessError where the packages for it are missing, OSError where the file cannot be
    written.
    """
    writers, stores = _packages(path)
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    with path.open("wb") as file:
        writer = writers.Writer(file)
        writer.start(profile="ros2", library="chiplog")
        schemas = {}
        for name in (_ODOMETRY, _TF):
            text = store.generate_msgdef(name, ros_version=2)[0]
            schemas[name] = writer.register_schema(name, "ros2msg", text.encode())

        def channel(topic: str, name: str) -> int:
            identifier: int = writer.register_channel(topic, "cdr", schemas[name])
            return identifier

        def add(to: int, name: str, message: Any, stamp_ns: int) -> None:
            data = bytes(store.serialize_cdr(message, name))
            writer.add_message(to, stamp_ns, data, stamp_ns)

        make = _Messages(store.types)
        for place, trajectory in enumerate(trajectories):
            poses = channel(TOPICS[trajectory.name], _ODOMETRY)
            transforms = channel("/tf", _TF) if place == 0 else None
            for row, time_s in enumerate(trajectory.time_s.tolist()):
                stamp_ns = round(time_s * 1e6) * 1000  # logs count in whole microseconds
                add(poses, _ODOMETRY, make.odometry(trajectory, row, stamp_ns), stamp_ns)
                if transforms is not None:
                    add(transforms, _TF, make.transform(trajectory.poses[row], stamp_ns), stamp_ns)
        writer.finish()


def _packages(path: Path) -> tuple[Any, Any]:
    try:
        return importlib.import_module("mcap.writer"), importlib.import_module("rosbags.typesys")
    except ImportError as error:
        raise HarnessError(
            f'{path}: writing MCAP needs {error.name}: pip install "chiplog[ros]"'
        ) from None


class _Messages:
    """Makes messages of the types that rosbags has."""

    def __init__(self, types: Any) -> None:
        self._types = types

    def _header(self, stamp_ns: int) -> Any:
        seconds, nanoseconds = divmod(stamp_ns, _NS_PER_S)
        stamp = self._types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id=ODOM_FRAME)

    def _vector(self, x: float, y: float, z: float, kind: str = "Vector3") -> Any:
        return self._types[f"geometry_msgs/msg/{kind}"](x=x, y=y, z=z)

    def _turn(self, heading_rad: float) -> Any:
        kind = self._types["geometry_msgs/msg/Quaternion"]
        return kind(x=0.0, y=0.0, z=math.sin(heading_rad / 2), w=math.cos(heading_rad / 2))

    def odometry(self, trajectory: Trajectory, row: int, stamp_ns: int) -> Any:
        types = self._types
        x_m, y_m, heading_rad = trajectory.poses[row].tolist()
        v_m_s, w_rad_s = trajectory.twist[row].tolist()
        pose = types["geometry_msgs/msg/Pose"](
            position=self._vector(x_m, y_m, 0.0, "Point"), orientation=self._turn(heading_rad)
        )
        twist = types["geometry_msgs/msg/Twist"](
            linear=self._vector(v_m_s, 0.0, 0.0), angular=self._vector(0.0, 0.0, w_rad_s)
        )
        return types[_ODOMETRY](
            header=self._header(stamp_ns),
            child_frame_id=ROBOT_FRAME,
            pose=types["geometry_msgs/msg/PoseWithCovariance"](
                pose=pose, covariance=_six_by_six(trajectory.pose_covariance[row], (0, 1, 5))
            ),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                twist=twist, covariance=_six_by_six(trajectory.twist_covariance[row], (0, 5))
            ),
        )

    def transform(self, pose: NDArray[np.float64], stamp_ns: int) -> Any:
        types = self._types
        x_m, y_m, heading_rad = pose.tolist()
        transform = types["geometry_msgs/msg/Transform"](
            translation=self._vector(x_m, y_m, 0.0), rotation=self._turn(heading_rad)
        )
        stamped = types["geometry_msgs/msg/TransformStamped"](
            header=self._header(stamp_ns), child_frame_id=ROBOT_FRAME, transform=transform
        )
        return types[_TF](transforms=[stamped])


def _six_by_six(part: NDArray[np.float64], axes: tuple[int, ...]) -> NDArray[np.float64]:
    """Return a covariance over x, y, z, roll, pitch, yaw, row by row, from that of some of them."""
    full = np.diag([0.0 if axis in axes else _NOT_MEASURED for axis in range(6)])
    full[np.ix_(axes, axes)] = part
    return full.ravel()
