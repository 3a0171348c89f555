"""One contract for every bus: the same tests on each backend."""

from __future__ import annotations

import itertools
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator

import can
import msgpack
import pytest
from on_vcan import VCAN_ENV

from can_bus import CanBusError, load_database, make_message, open_bus

DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")

# Not a deadline: only a broken bus waits so long.
GENEROUS_S = 20.0
# After this long a frame that is not coming has not come; only a broken bus could pass by luck.
SILENCE_S = 0.05

# Tests of other processes run beside these: each process has groups of its own.
_PROCESS = os.getpid() % 2**16
MULTICAST_GROUP = f"239.1.{_PROCESS >> 8}.{_PROCESS & 0xFF}"
OTHER_GROUP = f"239.2.{_PROCESS >> 8}.{_PROCESS & 0xFF}"
_numbers = itertools.count()

OpenBus = Callable[[], can.BusABC]


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@pytest.fixture(
    params=[
        "virtual",
        "chiplog",
        "udp_multicast",
        pytest.param("socketcan", marks=pytest.mark.vcan),
    ]
)
def open_handle(request: pytest.FixtureRequest) -> Iterator[OpenBus]:
    """Open any number of handles on one bus that nothing else is on."""
    interface: str = request.param
    opened: list[can.BusABC] = []
    channel = f"contract-{os.getpid()}-{next(_numbers)}"
    bus_args: dict[str, str] = {}
    if interface == "udp_multicast":
        channel = MULTICAST_GROUP
        bus_args = {"port": str(free_udp_port())}
    elif interface == "socketcan":
        channel = os.environ[VCAN_ENV]

    def handle() -> can.BusABC:
        opened.append(open_bus(interface, channel, bus_args=bus_args))
        return opened[-1]

    yield handle
    for bus in opened:
        bus.shutdown()


def encoder(left: int) -> can.Message:
    return make_message(ENCODER, ENCODER.pack((left, 0), 0), 0)


def test_what_one_handle_sends_the_others_receive(open_handle: OpenBus) -> None:
    sender, *receivers = open_handle(), open_handle(), open_handle()
    sent = encoder(7)
    sender.send(sent)
    for receiver in receivers:
        received = receiver.recv(GENEROUS_S)
        assert received is not None
        assert received.equals(
            sent, timestamp_delta=None, check_channel=False, check_direction=False
        )


def test_frames_arrive_in_the_order_they_were_sent(open_handle: OpenBus) -> None:
    sender, receiver = open_handle(), open_handle()
    for left in range(100):
        sender.send(encoder(left))
    for left in range(100):
        received = receiver.recv(GENEROUS_S)
        assert received is not None
        assert ENCODER.unpack(received.data)[0] == left


def test_a_handle_does_not_hear_itself(open_handle: OpenBus) -> None:
    sender, other = open_handle(), open_handle()
    sender.send(encoder(1))
    assert other.recv(GENEROUS_S) is not None
    assert sender.recv(SILENCE_S) is None


def test_a_received_frame_belongs_to_its_receiver(open_handle: OpenBus) -> None:
    sender, first, second = open_handle(), open_handle(), open_handle()
    message = encoder(1)
    sender.send(message)
    received = first.recv(GENEROUS_S)
    assert received is not None
    received.data[:] = bytes(8)
    message.data[:] = bytes(8)
    other = second.recv(GENEROUS_S)
    assert other is not None
    assert other.data == encoder(1).data


def test_extended_remote_and_short_frames_travel_unchanged(open_handle: OpenBus) -> None:
    sender, receiver = open_handle(), open_handle()
    for sent in (
        can.Message(arbitration_id=0x18FEF1FE, is_extended_id=True, data=b"\x01\x02\x03"),
        can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b""),
        can.Message(arbitration_id=0x55, is_extended_id=False, is_remote_frame=True, dlc=3),
    ):
        sender.send(sent)
        received = receiver.recv(GENEROUS_S)
        assert received is not None
        assert received.equals(
            sent, timestamp_delta=None, check_channel=False, check_direction=False
        )


def test_a_poll_of_a_silent_bus_returns_nothing(open_handle: OpenBus) -> None:
    assert open_handle().recv(0) is None


def test_filters_let_only_their_identifiers_through(open_handle: OpenBus) -> None:
    sender, receiver = open_handle(), open_handle()
    receiver.set_filters([{"can_id": 0x20, "can_mask": 0x7FF, "extended": False}])
    sender.send(can.Message(arbitration_id=0x10, is_extended_id=False))
    sender.send(can.Message(arbitration_id=0x20, is_extended_id=False))
    received = receiver.recv(GENEROUS_S)
    assert received is not None
    assert received.arbitration_id == 0x20
    assert receiver.recv(0) is None


