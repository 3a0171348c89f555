"""Independent clients on the bus: can-utils and cantools hear what we say and we what they say."""

from __future__ import annotations

import fcntl
import io
import os
import re
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import cantools_command
import pytest
from on_vcan import VCAN_ENV
from other_processes import Command
from vcan_tools import GENEROUS_S, encoder_frames, listeners, wait_for_listener

from can_bus import (
    FrameChecker,
    load_database,
    make_message,
    open_bus,
    open_log_writer,
    read_log,
    shipped_path,
)

pytestmark = pytest.mark.vcan

DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")


@pytest.fixture
def channel() -> str:
    return os.environ[VCAN_ENV]


@contextmanager
def started(command: list[str], channel: str) -> Iterator[subprocess.Popen[str]]:
    """Start a program that listens on the bus, and wait until it does."""
    before = listeners(channel)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        wait_for_listener(channel, before)
        yield process


def encoder_messages(count: int) -> list[can.Message]:
    data = encoder_frames(DATABASE, count)
    return [make_message(ENCODER, bytearray(one), tick * 10_000) for tick, one in enumerate(data)]


def test_candump_hears_what_we_send(channel: str) -> None:
    sent = [
        *encoder_messages(20),
        can.Message(arbitration_id=0x18FEF1FE, is_extended_id=True, data=b"\x01\x02"),
        can.Message(arbitration_id=0x55, is_extended_id=False, is_remote_frame=True),
    ]
    command = ["candump", "-L", "-n", str(len(sent)), channel]
    with open_bus("socketcan", channel) as bus, started(command, channel) as candump:
        for message in sent:
            bus.send(message)
        said, _ = candump.communicate()
    frames = [line.split()[2] for line in said.splitlines()]
    assert frames == [
        *(f"0C1#{data.hex().upper()}" for data in encoder_frames(DATABASE, 20)),
        "18FEF1FE#0102",
        "055#R",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0C1#1122334455667788", (0xC1, False, False, "1122334455667788")),
        ("18FEF1FE#AB", (0x18FEF1FE, True, False, "ab")),
        ("7FF#", (0x7FF, False, False, "")),
        ("055#R3", (0x55, False, True, "")),
    ],
)
def test_we_hear_what_cansend_sends(
    channel: str, text: str, expected: tuple[int, bool, bool, str]
) -> None:
    with open_bus("socketcan", channel) as bus:
        subprocess.run(["cansend", channel, text], check=True)
        received = bus.recv(GENEROUS_S)
    assert received is not None
    assert (
        received.arbitration_id,
        received.is_extended_id,
        received.is_remote_frame,
        received.data.hex(),
    ) == expected


@pytest.mark.vcan(size="full")
def test_canplayer_replays_our_log_frame_by_frame(channel: str, tmp_path: Path) -> None:
    path = tmp_path / "ours.log"
    sent = encoder_messages(200)
    with open_log_writer(path) as log:
        for message in sent:
            log.write(message, True)
    recorded = {line.split()[1] for line in path.read_text().splitlines()}
    (name,) = recorded
    checker = FrameChecker(DATABASE, ["ENCODER"], max_age_us=10**9)
    with open_bus("socketcan", channel) as bus:
        subprocess.run(["canplayer", "-t", "-I", path, f"{channel}={name}"], check=True)
        for expected in sent:
            received = bus.recv(GENEROUS_S)
            assert received is not None
            assert received.data == expected.data
            assert checker.check(received, round(received.timestamp * 1e6)) is not None
    assert sum(checker.rejected.values()) == 0


@pytest.mark.vcan(size="full")
def test_whatever_cangen_makes_we_hear_as_candump_does(channel: str, tmp_path: Path) -> None:
    count = 300
    checker = FrameChecker(DATABASE, ["ENCODER", "IMU"], max_age_us=10**9)
    heard = []
    command = ["candump", "-L", "-n", str(count), channel]
    with (
        open_bus("socketcan", channel, bus_args={"fd": "True"}) as bus,
        started(command, channel) as candump,
    ):
        with subprocess.Popen(["cangen", channel, "-g", "1", "-m", "-R", "-n", str(count)]):
            for _ in range(count):
                received = bus.recv(GENEROUS_S)
                assert received is not None
                heard.append(received)
                checker.check(received, round(received.timestamp * 1e6))
        said, _ = candump.communicate()
    (tmp_path / "theirs.log").write_text(said)
    for ours, theirs in zip(heard, read_log(tmp_path / "theirs.log"), strict=True):
        assert theirs.equals(
            ours, timestamp_delta=1e-3, check_channel=False, check_direction=False
        ), (ours, theirs)
    assert len({(one.is_extended_id, one.is_remote_frame) for one in heard}) >= 2


@pytest.mark.vcan(size="full")
def test_cantools_decodes_what_candump_hears_with_our_dbc(
    channel: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["candump", "-n", "3", channel]
    with open_bus("socketcan", channel) as bus, started(command, channel) as candump:
        for message in encoder_messages(3):
            bus.send(message)
        dump, _ = candump.communicate()
    monkeypatch.setattr(sys, "argv", ["cantools", "decode", "--single-line", str(shipped_path())])
    monkeypatch.setattr(sys, "stdin", io.StringIO(dump))
    cantools_command.main()
    decoded = capsys.readouterr().out
    counts = re.findall(r"ENCODER\(.*left_count: (\d+).*right_count: (\d+)", decoded)
    assert counts == [("0", "0"), ("7", "5"), ("14", "10")]


@pytest.mark.vcan(size="full")
def test_cantools_monitor_shows_our_signals(channel: str, tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 120, 0, 0))
    arguments = ["cantools", "monitor", "--interface", "socketcan", "--channel", channel]
    os.set_blocking(ours, False)
    screen = b""
    with (
        open_bus("socketcan", channel) as bus,
        Command(
            "cantools_command:main",
            [*arguments, str(shipped_path())],
            tmp_path / "monitor",
            terminal=os.ttyname(theirs),
        ) as monitor,
    ):
        message = encoder_messages(3)[2]

        def has_shown_it() -> bool:
            nonlocal screen
            bus.send(message)
            time.sleep(0.1)
            with suppress(BlockingIOError):
                screen += os.read(ours, 1 << 16)
            return b"left_count: 14" in screen and b"right_count: 10" in screen

        monitor.until(has_shown_it)
        os.write(ours, b"q")
        assert monitor.wait() == 0
    for descriptor in (ours, theirs):
        os.close(descriptor)
