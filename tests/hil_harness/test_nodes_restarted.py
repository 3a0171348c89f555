"""Plant and firmware as processes: one is killed, the other notices, says so, and goes on.

The same story on UDP multicast and on a SocketCAN interface of a real kernel.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from on_vcan import VCAN_ENV
from other_processes import Command, chiplog, under_way

from can_bus import load_database, read_log

_LONG = ("--duration-s", "3600")


@dataclass
class Story:
    """What was said and written by the four processes of the story."""

    folder: Path
    stderr: dict[str, str] = field(default_factory=dict)
    stdout: dict[str, str] = field(default_factory=dict)
    status: dict[str, int | None] = field(default_factory=dict)

    def outages(self, name: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.summary(name)["timing"]["outages"]
        return found

    def summary(self, name: str) -> dict[str, Any]:
        summary: dict[str, Any] = json.loads((self.folder / f"{name}.json").read_text())
        return summary


@pytest.fixture(
    scope="module",
    params=["udp_multicast", pytest.param("socketcan", marks=pytest.mark.vcan(size="full"))],
)
def story(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Story:
    """Kill the plant and start it again; kill the firmware and start it again; stop both."""
    folder = tmp_path_factory.mktemp("story")
    interface: str = request.param
    group = f"239.76.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF or 1}"
    channel = os.environ[VCAN_ENV] if interface == "socketcan" else group
    told = Story(folder)
    with ExitStack() as stack:

        def start(role: str, name: str, *options: str) -> Command:
            files = ("--log", str(folder / f"{name}.log"), "--json", str(folder / f"{name}.json"))
            bus = ("--interface", interface, "--channel", channel)
            arguments = ("node", role, *bus, *files, *options)
            return stack.enter_context(chiplog(*arguments, folder=folder / name))

        def grown(name: str) -> Callable[[], bool]:
            return under_way(folder / f"{name}.log")

        firmware = start("firmware", "firmware", "--kernel", "python")
        firmware.until(lambda: "waiting for the first sensor frame" in firmware.stdout)
        plant = start("plant", "plant", *_LONG)
        firmware.until(grown("firmware"))
        plant.kill()
        firmware.until(lambda: "plant: silent since" in firmware.stderr)
        plant_again = start("plant", "plant again", *_LONG)
        firmware.until(lambda: "plant: back at" in firmware.stderr)
        plant_again.until(grown("plant again"))
        firmware.kill()
        plant_again.until(lambda: "firmware: silent since" in plant_again.stderr)
        firmware_again = start("firmware", "firmware again", "--kernel", "python")
        plant_again.until(lambda: "firmware: back at" in plant_again.stderr)
        firmware_again.until(grown("firmware again"))
        told.status["plant again"] = plant_again.stop()
        told.status["firmware again"] = firmware_again.stop()
        for name, process in (
            ("firmware", firmware),
            ("plant again", plant_again),
            ("firmware again", firmware_again),
        ):
            told.stderr[name] = process.stderr
            told.stdout[name] = process.stdout
    return told


def lines(text: str) -> Iterator[str]:
    for line in text.splitlines():
        assert line.startswith("chiplog: ")
        yield line.removeprefix("chiplog: ")


def test_a_killed_plant_is_noticed_by_the_firmware_and_picked_up_again(story: Story) -> None:
    said = list(lines(story.stderr["firmware"]))
    assert said[0].startswith("plant: silent since ")
    assert said[1].startswith("plant: back at ")
    spec = load_database().message("ENCODER")
    data = [m.data for m in read_log(story.folder / "firmware.log") if m.arbitration_id == 193]
    starts = [row for row, frame in enumerate(data) if spec.unpack(frame)[:2] == (0, 0)]
    assert max(starts) > min(starts), "the log holds the frames of both plants"


def test_a_killed_firmware_is_noticed_by_the_plant_and_picked_up_again(story: Story) -> None:
    said = list(lines(story.stderr["plant again"]))
    assert any(line.startswith("firmware: silent since ") for line in said)
    assert said[-1].startswith("interrupted after ")
    back = [one for one in story.outages("plant again") if one["stop_s"] is not None]
    assert back
    assert all(one["node"] == "firmware" for one in back)
    assert all(0 < one["start_s"] < one["stop_s"] for one in back)


def test_both_end_with_a_summary_of_their_timing(story: Story) -> None:
    for name in ("plant again", "firmware again"):
        assert story.status[name] == 130
        summary = story.summary(name)
        assert summary["role"] == name.removesuffix(" again")
        assert summary["interrupted"] is True
        jitter_us = summary["timing"]["jitter_us"]
        assert 0 <= jitter_us["p50"] <= jitter_us["p99"] <= jitter_us["max"]
        assert summary["timing"]["missed_deadlines"] <= summary["ticks"]
        assert summary["timing"]["unsent_frames"] == 0
        sentence = story.stdout[name].splitlines()[-1]
        assert f"{jitter_us['p99']:.0f} µs (99 %)" in sentence
        print(f"{name}: {sentence}")  # shown with pytest -rP: how well this machine keeps time


def test_the_restarted_firmware_hears_every_kind_of_sensor_frame(story: Story) -> None:
    heard = {m.arbitration_id for m in read_log(story.folder / "firmware again.log")}
    database = load_database()
    names = ("ENCODER", "IMU", "ODOMETRY_X", "ODOMETRY_HEADING")
    assert {database.message(name).frame_id for name in names} <= heard
