"""Plant and firmware as two processes of `chiplog node` on an interface of a real kernel.

What becomes of them when one is killed is told in tests/hil_harness/test_nodes_restarted.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from on_vcan import VCAN_ENV
from other_processes import chiplog

from can_bus import FrameChecker, load_database, read_log, timestamp_us

pytestmark = pytest.mark.vcan(size="full")

PLANT_TICKS, FIRMWARE_TICKS = 300, 200
TICK_S = 0.01


def test_a_plant_and_a_firmware_close_the_loop(tmp_path: Path) -> None:
    database = load_database()
    bus = ("--interface", "socketcan", "--channel", os.environ[VCAN_ENV])

    def options(name: str, ticks: int) -> tuple[str, ...]:
        files = ("--log", str(tmp_path / f"{name}.log"), "--json", str(tmp_path / f"{name}.json"))
        return ("node", name, *bus, *files, "--duration-s", str(ticks * TICK_S))

    with chiplog(
        *options("firmware", FIRMWARE_TICKS), "--kernel", "python", folder=tmp_path / "1"
    ) as firmware:
        firmware.until(lambda: "waiting for the first sensor frame" in firmware.stdout)
        with chiplog(*options("plant", PLANT_TICKS), folder=tmp_path / "2") as plant:
            assert firmware.wait() == 0, firmware.stderr
            assert plant.wait() == 0, plant.stderr
    for name, ticks in (("plant", PLANT_TICKS), ("firmware", FIRMWARE_TICKS)):
        summary = json.loads((tmp_path / f"{name}.json").read_text())
        assert summary["ticks"] == ticks
        jitter_us = summary["timing"]["jitter_us"]
        assert 0 <= jitter_us["p50"] <= jitter_us["p99"] <= jitter_us["max"]
    # Each recorded what the other said, and it was good: the robot drives, and the ECU knows.
    for name, spoken, signal in (
        ("firmware", "ENCODER", "left_count"),
        ("plant", "ODOMETRY_X", "x_m"),
    ):
        checker = FrameChecker(database, [spoken], max_age_us=0)
        found = [
            checker.check(one, timestamp_us(one)) for one in read_log(tmp_path / f"{name}.log")
        ]
        values = [one.raw[signal] for one in found if one is not None]
        assert values
        # How many is up to how busy this machine is: one, where something else has it.
        assert len(values) == 1 or values[0] != values[-1]
