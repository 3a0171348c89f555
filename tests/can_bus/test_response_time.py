"""Worst-case response times: the analysis of 2007 against the simulated bus, frame by frame."""

from __future__ import annotations

import itertools
import random
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import can
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from can_bus import (
    CanBusError,
    QueuedFrame,
    frame_length_bits,
    response_times,
    worst_length_bits,
)
from can_bus.response_time import utilisation
from can_bus.simulated import SimulatedBus
from can_bus.simulated.queues import arbitration_key

BITRATE = 500_000
BIT_NS = 2_000
MS = 1_000_000
INTERMISSION = 3
_numbers = itertools.count()


class Stream(NamedTuple):
    """A frame that is sent every so often, first at `offset_ns`, by one of the nodes."""

    arbitration_id: int
    data: bytes
    period_ns: int
    offset_ns: int = 0
    node: int = 0

    @property
    def message(self) -> can.Message:
        return can.Message(arbitration_id=self.arbitration_id, is_extended_id=False, data=self.data)

    def queued(self, *, is_worst: bool) -> QueuedFrame:
        length = (
            worst_length_bits(False, len(self.data))
            if is_worst
            else frame_length_bits(self.arbitration_id, False, self.data)
        )
        key = arbitration_key(self.arbitration_id, False, False)
        return QueuedFrame(hex(self.arbitration_id), key, length, self.period_ns)


def measured_ns(
    streams: Sequence[Stream], duration_ns: int, tx_order: str = "priority", bitrate: int = BITRATE
) -> Mapping[int, list[int]]:
    """Return, by identifier, from each release to the end of the intermission after its frame."""
    channel = f"response-{next(_numbers)}"
    count = max(stream.node for stream in streams) + 1
    nodes = [SimulatedBus(channel, bitrate=bitrate, tx_order=tx_order) for _ in range(count)]  # type: ignore[arg-type]
    observer = SimulatedBus(channel)
    responses: defaultdict[int, list[int]] = defaultdict(list)
    by_id = {stream.arbitration_id: stream for stream in streams}
    try:
        for stream in streams:
            bus, message = nodes[stream.node], stream.message
            for release_ns in range(stream.offset_ns, duration_ns, stream.period_ns):
                bus.at_ns(release_ns, lambda bus=bus, message=message: bus.send(message))  # type: ignore[misc]
        observer.pass_until_ns(duration_ns)
        intermission_ns = INTERMISSION * 1_000_000_000 // bitrate
        while (message := observer.recv(0)) is not None:  # type: ignore[assignment]
            stream = by_id[message.arbitration_id]
            seen = responses[message.arbitration_id]
            release_ns = stream.offset_ns + len(seen) * stream.period_ns
            seen.append(round(message.timestamp * 1e9) + intermission_ns - release_ns)
    finally:
        for bus in (*nodes, observer):
            bus.shutdown()
    return responses


@st.composite
def frame_sets(draw: st.DrawFn) -> list[Stream]:
    identifiers = draw(st.lists(st.integers(0, 0x7FF), min_size=2, max_size=6, unique=True))
    streams = [
        Stream(
            arbitration_id,
            draw(st.binary(max_size=8)),
            draw(st.integers(500, 8_000)) * 1_000,
            draw(st.integers(0, 4_000)) * 1_000,
            draw(st.integers(0, 2)),
        )
        for arbitration_id in identifiers
    ]
    assume(utilisation([s.queued(is_worst=True) for s in streams], BITRATE) < 1)
    return streams


@given(frame_sets())
@settings(max_examples=100)
def test_with_priority_queues_no_response_exceeds_the_bound(streams: list[Stream]) -> None:
    bounds = response_times([s.queued(is_worst=True) for s in streams], BITRATE)
    measured = measured_ns(streams, 60 * MS)
    for stream in streams:
        (bound,) = [b for b in bounds if b.frame.name == hex(stream.arbitration_id)]
        assert bound.response_s is not None
        worst_ns = max(measured[stream.arbitration_id], default=0)
        assert worst_ns <= bound.response_s * 1e9 + 1e-3


def at_the_critical_instant(
    streams: Sequence[Stream], place: int, bitrate: int = BITRATE
) -> list[int]:
    """Return the responses of one stream when all above it are released with it.

    That is one bit after the longest frame below it began; `streams` is in order of priority.
    """
    bit_ns = 1_000_000_000 // bitrate
    below = streams[place + 1 :]
    duration_ns = 40 * MS
    release_ns = bit_ns if below else 0
    chosen = [s._replace(offset_ns=release_ns, node=n) for n, s in enumerate(streams[: place + 1])]
    if below:
        longest = max(below, key=lambda s: s.queued(is_worst=False).length_bits)
        chosen.append(longest._replace(offset_ns=0, period_ns=10 * duration_ns, node=len(chosen)))
    found = measured_ns(chosen, duration_ns, bitrate=bitrate)
    return found[streams[place].arbitration_id]


