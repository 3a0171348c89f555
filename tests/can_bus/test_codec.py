"""Raw values to bytes and back: against cantools, and against itself on the fast path."""

import math
import struct
from pathlib import Path

import cantools.database.can as cantools
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from random_messages import parsed_messages, spec_of

from can_bus import CanBusError, MessageSpec, SignalSpec, load_database, parse_database, protect
from can_bus.signals import Raw

DATABASE = load_database()
SPECS = list(DATABASE.messages.values())
each_spec = pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)

MULTIPLEXED_DBC = """\
VERSION ""
NS_ :
BS_:
BU_: A B
BO_ 100 MUX: 8 A
 SG_ page M : 0|4@1+ (1,0) [0|0] "" B
 SG_ first m0 : 8|16@1- (0.5,0) [-100|100] "m" B
 SG_ second m1 : 8|8@1+ (1,0) [0|0] "" B
 SG_ always : 56|8@1+ (1,0) [0|0] "" B
"""
MUX = parse_database(MULTIPLEXED_DBC, Path("mux.dbc")).message("MUX")


@given(parsed_messages(), st.data())
def test_decoding_agrees_with_cantools(parsed: cantools.Message, data: st.DataObject) -> None:
    frame = data.draw(st.binary(min_size=parsed.length, max_size=parsed.length))
    ours = spec_of(parsed).decode_raw(frame)
    theirs = parsed.decode(frame, scaling=False, decode_choices=False)
    assert isinstance(theirs, dict)
    assert set(ours) == set(theirs)
    for name, value in ours.items():
        expected = theirs[name]
        assert isinstance(expected, (int, float))
        assert value == expected or (math.isnan(value) and math.isnan(expected))


@given(parsed_messages(), st.data())
def test_encoding_agrees_with_cantools(parsed: cantools.Message, data: st.DataObject) -> None:
    spec = spec_of(parsed)
    values: dict[str, Raw] = {s.name: data.draw(raw_values(s)) for s in spec.signals.values()}
    assert spec.encode_raw(values) == parsed.encode(values, scaling=False, strict=False)


@given(parsed_messages(max_bytes=64), st.data())
def test_encoding_inverts_decoding(parsed: cantools.Message, data: st.DataObject) -> None:
    spec = spec_of(parsed)
    values = {s.name: data.draw(raw_values(s)) for s in spec.signals.values()}
    assert spec.decode_raw(spec.encode_raw(values)) == values


@given(st.data())
def test_scaling_agrees_with_cantools(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(SPECS))
    signal = data.draw(st.sampled_from(spec.payload))
    raw = data.draw(st.integers(signal.low_raw, signal.high_raw))
    frame = spec.encode_raw({signal.name: raw})
    parsed = cantools_message(spec)
    theirs = parsed.decode(bytes(frame), decode_choices=False)
    assert isinstance(theirs, dict)
    assert signal.to_scaled(raw) == theirs[signal.name]


@given(st.data())
def test_every_raw_value_survives_its_scaled_value(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(SPECS))
    signal = data.draw(st.sampled_from(list(spec.signals.values())))
    raw = data.draw(st.integers(signal.low_raw, signal.high_raw))
    assert signal.to_raw(signal.to_scaled(raw)) == raw


@given(st.data())
def test_the_fast_path_agrees_with_the_general_one(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(SPECS))
    values = [data.draw(st.integers(s.low_code, s.high_code)) for s in spec.payload]
    counter = data.draw(st.integers(0, 14))
    frame = spec.encode_raw({s.name: v for s, v in zip(spec.payload, values, strict=True)})
    protect(spec, frame, counter)
    assert spec.pack(values, counter) == frame
    assert list(spec.unpack(frame)) == values


@each_spec
def test_bits_of_no_signal_are_zero(spec: MessageSpec) -> None:
    full = int.from_bytes(spec.pack([-1 if s.is_signed else s.high_code for s in spec.payload]))
    payload_bits = sum(s.length_bits for s in spec.payload)
    assert full.bit_count() == payload_bits


def test_numpy_integers_pack_like_plain_ones() -> None:
    spec = DATABASE.message("ODOMETRY_X")
    raw = -(2**50) + 12345
    assert spec.pack([np.int64(raw)]) == spec.pack([raw])  # type: ignore[list-item]


def test_a_number_of_values_that_does_not_fit_raises() -> None:
    with pytest.raises(CanBusError, match=r"ENCODER: 1 values for 2 signals \(left_count, right"):
        DATABASE.message("ENCODER").pack([1])


def test_a_value_that_its_bits_cannot_hold_raises() -> None:
    with pytest.raises(CanBusError, match=r"ENCODER.right_count = -1: its 17 bits hold .* 0 to"):
        DATABASE.message("ENCODER").pack([1, -1])
    with pytest.raises(CanBusError, match=r"ENCODER.left_count = 131072: its 17 bits hold"):
        DATABASE.message("ENCODER").encode_raw({"left_count": 2**17})


def test_a_fraction_is_no_raw_value() -> None:
    with pytest.raises(TypeError):
        DATABASE.message("ENCODER").pack([1.5, 0])  # type: ignore[list-item]
    with pytest.raises(CanBusError, match=r"ENCODER.left_count = 1.5: expected a raw whole"):
        DATABASE.message("ENCODER").encode_raw({"left_count": 1.5})


