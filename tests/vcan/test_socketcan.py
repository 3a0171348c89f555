"""What SocketCAN alone can do, on an interface of a real kernel; the contract is test_buses."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from on_vcan import VCAN_ENV
from vcan_tools import GENEROUS_S, listeners

from can_bus import (
    BusFullError,
    CanBusError,
    FrameChecker,
    load_database,
    make_message,
    open_bus,
    open_log_writer,
    read_log,
)

pytestmark = pytest.mark.vcan

SILENCE_S = 0.05
DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")


@pytest.fixture
def channel() -> str:
    return os.environ[VCAN_ENV]


@pytest.fixture
def other_channel() -> Iterator[str]:
    """Make a second interface, for tests that take it down."""
    name = "vcan7"
    ip("link", "add", "dev", name, "type", "vcan")
    ip("link", "set", "up", name)
    yield name
    ip("link", "del", name)


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


def encoder(left: int) -> can.Message:
    return make_message(ENCODER, ENCODER.pack((left, 0), 0), 0)


def error_frame() -> can.Message:
    """Return "no acknowledgement" (CAN_ERR_ACK), as a controller reports it."""
    return can.Message(arbitration_id=0x20, is_extended_id=False, is_error_frame=True, dlc=8)


def test_a_handle_hears_itself_where_that_is_asked_for(channel: str) -> None:
    own = {"receive_own_messages": "True"}
    with open_bus("socketcan", channel, bus_args=own) as bus:
        bus.send(encoder(3))
        received = bus.recv(GENEROUS_S)
        assert received is not None
        assert ENCODER.unpack(received.data)[0] == 3
        assert not received.is_rx


def test_without_loopback_nobody_on_this_host_hears(channel: str) -> None:
    with (
        open_bus("socketcan", channel, bus_args={"local_loopback": "False"}) as mute,
        open_bus("socketcan", channel) as loud,
        open_bus("socketcan", channel) as listener,
    ):
        mute.send(encoder(1))
        loud.send(encoder(2))
        received = listener.recv(GENEROUS_S)
        assert received is not None
        assert ENCODER.unpack(received.data)[0] == 2


def test_filters_are_the_kernels(channel: str) -> None:
    before = listeners(channel)
    with open_bus("socketcan", channel) as bus, open_bus("socketcan", channel) as sender:
        bus.set_filters(
            [
                {"can_id": 0x20, "can_mask": 0x7F0, "extended": False},
                {"can_id": 0x18FEF100, "can_mask": 0x1FFFFF00, "extended": True},
            ]
        )
        assert listeners(channel) > before
        lists = [path.read_text() for path in Path("/proc/net/can").glob("rcvlist_*")]
        assert any(" 020 " in text for text in lists)
        for frame_id, is_extended in (
            (0x1F, False), (0x25, False), (0x20, True), (0x18FEF1AA, True), (0x18FEF2AA, True),
        ):  # fmt: skip
            sender.send(can.Message(arbitration_id=frame_id, is_extended_id=is_extended))
        heard = [bus.recv(GENEROUS_S), bus.recv(GENEROUS_S)]
        assert [m.arbitration_id for m in heard if m is not None] == [0x25, 0x18FEF1AA]
        assert bus.recv(0) is None


def test_stamps_are_the_kernels_wall_clock(channel: str) -> None:
    with open_bus("socketcan", channel) as sender, open_bus("socketcan", channel) as receiver:
        before_s = time.time()
        sender.send(encoder(1))
        after_s = time.time()
        time.sleep(SILENCE_S)
        received = receiver.recv(GENEROUS_S)
        assert received is not None
        assert before_s <= received.timestamp <= after_s + 1e-3


def test_error_frames_are_heard_and_never_taken_for_data(channel: str, tmp_path: Path) -> None:
    checker = FrameChecker(DATABASE, ["ENCODER"], max_age_us=10**9)
    path = tmp_path / "errors.log"
    with (
        open_bus("socketcan", channel) as sender,
        open_bus("socketcan", channel) as receiver,
        open_bus("socketcan", channel, bus_args={"ignore_rx_error_frames": "True"}) as deaf,
        open_log_writer(path) as log,
    ):
        sender.send(error_frame())
        sender.send(encoder(1))
        heard = [receiver.recv(GENEROUS_S), receiver.recv(GENEROUS_S)]
        for message in heard:
            assert message is not None
            log.write(message, True)
        first, second = heard
        assert first is not None
        assert second is not None
        assert (first.is_error_frame, first.arbitration_id) == (True, 0x20)
        now_us = round(second.timestamp * 1e6)
        assert checker.check(first, now_us) is None
        assert checker.check(second, now_us) is not None
        only = deaf.recv(GENEROUS_S)
        assert only is not None
        assert not only.is_error_frame
    assert [message.is_error_frame for message in read_log(path)] == [True, False]


def test_fd_frames_reach_those_who_ask_for_them(channel: str) -> None:
    with (
        open_bus("socketcan", channel, bus_args={"fd": "True"}) as sender,
        open_bus("socketcan", channel, bus_args={"fd": "True"}) as fd,
        open_bus("socketcan", channel) as classic,
    ):
        sent = can.Message(
            arbitration_id=0x123, is_extended_id=False, is_fd=True, bitrate_switch=True,
            data=bytes(range(48)),
        )  # fmt: skip
        sender.send(sent)
        sender.send(encoder(1))
        received = fd.recv(GENEROUS_S)
        assert received is not None
        assert received.equals(
            sent, timestamp_delta=None, check_channel=False, check_direction=False
        )
        first = classic.recv(GENEROUS_S)
        assert first is not None
        assert not first.is_fd


def test_an_interface_that_goes_down_is_one_line(other_channel: str) -> None:
    with open_bus("socketcan", other_channel) as bus:
        ip("link", "set", "down", other_channel)
        with pytest.raises(CanBusError, match=r"went away: cannot receive: .*[Nn]etwork is down"):
            bus.recv(GENEROUS_S)
        with pytest.raises(CanBusError, match=r"went away: cannot send: .*[Nn]etwork is down"):
            bus.send(encoder(1))


def test_an_interface_that_takes_no_frame_is_full_not_gone(other_channel: str) -> None:
    # A queue for no byte: what the kernel says when nobody on a real bus acknowledges.
    queue = ["tc", "qdisc", "replace", "dev", other_channel, "root", "bfifo", "limit", "1"]
    subprocess.run(queue, check=True)
    with open_bus("socketcan", other_channel) as bus, open_bus("socketcan", other_channel) as peer:
        with pytest.raises(BusFullError, match="takes no more frames"):
            bus.send(encoder(1))
        subprocess.run([*queue[:-1], "10000"], check=True)
        bus.send(encoder(2))
        received = peer.recv(GENEROUS_S)
        assert received is not None
        assert ENCODER.unpack(received.data)[0] == 2


def test_where_the_kernel_has_vcan_no_machine_is_needed() -> None:
    script = Path(__file__).parent.parent.parent / "scripts" / "vcan.sh"
    environment = {k: v for k, v in os.environ.items() if k not in (VCAN_ENV, "VCAN_KEEP")}
    where = subprocess.run(
        [script, "--where"], env=environment, capture_output=True, text=True, check=True
    )
    assert where.stdout == "namespace\n"
    there = subprocess.run(
        [script, "sh", "-c", f"ip -o link show vcan0; echo ${VCAN_ENV}; exit 7"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert there.returncode == 7, there.stderr
    shown, name = there.stdout.splitlines()
    assert "link/can" in shown
    assert name == "vcan0"
