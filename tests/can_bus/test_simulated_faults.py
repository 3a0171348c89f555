"""Faults of the simulated bus: each kind, by exact turns and by seeded chance."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import CanBusError
from can_bus.simulated import BUS_FAULT_KINDS, BusFault, BusFaultKind, SimulatedBus
from can_bus.simulated.fault_file import load_faults

_numbers = itertools.count()

OpenNode = Callable[..., SimulatedBus]


@pytest.fixture
def node() -> Iterator[OpenNode]:
    opened: list[SimulatedBus] = []
    channel = f"faults-{next(_numbers)}"

    def open_node(name: str, **arguments: object) -> SimulatedBus:
        opened.append(SimulatedBus(channel, node=name, **arguments))  # type: ignore[arg-type]
        return opened[-1]

    yield open_node
    for bus in opened:
        bus.shutdown()


def frame(number: int, arbitration_id: int = 0x100) -> can.Message:
    return can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=[number])


def send(bus: can.BusABC, count: int, arbitration_id: int = 0x100) -> None:
    for number in range(count):
        bus.send(frame(number, arbitration_id))


def numbers(bus: can.BusABC, seconds: float = 1.0) -> list[int]:
    found = []
    while (message := bus.recv(seconds)) is not None:
        if not message.is_error_frame:
            found.append(message.data[0])
    return found


def test_loss_strikes_the_receivers_named_and_nobody_else(node: OpenNode) -> None:
    sender, first, second = node("s"), node("first"), node("second")
    active = sender.inject(BusFault(kind="loss", receivers=("first",), turns=(1, 3)))
    send(sender, 5)
    assert numbers(first) == [0, 2, 4]
    assert numbers(second) == [0, 1, 2, 3, 4]
    assert active.struck == 2
    assert sender.error_counters == (0, 0)


def test_corruption_at_a_bit_costs_an_error_frame_and_no_data(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(BusFault(kind="corruption", bits=(25,), turns=(0, 2, 3)))
    send(sender, 5)
    assert numbers(receiver) == [0, 1, 2, 3, 4]


def test_delay_queues_a_frame_later(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(BusFault(kind="delay", delay_s=0.01, turns=(0,)))
    send(sender, 3)
    assert numbers(receiver) == [1, 2, 0]


def test_jitter_lies_between_nothing_and_its_bound(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.send_periodic(frame(0), 0.01)
    sender.inject(BusFault(kind="jitter", delay_s=0.005))
    stamps = [m.timestamp for m in itertools.islice(receiver, 200)]
    undisturbed = stamps[0] - stamps[0] % 0.01
    late = [stamp - undisturbed - 0.01 * n for n, stamp in enumerate(stamps)]
    assert 0 <= min(late) < 0.0005
    assert 0.0045 < max(late) < 0.0052


def test_duplication_sends_a_frame_twice(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(BusFault(kind="duplication", turns=(1,)))
    send(sender, 3)
    assert numbers(receiver) == [0, 1, 1, 2]


def test_reordering_puts_a_frame_behind_the_next_of_its_identifier(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(BusFault(kind="reordering", turns=(1,)))
    send(sender, 4)
    assert numbers(receiver) == [0, 2, 1, 3]


def test_a_frame_that_waits_for_the_next_comes_though_the_fault_was_switched_off(
    node: OpenNode,
) -> None:
    sender, receiver = node("s"), node("r")
    fault = sender.inject(BusFault(kind="reordering", turns=(1,)))
    for number in range(4):
        if number == 2:
            sender.clear(fault)
        sender.send(frame(number))
    assert numbers(receiver) == [0, 2, 1, 3]
    # Then nothing is left of it that would hold up the bus.
    assert sender._channel.faults.is_empty


def test_a_babbling_node_starves_all_below_it_and_nobody_above(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(
        BusFault(kind="babbling", node="b", arbitration_id=0x080, start_s=0.001, stop_s=0.101)
    )
    sender.send_periodic(frame(1, 0x100), 0.01)
    sender.send_periodic(frame(2, 0x010), 0.01)
    seen: dict[int, list[float]] = {0x080: [], 0x100: [], 0x010: []}
    while (message := receiver.recv(0)) is not None or receiver.now_s < 0.2:
        if message is None:
            receiver.pass_time(0.01)
        else:
            seen[message.arbitration_id].append(message.timestamp)
    starved = [stamp for stamp in seen[0x100] if 0.002 < stamp < 0.101]
    assert starved == []
    assert len(seen[0x100]) == len(seen[0x010]) == 20
    assert len(seen[0x080]) > 0.09 * receiver.bitrate / 70


def test_a_babbling_node_may_pause(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    fault = BusFault(kind="babbling", node="s", arbitration_id=1, delay_s=0.01, data=b"\x07")
    active = sender.inject(fault)
    receiver.pass_time(0.0995)
    sender.clear(active)
    assert numbers(receiver) == [7] * 10


def test_a_silent_node_neither_sends_nor_acknowledges_nor_receives(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(BusFault(kind="silence", node="r", start_s=0.0, stop_s=0.1))
    send(sender, 3)
    receiver.send(frame(9, 0x050))
    receiver.pass_time(0.0999)
    assert receiver.recv(0) is None
    assert sender.state is can.BusState.PASSIVE  # nobody acknowledges
    assert numbers(receiver) == [0, 1, 2]
    assert numbers(sender) == [9]


def trace(seed: int, probability: float, kind: BusFaultKind) -> list[str]:
    channel = f"seeded-{next(_numbers)}"
    with SimulatedBus(channel, node="a", seed=seed) as a, SimulatedBus(channel, node="b") as b:
        a.inject(
            BusFault(
                kind=kind,
                node="a",
                arbitration_id=0x100,
                probability=probability,
                bits=(20,) if kind == "corruption" else (),
                delay_s=0.001,
            )
        )
        a.send_periodic(frame(1), 0.002)
        b.pass_time(0.1)
        return [str((m.timestamp, m.arbitration_id)) for m in iter(lambda: b.recv(0), None)]


@given(st.integers(0, 2**32), st.sampled_from(BUS_FAULT_KINDS))
def test_the_same_seed_gives_the_same_bus(seed: int, kind: BusFaultKind) -> None:
    assert trace(seed, 0.3, kind) == trace(seed, 0.3, kind)


def test_the_probability_is_the_share_that_is_struck(node: OpenNode) -> None:
    sender, receiver = node("s", seed=5), node("r")
    active = sender.inject(BusFault(kind="loss", probability=0.2))
    for _ in range(40):
        send(sender, 50)
        numbers(receiver)
    # 2000 draws: five standard deviations either way.
    assert abs(active.struck - 400) < 5 * (2000 * 0.2 * 0.8) ** 0.5


def test_a_fault_acts_inside_its_window_and_so_often(node: OpenNode) -> None:
    sender, receiver = node("s"), node("r")
    sender.inject(BusFault(kind="loss", start_s=0.5, stop_s=1.5, count=1))
    lost = []
    for second in range(3):
        for number in range(2):
            sender.send(frame(number))
            if receiver.recv(0.1) is None:
                lost.append((second, number))
        receiver.pass_time(1.0 - receiver.now_s % 1.0)
    assert lost == [(1, 0)]


def test_faults_come_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(
        '[[fault]]\nkind = "loss"\nturns = [0]\n\n'
        '[[fault]]\nkind = "babbling"\nnode = "idiot"\narbitration_id = 0x700\ndata = "0aff"\n'
        "delay_s = 0.5\n"
    )
    assert load_faults(path)[1].data == b"\x0a\xff"
    with (
        can.Bus("filed", interface="chiplog", faults=str(path)) as sender,
        can.Bus("filed", interface="chiplog") as receiver,
    ):
        send(sender, 2)
        heard = [message.arbitration_id for message in itertools.islice(receiver, 2)]
        assert heard == [0x100, 0x700]


def test_babble_that_no_frame_carries_opens_nothing(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text('[[fault]]\nkind = "babbling"\nnode = "b"\narbitration_id = 0x800\n')
    with pytest.raises(can.CanInitializationError, match="0x800 does not fit 11 bits"):
        SimulatedBus("babble", faults=path)
    with SimulatedBus("babble", bitrate=125_000) as bus:
        assert bus.bitrate == 125_000


BAD_FAULTS = [
    ({"kind": "rain"}, "no bus fault 'rain': there are loss, corruption"),
    ({"kind": "silence"}, "bus fault 'silence' needs the name of a node"),
    ({"kind": "babbling", "node": "b"}, "bus fault 'babbling' needs an arbitration_id"),
    ({"kind": "delay"}, "bus fault 'delay': delay_s = 0.0: expected more than 0"),
    ({"kind": "delay", "delay_s": 0.1, "receivers": ("r",)}, "'delay': receivers: it strikes"),
    ({"kind": "corruption"}, "bus fault 'corruption' needs bits"),
    ({"kind": "corruption", "bits": (-1,)}, r"bits = \(-1,\): expected 0 to 511"),
    ({"kind": "loss", "probability": 1.5}, "probability = 1.5: expected 0 to 1"),
    ({"kind": "loss", "count": -1}, "count = -1: expected 0 or more"),
    ({"kind": "loss", "start_s": -1.0}, "start_s = -1.0: expected 0 or more"),
]


@pytest.mark.parametrize(("arguments", "complaint"), BAD_FAULTS, ids=str)
def test_a_fault_that_makes_no_sense_raises(arguments: dict[str, object], complaint: str) -> None:
    with pytest.raises(CanBusError, match=complaint):
        BusFault(**arguments)  # type: ignore[arg-type]


BAD_FILES = [
    ("kind = ", "this is no TOML file"),
    ('[fault]\nkind = "loss"\n', r"expected \[\[fault\]\] tables and nothing else"),
    ("[[fault]]\ncount = 1\n", "fault 1: kind is missing"),
    ('[[fault]]\nkind = "loss"\ncolour = 1\n', "fault 1: no field 'colour': there are kind, node"),
    ('[[fault]]\nkind = "loss"\ncount = "x"\n', "fault 1: count = 'x': expected int"),
    ('[[fault]]\nkind = "loss"\nturns = 1\n', "fault 1: turns: expected a list of int"),
    (
        '[[fault]]\nkind = "loss"\ndata = "zz"\n',
        "fault 1: data: expected bytes as hex",
    ),
    ('[[fault]]\nkind = "rain"\n', "fault 1: no bus fault 'rain'"),
]


@pytest.mark.parametrize(("text", "complaint"), BAD_FILES, ids=str)
def test_a_file_of_faults_that_is_wrong_says_where(
    tmp_path: Path, text: str, complaint: str
) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(text)
    with pytest.raises(CanBusError, match=complaint):
        load_faults(path)
