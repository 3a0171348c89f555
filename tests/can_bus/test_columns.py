"""The array codec against the scalar one, frame by frame."""

from pathlib import Path

import cantools.database.can as cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_messages import parsed_messages, spec_of

from can_bus import (
    CanBusError,
    decode_columns,
    decode_columns_scaled,
    load_database,
    parse_database,
    present_columns,
)

DATABASE = load_database()

MULTIPLEXED_DBC = """\
VERSION ""
NS_ :
BS_:
BU_: A B
BO_ 100 MUX: 3 A
 SG_ page M : 0|8@1+ (1,0) [0|0] "" B
 SG_ first m0 : 8|16@1- (0.5,0) [-100|100] "m" B
 SG_ second m1 : 8|8@1+ (1,0) [0|0] "" B
VAL_ 100 second 255 "SNA" ;
"""
MUX = parse_database(MULTIPLEXED_DBC, Path("mux.dbc")).message("MUX")


def as_columns(rows: list[bytes]) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    return np.frombuffer(b"".join(rows), dtype=np.uint8).reshape(len(rows), -1)


@given(parsed_messages(max_bytes=64), st.data())
def test_every_column_is_the_scalar_decoding_of_its_frames(
    parsed: cantools.Message, data: st.DataObject
) -> None:
    spec = spec_of(parsed)
    frame = st.binary(min_size=spec.length_bytes, max_size=spec.length_bytes)
    rows = data.draw(st.lists(frame, min_size=1, max_size=8))
    columns = decode_columns(spec, as_columns(rows))
    for row, values in enumerate(map(spec.decode_raw, rows)):
        for name, value in values.items():
            np.testing.assert_equal(columns[name][row].item(), value)


@given(st.data())
def test_scaled_columns_are_the_scalar_scaling(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(list(DATABASE.messages.values())))
    rows = data.draw(st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=8))
    columns = decode_columns_scaled(spec, as_columns(rows))
    for row, values in enumerate(map(spec.decode_scaled, rows)):
        for name, value in values.items():
            np.testing.assert_equal(columns[name][row], np.nan if value is None else value)


def test_a_multiplexed_signal_is_present_on_its_page_only() -> None:
    data = as_columns([b"\0\xfe\xff", b"\x01\x07\0", b"\x01\xff\0", b"\x02\0\0"])
    raw = decode_columns(MUX, data)
    present = present_columns(MUX, raw)
    assert present["first"].tolist() == [True, False, False, False]
    assert present["second"].tolist() == [False, True, True, False]
    scaled = decode_columns_scaled(MUX, data)
    np.testing.assert_equal(scaled["first"], [-1.0, np.nan, np.nan, np.nan])
    np.testing.assert_equal(scaled["second"], [np.nan, 7.0, np.nan, np.nan])  # 255 is SNA


def test_columns_beyond_the_message_are_ignored() -> None:
    data = np.zeros((2, 8), dtype=np.uint8)
    data[:, 3:] = 0xFF
    assert decode_columns(MUX, data)["first"].tolist() == [0, 0]


@pytest.mark.parametrize(
    "data",
    [
        np.zeros((2, 2), dtype=np.uint8),
        np.zeros(8, dtype=np.uint8),
        np.zeros((2, 8), dtype=np.int64),
    ],
)
def test_an_array_that_is_no_column_of_frames_raises(
    data: np.ndarray[tuple[int, ...], np.dtype[np.uint8]],
) -> None:
    with pytest.raises(CanBusError, match=r"MUX: frames of shape .*: expected uint8\[frames, at l"):
        decode_columns(MUX, data)


def test_no_frames_decode_to_empty_columns() -> None:
    spec = DATABASE.message("IMU")
    columns = decode_columns_scaled(spec, np.zeros((0, 8), dtype=np.uint8))
    assert all(len(column) == 0 for column in columns.values())