def test_a_closed_bus_says_so_in_one_line(open_handle: OpenBus) -> None:
    bus, peer = open_handle(), open_handle()
    peer.send(encoder(0))
    bus.shutdown()
    uses: list[Callable[[], object]] = [
        lambda: bus.send(encoder(0)),
        lambda: bus.recv(0),
        lambda: bus.recv(SILENCE_S),
    ]
    for use in uses:
        with pytest.raises(
            CanBusError, match=r"the bus .* went away: cannot (send|receive): "
        ) as e:
            use()
        assert "\n" not in str(e.value)


def test_closing_twice_is_fine(open_handle: OpenBus) -> None:
    bus = open_handle()
    bus.shutdown()
    bus.shutdown()


def test_the_virtual_bus_keeps_the_stamp_of_the_sender() -> None:
    with open_bus("virtual", "stamps") as sender, open_bus("virtual", "stamps") as receiver:
        sender.send(make_message(ENCODER, ENCODER.pack((0, 0), 0), 1_230_000))
        received = receiver.recv(0)
        assert received is not None
        assert received.timestamp == 1.23


def test_the_virtual_bus_meets_python_cans_own_handles() -> None:
    theirs = can.Bus("meeting", interface="virtual")
    with open_bus("virtual", "meeting") as ours, theirs:
        ours.send(encoder(1))
        theirs.send(encoder(2))
        first, second = theirs.recv(0), ours.recv(0)
        assert first is not None
        assert second is not None
        assert [ENCODER.unpack(m.data)[0] for m in (first, second)] == [1, 2]


def test_a_full_receive_queue_stays_bounded() -> None:
    with (
        open_bus("virtual", "bounded") as sender,
        open_bus("virtual", "bounded", bus_args={"rx_queue_size": "1"}) as receiver,
    ):
        sender.send(encoder(1))
        with pytest.raises(CanBusError, match="Could not send message to one or more recipients"):
            sender.send(encoder(2), timeout=SILENCE_S)
        assert receiver.recv(0) is not None
        assert receiver.recv(0) is None


# --- udp_multicast: confined to this host -----------------------------------------------------


@pytest.fixture
def multicast_args() -> dict[str, str]:
    return {"port": str(free_udp_port())}


def test_two_processes_meet_on_loopback(multicast_args: dict[str, str]) -> None:
    script = (
        "import sys; from can_bus import open_bus\n"
        "bus = open_bus('udp_multicast', sys.argv[1], bus_args={'port': sys.argv[2]})\n"
        "print('ready', flush=True)\n"
        f"message = bus.recv({GENEROUS_S})\n"
        "message.arbitration_id += 1\n"
        "bus.send(message); bus.shutdown()\n"
    )
    command = [sys.executable, "-c", script, MULTICAST_GROUP, multicast_args["port"]]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as echo,
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as bus,
    ):
        assert echo.stdout is not None
        assert echo.stdout.readline() == "ready\n"
        bus.send(encoder(5))
        answer = bus.recv(GENEROUS_S)
        assert answer is not None
        assert answer.arbitration_id == ENCODER.frame_id + 1
        assert answer.data == encoder(5).data
        assert echo.wait(GENEROUS_S) == 0


def test_the_sockets_reach_nothing_but_loopback(multicast_args: dict[str, str]) -> None:
    with open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as bus:
        sender: socket.socket = bus._multicast._sender  # type: ignore[attr-defined]
        receiver: socket.socket = bus._multicast._socket  # type: ignore[attr-defined]
        assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        outgoing = sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
        assert outgoing == socket.inet_aton("127.0.0.1")
        assert sender.getsockname()[0] == "127.0.0.1"
        assert receiver.getsockname()[0] == MULTICAST_GROUP


def test_another_group_on_the_same_port_is_not_heard(multicast_args: dict[str, str]) -> None:
    with (
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as ours,
        open_bus("udp_multicast", OTHER_GROUP, bus_args=multicast_args) as theirs,
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as friend,
    ):
        theirs.send(encoder(1))
        friend.send(encoder(2))
        received = ours.recv(GENEROUS_S)
        assert received is not None
        assert ENCODER.unpack(received.data)[0] == 2
        assert ours.recv(SILENCE_S) is None


