"""Faults strike exactly what they say, and the same way every time."""

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import (
    FAULT_KINDS,
    CanBusError,
    Fault,
    FaultInjector,
    load_database,
    make_message,
    timestamp_us,
)
from can_bus.faults import FaultKind

DATABASE = load_database()
TICK_US = DATABASE.message("ENCODER").cycle_time_us or 0


def frame(name: str, tick: int) -> can.Message:
    spec = DATABASE.message(name)
    values = [signal.low_raw for signal in spec.payload]
    return make_message(spec, spec.pack(values, tick % 15), tick * TICK_US)


def run(injector: FaultInjector, ticks: int) -> list[list[tuple[str, int]]]:
    """Send one encoder and one IMU frame a tick; return (name, stamp) of what comes out."""
    delivered = []
    for tick in range(ticks):
        out = injector.transfer(tick * TICK_US, [frame("ENCODER", tick), frame("IMU", tick)])
        delivered.append([(name_of(message), timestamp_us(message)) for message in out])
    return delivered


def name_of(message: can.Message) -> str:
    spec = DATABASE.by_id(message.arbitration_id, message.is_extended_id)
    assert spec is not None
    return spec.name


def with_faults(*faults: Fault, seed: int = 0) -> FaultInjector:
    injector = FaultInjector(DATABASE, seed)
    for fault in faults:
        injector.add(fault)
    return injector


def test_without_faults_the_very_frames_pass() -> None:
    frames = [frame("ENCODER", 0), frame("IMU", 0)]
    out = with_faults().transfer(0, frames)
    assert all(a is b for a, b in zip(out, frames, strict=True))


def test_drop_loses_so_many_frames_of_one_message() -> None:
    out = run(with_faults(Fault(kind="drop", message="ENCODER", count=2)), 4)
    assert [[name for name, _ in tick] for tick in out] == [
        ["IMU"],
        ["IMU"],
        ["ENCODER", "IMU"],
        ["ENCODER", "IMU"],
    ]


def test_a_fault_acts_only_inside_its_window() -> None:
    fault = Fault(kind="drop", message="IMU", start_us=TICK_US, stop_us=3 * TICK_US)
    out = run(with_faults(fault), 5)
    assert [len(tick) for tick in out] == [2, 1, 1, 2, 2]


def test_silence_loses_all_that_a_node_sends() -> None:
    injector = with_faults(Fault(kind="silence", node="PLANT"))
    frames = [frame("ENCODER", 0), frame("COMMAND", 0), frame("ODOMETRY_X", 0), frame("IMU", 0)]
    assert [name_of(m) for m in injector.transfer(0, frames)] == ["COMMAND", "ODOMETRY_X"]
    assert injector.struck["silence"] == 2


def test_delay_holds_a_frame_back_and_stamps_it_at_delivery() -> None:
    fault = Fault(kind="delay", message="ENCODER", delay_us=TICK_US + 1, count=1)
    out = run(with_faults(fault), 4)
    assert out == [
        [("IMU", 0)],
        [("ENCODER", TICK_US), ("IMU", TICK_US)],
        [("ENCODER", 2 * TICK_US), ("ENCODER", 2 * TICK_US), ("IMU", 2 * TICK_US)],
        [("ENCODER", 3 * TICK_US), ("IMU", 3 * TICK_US)],
    ]


def test_frames_held_back_come_out_in_the_order_they_are_due() -> None:
    injector = with_faults(
        Fault(kind="delay", message="ENCODER", delay_us=2 * TICK_US, count=1),
        Fault(kind="delay", message="IMU", delay_us=TICK_US, count=1),
    )
    injector.transfer(0, [frame("ENCODER", 0), frame("IMU", 0)])
    assert [name_of(m) for m in injector.transfer(5 * TICK_US, [])] == ["IMU", "ENCODER"]


