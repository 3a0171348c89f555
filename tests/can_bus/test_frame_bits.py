"""A frame bit by bit: what is sent is what the independent encoder writes, and is read back."""

from hypothesis import given
from hypothesis import strategies as st
from wire_text import frame_as_text

from can_bus.simulated.confinement import Confinement
from can_bus.simulated.disturbed_frame import Station, play
from can_bus.simulated.frame_bits import FrameContent, Receiver, wire_frame
from can_bus.simulated.queues import arbitration_key


@st.composite
def contents(draw: st.DrawFn) -> FrameContent:
    is_extended = draw(st.booleans())
    frame_id = draw(st.integers(0, 2 ** (29 if is_extended else 11) - 1))
    if draw(st.integers(0, 9)) == 0:
        return FrameContent(frame_id, is_extended, True, draw(st.integers(0, 8)), b"")
    choices = st.one_of(
        st.binary(max_size=8), st.lists(st.sampled_from([0, 0xFF, 0x0F]), max_size=8).map(bytes)
    )
    data = draw(choices)
    return FrameContent(frame_id, is_extended, False, len(data), data)


def as_text(content: FrameContent) -> str:
    remote_dlc = content.dlc if content.is_remote else None
    return frame_as_text(content.arbitration_id, content.is_extended, content.data, remote_dlc)


@given(contents())
def test_a_transmitter_sends_what_the_encoder_writes(content: FrameContent) -> None:
    wire = wire_frame(content)
    expected = as_text(content)
    # The encoder draws the acknowledge slot as it is on the wire, the transmitter sends recessive.
    expected = expected[: wire.ack_slot] + "1" + expected[wire.ack_slot + 1 :]
    assert "".join(map(str, wire.bits)) == expected


@given(contents())
def test_a_receiver_reads_what_was_sent_and_acknowledges_it(content: FrameContent) -> None:
    receiver = Receiver()
    readings = []
    for place, bit in enumerate(map(int, as_text(content))):
        assert receiver.acknowledges is (place == wire_frame(content).ack_slot)
        readings.append(receiver.feed(bit))
    assert [reading for reading in readings if reading] == ["accepted", "end"]
    assert receiver.content == content


@given(contents())
def test_bit_by_bit_a_frame_takes_as_long_as_it_is(content: FrameContent) -> None:
    stations = [Station(Confinement(9, 0), content), Station(Confinement(0, 9), None)]
    assert play(stations, {}) == len(as_text(content))
    assert stations[0].has_sent
    assert stations[1].received == content
    assert [(s.confinement.tec, s.confinement.rec) for s in stations] == [(8, 0), (0, 8)]


@given(contents(), contents())
def test_on_the_wire_the_smaller_arbitration_field_wins(
    first: FrameContent, second: FrameContent
) -> None:
    keys = [arbitration_key(c.arbitration_id, c.is_extended, c.is_remote) for c in (first, second)]
    if keys[0] == keys[1]:
        return
    stations = [Station(Confinement(), c) for c in (first, second)]
    stations.append(Station(Confinement(), None))
    winner, loser = (0, 1) if keys[0] < keys[1] else (1, 0)
    assert play(stations, {}) == len(as_text((first, second)[winner]))
    assert stations[winner].has_sent
    assert not stations[loser].has_sent
    assert stations[loser].received == stations[2].received == (first, second)[winner]