@given(frame_sets())
@settings(max_examples=100)
def test_fed_the_actual_lengths_the_analysis_is_met_within_one_bit(streams: list[Stream]) -> None:
    ordered = sorted(streams)
    frames = [s.queued(is_worst=False) for s in ordered]
    bounds = response_times(frames, BITRATE)
    # A release within a bit of a start of frame is counted by the paper and may miss it here.
    strict = response_times(frames, BITRATE, arbitration_bits=-1)
    for place, (bound, same) in enumerate(zip(bounds, strict, strict=True)):
        if bound == same and bound.response_s is not None:
            worst_ns = max(at_the_critical_instant(ordered, place))
            assert 0 <= bound.response_s * 1e9 - worst_ns <= BIT_NS + 1e-3


def payload_of(arbitration_id: int, length_bits: int, seed: int) -> bytes:
    """Return eight bytes that make a frame exactly so long."""
    stream = random.Random(seed)
    while True:
        data = bytes(
            stream.choice((0x00, 0xFF, 0x0F, 0x55, stream.randrange(256))) for _ in range(8)
        )
        if frame_length_bits(arbitration_id, False, data) == length_bits:
            return data


def test_the_worst_case_need_not_be_the_first_instance() -> None:
    """The paper's own example (its table 3): three frames of 1 ms each at 125 kbit/s."""
    streams = [
        Stream(identifier, payload_of(identifier, 125 - INTERMISSION, identifier), period_ns)
        for identifier, period_ns in ((0x101, 2_500_000), (0x102, 3_500_000), (0x103, 3_500_000))
    ]
    bounds = response_times([s.queued(is_worst=False) for s in streams], 125_000)
    assert [b.response_s for b in bounds] == pytest.approx([2e-3, 3e-3, 3.5e-3])
    assert [b.instance for b in bounds] == [0, 0, 1]
    last = at_the_critical_instant(streams, 2, 125_000)
    assert last[0] == 3_000_000
    assert max(last) == last[1] == 3_500_000


def test_with_fifo_queues_the_bound_does_not_hold() -> None:
    """An urgent frame waits behind others of its node, which wait for other nodes."""
    streams = [
        Stream(0x010, bytes(8), 5 * MS, 0, 0),
        Stream(0x700, bytes(8), 5 * MS, 0, 0),
        *(Stream(0x100 + n, bytes(8), 5 * MS, 0, 1) for n in range(8)),
    ]
    # The slow frame is queued first.
    ordered = [streams[1], streams[0], *streams[2:]]
    bounds = response_times([s.queued(is_worst=True) for s in streams], BITRATE)
    urgent = next(b for b in bounds if b.frame.name == "0x10")
    assert urgent.response_s is not None
    by_priority = max(measured_ns(ordered, 50 * MS)[0x010])
    by_order = max(measured_ns(ordered, 50 * MS, "fifo")[0x010])
    assert by_priority <= urgent.response_s * 1e9 < by_order


def test_frames_that_ask_for_too_much_have_no_bound() -> None:
    frames = [QueuedFrame("A", 1, 132, 500_000), QueuedFrame("B", 2, 132, 500_000)]
    first, second = response_times(frames, BITRATE)
    assert first.response_s == pytest.approx(2 * 135 / BITRATE)
    assert second.response_s is None


def test_jitter_of_those_above_and_of_its_own_lengthens_a_response() -> None:
    frames = [QueuedFrame("A", 1, 97, MS, 100_000), QueuedFrame("B", 2, 97, 5 * MS, 50_000)]
    first, second = response_times(frames, BITRATE)
    assert first.response_s == pytest.approx(100e-6 + 2 * 200e-6)
    assert second.response_s == pytest.approx(50e-6 + 2 * 200e-6)
    late = [frames[0]._replace(jitter_ns=850_000), frames[1]]
    assert response_times(late, BITRATE)[1].response_s == pytest.approx(50e-6 + 3 * 200e-6)


@pytest.mark.parametrize(
    ("frames", "bitrate", "complaint"),
    [
        ([QueuedFrame("A", 1, 100, MS), QueuedFrame("B", 1, 100, MS)], BITRATE, "A and B have the"),
        ([QueuedFrame("A", 1, 100, 0)], BITRATE, "A: length 100 bits, period 0 ns"),
        ([QueuedFrame("A", 1, 100, MS)], 0, "bitrate = 0"),
    ],
)
def test_what_cannot_be_analysed_raises(
    frames: list[QueuedFrame], bitrate: int, complaint: str
) -> None:
    with pytest.raises(CanBusError, match=complaint):
        response_times(frames, bitrate)