def test_frames_held_back_still_come_out_after_clear() -> None:
    injector = with_faults(Fault(kind="delay", delay_us=TICK_US))
    assert injector.transfer(0, [frame("IMU", 0)]) == []
    injector.clear()
    assert [name_of(m) for m in injector.transfer(TICK_US, [])] == ["IMU"]
    assert injector.transfer(2 * TICK_US, []) == []


def test_duplicate_delivers_twice_with_separate_data() -> None:
    injector = with_faults(Fault(kind="duplicate", message="IMU"))
    first, second = injector.transfer(0, [frame("IMU", 0)])
    assert first.data == second.data
    assert first.data is not second.data


@given(st.integers(0, 63))
def test_corrupt_inverts_exactly_the_bit_asked_for(bit: int) -> None:
    sent = frame("IMU", 0)
    before = bytes(sent.data)
    (received,) = with_faults(Fault(kind="corrupt", bit=bit)).transfer(0, [sent])
    difference = int.from_bytes(before, "little") ^ int.from_bytes(received.data, "little")
    assert difference == 1 << bit
    assert bytes(sent.data) == before  # the sender's own frame is not touched


def test_corrupt_without_a_bit_draws_one() -> None:
    injector = with_faults(Fault(kind="corrupt"))
    bits = set()
    for _ in range(200):
        sent = frame("IMU", 0)
        (received,) = injector.transfer(0, [sent])
        flipped = int.from_bytes(sent.data, "little") ^ int.from_bytes(received.data, "little")
        assert flipped.bit_count() == 1
        bits.add(flipped)
    assert len(bits) > 50


def test_a_frame_without_data_cannot_be_corrupted() -> None:
    empty = can.Message(arbitration_id=1, is_extended_id=False)
    (received,) = with_faults(Fault(kind="corrupt")).transfer(0, [empty])
    assert received is empty


@given(st.integers(0, 2**32), st.sampled_from(FAULT_KINDS))
def test_the_same_seed_strikes_the_same_frames(seed: int, kind: FaultKind) -> None:
    fault = Fault(kind=kind, node="PLANT", probability=0.3, delay_us=TICK_US)
    first = run(with_faults(fault, seed=seed), 30)
    assert run(with_faults(fault, seed=seed), 30) == first


def test_another_fault_does_not_shift_the_draws_of_the_first() -> None:
    lossy = Fault(kind="drop", message="ENCODER", probability=0.5)
    alone = run(with_faults(lossy), 60)
    accompanied = run(with_faults(lossy, Fault(kind="duplicate", message="IMU")), 60)
    encoders = [[entry for entry in tick if entry[0] == "ENCODER"] for tick in alone]
    assert encoders == [[e for e in tick if e[0] == "ENCODER"] for tick in accompanied]


def test_the_probability_is_the_share_that_is_struck() -> None:
    # 3000 draws: 5 standard deviations of the share are 0.046.
    injector = with_faults(Fault(kind="drop", message="IMU", probability=0.4))
    run(injector, 3000)
    assert abs(injector.struck["drop"] / 3000 - 0.4) < 0.046


BAD_FAULTS = [
    ({"kind": "explode"}, r"no fault 'explode': there are drop, delay"),
    ({"kind": "silence"}, r"fault 'silence' needs the name of a node"),
    ({"kind": "delay"}, r"fault 'delay': delay_us = 0: expected more than 0"),
    ({"kind": "drop", "probability": 1.5}, r"probability = 1.5: expected 0 to 1"),
    ({"kind": "drop", "count": -1}, r"count = -1: expected 0 or more"),
    ({"kind": "corrupt", "bit": -1}, r"bit = -1: expected 0 or more"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD_FAULTS)
def test_a_fault_that_makes_no_sense_raises(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(CanBusError, match=message):
        Fault(**arguments)  # type: ignore[arg-type]


def test_a_fault_on_something_unknown_raises() -> None:
    with pytest.raises(CanBusError, match="no message 'ODOMETER'"):
        with_faults(Fault(kind="drop", message="ODOMETER"))
    with pytest.raises(CanBusError, match="no node 'TOASTER'"):
        with_faults(Fault(kind="silence", node="TOASTER"))
