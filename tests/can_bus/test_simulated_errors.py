"""Fault confinement on the simulated bus: the rules of ISO 11898-1, seen from python-can."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus.simulated import BusFault, SimulatedBus
from can_bus.simulated.confinement import Confinement, ErrorState
from can_bus.simulated.disturbed_frame import Station, play
from can_bus.simulated.frame_bits import FrameContent, wire_frame

BIT_S = 2e-6
CONTENT = FrameContent(0x123, False, False, 8, bytes(range(1, 9)))
_numbers = itertools.count()

OpenNode = Callable[..., SimulatedBus]


@pytest.fixture
def node() -> Iterator[OpenNode]:
    opened: list[SimulatedBus] = []
    channel = f"errors-{next(_numbers)}"

    def open_node(**arguments: object) -> SimulatedBus:
        opened.append(SimulatedBus(channel, **arguments))  # type: ignore[arg-type]
        return opened[-1]

    yield open_node
    for bus in opened:
        bus.shutdown()


def frame(arbitration_id: int = 0x123, data: bytes = CONTENT.data) -> can.Message:
    return can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=data)


def drain(bus: can.BusABC, seconds: float) -> list[can.Message]:
    found = []
    while (message := bus.recv(seconds)) is not None:
        found.append(message)
    return found


def state_of(bus: can.BusABC) -> can.BusState:
    """Return the state as it is now (a property that mypy takes for a constant)."""
    return bus.state


# --- one frame, bit by bit --------------------------------------------------------------------


def stations(*confinements: Confinement) -> list[Station]:
    """Return a transmitter of the frame and receivers."""
    return [
        Station(each, CONTENT if number == 0 else None) for number, each in enumerate(confinements)
    ]


def counters(nodes: list[Station]) -> list[tuple[int, int]]:
    return [(each.confinement.tec, each.confinement.rec) for each in nodes]


AFTER_ARBITRATION = wire_frame(CONTENT).arbitration_end


@given(st.integers(AFTER_ARBITRATION, len(wire_frame(CONTENT).bits) - 1))
def test_whichever_bit_all_misread_an_error_frame_follows_within_known_bounds(place: int) -> None:
    nodes = stations(Confinement(), Confinement(), Confinement())
    length = play(nodes, {place: [0, 1, 2]})
    assert not nodes[0].has_sent
    # A flag of 6 to 12 bits from the next bit on, and a delimiter of 8.
    assert place + 1 + 6 + 8 <= length <= place + 1 + 12 + 8
    assert nodes[0].confinement.tec == 8


@given(st.integers(0, AFTER_ARBITRATION - 1))
def test_a_bit_misread_in_arbitration_may_look_like_a_lost_one(place: int) -> None:
    nodes = stations(Confinement(), Confinement(), Confinement())
    length = play(nodes, {place: [0, 1, 2]})
    assert not nodes[0].has_sent
    # Who has lost against nobody stops sending: a stuff error of all, six recessive bits later.
    assert place + 1 + 6 + 8 <= length <= place + 1 + 6 + 12 + 8
    assert nodes[0].confinement.tec in (0, 8)


@given(st.integers(1, len(wire_frame(CONTENT).bits) - 3))
def test_what_one_active_node_misreads_nobody_takes_in(place: int) -> None:
    """All or nobody: the flag of the one that saw an error tells the others."""
    nodes = stations(Confinement(), Confinement(), Confinement())
    play(nodes, {place: [1]})
    if place == wire_frame(CONTENT).ack_slot:
        assert nodes[0].has_sent  # a receiver does not judge what is in the slot
    else:
        assert [each.received for each in nodes] == [None, None, None]
        assert not nodes[0].has_sent
        # It saw the error first, and a dominant bit after its own flag: 1 + 8. The rest: 1.
        assert counters(nodes)[0][0] in ((8,) if place >= AFTER_ARBITRATION else (0, 8))
        assert counters(nodes)[1][1] in (1, 9)


def test_the_last_bit_but_one_of_a_frame_is_where_consistency_ends() -> None:
    """A receiver that misreads it rejects; the rest accept, and get the frame a second time."""
    last = len(wire_frame(CONTENT).bits) - 1
    nodes = stations(Confinement(), Confinement(), Confinement())
    play(nodes, {last - 1: [1]})
    assert not nodes[0].has_sent
    assert nodes[1].received is None
    assert nodes[2].received == CONTENT


def test_a_passive_receiver_that_misreads_disturbs_nobody() -> None:
    nodes = stations(Confinement(), Confinement(rec=128), Confinement())
    length = play(nodes, {40: [1]})
    assert nodes[0].has_sent
    assert nodes[1].received is None
    assert nodes[2].received == CONTENT
    assert length >= len(wire_frame(CONTENT).bits)


@given(st.integers(1, 2**11 - 1), st.integers(0, 8), st.data())
def test_no_disturbance_lets_a_wrong_frame_through_to_an_observer_of_few_errors(
    frame_id: int, size: int, data: st.DataObject
) -> None:
    payload = data.draw(st.binary(min_size=size, max_size=size))
    content = FrameContent(frame_id, False, False, size, payload)
    length = len(wire_frame(content).bits)
    places = data.draw(st.sets(st.integers(1, length - 1), min_size=1, max_size=2))
    nodes = [Station(Confinement(), content), Station(Confinement(), None)]
    play(nodes, {place: [1] for place in places})
    assert nodes[1].received in (None, content)


def test_nobody_acknowledges_a_lone_node_which_stays_passive() -> None:
    confinement = Confinement()
    for attempt in range(1, 40):
        station = Station(confinement, CONTENT)
        play([station], {})
        assert [error.kind for error in station.errors] == ["ack"]
        confinement = station.confinement
        assert confinement.tec == min(8 * attempt, 128)
    assert confinement.state is ErrorState.PASSIVE


def test_a_passive_node_that_sees_another_flag_after_a_missing_acknowledge_counts_it() -> None:
    """The exception holds only where no dominant bit shows that somebody else is there."""
    slot = wire_frame(CONTENT).ack_slot
    nodes = stations(Confinement(tec=128), Confinement())
    play(nodes, {slot: [0], slot + 5: [1]})
    assert nodes[0].confinement.tec == 136


def test_a_stuff_error_of_arbitration_is_not_counted_against_the_sender() -> None:
    # Identifier 0: bits 0 to 4 dominant, so bit 5 is a recessive stuff bit; it is read dominant.
    content = FrameContent(0, False, False, 0, b"")
    assert 5 in wire_frame(content).stuff_places
    nodes = [Station(Confinement(), content), Station(Confinement(), None)]
    play(nodes, {5: [0, 1]})
    assert [error.kind for error in nodes[0].errors] == ["stuff"]
    assert nodes[0].confinement.tec == 0
    assert nodes[1].confinement.rec >= 1


@pytest.mark.parametrize(
    ("rec", "after"), [(0, 0), (1, 0), (127, 126), (128, 127), (200, 127)], ids=str
)
def test_a_good_reception_lowers_the_receive_counter(rec: int, after: int) -> None:
    confinement = Confinement(rec=rec)
    confinement.count_received()
    assert confinement.rec == after


# --- on the bus -------------------------------------------------------------------------------


def test_a_corrupted_frame_is_reported_and_sent_again(node: OpenNode) -> None:
    sender, receiver = node(node="sender"), node(node="receiver")
    sender.inject(BusFault(kind="corruption", bits=(30,), turns=(0,)))
    sender.send(frame())
    error, good = drain(receiver, 0.01)
    assert error.is_error_frame
    assert good.data == frame().data
    assert sender.error_counters == (7, 0)  # 8 for the error, 1 off for the success
    (report,) = drain(sender, 0.01)
    assert report.is_error_frame
    assert report.data[6] == 8


def test_error_frames_can_be_left_out(node: OpenNode) -> None:
    sender, receiver = node(), node(ignore_rx_error_frames=True)
    sender.inject(BusFault(kind="corruption", bits=(30,), count=3))
    sender.send(frame())
    assert [message.is_error_frame for message in drain(receiver, 0.01)] == [False]


def test_without_retransmission_a_corrupted_frame_is_gone(node: OpenNode) -> None:
    sender, receiver = node(retransmit=False), node()
    sender.inject(BusFault(kind="corruption", bits=(30,), turns=(0,)))
    sender.send(frame())
    assert all(message.is_error_frame for message in drain(receiver, 0.01))
    assert sender.waiting_to_send == 0


def test_the_states_follow_the_counters(node: OpenNode) -> None:
    sender, receiver = node(restart=False), node(ignore_rx_error_frames=True)
    sender.inject(BusFault(kind="corruption", bits=(30,), count=32))
    sender.send(frame())
    seen = {}
    while state_of(sender) is not can.BusState.ERROR:
        report = sender.recv(0.1)
        assert report is not None
        seen[sender.error_counters[0]] = sender.state
    assert seen[120] is can.BusState.ACTIVE
    assert seen[128] is can.BusState.PASSIVE
    assert seen[248] is can.BusState.PASSIVE
    assert len(seen) == 32
    assert state_of(receiver) is can.BusState.ACTIVE
    assert receiver.recv(1.0) is None  # off means off


def test_bus_off_ends_after_128_times_11_recessive_bits(node: OpenNode) -> None:
    sender, receiver = node(restart=False), node(ignore_rx_error_frames=True)
    sender.inject(BusFault(kind="corruption", bits=(30,), count=32))
    sender.send(frame())
    while state_of(sender) is not can.BusState.ERROR:
        sender.recv(0.1)
    sender.pass_time(0.5)
    asked_s = sender.now_s
    sender.state = can.BusState.ACTIVE
    restarted = sender.recv(1.0)
    assert restarted is not None
    assert restarted.is_error_frame
    assert restarted.timestamp - asked_s == pytest.approx(128 * 11 * BIT_S, abs=11 * BIT_S)
    assert state_of(sender) is can.BusState.ACTIVE
    assert sender.error_counters == (0, 0)
    good = receiver.recv(1.0)  # the frame has waited
    assert good is not None
    assert good.data == frame().data


def test_on_a_busy_bus_every_frame_counts_for_recovery(node: OpenNode) -> None:
    sender, other = node(node="sender", ignore_rx_error_frames=True), node(node="other")
    node(node="who acknowledges")
    sender.inject(BusFault(kind="corruption", node="sender", bits=(30,), count=32))
    sender.send(frame())
    while state_of(sender) is not can.BusState.ERROR:
        other.recv(1e-4)
    for _ in range(200):
        other.send(frame(0x10))
    before = len(drain(sender, 0.1))
    assert state_of(sender) is can.BusState.ACTIVE
    # 128 sequences went by, one with each frame: it could not hear them.
    assert 200 - 130 <= before <= 200 - 126


def test_a_passive_transmitter_lets_others_go_first(node: OpenNode) -> None:
    passive, other, observer = node(node="passive"), node(), node(ignore_rx_error_frames=True)
    passive.inject(BusFault(kind="corruption", node="passive", bits=(30,), count=18))
    passive.send(frame(0x001))
    (first,) = drain(observer, 0.01)
    assert state_of(passive) is can.BusState.PASSIVE
    stamps = []
    for arbitration_id in (0x001, 0x001):
        passive.send(frame(arbitration_id))
    stamps = [message.timestamp for message in drain(observer, 0.01)]
    gap_bits = (stamps[1] - stamps[0]) / BIT_S - len(
        wire_frame(FrameContent(1, False, False, 8, CONTENT.data)).bits
    )
    assert gap_bits == pytest.approx(3 + 8)
    for arbitration_id in (0x001, 0x001):
        passive.send(frame(arbitration_id))
    other.send(frame(0x700))
    order = [message.arbitration_id for message in drain(observer, 0.01)]
    assert order == [0x001, 0x700, 0x001]
    assert first.data == frame().data


def test_two_nodes_that_send_one_identifier_with_different_data_drive_each_other_passive(
    node: OpenNode,
) -> None:
    first, second = node(), node()
    observer = node(ignore_rx_error_frames=True)
    first.send(frame(0x100, b"\x00"))
    second.send(frame(0x100, b"\x01"))
    received = drain(observer, 0.1)
    assert sorted(bytes(message.data) for message in received) == [b"\x00", b"\x01"]
    # 16 collisions, each 8 for both; then the flag of the passive loser disturbs nobody.
    assert bytes(received[0].data) == b"\x00"
    assert first.error_counters[0] == 127
    assert second.error_counters[0] == 135


def test_two_nodes_that_send_the_same_frame_at_once_both_have_sent_it(node: OpenNode) -> None:
    first, second, observer = node(), node(), node()
    first.send(frame())
    second.send(frame())
    assert len(drain(observer, 0.01)) == 1
    assert first.waiting_to_send == second.waiting_to_send == 0


def test_a_lone_sender_waits_for_somebody_to_acknowledge(node: OpenNode) -> None:
    sender = node()
    sender.send(frame())
    reports = drain(sender, 0.5)
    assert [report.data[6] for report in reports] == [8 * n for n in range(1, 17)]
    assert state_of(sender) is can.BusState.PASSIVE
    receiver = node()
    received = receiver.recv(0.01)
    assert received is not None
    assert received.data == frame().data
    assert sender.error_counters == (127, 0)
    assert state_of(sender) is can.BusState.ACTIVE
