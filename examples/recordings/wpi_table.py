"""Turns a trial of a Kobuki under motion capture (PHIL of WPI) into a table and a reference.

    python wpi_table.py recorded_sensor_data/turtlebot_mocap_3_17/trial_3 OUT

Three computers wrote: a laptop the wheels' counts, a roboRIO the gyro, the cameras the poses, each
by its own clock. They are laid over each other by how fast the robot turns. The Kobuki sends its
counts every 20 ms, the laptop took one or three of these packets at a time: a row's counts are as
many packets after those of the row before as its counts tell, about the stamps of 1.5 s around.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from robots import WPI, WPI_MAP
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

WHEELBASE_M, PER_TICK_M = 0.23, 2 * np.pi * 0.0349955 / 2578
PACKET_S, AROUND_S, AT_REST_S = 0.02, 0.75, 0.1
SEVERAL = 20
"""Counts of both wheels in a packet from which on they tell how many packets came."""
BODY_RAD = 1.88
"""From the axis of the tracked body to the left to the way the robot goes."""


def main() -> None:
    """Convert one trial."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trial", type=Path, help="the folder of a trial")
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    counts = read(given.trial, "kobuki_data*.csv", 1)
    seconds, nanoseconds = counts[:, 2], counts[:, 3]
    stamp_s = seconds - seconds[0] + 1e-9 * (nanoseconds - nanoseconds[0])
    left, right = (np.unwrap(counts[:, place], period=65536) for place in (0, 1))
    rows, t_s = sampled_at(stamp_s, left, right)
    turn = (right - left)[rows] * PER_TICK_M / WHEELBASE_M
    rio = read(given.trial, "rio-data*.csv", 1)
    rio_s, gyro_rad_s = rio[:, -2] - rio[0, -2], np.deg2rad(rio[:, 5])
    angle = np.concatenate([[0.0], np.cumsum(gyro_rad_s[1:] * np.diff(rio_s))])
    angle = np.interp(t_s, rio_s + later_s(rio_s, angle, t_s, turn), angle)
    rate_rad_s = np.diff(angle) / np.diff(t_s)
    wheels = counts[rows, 0], counts[rows, 1]
    table = np.column_stack([t_s, *wheels, np.concatenate([rate_rad_s[:1], rate_rad_s])])
    names = "t_s,left_ticks,right_ticks,yaw_rad_s"
    layout = ["%.5f", "%d", "%d", "%.6f"]
    path = given.out / "table.csv"
    np.savetxt(path, table, layout, delimiter=",", header=names, comments="")
    poses = poses_of(given.trial)
    pose_s = 0.01 * poses[:, 0]
    turned = Rotation.from_rotvec(poses[:, 1:4]).apply([1.0, 0.0, 0.0])
    heading = np.unwrap(np.arctan2(turned[:, 1], turned[:, 0])) + BODY_RAD
    lines = np.zeros((len(poses), 8))
    lines[:, 0] = pose_s + later_s(pose_s, heading, t_s, turn)
    lines[:, 1:3] = 1e-3 * poses[:, 4:6]
    lines[:, 6], lines[:, 7] = np.sin(heading / 2), np.cos(heading / 2)
    np.savetxt(given.out / "reference.tum", lines, fmt="%.9f")
    (given.out / "robot.toml").write_text(WPI, encoding="utf-8")
    (given.out / "map.toml").write_text(WPI_MAP, encoding="utf-8")
    print(f"{given.out}: {len(table)} rows, {len(poses)} poses")


def read(trial: Path, name: str, skipped: int) -> Floats:
    """Return the numbers of a trial's file."""
    (path,) = trial.glob(name)
    return np.genfromtxt(path, delimiter=",", skip_header=skipped)


def poses_of(trial: Path) -> Floats:
    """Return number, axis times angle and place [mm] of the robot in each frame, float64[n, 7]."""
    (path,) = trial.glob("turtlebot_mocap*.csv")
    lines = path.read_text(encoding="utf-8").splitlines()
    column = next(k for k, name in enumerate(lines[2].split(",")) if "turtlebot" in name)
    cells = [line.split(",") for line in lines[5:]]
    known = [[one[0], *one[column : column + 6]] for one in cells if "" not in one[column:][:6]]
    return np.array([row for row in known if len(row) == 7], dtype=np.float64)


def sampled_at(stamp_s: Floats, left: Floats, right: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return rows with news, and those at rest, and when their counts were taken."""
    moved = np.abs(np.diff(left, prepend=left[0])) + np.abs(np.diff(right, prepend=right[0]))
    news = np.flatnonzero(np.concatenate([[True], moved[1:] > 0]))
    news_s, way = stamp_s[news], np.cumsum(moved)[news]
    grid_s = np.arange(0.0, stamp_s[-1], PACKET_S)
    rate = gaussian_filter1d(np.gradient(np.interp(grid_s, news_s, way)), 0.3 / PACKET_S)
    per_packet = np.interp(0.5 * (news_s[1:] + news_s[:-1]), grid_s, rate)
    told = np.maximum(np.rint(np.diff(way) / np.maximum(per_packet, 1e-9)), 1.0)
    packets = np.where(per_packet > SEVERAL, told, np.diff(news_s) / PACKET_S)
    even_s = PACKET_S * np.concatenate([[0.0], np.cumsum(packets)])
    nearness = np.exp(-0.5 * ((news_s[:, np.newaxis] - news_s) / AROUND_S) ** 2)
    taken_s = even_s + nearness @ (news_s - even_s) / nearness.sum(axis=1)
    rest = np.setdiff1d(np.arange(len(stamp_s)), news)
    at = np.clip(np.searchsorted(news_s, stamp_s[rest]), 1, len(news_s) - 1)
    away_s = np.minimum(np.abs(news_s[at] - stamp_s[rest]), np.abs(stamp_s[rest] - news_s[at - 1]))
    rest = rest[away_s > AT_REST_S]
    rows, t_s = np.concatenate([news, rest]), np.concatenate([taken_s, stamp_s[rest]])
    order = np.argsort(t_s)
    rows, t_s = rows[order], t_s[order]
    apart = np.concatenate([[True], np.diff(t_s) > 1e-3])
    return rows[apart], t_s[apart] - t_s[0]


def later_s(other_s: Floats, angle: Floats, t_s: Floats, turn: Floats) -> float:
    """Return by how much a clock must be put forward for its turns to be those of the wheels."""
    grid_s = np.arange(t_s[0] + 2.0, min(t_s[-1], other_s[-1]) - 2.0, 0.05)
    wheels = np.gradient(np.interp(grid_s, t_s, turn))

    def unlike(shift_s: float) -> float:
        own = np.gradient(np.interp(grid_s, other_s + shift_s, angle))
        return float(np.mean((own - wheels) ** 2))

    coarse = min(np.arange(-2.0, 2.0, 0.02), key=unlike)
    return float(min(coarse + np.arange(-0.02, 0.02, 0.002), key=unlike))


if __name__ == "__main__":
    main()
