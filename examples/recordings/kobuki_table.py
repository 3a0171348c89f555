"""Turns the topics of a Kobuki, recorded as gzipped CSV, into a table and a robot.toml.

    python kobuki_table.py FOLDER OUT

One row for each `sensors_core` message (50 Hz): the host's stamp, the robot's own clock, both wheel
counters, the mean of the raw gyro since the row before, the command in force, the robot's odometry.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from robots import KOBUKI

Floats = NDArray[np.float64]

DIGIT_RAD_S = math.radians(0.00875)
ZERO_CODE = 32_768
COMMAND_TIMEOUT_S = 0.6
"""After this long without a command the robot stops by itself."""

HEADER = (
    "t_s,ecu_t_s,left_ticks,right_ticks,gyro_code,v_command_m_s,w_command_rad_s,"
    "odom_x_m,odom_y_m,odom_heading_rad"
)


def topic(folder: Path, name: str, fields: list[str], origin_ns: int) -> dict[str, Floats]:
    """Return fields of a topic; those that end in `stamp` or `time` in seconds from the origin."""
    columns: dict[str, list[float]] = {field: [] for field in fields}
    with gzip.open(folder / f"{name}.csv.gz", "rt", newline="") as file:
        for row in csv.DictReader(file):
            for field in fields:
                is_stamp = field.endswith(("%time", ".stamp"))
                # Nanoseconds since 1970 do not fit a float: the origin is taken off before.
                value = (int(row[field]) - origin_ns) * 1e-9 if is_stamp else float(row[field])
                columns[field].append(value)
    return {field: np.array(values) for field, values in columns.items()}


def first_stamp_ns(folder: Path) -> int:
    """Return the first stamp of the host, in whole seconds, as nanoseconds."""
    with gzip.open(folder / "_mobile_base_sensors_core.csv.gz", "rt", newline="") as file:
        row = next(csv.DictReader(file))
    return int(row["field.header.stamp"]) // 10**9 * 10**9


def mean_since_the_row_before(t_s: Floats, sample_s: Floats, value: Floats) -> Floats:
    """Return the mean of the samples in (t of the row before, t of the row]; NaN without any."""
    row = np.searchsorted(t_s, sample_s, side="left")
    inside = (row > 0) & (row < len(t_s))
    count = np.bincount(row[inside], minlength=len(t_s))
    total = np.bincount(row[inside], value[inside], len(t_s))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def newest(t_s: Floats, sample_s: Floats, value: Floats) -> tuple[Floats, Floats]:
    """Return the newest sample at each row (NaN before the first), and how old it is."""
    place = np.searchsorted(sample_s, t_s, side="right") - 1
    known = place >= 0
    place = np.maximum(place, 0)
    return np.where(known, value[place], np.nan), t_s - sample_s[place]


def table(folder: Path) -> list[str]:
    """Return the lines of the table."""
    origin_ns = first_stamp_ns(folder)
    core = topic(
        folder,
        "_mobile_base_sensors_core",
        ["field.header.stamp", "field.time_stamp", "field.left_encoder", "field.right_encoder"],
        origin_ns,
    )
    gyro = topic(
        folder,
        "_mobile_base_sensors_imu_data_raw",
        ["field.header.stamp", "field.angular_velocity.z"],
        origin_ns,
    )
    commands = topic(
        folder,
        "_mobile_base_commands_velocity",
        ["%time", "field.linear.x", "field.angular.z"],
        origin_ns,
    )
    pose = "field.pose.pose."
    odom = topic(
        folder,
        "_odom",
        [
            "field.header.stamp",
            *(f"{pose}{name}" for name in ("position.x", "position.y")),
            *(f"{pose}orientation.{name}" for name in ("z", "w")),
        ],
        origin_ns,
    )
    t_s = core["field.header.stamp"]
    rate = mean_since_the_row_before(
        t_s, gyro["field.header.stamp"], gyro["field.angular_velocity.z"]
    )
    columns = [
        t_s,
        core["field.time_stamp"] / 1000,
        core["field.left_encoder"],
        core["field.right_encoder"],
        rate / DIGIT_RAD_S + ZERO_CODE,
    ]
    for name in ("field.linear.x", "field.angular.z"):
        command, age_s = newest(t_s, commands["%time"], commands[name])
        columns.append(np.where(age_s > COMMAND_TIMEOUT_S, 0.0, command))
    heading = 2 * np.arctan2(odom[f"{pose}orientation.z"], odom[f"{pose}orientation.w"])
    for value in (odom[f"{pose}position.x"], odom[f"{pose}position.y"], np.unwrap(heading)):
        columns.append(newest(t_s, odom["field.header.stamp"], value)[0])
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [HEADER, *(",".join(_cell(value) for value in row) for row in rows)]


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}"


def main() -> None:
    """Convert one folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    lines = table(given.folder)
    (given.out / "table.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (given.out / "robot.toml").write_text(KOBUKI, encoding="utf-8")
    print(f"{given.out}: {len(lines) - 1} rows")


if __name__ == "__main__":
    main()
