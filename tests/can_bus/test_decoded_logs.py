"""A whole log decoded by DBC: cantools' decode_message frame by frame, bit for bit."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import cantools.database.can as cantools
import numpy as np
import pytest
from cantools.database import DecodeError, load_string
from hypothesis import given
from hypothesis import strategies as st
from random_messages import multiplexed_messages, parsed_messages

from can_bus import decode_log, load_database, parse_database

FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


@st.composite
def databases(draw: st.DrawFn) -> cantools.Database:
    """Draw a database of one to four messages, plain and multiplexed."""
    messages = []
    for number in range(draw(st.integers(1, 4))):
        frame_id, name = draw(st.integers(0, 255)) * 8 + number, f"MESSAGE_{number}"
        kind = draw(st.sampled_from((parsed_messages, parsed_messages, multiplexed_messages)))
        if kind is parsed_messages:
            messages.append(draw(parsed_messages(64, frame_id, name)))
        else:
            messages.append(draw(multiplexed_messages(frame_id, name)))
    return cantools.Database(messages=messages)


def line(message: cantools.Message, data: bytes, stamp: int) -> str:
    """Return a candump line, of CAN FD where the data are longer than eight bytes."""
    width = 8 if message.is_extended_frame else 3
    mark = "#" if len(data) <= 8 else "##1"
    return f"({stamp}.000000) can0 {message.frame_id:0{width}X}{mark}{data.hex()}\n"


def same_bits(ours: float, theirs: float) -> bool:
    if math.isnan(ours) or math.isnan(theirs):
        return math.isnan(ours) and math.isnan(theirs)
    return struct.pack("<d", ours) == struct.pack("<d", float(theirs))


@given(database=databases(), data=st.data())
def test_every_frame_is_decoded_as_cantools_does_bit_for_bit(
    database: cantools.Database, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    text = database.as_dbc_string()
    theirs = load_string(text, "dbc")
    ours = parse_database(text, Path("random.dbc"))
    frames = []
    for stamp in range(data.draw(st.integers(1, 8))):
        message = data.draw(st.sampled_from(theirs.messages))
        size = next(length for length in FD_LENGTHS if length >= message.length)
        frames.append((message, data.draw(st.binary(min_size=size, max_size=size)), stamp))
    path = tmp_path_factory.mktemp("decoded") / "bus.log"
    path.write_text("".join(line(*frame) for frame in frames))
    decoded = decode_log(path, ours)
    raw_columns = {name: columns.raw() for name, columns in decoded.items()}
    seen = dict.fromkeys(decoded, 0)
    for message, payload, stamp in frames:
        columns, row = decoded[message.name], seen[message.name]
        seen[message.name] += 1
        assert columns.timestamp_us[row] == stamp * 10**6
        arguments = {"decode_choices": False}
        try:
            scaled = theirs.decode_message(message.name, payload, **arguments)
            raw = theirs.decode_message(message.name, payload, scaling=False, **arguments)
        except DecodeError:  # a page that the message has not: what lies on none is there
            scaled = raw = {}
        for name, value in scaled.items():
            assert same_bits(columns.values[name][row].item(), value), name
            assert same_bits(
                float(raw_columns[message.name][name][row].item()), float(raw[name])
            ), name
            if not isinstance(raw[name], float):
                assert raw_columns[message.name][name][row].item() == raw[name]
        if scaled:
            absent = {n for n in columns.values if math.isnan(columns.values[n][row])}
            assert absent >= set(columns.values) - set(scaled)
    assert seen == {name: len(columns.rows) for name, columns in decoded.items()}


@pytest.mark.parametrize(
    ("length_bits", "is_signed", "factor", "offset"),
    [(64, False, 3, -40), (64, True, 3, 7), (63, False, 1, 1), (60, True, -5, 0)],
)
def test_whole_numbers_beyond_a_float_are_rounded_once(
    length_bits: int, is_signed: bool, factor: int, offset: int, tmp_path: Path
) -> None:
    sign = "-" if is_signed else "+"
    text = (
        'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 5 M: 8 A\n'
        f' SG_ s : 0|{length_bits}@1{sign} ({factor},{offset}) [0|0] "" A\n'
    )
    theirs, ours = load_string(text, "dbc"), parse_database(text, Path("m.dbc"))
    rows = [bytes([k, 1, 2, 3, 5, 7, 11, 255 - k]) for k in range(0, 256, 5)]
    path = tmp_path / "bus.log"
    path.write_text("".join(f"(1.000000) can0 005#{row.hex()}\n" for row in rows))
    exact = [theirs.decode_message(5, row)["s"] for row in rows]
    np.testing.assert_array_equal(decode_log(path, ours)["M"].values["s"], list(map(float, exact)))


def test_short_remote_and_error_frames_and_those_of_others_are_left_out(tmp_path: Path) -> None:
    database = load_database()
    spec = database.message("ENCODER")
    name = f"{spec.frame_id:03X}"
    path = tmp_path / "bus.log"
    path.write_text(
        f"(1.000000) c {name}#0011\n(2.000000) c {name}#R8\n(3.000000) c 7FF#{'00' * 8}\n"
        f"(4.000000) c {spec.frame_id:08X}#{'00' * 8}\n(5.000000) c {name}#{'00' * 8}\n"
        f"(6.000000) c 20000080#{'00' * 8}\n(7.000000) c {name}##1{'01' * 12}\n"
    )
    decoded = decode_log(path, database)
    assert list(decoded) == ["ENCODER"]
    assert decoded["ENCODER"].rows.tolist() == [4, 6]
    assert decoded["ENCODER"].timestamp_us.tolist() == [5_000_000, 7_000_000]


def test_an_empty_log_decodes_to_nothing(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("")
    assert decode_log(path, load_database()) == {}
