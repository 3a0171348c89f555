"""References from ROS recordings: MCAP files, rosbag2 folders and databases, rosbag1 files.

Read by rosbags, which is an extra; no ROS is needed. Poses come from messages that state one:
nav_msgs/Odometry, geometry_msgs/PoseStamped and PoseWithCovarianceStamped, at their header's stamp.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError

SUFFIXES: Final = (".mcap", ".db3", ".bag")
_POSE_TYPES: Final = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
}


def ros_file(path: Path) -> tuple[Path, str | None] | None:
    """Return file and topic of `FILE` or `FILE:/topic`; None for what is no ROS recording."""
    name, colon, topic = str(path).rpartition(":/")
    file = Path(name) if colon else path
    is_folder = file.is_dir() and (file / "metadata.yaml").is_file()
    if file.suffix.lower() in SUFFIXES or is_folder:
        return file, f"/{topic}" if colon else None
    return None


def read_ros_rows(path: Path, topic: str | None, most_rows: int) -> NDArray[np.float64]:
    """Return the poses of one topic: float64[n, 8], rows ``t x y z qx qy qz qw``.

    Raises DiagnosisError for a file that cannot be read, several topics that state poses where none
    is chosen, or more than `most_rows` poses.
    """
    try:
        readers: Any = importlib.import_module("rosbags.highlevel")
        stores: Any = importlib.import_module("rosbags.typesys")
    except ImportError:
        raise DiagnosisError(
            f'{path}: reading a ROS recording needs rosbags: pip install "chiplog[ros]"'
        ) from None
    if not path.exists():
        raise DiagnosisError(f"{path}: cannot read this reference: No such file or directory")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    try:
        with readers.AnyReader([path], default_typestore=store) as recording:
            chosen = _chosen(path, topic, recording.connections)
            rows = []
            for connection, _, data in recording.messages(connections=chosen):
                message = recording.deserialize(data, connection.msgtype)
                rows.append(_row(message, _POSE_TYPES[connection.msgtype](message)))
                if len(rows) > most_rows:
                    raise DiagnosisError(f"{path}: more than {most_rows} poses: expected fewer")
    except DiagnosisError:
        raise
    except Exception as error:  # rosbags raises what parsing happens to raise
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise DiagnosisError(f"{path}: not a ROS recording that can be read: {text}") from error
    return np.array(rows, dtype=np.float64).reshape(-1, 8)


def _chosen(path: Path, topic: str | None, connections: list[Any]) -> list[Any]:
    """Return the connections of the one topic that states poses."""
    stating = [one for one in connections if one.msgtype in _POSE_TYPES]
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


def _row(message: Any, pose: Any) -> tuple[float, ...]:
    stamp, at, turn = message.header.stamp, pose.position, pose.orientation
    time_s = stamp.sec + stamp.nanosec * 1e-9
    return (time_s, at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)
