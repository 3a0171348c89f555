"""References from ROS recordings: MCAP files, rosbag2 folders and databases, rosbag1 files.

Read by rosbags, which is an extra; no ROS is needed. Poses come from messages that state one:
nav_msgs/Odometry, geometry_msgs/PoseStamped and PoseWithCovarianceStamped, at their header's stamp.
A GPS receiver's sensor_msgs/NavSatFix states a latitude and a longitude: they are laid, at the
height of the first, on the plane that touches WGS 84 there, x to the east and y to the north.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.fixes import east_north_m

SUFFIXES: Final = (".mcap", ".db3", ".bag")
_POSE_TYPES: Final = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
}
_FIX_TYPE: Final = "sensor_msgs/msg/NavSatFix"
_FIX: Final = 0
"""NavSatStatus.STATUS_FIX: what is less has none, -1 by its name and -2 before it is known."""
_NO_TURN: Final = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class RosPoses:
    """What one topic of a ROS recording says of where the robot was.

    Attributes:
        rows: float64[n, 8], ``t x y z qx qy qz qw`` in s and m.
        has_headings: False for the fixes of a GPS receiver, whose quaternions mean nothing.
        without_fix: messages of a receiver that had no fix; they are in no row.
    """

    rows: NDArray[np.float64]
    has_headings: bool
    without_fix: int


def ros_file(path: Path) -> tuple[Path, str | None] | None:
    """Return file and topic of `FILE` or `FILE:/topic`; None for what is no ROS recording."""
    name, colon, topic = str(path).rpartition(":/")
    file = Path(name) if colon else path
    is_folder = file.is_dir() and (file / "metadata.yaml").is_file()
    if file.suffix.lower() in SUFFIXES or is_folder:
        return file, f"/{topic}" if colon else None
    return None


def read_ros_poses(path: Path, topic: str | None, most_rows: int) -> RosPoses:
    """Return the poses of one topic.

    Raises DiagnosisError for a file that cannot be read, several topics that state poses where none
    is chosen, more than `most_rows` poses, or a latitude or longitude that is none.
    """
    readers = _package("rosbags.highlevel", path)
    stores = _package("rosbags.typesys", path)
    if not path.exists():
        raise DiagnosisError(f"{path}: cannot read this reference: No such file or directory")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    try:
        with readers.AnyReader([path], default_typestore=store) as recording:
            chosen = _chosen(path, topic, recording.connections)
            is_fix = chosen[0].msgtype == _FIX_TYPE
            rows = []
            without_fix = 0
            for connection, _, data in recording.messages(connections=chosen):
                message = recording.deserialize(data, connection.msgtype)
                if not is_fix:
                    rows.append(_row(message, _POSE_TYPES[connection.msgtype](message)))
                elif message.status.status < _FIX:
                    without_fix += 1
                else:
                    rows.append(_fix(path, message))
                if len(rows) > most_rows:
                    raise DiagnosisError(f"{path}: more than {most_rows} poses: expected fewer")
    except DiagnosisError:
        raise
    except Exception as error:  # rosbags raises what parsing happens to raise
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise DiagnosisError(f"{path}: not a ROS recording that can be read: {text}") from error
    poses = np.array(rows, dtype=np.float64).reshape(-1, 8)
    if is_fix and len(poses):
        _lay_flat(poses)
    return RosPoses(poses, not is_fix, without_fix)


def _package(name: str, path: Path) -> Any:
    """Return a module of the extra, or raise DiagnosisError that says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise DiagnosisError(
            f'{path}: reading this ROS recording needs {package}: pip install "chiplog[ros]"'
        ) from None


def _chosen(path: Path, topic: str | None, connections: list[Any]) -> list[Any]:
    """Return the connections of the one topic that states poses."""
    stating = [one for one in connections if one.msgtype in (*_POSE_TYPES, _FIX_TYPE)]
    topics = sorted({one.topic for one in stating})
    if topic is not None and topic not in topics:
        raise DiagnosisError(
            f"{path}: no poses on {topic}: they are on {', '.join(topics) or 'no topic'}"
        )
    if topic is None and len(topics) != 1:
        example = f", such as {path}:{topics[0]}" if topics else ""
        raise DiagnosisError(
            f"{path}: poses on {', '.join(topics) or 'no topic'}: expected one of them{example}"
        )
    wanted = topic if topic is not None else topics[0]
    return [one for one in stating if one.topic == wanted]


def _fix(path: Path, message: Any) -> tuple[float, ...]:
    """Return the row of a fix, its place in degrees and metres of height."""
    place_deg = (message.latitude, message.longitude)
    if not (abs(place_deg[0]) <= 90 and abs(place_deg[1]) <= 360):
        raise DiagnosisError(
            f"{path}: a fix at latitude {place_deg[0]:g}°, longitude {place_deg[1]:g}°: expected "
            "at most 90° and 360°, or a message that says that there is no fix"
        )
    height_m = message.altitude if np.isfinite(message.altitude) else 0.0
    return (_time_s(message), *place_deg, height_m, *_NO_TURN)


def _lay_flat(rows: NDArray[np.float64]) -> None:
    """Put metres to the east and to the north of the first fix in the place of degrees."""
    latitude, longitude = np.radians(rows[:, 1]), np.radians(rows[:, 2])
    rows[:, 1], rows[:, 2] = east_north_m(latitude, longitude, float(rows[0, 3]))
    rows[:, 3] = 0.0


def _row(message: Any, pose: Any) -> tuple[float, ...]:
    at, turn = pose.position, pose.orientation
    return (_time_s(message), at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)


def _time_s(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9)
