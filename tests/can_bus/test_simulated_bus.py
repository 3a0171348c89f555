"""The simulated bus through python-can: its clock, its order, its queues, its threads."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator

import can
import pytest
from wire_text import frame_as_text

from can_bus import CanBusError, open_bus
from can_bus.simulated import SimulatedBus

BIT_S = 2e-6
INTERMISSION = 3
_numbers = itertools.count()

OpenNode = Callable[..., SimulatedBus]


@pytest.fixture
def node() -> Iterator[OpenNode]:
    opened: list[SimulatedBus] = []
    channel = f"simulated-{next(_numbers)}"

    def open_node(**arguments: object) -> SimulatedBus:
        bus = can.Bus(channel, interface="chiplog", **arguments)  # type: ignore[arg-type]
        assert isinstance(bus, SimulatedBus)
        opened.append(bus)
        return bus

    yield open_node
    for bus in opened:
        bus.shutdown()


def frame(arbitration_id: int, data: bytes = b"\x01\x02\x03\x04") -> can.Message:
    return can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=data)


def bits(message: can.Message) -> int:
    return len(frame_as_text(message.arbitration_id, message.is_extended_id, bytes(message.data)))


def drain(bus: can.BusABC, seconds: float = 1.0) -> list[can.Message]:
    found = []
    while (message := bus.recv(seconds)) is not None:
        found.append(message)
    return found


# --- the clock --------------------------------------------------------------------------------


def test_a_frame_is_stamped_at_its_last_bit(node: OpenNode) -> None:
    sender, receiver = node(), node()
    message = frame(0x123)
    sender.send(message)
    received = receiver.recv(1.0)
    assert received is not None
    assert received.timestamp == pytest.approx(bits(message) * BIT_S, abs=1e-12)
    assert receiver.now_s == received.timestamp


def test_frames_that_wait_follow_after_the_intermission(node: OpenNode) -> None:
    sender, receiver = node(), node()
    messages = [frame(0x100 + n, bytes([n] * n)) for n in range(8)]
    for message in messages:
        sender.send(message)
    end = -INTERMISSION
    for message in messages:
        end += INTERMISSION + bits(message)
        received = receiver.recv(1.0)
        assert received is not None
        assert received.timestamp == pytest.approx(end * BIT_S, abs=1e-12)


def test_waiting_in_vain_moves_the_clock_and_polling_does_not(node: OpenNode) -> None:
    bus = node()
    assert bus.recv(0.25) is None
    assert bus.now_s == 0.25
    assert bus.recv(0) is None
    assert bus.now_s == 0.25


@pytest.mark.parametrize("bitrate", [10_000, 83_333, 125_000, 500_000, 1_000_000])
def test_bits_do_not_drift_against_the_clock_at_any_bit_rate(node: OpenNode, bitrate: int) -> None:
    sender, receiver = node(bitrate=bitrate), node()
    message = frame(0x123)
    for _ in range(500):
        sender.send(message)
    last = drain(receiver)[-1]
    taken = 500 * (bits(message) + INTERMISSION) - INTERMISSION
    assert last.timestamp == pytest.approx(taken / bitrate, abs=2e-9)


def test_the_clock_begins_anew_when_the_last_handle_is_closed(node: OpenNode) -> None:
    channel = "simulated-anew"
    with SimulatedBus(channel) as first:
        assert first.recv(1.0) is None
        with SimulatedBus(channel) as second:
            assert second.now_s == 1.0
    with SimulatedBus(channel) as third:
        assert third.now_s == 0.0


def test_a_skewed_clock_stamps_waits_and_repeats_by_its_own_seconds(node: OpenNode) -> None:
    fast, true = node(clock_skew=0.01), node()
    assert fast.recv(1.01) is None
    assert true.now_s == pytest.approx(1.0)
    fast.send_periodic(frame(0x10), 0.101)
    stamps = [message.timestamp for message in itertools.islice(true, 5)]
    gaps = [after - before for before, after in itertools.pairwise(stamps)]
    assert gaps == pytest.approx([0.1] * 4)
    true.send(frame(0x20))
    received = fast.recv(0.05)
    assert received is not None
    assert received.timestamp == pytest.approx(true.now_s * 1.01)


def test_the_same_calls_give_the_same_bus(node: OpenNode) -> None:
    def trace() -> list[str]:
        with SimulatedBus("twice") as first, SimulatedBus("twice") as second:
            first.send_periodic(frame(0x100), 0.01)
            second.send_periodic(frame(0x0FF), 0.007)
            return [str(m) for m in itertools.islice(second, 30)]

    assert trace() == trace()


# --- arbitration and queues -------------------------------------------------------------------


def test_of_frames_queued_at_one_time_the_lowest_identifier_goes_first(node: OpenNode) -> None:
    nodes = [node() for _ in range(3)]
    observer = node()
    for bus, arbitration_id in zip(nodes, (0x300, 0x100, 0x200), strict=True):
        bus.send(frame(arbitration_id))
    assert [m.arbitration_id for m in drain(observer)] == [0x100, 0x200, 0x300]


def test_a_standard_frame_wins_against_an_extended_one_of_equal_base(node: OpenNode) -> None:
    first, second, observer = node(), node(), node()
    first.send(can.Message(arbitration_id=0x100 << 18, is_extended_id=True))
    second.send(frame(0x100))
    second.send(can.Message(arbitration_id=0x100, is_extended_id=False, is_remote_frame=True))
    seen = [(m.is_extended_id, m.is_remote_frame) for m in drain(observer)]
    assert seen == [(False, False), (False, True), (True, False)]


def test_a_frame_on_the_wire_is_not_interrupted(node: OpenNode) -> None:
    slow, urgent, observer = node(), node(), node()
    slow.send(frame(0x700, bytes(8)))
    observer.pass_time(BIT_S)
    urgent.send(frame(0x001))
    assert [m.arbitration_id for m in drain(observer)] == [0x700, 0x001]


IDENTIFIERS = (0x300, 0x200, 0x100, 0x000)


@pytest.mark.parametrize(
    ("arguments", "order"),
    [
        ({}, [0x000, 0x100, 0x200, 0x300]),
        ({"tx_order": "fifo"}, [0x300, 0x200, 0x100, 0x000]),
        ({"tx_mailboxes": 1}, [0x300, 0x200, 0x100, 0x000]),
        ({"tx_mailboxes": 2}, [0x200, 0x100, 0x000, 0x300]),
        ({"tx_mailboxes": 3}, [0x100, 0x000, 0x200, 0x300]),
    ],
    ids=str,
)
def test_the_transmit_queue_decides_what_takes_part(
    node: OpenNode, arguments: dict[str, object], order: list[int]
) -> None:
    sender, observer = node(**arguments), node()
    for arbitration_id in IDENTIFIERS:
        sender.send(frame(arbitration_id))
    assert [m.arbitration_id for m in drain(observer)] == order


def test_frames_of_one_identifier_keep_their_order(node: OpenNode) -> None:
    sender, observer = node(), node()
    for number in range(20):
        sender.send(frame(0x100, bytes([number])))
    assert [m.data[0] for m in drain(observer)] == list(range(20))


def test_a_full_queue_says_so_or_waits_for_room(node: OpenNode) -> None:
    sender, observer = node(tx_mailboxes=2, tx_backlog=1), node()
    for _ in range(3):
        sender.send(frame(0x100))
    with pytest.raises(can.CanOperationError, match="the transmit queue of node-1 is full"):
        sender.send(frame(0x100))
    sender.send(frame(0x100), timeout=1.0)
    assert sender.now_s == pytest.approx(bits(frame(0x100)) * BIT_S)
    assert len(drain(observer)) == 4


def test_what_waits_can_be_dropped(node: OpenNode) -> None:
    sender, observer = node(), node()
    for _ in range(3):
        sender.send(frame(0x100))
    observer.pass_time(BIT_S)
    sender.flush_tx_buffer()
    assert len(drain(observer)) == 1


def test_own_frames_come_back_when_they_have_been_sent(node: OpenNode) -> None:
    sender = node(receive_own_messages=True)
    node()
    sender.send(frame(0x100))
    own = sender.recv(1.0)
    assert own is not None
    assert own.is_rx is False
    assert own.timestamp == pytest.approx(bits(frame(0x100)) * BIT_S)


def test_what_classic_can_does_not_have_is_refused(node: OpenNode) -> None:
    bus = node()
    with pytest.raises(CanBusError, match="classic"):
        bus.send(can.Message(arbitration_id=1, is_fd=True))
    with pytest.raises(CanBusError, match="9 bytes"):
        bus.send(frame(1, bytes(8)).__class__(arbitration_id=1, data=bytes(9), is_fd=False))
    with pytest.raises(can.CanInitializationError, match="classic CAN only"):
        SimulatedBus("fd", fd=True)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"bitrate": 0}, "bitrate = 0: expected 1 to 1000000"),
        ({"tx_order": "last"}, "tx_order = 'last': expected priority or fifo"),
        ({"tx_mailboxes": 0}, "tx_mailboxes = 0: expected 1 or more"),
        ({"tx_mailboxes": 1, "tx_backlog": -1}, "tx_backlog = -1: expected 0 or more"),
        ({"clock_skew": 2.0}, "clock_skew = 2.0: expected -0.5 to 0.5"),
        ({"faults": "nowhere.toml"}, "nowhere.toml: cannot read these faults"),
    ],
    ids=str,
)
def test_what_cannot_be_opened_says_why_and_leaves_nothing_open(
    arguments: dict[str, object], complaint: str
) -> None:
    with pytest.raises(can.CanInitializationError, match=complaint):
        SimulatedBus("refused", **arguments)  # type: ignore[arg-type]
    with SimulatedBus("refused", bitrate=250_000) as bus:
        assert bus.bitrate == 250_000
        with pytest.raises(can.CanInitializationError, match="runs at 250000 bit/s"):
            SimulatedBus("refused", bitrate=500_000)
        with pytest.raises(can.CanInitializationError, match="there is a node 'node-1'"):
            SimulatedBus("refused", node="node-1")
        assert SimulatedBus._detect_available_configs()


def test_open_bus_refuses_an_argument_that_there_is_not() -> None:
    with pytest.raises(CanBusError, match="chiplog has no argument 'speed': it has"):
        open_bus("chiplog", "x", bus_args={"speed": "1"})


# --- cyclic sending ---------------------------------------------------------------------------


def test_a_cyclic_task_sends_on_the_simulated_clock(node: OpenNode) -> None:
    sender, receiver = node(), node()
    task = sender.send_periodic(frame(0x100), 0.01, duration=0.05)
    length_s = bits(frame(0x100)) * BIT_S
    stamps = [message.timestamp for message in drain(receiver, 0.1)]
    assert stamps == pytest.approx([n * 0.01 + length_s for n in range(5)], abs=1e-12)
    task.start()  # type: ignore[attr-defined]
    assert len(drain(receiver, 0.1)) == 5


def test_a_cyclic_task_can_be_changed_and_stopped(node: OpenNode) -> None:
    sender, receiver = node(), node()

    def count(message: can.Message) -> None:
        message.data[0] += 1

    task = sender.send_periodic(frame(0x100, b"\x00"), 0.01, modifier_callback=count)
    assert [m.data[0] for m in itertools.islice(receiver, 3)] == [1, 2, 3]
    task.modify_data(frame(0x100, b"\x10"))  # type: ignore[attr-defined]
    assert [m.data[0] for m in itertools.islice(receiver, 2)] == [0x11, 0x12]
    task.stop()
    assert receiver.recv(1.0) is None
    with pytest.raises(ValueError, match="expected more than 0 s"):
        sender.send_periodic(frame(0x100), 0.0)


def test_a_cyclic_frame_that_finds_no_room_is_counted(node: OpenNode) -> None:
    sender = node(tx_mailboxes=1, tx_backlog=0)
    observer = node()
    task = sender.send_periodic([frame(0x100, bytes(8))], 1e-4)
    assert len(drain_for(observer, 0.01)) < 50
    assert task.dropped > 0  # type: ignore[attr-defined]


def drain_for(bus: SimulatedBus, seconds: float) -> list[can.Message]:
    bus.pass_time(seconds)
    return list(iter(lambda: bus.recv(0), None))


# --- filters and notifier ---------------------------------------------------------------------


def test_filters_hold_for_frames_that_arrive_after_them(node: OpenNode) -> None:
    sender, receiver = node(), node()
    receiver.set_filters([{"can_id": 0x100, "can_mask": 0x7FF, "extended": False}])
    for arbitration_id in (0x0FF, 0x100, 0x101):
        sender.send(frame(arbitration_id))
    assert [m.arbitration_id for m in drain(receiver)] == [0x100]


def test_a_notifier_reads_in_its_own_thread(node: OpenNode) -> None:
    sender, receiver = node(), node()
    heard: list[float] = []
    enough = threading.Event()

    def listen(message: can.Message) -> None:
        heard.append(message.timestamp)
        if len(heard) == 10:
            enough.set()

    sender.send_periodic(frame(0x100), 0.01)
    with can.Notifier(receiver, [listen]):
        assert enough.wait(20.0)
    length_s = bits(frame(0x100)) * BIT_S
    assert heard[:10] == pytest.approx([n * 0.01 + length_s for n in range(10)])


def test_periodic_frames_keep_their_period_beside_a_notifier_that_runs_already(
    node: OpenNode,
) -> None:
    """Its thread moves the clock on while this one starts the task."""
    sender, receiver = node(), node()
    for turn in range(20):
        heard: list[float] = []
        enough = threading.Event()

        def listen(message: can.Message, heard=heard, enough=enough) -> None:
            heard.append(message.timestamp)
            if len(heard) == 10:
                enough.set()

        with can.Notifier(receiver, [listen]):
            task = sender.send_periodic(frame(0x100 + turn), 0.01)
            assert enough.wait(20.0)
            task.stop()
        gaps = [later - earlier for earlier, later in itertools.pairwise(heard[:10])]
        assert gaps == pytest.approx([0.01] * 9)


def test_a_notifier_stops_at_once_though_the_clock_stands(node: OpenNode) -> None:
    """Its thread waits for this one, which waits for it: neither moves the clock."""
    main, background = node(), node()
    notifier = can.Notifier(background, [])
    assert main.recv(0.5) is None
    notifier.stop()
    assert not any(thread.is_alive() for thread in notifier._readers)  # type: ignore[union-attr]


# --- threads ----------------------------------------------------------------------------------


def test_the_clock_waits_for_the_slowest_thread(node: OpenNode) -> None:
    """A thread that thinks for long in wall time loses no simulated time."""
    asking, answering = node(), node()
    waits = 30
    arrived = threading.Event()
    asking.recv(0)

    def answer() -> None:
        answering.recv(0)  # from here on the clock waits for this thread too
        arrived.set()
        for _ in range(waits):
            request = answering.recv(1.0)
            assert request is not None
            threading.Event().wait(0.002)
            answering.send(frame(0x200, bytes(request.data)))

    thread = threading.Thread(target=answer)
    thread.start()
    assert arrived.wait(20.0)
    stamps = []
    for number in range(waits):
        asking.send(frame(0x100, bytes([number])))
        reply = asking.recv(1.0)
        assert reply is not None
        assert reply.data[0] == number
        stamps.append(reply.timestamp)
    thread.join()
    one_way = [bits(frame(i, bytes([n]))) for n in range(waits) for i in (0x100, 0x200)]
    assert stamps[-1] <= (sum(one_way) + INTERMISSION * len(one_way)) * BIT_S + 1e-9


def test_a_thread_that_has_ended_holds_nobody_up(node: OpenNode) -> None:
    short, long = node(), node()
    thread = threading.Thread(target=lambda: short.recv(0.001))
    thread.start()
    thread.join(20.0)
    assert long.recv(5.0) is None
    assert long.now_s >= 5.0


def test_closing_a_handle_wakes_who_waits_for_it(node: OpenNode) -> None:
    held, main = node(), node()
    complaints: list[Exception] = []
    started = threading.Event()

    def wait() -> None:
        started.set()
        try:
            held.recv(None)
        except can.CanOperationError as error:
            complaints.append(error)

    assert main.recv(0.001) is None  # from here on the clock waits for this thread too
    thread = threading.Thread(target=wait)
    thread.start()
    assert started.wait(20.0)
    held.shutdown()
    thread.join(20.0)
    assert len(complaints) == 1
