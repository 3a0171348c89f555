"""The converters on small made-up recordings of the same layout, and on the real ones if given.

    CHIPLOG_RECORDINGS=FOLDER pytest examples/recordings

FOLDER holds `kobuki/NAME/*.csv.gz`, `plaza_lawnmower/Plaza1_DR.txt`, …, a `global_pose` below
`comma2k19`, `optiodom/*_run-NN.csv`, `chemnitz/*_Input.txt`, `labyrinth/Indoor_UWB_Input.txt`,
`smartloc/*_Input.txt` and `wpi/trial_N/*.csv`, as they are published.
"""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from scipy.io import savemat

from gap_diagnosis.reading import read_recording
from gap_diagnosis.recording import Recording
from hil_harness import load_robot

HERE = Path(__file__).parent
RECORDINGS = Path(os.environ.get("CHIPLOG_RECORDINGS", HERE / "none"))
KOBUKI = sorted(path.parent for path in RECORDINGS.glob("kobuki/*/_odom.csv.gz"))
PLAZA = sorted(RECORDINGS.glob("plaza_lawnmower/*_DR.txt"))
OPTITRACK = sorted(RECORDINGS.glob("optiodom/**/*_run-[0-9][0-9].csv"))
CARS = sorted(path.parent for path in RECORDINGS.glob("comma2k19/**/global_pose"))
CHEMNITZ = sorted(RECORDINGS.glob("chemnitz/*_Input.txt"))
LABYRINTH = [
    path.with_name(path.name.removesuffix("_Input.txt"))
    for path in RECORDINGS.glob("labyrinth/*_Input.txt")
]
TRIALS = sorted(RECORDINGS.glob("wpi/trial_*"))
CITIES = [
    path.with_name(path.name.removesuffix("_Input.txt"))
    for path in sorted(RECORDINGS.glob("smartloc/*_Input.txt"))
]
NS = 10**9
START = 1_494_449_908 * NS


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Real recordings, where there are any, are further cases beside the made-up one."""
    if "kobuki" in metafunc.fixturenames:
        metafunc.parametrize(
            "kobuki", [None, *KOBUKI], ids=lambda p: "made up" if p is None else p.name
        )
    if "car" in metafunc.fixturenames:
        metafunc.parametrize("car", [None, *CARS], ids=lambda p: "made up" if p is None else p.name)
    if "run" in metafunc.fixturenames:
        metafunc.parametrize(
            "run", [None, *OPTITRACK], ids=lambda p: "made up" if p is None else p.stem
        )
    if "drive" in metafunc.fixturenames:
        metafunc.parametrize(
            "drive", [None, *CHEMNITZ], ids=lambda p: "made up" if p is None else p.stem
        )
    for name, real in (("labyrinth", LABYRINTH), ("city", CITIES), ("trial", TRIALS)):
        if name in metafunc.fixturenames:
            metafunc.parametrize(
                name, [None, *real], ids=lambda p: "made up" if p is None else p.name
            )
    if "plaza" in metafunc.fixturenames:
        metafunc.parametrize(
            "plaza", [None, *PLAZA], ids=lambda p: "made up" if p is None else p.stem
        )


def write(folder: Path, topic: str, header: str, rows: list[tuple[object, ...]]) -> None:
    lines = [header, *(",".join(map(str, row)) for row in rows)]
    with gzip.open(folder / f"{topic}.csv.gz", "wt") as file:
        file.write("\n".join(lines) + "\n")


def made_up_kobuki(folder: Path) -> Path:
    """Forty seconds of turning; the robot's clock is 1200 ppm slow, two frames are lost."""
    folder.mkdir()
    random = np.random.default_rng(0)
    tick = np.delete(np.arange(2000), [700, 701])
    stamp = START + (tick * 0.02 * 1.0012 * NS + random.exponential(5e5, len(tick))).astype(int)
    wheel = (tick * 10, tick * 30)
    write(
        folder,
        "_mobile_base_sensors_core",
        "%time,field.header.stamp,field.time_stamp,field.left_encoder,field.right_encoder",
        [
            (s, s, (60_000 + k * 20) % 65_536, (65_000 + a) % 65_536, b % 65_536)
            for s, k, a, b in zip(stamp, tick.tolist(), *map(np.ndarray.tolist, wheel), strict=True)
        ],
    )
    gyro = START + np.arange(4000) * NS // 100
    write(
        folder,
        "_mobile_base_sensors_imu_data_raw",
        "%time,field.header.stamp,field.angular_velocity.z",
        [(s, s, 0.37) for s in gyro],
    )
    write(
        folder,
        "_mobile_base_commands_velocity",
        "%time,field.linear.x,field.angular.z",
        [(START + k * NS // 10, 0.08, 0.37) for k in range(300)],
    )
    write(
        folder,
        "_odom",
        "%time,field.header.stamp,field.pose.pose.position.x,field.pose.pose.position.y,"
        "field.pose.pose.orientation.z,field.pose.pose.orientation.w",
        [(s, s, 0, 0, np.sin(k / 400), np.cos(k / 400)) for k, s in enumerate(stamp)],
    )
    return folder


def convert(script: str, recording: Path, out: Path, *options: str) -> None:
    command = [sys.executable, HERE / script, recording, out, *options]
    subprocess.run(command, check=True, timeout=120)


def read_folder(folder: Path, reference: str = "reference") -> Recording:
    return read_recording(
        folder / "table.csv",
        robot=load_robot(folder / "robot.toml"),
        signals=folder / "map.toml",
        reference=folder / f"{reference}.tum",
    )


def test_a_kobuki_is_read_with_its_clock_its_gaps_and_its_gyro(
    kobuki: Path | None, tmp_path: Path
) -> None:
    folder = kobuki or made_up_kobuki(tmp_path / "recording")
    convert("kobuki_table.py", folder, tmp_path / "out")
    robot = load_robot(tmp_path / "out" / "robot.toml")
    found = read_recording(tmp_path / "out" / "table.csv", robot=robot)
    assert found.tick_period_s == pytest.approx(0.02)
    assert -1400e-6 < found.clock_skew < -950e-6
    lost = np.flatnonzero(np.isnan(found.left_ticks))
    assert len(lost) % 2 == 0
    assert np.all(np.diff(lost)[::2] == 1)  # always two in a row
    assert found.gyro_rate_rad_s is not None
    turned = np.nansum(found.gyro_rate_rad_s) * found.tick_period_s
    wheels = (found.right_ticks - found.left_ticks)[-1] * 2 * np.pi / 2578 * 0.0349955 / 0.230
    assert turned == pytest.approx(wheels, abs=0.1 * abs(wheels) + 1.0)
    assert found.odometry_heading_rad is not None
    assert found.w_command_rad_s is not None


def test_a_lawnmower_is_read_with_its_gps(plaza: Path | None, tmp_path: Path) -> None:
    if plaza is None:
        t_s = 3000 + np.cumsum(np.random.default_rng(0).uniform(0.18, 0.22, 600))
        np.savetxt(tmp_path / "Plaza0_DR.txt", np.stack([t_s, t_s * 0 + 0.2, t_s * 0 + 0.01], 1))
        angle = np.arange(601) * 0.01
        gps = np.stack(
            [np.append(t_s[0] - 0.2, t_s), 20 * np.sin(angle), 20 * (1 - np.cos(angle)), angle], 1
        )
        savemat(tmp_path / "Plaza0_.mat", {"GT": gps})
        plaza = tmp_path / "Plaza0_DR.txt"
    recording = Path(str(plaza).removesuffix("_DR.txt"))
    convert("lawnmower_table.py", recording, tmp_path / "out")
    out = tmp_path / "out"
    found = read_folder(out)
    assert found.reference is not None
    assert found.reference.heading_rad is None  # positions only
    metres = (found.left_ticks + found.right_ticks)[-1] / 2 / 60_000 * 2 * np.pi * 0.1
    increments = np.loadtxt(plaza)[1:, 1]
    assert metres == pytest.approx(np.sum(increments), rel=1e-6)
    convert("lawnmower_table.py", recording, tmp_path / "off", "--left", "1.02")
    rows, off = (
        np.loadtxt(tmp_path / name / "table.csv", delimiter=",", skiprows=1)
        for name in ("out", "off")
    )
    assert off == pytest.approx(rows * [1.0, 1.02, 1.0], rel=1e-9, abs=2e-9)


def made_up_car(folder: Path) -> Path:
    """Ten seconds to the north at 20 m/s by the rear wheels, by a phone that reads 0.07 rad/s."""

    def save(name: str, array: np.ndarray) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:  # as published: NumPy's format without its suffix
            np.save(file, array)

    wheel_s, gyro_s, fix_s = (100.0 + np.arange(0, 10, step) for step in (0.012, 0.01, 0.1))
    save("processed_log/CAN/wheel_speed/t", wheel_s)
    save("processed_log/CAN/wheel_speed/value", np.full((len(wheel_s), 4), [3.0, 4.0, 20.0, 20.1]))
    save("processed_log/IMU/gyro_uncalibrated/t", gyro_s)
    save("processed_log/IMU/gyro_uncalibrated/value", np.full((len(gyro_s), 3), [1.0, 2.0, 0.07]))
    north_deg = 37.7 + (fix_s - 100.0) * 20.0 / 111_000.0
    east_deg = np.full(len(fix_s), -122.5)
    save("processed_log/GNSS/live_gnss_ublox/t", fix_s)
    save("processed_log/GNSS/live_gnss_ublox/value", np.stack([north_deg, east_deg], axis=1))
    save("global_pose/frame_times", fix_s)
    places_m = pymap3d.geodetic2ecef(north_deg, east_deg, np.zeros(len(fix_s)))
    save("global_pose/frame_positions", np.stack(places_m, axis=1))
    return folder


@pytest.mark.parametrize("name", ["reference", "fixes"])
def test_a_car_is_read_with_its_wheels_a_phone_and_a_gps(
    car: Path | None, name: str, tmp_path: Path
) -> None:
    convert("car_table.py", car or made_up_car(tmp_path / "recording"), tmp_path / "out")
    out = tmp_path / "out"
    found = read_folder(out, name)
    assert found.reference is not None
    assert found.gyro_rate_rad_s is not None
    assert np.nanmean(found.gyro_rate_rad_s) == pytest.approx(-0.07, abs=0.005)
    way = np.hypot(np.diff(found.reference.x_m), np.diff(found.reference.y_m)).sum()
    metres = (found.left_ticks + found.right_ticks)[-1] / 2 / 4096 * 2 * np.pi * 0.316
    assert way == pytest.approx(metres, rel=0.03)
    if car is None:
        assert found.right_ticks[-1] == pytest.approx(1.005 * found.left_ticks[-1])


def made_up_run(path: Path) -> Path:
    """Ten seconds of a circle to the left, 1 m across."""
    t_s = np.arange(0, 10, 0.05)
    heading = 0.4 * t_s
    left, right = (
        np.diff(np.rint(heading * (0.5 + side * 0.1) / (0.084 * np.pi) * 2796.8), prepend=0.0)
        for side in (-1.0, 1.0)
    )
    place = 0.5 * np.sin(heading), 0.5 * (1.0 - np.cos(heading))
    np.savetxt(path, np.stack([t_s, *place, heading, right, left], axis=1), delimiter=",")
    return path


def test_a_robot_under_optitrack_turns_as_its_wheels_do(run: Path | None, tmp_path: Path) -> None:
    convert("optitrack_table.py", run or made_up_run(tmp_path / "run.csv"), tmp_path / "out")
    out = tmp_path / "out"
    found = read_recording(
        out / "table.csv", robot=load_robot(out / "robot.toml"), reference=out / "reference.tum"
    )
    assert found.reference is not None
    assert found.reference.heading_rad is not None
    turned = np.ptp(found.reference.heading_rad)
    per_tick_m = 2 * np.pi * 0.042003 / 2797
    wheels = np.ptp(found.right_ticks - found.left_ticks) * per_tick_m / 0.2
    assert turned == pytest.approx(wheels, rel=0.05)


def made_up_drive(path: Path) -> Path:
    """A minute of turns to and fro at half a metre a second, seen once in two seconds and told ten
    times."""
    t_s = np.arange(600) * 0.1
    turn_rad_s = 0.3 * np.cos(0.2 * t_s)
    heading = 1.5 * np.sin(0.2 * t_s)
    lines = [
        f"odom2 {t} 0.5 0 {w} 0.0025 0.0025 0.0001" for t, w in zip(t_s, turn_rad_s, strict=True)
    ]
    path.write_text("\n".join(["loop 0 30 0.5", *lines]), encoding="utf-8")
    seen = slice(None, None, 20)
    x_m, y_m = (np.cumsum(0.05 * one(heading)) for one in (np.cos, np.sin))
    told_s = t_s[::2]
    places = (np.interp(told_s, t_s[seen], one[seen]) for one in (x_m, y_m))
    told = [f"point2 {t} {x} {y} 0 0 0 0" for t, x, y in zip(told_s, *places, strict=True)]
    path.with_name("Hall_GT.txt").write_text("\n".join(told), encoding="utf-8")
    return path


def test_a_robot_of_chemnitz_is_read_with_what_its_laser_measured(
    drive: Path | None, tmp_path: Path
) -> None:
    recording = drive or made_up_drive(tmp_path / "Hall_Input.txt")
    name = str(recording).removesuffix("_Input.txt")
    out = tmp_path / "out"
    convert("chemnitz_table.py", Path(name), out, "--end", "240")
    found = read_folder(out)
    assert found.reference is not None
    told = np.loadtxt(out / "reference.tum")
    assert len(found.reference.t_s) < 0.2 * len(told)
    assert any("on straight lines" in note for note in found.notes)
    off = tmp_path / "off"
    convert("chemnitz_table.py", Path(name), off, "--begin", "30", "--end", "60", "--left", "1.02")
    rows, moved = (
        np.loadtxt(folder / "table.csv", delimiter=",", skiprows=1) for folder in (out, off)
    )
    part = rows[(rows[:, 0] >= 30.0) & (rows[:, 0] < 60.0)] - [30.0, 0.0, 0.0]
    assert moved == pytest.approx(part * [1.0, 1.02, 1.0], rel=1e-6, abs=2e-9)


def made_up_labyrinth(path: Path) -> Path:
    """Ten seconds of a turn to the left, the right wheel before the left one in each line."""
    t_s = np.arange(80) * 0.128
    lines = [f"odom2diff {t} 0.4 0.3 0 0.0785 0.0001 0.0001 0.0001" for t in t_s]
    path.write_text("\n".join(["range2 0 4.8 0.01 0 0 1 0", *lines]), encoding="utf-8")
    heading = 0.1 / 0.0785 * t_s
    x_m, y_m = 0.275 * np.sin(heading), -0.275 * np.cos(heading)
    places = [f"point2 {t} {x} {y} 0 0 0 0" for t, x, y in zip(t_s, x_m, y_m, strict=True)]
    path.with_name("Maze_GT.txt").write_text("\n".join(places), encoding="utf-8")
    return path.with_name("Maze")


def test_the_wheels_of_the_labyrinth_are_read_in_either_order(
    labyrinth: Path | None, tmp_path: Path
) -> None:
    name = labyrinth or made_up_labyrinth(tmp_path / "Maze_Input.txt")
    convert("labyrinth_table.py", name, tmp_path / "told")
    convert("labyrinth_table.py", name, tmp_path / "exchanged", "--exchanged")
    told, exchanged = (read_folder(tmp_path / one) for one in ("told", "exchanged"))
    np.testing.assert_array_equal(told.left_ticks, exchanged.right_ticks)
    assert told.reference is not None
    assert told.reference.heading_rad is None
    if labyrinth is None:
        assert told.right_ticks[-1] == pytest.approx(4 / 3 * told.left_ticks[-1], rel=1e-3)


def made_up_city(path: Path) -> Path:
    """Forty seconds at 8 m/s to the north, then 20 s of a turn to the left."""
    t_s = np.arange(300) * 0.2
    turn_rad_s = np.where(t_s > 40.0, 0.1, 0.0)
    heading = np.pi / 2 + 0.2 * np.cumsum(turn_rad_s)
    lines = [f"odom3 {t} 8 0 0 0 0 {w} 1 1 1 1 1 1" for t, w in zip(t_s, turn_rad_s, strict=True)]
    path.write_text("\n".join(lines), encoding="utf-8")
    east_m, north_m = (np.cumsum(1.6 * one(heading)) for one in (np.cos, np.sin))
    places = pymap3d.enu2ecef(east_m, north_m, np.zeros(len(t_s)), 52.5, 13.4, 40.0)
    told = [f"point3 {' '.join(map(str, one))}" for one in zip(t_s, *places, strict=True)]
    path.with_name("City_GT.txt").write_text("\n".join(told), encoding="utf-8")
    return path.with_name("City")


def test_a_car_in_berlin_goes_as_far_as_its_wheels(city: Path | None, tmp_path: Path) -> None:
    name = city or made_up_city(tmp_path / "City_Input.txt")
    convert("berlin_table.py", name, tmp_path / "out", "--begin", "10")
    found = read_folder(tmp_path / "out")
    assert found.reference is not None
    way_m = np.hypot(np.diff(found.reference.x_m), np.diff(found.reference.y_m)).sum()
    per_tick_m = 2 * np.pi * 0.3 / 4096
    left, right = (one[np.isfinite(one)] for one in (found.left_ticks, found.right_ticks))
    assert way_m == pytest.approx(0.5 * np.ptp(left + right) * per_tick_m, rel=0.05)
    if city is None:
        turned = np.ptp(right - left) * per_tick_m / 1.5
        assert turned == pytest.approx(2.0, abs=0.1)


def made_up_trial(folder: Path) -> Path:
    """Forty seconds of turns to and fro: packets of 20 ms, one or three of them at a time, a gyro
    that begins 0.3 s and cameras that begin 0.2 s later than the wheels."""
    folder.mkdir()
    t_s = np.arange(2000) * 0.02
    rate = 0.6 * np.sin(0.5 * t_s) * (t_s > 1.0)
    heading = 0.02 * np.cumsum(rate)
    way = 0.02 * np.cumsum(0.2 * (t_s > 1.0))
    per_tick_m = 2 * np.pi * 0.0349955 / 2578
    left, right = (np.rint((way + side * 0.115 * heading) / per_tick_m) for side in (-1.0, 1.0))
    taken = np.cumsum(np.tile([1, 3], 500)) - 1
    stamp_s = 0.04 * np.arange(len(taken)) + 0.003
    counts = np.stack([left[taken] % 65536, right[taken] % 65536, 1e9 + stamp_s // 1], axis=1)
    rows = np.column_stack([counts, np.rint(stamp_s % 1 * 1e9)])
    names = "left_ticks,right_ticks,time_s,time_ns"
    path = folder / "kobuki_data_1.csv"
    np.savetxt(path, rows, "%.0f", delimiter=",", header=names, comments="")
    rio_s = np.arange(3600) * 0.01
    rio = np.zeros((len(rio_s), 19))
    rio[:, 5], rio[:, -2] = np.rad2deg(np.interp(rio_s + 0.3, t_s, rate)), 77.0 + rio_s
    np.savetxt(folder / "rio-data-77.csv", rio, delimiter=",", header="columns", comments="")
    seen_s = np.arange(3600) * 0.01
    turned = np.interp(seen_s + 0.2, t_s, heading) - 1.88
    x_m, y_m = (np.cumsum(0.002 * one(np.interp(seen_s, t_s, heading))) for one in (np.cos, np.sin))
    poses = [
        f"{k},0,,,,,,,0,0,{one},{1e3 * x},{1e3 * y},120"
        for k, (one, x, y) in enumerate(zip(turned, x_m, y_m, strict=True))
    ]
    head = ["Objects", "100", ",,tag:tag,,,,,,phil_turtlebot:phil_turtlebot", "Frame", ",,rad"]
    (folder / "turtlebot_mocap 1.csv").write_text("\n".join([*head, *poses]), encoding="utf-8")
    return folder


def test_three_computers_of_a_trial_turn_at_the_same_time(
    trial: Path | None, tmp_path: Path
) -> None:
    convert("wpi_table.py", trial or made_up_trial(tmp_path / "trial"), tmp_path / "out")
    found = read_folder(tmp_path / "out")
    assert found.reference is not None
    assert found.reference.heading_rad is not None
    t_s, left, right, rate = np.loadtxt(tmp_path / "out/table.csv", delimiter=",", skiprows=1).T
    counts = np.unwrap(right, period=65536) - np.unwrap(left, period=65536)
    turned = counts * 2 * np.pi * 0.0349955 / 2578 / 0.23
    there = (t_s > 3.0) & (t_s < found.reference.t_s[-1] - 3.0)
    by_cameras = np.interp(t_s, found.reference.t_s, found.reference.heading_rad)
    by_gyro = np.cumsum(rate * np.diff(t_s, prepend=0.0))
    for angle in (by_cameras, by_gyro):
        line = np.polyfit(turned[there], angle[there], 1)
        assert line[0] == pytest.approx(1.0, abs=0.05)
        off = angle[there] - np.polyval(line, turned[there])
        assert off.std() < (0.005 if trial is None else 0.1)