def test_an_unknown_signal_raises_with_the_names_there_are() -> None:
    with pytest.raises(CanBusError, match=r"COMMAND has no signal 'v': .*v_m_s, w_rad_s"):
        DATABASE.message("COMMAND").encode_scaled({"v": 1.0})


def test_a_wrong_length_raises() -> None:
    for decode in (DATABASE.message("IMU").unpack, DATABASE.message("IMU").decode_raw):
        with pytest.raises(CanBusError, match="IMU: a frame of 7 bytes, not 8"):
            decode(bytes(7))


@pytest.mark.parametrize("value", [8.0, -8.0, math.inf, math.nan, 1e300])
def test_a_scaled_value_out_of_range_raises_and_is_never_clipped(value: float) -> None:
    with pytest.raises(
        CanBusError, match=r"COMMAND.v_m_s = .* m/s: expected -7.99.* to 7.99.* m/s"
    ):
        DATABASE.message("COMMAND").encode_scaled({"v_m_s": value})


def test_ties_round_to_even() -> None:
    signal = SignalSpec(message="M", name="s", start_bit=0, length_bits=8, factor=2.0)
    assert [signal.to_raw(x) for x in (1.0, 3.0, 5.0, 7.0)] == [0, 2, 2, 4]


def test_names_of_the_value_table_are_values_too() -> None:
    status = DATABASE.message("STATUS")
    frame = status.encode_scaled({"mode": "gyro", "gyro_offset_raw": "SNA"})
    assert status.decode_raw(frame)["mode"] == status.signal("mode").raw_of_choice("gyro")
    assert status.decode_scaled(frame)["gyro_offset_raw"] is None
    with pytest.raises(
        CanBusError, match=r"STATUS.mode = 'sonar': its named values are wheel, gyro"
    ):
        status.encode_scaled({"mode": "sonar"})


@given(st.sampled_from((0.1, 0.7, 0.01, 0.001)), st.integers(1, 999))
@example(0.1, 3)
@example(0.3, 7)
def test_a_decimal_range_limit_is_inside_the_range(factor: float, code: int) -> None:
    # 0.3 / 0.1 is 2.9999999999999996 in binary: the code 3 counts as in range all the same.
    limit = round(code * factor, 6)
    signal = SignalSpec(
        message="M",
        name="s",
        start_bit=0,
        length_bits=10,
        factor=factor,
        minimum=limit,
        maximum=limit,
    )
    assert (signal.low_raw, signal.high_raw) == (code, code)


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        ("00feff0000000007", {"page": 0, "first": -2, "always": 7}),
        ("01feff0000000007", {"page": 1, "second": 254, "always": 7}),
        ("05feff0000000007", {"page": 5, "always": 7}),
    ],
)
def test_a_multiplexed_frame_has_the_signals_its_page_selects(
    frame: str, expected: dict[str, int]
) -> None:
    assert MUX.decode_raw(bytes.fromhex(frame)) == expected


def test_a_signal_of_another_page_cannot_be_sent() -> None:
    assert MUX.encode_raw({"page": 1, "second": 254, "always": 7}).hex() == "01fe000000000007"
    with pytest.raises(CanBusError, match=r"MUX.first is not in the frame: page must be one of"):
        MUX.encode_raw({"page": 1, "first": 3})


def test_a_multiplexed_message_has_no_fast_path() -> None:
    with pytest.raises(CanBusError, match="MUX is multiplexed, big endian or float"):
        MUX.pack([1, 2, 3, 4])
    with pytest.raises(CanBusError, match="MUX is multiplexed, big endian or float"):
        MUX.unpack(bytes(8))


@given(st.floats(width=32, allow_nan=False))
@example(-0.0)
def test_a_float_signal_carries_its_float(value: float) -> None:
    signal = SignalSpec(message="M", name="s", start_bit=0, length_bits=32, is_float=True)
    spec = MessageSpec("M", 1, False, 4, {"s": signal})
    assert spec.encode_raw({"s": value}) == struct.pack("<f", value)
    assert struct.pack("<f", spec.decode_raw(struct.pack("<f", value))["s"]) == struct.pack(
        "<f", value
    )


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_float_that_is_no_number_is_never_in_range(value: float) -> None:
    signal = SignalSpec(message="M", name="s", start_bit=0, length_bits=64, is_float=True)
    assert not signal.in_range(value)


def test_a_float_too_large_for_its_bits_raises() -> None:
    signal = SignalSpec(message="M", name="s", start_bit=0, length_bits=32, is_float=True)
    with pytest.raises(CanBusError, match=r"M.s = 1e\+39: not a float of 32 bits"):
        signal.to_bits(1e39)


def raw_values(signal: SignalSpec) -> st.SearchStrategy[Raw]:
    if signal.is_float:
        width = signal.length_bits
        return st.floats(width=width, allow_nan=False)  # type: ignore[arg-type]
    return st.integers(signal.low_code, signal.high_code)


def cantools_message(spec: MessageSpec) -> cantools.Message:
    message = PARSED.get_message_by_name(spec.name)
    assert isinstance(message, cantools.Message)
    return message


def _parse_shipped() -> cantools.Database:
    database = cantools.Database()
    database.add_dbc_file(str(DATABASE.path))
    return database


PARSED = _parse_shipped()