def test_datagrams_sent_straight_to_the_port_are_not_heard(multicast_args: dict[str, str]) -> None:
    with (
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as bus,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        stranger.sendto(b"unicast", ("127.0.0.1", int(multicast_args["port"])))
        assert bus.recv(SILENCE_S) is None
        assert bus.malformed == 0  # type: ignore[attr-defined]


GOOD_FIELDS = {
    "timestamp": 0.0,
    "arbitration_id": 1,
    "is_extended_id": False,
    "is_remote_frame": False,
    "is_error_frame": False,
    "channel": None,
    "dlc": 2,
    "data": b"ab",
    "is_fd": False,
    "bitrate_switch": False,
    "error_state_indicator": False,
}


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"\xff" * 30,
        msgpack.packb([1, 2, 3]),
        msgpack.packb({}),
        msgpack.packb({**GOOD_FIELDS, "arbitration_id": "one"}),
        msgpack.packb({**GOOD_FIELDS, "arbitration_id": 1 << 29}),
        msgpack.packb({**GOOD_FIELDS, "arbitration_id": 1 << 11}),
        msgpack.packb({**GOOD_FIELDS, "data": 4_000_000_000, "dlc": 8}),
        msgpack.packb({**GOOD_FIELDS, "data": bytes(9), "dlc": 9}),
        msgpack.packb({**GOOD_FIELDS, "dlc": 3}),
        msgpack.packb({**GOOD_FIELDS, "is_extended_id": "no"}),
        msgpack.packb({**GOOD_FIELDS, "is_fd": True}),
    ],
)
def test_a_datagram_that_is_no_classic_frame_is_dropped_and_counted(
    datagram: bytes, multicast_args: dict[str, str]
) -> None:
    with (
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as bus,
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=multicast_args) as peer,
    ):
        peer._multicast.send(datagram)  # type: ignore[attr-defined]
        peer.send(encoder(3))
        received = bus.recv(GENEROUS_S)
        assert received is not None
        assert ENCODER.unpack(received.data)[0] == 3
        assert bus.malformed == 1  # type: ignore[attr-defined]


def test_a_can_fd_frame_is_not_sent() -> None:
    bus_args = {"port": str(free_udp_port())}
    with (
        open_bus("udp_multicast", MULTICAST_GROUP, bus_args=bus_args) as bus,
        pytest.raises(CanBusError, match="classic CAN frames only"),
    ):
        bus.send(can.Message(is_fd=True, data=bytes(12)))


# --- errors of opening ------------------------------------------------------------------------

UNOPENED_GROUP = "239.74.163.2"
CANNOT_OPEN = [
    (
        "udp_multicast",
        "vcan0",
        {},
        r"channel 'vcan0': expected an IPv4 multicast group, for example",
    ),
    ("udp_multicast", "127.0.0.1", {}, r"channel '127.0.0.1': expected an IPv4 multicast group"),
    (
        "udp_multicast",
        UNOPENED_GROUP,
        {"interface_ip": "lo"},
        r"interface_ip 'lo': expected an IPv4",
    ),
    (
        "udp_multicast",
        UNOPENED_GROUP,
        {"interface_ip": "203.0.113.7"},
        r"on 203.0.113.7: .*interface_ip must be an address of this host",
    ),
    (
        "udp_multicast",
        UNOPENED_GROUP,
        {"speed": "1"},
        r"udp_multicast has no argument 'speed': it has port",
    ),
    (
        "udp_multicast",
        UNOPENED_GROUP,
        {"port": "many"},
        r"udp_multicast port 'many': expected 1 to",
    ),
    (
        "udp_multicast",
        UNOPENED_GROUP,
        {"hop_limit": "far"},
        r"udp_multicast hop_limit .far.: expected 0",
    ),
    (
        "virtual",
        "x",
        {"preserve": "1"},
        r"virtual has no argument 'preserve': it has preserve_time",
    ),
    ("telepathy", "x", {}, r"no interface 'telepathy': python-can knows .*socketcan.*virtual"),
    ("slcan", "/dev/none", {}, r"cannot open slcan channel '/dev/none': "),
]


@pytest.mark.parametrize(("interface", "channel", "bus_args", "message"), CANNOT_OPEN)
def test_a_bus_that_cannot_be_opened_is_one_line(
    interface: str,
    channel: str,
    bus_args: dict[str, str],
    message: str,
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(CanBusError, match=message) as caught:
        open_bus(interface, channel, bus_args=bus_args)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_missing_vcan_comes_with_the_three_commands_that_make_it() -> None:
    with pytest.raises(CanBusError) as caught:
        open_bus("socketcan", "vcan17")
    assert "as root: modprobe vcan; ip link add dev vcan17 type vcan; ip link set up vcan17" in str(
        caught.value
    )
    assert "\n" not in str(caught.value)


def test_a_missing_can_interface_comes_with_the_command_that_brings_it_up() -> None:
    with pytest.raises(
        CanBusError, match=r"ip link set can17 up type can bitrate 250000 restart-ms 100"
    ):
        open_bus("socketcan", "can17", bitrate=250_000)
