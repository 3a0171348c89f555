"""Frame lengths on the bus, against an encoder that writes the frame as text."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wire_text import frame_as_text

from can_bus import (
    CanBusError,
    frame_length_bits,
    frame_length_bits_array,
    worst_length_bits,
)
from can_bus.timing import crc15

frame_ids = st.one_of(
    st.tuples(st.integers(0, 2**11 - 1), st.just(False)),
    st.tuples(st.integers(0, 2**29 - 1), st.just(True)),
)
payloads = st.one_of(
    st.binary(max_size=8), st.lists(st.sampled_from([0, 0xFF, 0x0F]), max_size=8).map(bytes)
)


@given(frame_ids, payloads)
def test_a_data_frame_is_as_long_as_the_encoder_writes_it(
    identifier: tuple[int, bool], data: bytes
) -> None:
    assert frame_length_bits(*identifier, data) == len(frame_as_text(*identifier, data))


@given(frame_ids, st.integers(0, 8))
def test_a_remote_frame_is_as_long_as_the_encoder_writes_it(
    identifier: tuple[int, bool], dlc: int
) -> None:
    expected = len(frame_as_text(*identifier, b"", dlc))
    assert frame_length_bits(*identifier, b"", remote_dlc=dlc) == expected


@given(frame_ids, st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=20))
def test_a_column_of_frames_is_as_long_as_each(
    identifier: tuple[int, bool], rows: list[bytes]
) -> None:
    data = np.frombuffer(b"".join(rows), dtype=np.uint8).reshape(-1, 8)
    lengths = frame_length_bits_array(*identifier, data)
    assert lengths.tolist() == [frame_length_bits(*identifier, row) for row in rows]


@pytest.mark.parametrize("size", range(9))
def test_columns_of_every_length_agree(size: int) -> None:
    data = np.arange(3 * size, dtype=np.uint8).reshape(3, size)
    lengths = frame_length_bits_array(0x123, False, data)
    assert lengths.tolist() == [frame_length_bits(0x123, False, bytes(row)) for row in data]


@given(frame_ids, payloads)
def test_no_frame_is_longer_than_the_published_worst_case(
    identifier: tuple[int, bool], data: bytes
) -> None:
    # Davis, Burns, Bril, Lukkien 2007: g + 8n + 13 + floor((g + 8n - 1)/4) with the intermission,
    # g = 34 (11-bit identifiers) or 54 (29-bit); 13 = 10 unstuffed bits + 3 of intermission.
    stuffable = (54 if identifier[1] else 34) + 8 * len(data)
    worst = stuffable + 10 + (stuffable - 1) // 4
    assert stuffable + 10 <= frame_length_bits(*identifier, data) <= worst
    assert worst_length_bits(identifier[1], len(data)) == worst


def test_the_worst_length_of_eight_bytes_is_the_one_everybody_quotes() -> None:
    # Davis et al.: 135 and 160 bits with the intermission of 3.
    assert [worst_length_bits(is_extended, 8) + 3 for is_extended in (False, True)] == [135, 160]


def test_the_crc_has_its_catalogued_check_value() -> None:
    # CRC-15/CAN of the ASCII digits 1 to 9.
    bits = [byte >> position & 1 for byte in b"123456789" for position in range(7, -1, -1)]
    assert crc15(bits) == 0x059E


@pytest.mark.parametrize(
    ("frame_id", "is_extended", "data"),
    [(1 << 11, False, b""), (1 << 29, True, b""), (-1, False, b""), (0, False, bytes(9))],
)
def test_what_no_classic_frame_carries_raises(
    frame_id: int, is_extended: bool, data: bytes
) -> None:
    with pytest.raises(CanBusError, match=r"does not fit|a classic data frame has 0 to 8"):
        frame_length_bits(frame_id, is_extended, data)
