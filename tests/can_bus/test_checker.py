"""What a receiver accepts, what it rejects and under which reason it counts it."""

import math
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import (
    REASONS,
    Accepted,
    CanBusError,
    FrameChecker,
    MessageSpec,
    load_database,
    make_message,
    parse_database,
    protect,
)

DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")
TICK_US = ENCODER.cycle_time_us or 0
MAX_AGE_US = 15_000

PLAIN_DBC = """\
VERSION ""
NS_ :
BS_:
BU_: A B
BO_ 2147483749 WIDE: 4 A
 SG_ level : 7|16@0- (0.5,0) [-100|100] "V" B
 SG_ word : 16|8@1+ (1,0) [0|200] "" B
BO_ 102 REAL: 4 A
 SG_ value : 0|32@1- (1,0) [-10|10] "m" B
VAL_ 2147483749 word 100 "SNA" ;
SIG_VALTYPE_ 102 value : 1;
"""
PLAIN = parse_database(PLAIN_DBC, Path("plain.dbc"))


def checker(*names: str) -> FrameChecker:
    return FrameChecker(DATABASE, names or ("ENCODER", "IMU", "COMMAND"), max_age_us=MAX_AGE_US)


def encoder(tick: int, left: int = 1, right: int = 2) -> can.Message:
    return make_message(ENCODER, ENCODER.pack((left, right), tick % 15), tick * TICK_US)


def check(
    receiver: FrameChecker, message: can.Message, now_us: int | None = None
) -> Accepted | None:
    return receiver.check(message, round(message.timestamp * 1e6) if now_us is None else now_us)


def rejections(receiver: FrameChecker) -> dict[str, int]:
    return {reason: count for reason, count in receiver.rejected.items() if count}


def test_a_good_frame_is_accepted_with_its_raw_values() -> None:
    receiver = checker()
    accepted = check(receiver, encoder(3, left=65535, right=0))
    assert accepted is not None
    assert accepted.spec is ENCODER
    assert accepted.raw == {"left_count": 65535, "right_count": 0}
    assert accepted.invalid == ()
    assert accepted.timestamp_us == 3 * TICK_US
    assert accepted.counter == 3
    assert rejections(receiver) == {}


def test_an_unknown_identifier_is_counted() -> None:
    receiver = checker()
    for message in (
        can.Message(arbitration_id=ENCODER.frame_id + 1, is_extended_id=False, data=bytes(8)),
        can.Message(arbitration_id=ENCODER.frame_id, is_extended_id=True, data=bytes(8)),
    ):
        assert check(receiver, message) is None
    assert rejections(receiver) == {"unknown_id": 2}


def test_an_error_frame_is_no_message() -> None:
    receiver = checker()
    error = can.Message(arbitration_id=ENCODER.frame_id, is_extended_id=False, is_error_frame=True)
    assert check(receiver, error) is None
    assert rejections(receiver) == {"unknown_id": 1}


def test_messages_for_others_are_ignored_and_not_counted_as_unknown() -> None:
    receiver = checker("ENCODER")
    odometry = DATABASE.message("ODOMETRY_X")
    assert check(receiver, make_message(odometry, odometry.pack((0,), 0), 0)) is None
    assert rejections(receiver) == {}


@pytest.mark.parametrize("length", [0, 1, 7])
def test_a_wrong_length_is_counted(length: int) -> None:
    receiver = checker()
    message = encoder(0)
    message.data = message.data[:length]
    message.dlc = length
    assert check(receiver, message) is None
    assert rejections(receiver) == {"length": 1}


def test_a_remote_frame_and_a_can_fd_frame_have_a_wrong_length() -> None:
    receiver = checker()
    remote = can.Message(
        arbitration_id=ENCODER.frame_id, is_extended_id=False, is_remote_frame=True, dlc=8
    )
    flexible = can.Message(
        arbitration_id=ENCODER.frame_id,
        is_extended_id=False,
        is_fd=True,
        data=ENCODER.pack((0, 0), 0),
    )
    assert check(receiver, remote) is None
    assert check(receiver, flexible) is None
    assert rejections(receiver) == {"length": 2}


@pytest.mark.parametrize("bit", range(64))
def test_every_flipped_bit_is_counted_as_crc(bit: int) -> None:
    receiver = checker()
    message = encoder(0)
    message.data[bit // 8] ^= 1 << bit % 8
    assert check(receiver, message) is None
    assert rejections(receiver) == {"crc": 1}


def test_the_payload_of_another_message_is_counted_as_crc() -> None:
    receiver = checker()
    imu = DATABASE.message("IMU")
    masquerade = make_message(ENCODER, imu.pack((1, 2, 3), 0), 0)
    assert check(receiver, masquerade) is None
    assert rejections(receiver) == {"crc": 1}


def test_a_repeated_frame_is_counted_as_counter() -> None:
    receiver = checker()
    assert check(receiver, encoder(4)) is not None
    assert check(receiver, encoder(4)) is None
    assert check(receiver, encoder(5)) is not None
    assert rejections(receiver) == {"counter": 1}


@pytest.mark.parametrize("lost", range(14))
def test_after_lost_frames_the_next_one_is_accepted_in_its_own_time(lost: int) -> None:
    receiver = checker()
    assert check(receiver, encoder(0)) is not None
    assert check(receiver, encoder(1 + lost)) is not None
    assert rejections(receiver) == {}


@pytest.mark.parametrize("jump", range(2, 14))
def test_a_counter_that_jumps_without_time_passing_is_rejected(jump: int) -> None:
    receiver = checker()
    assert check(receiver, encoder(0)) is not None
    early = encoder(1 + jump)
    early.timestamp = TICK_US * 1e-6
    assert check(receiver, early) is None
    assert rejections(receiver) == {"counter": 1}
    assert check(receiver, encoder(2)) is not None


def test_jitter_of_almost_half_a_cycle_is_no_lost_frame() -> None:
    receiver = checker()
    for tick in range(40):
        message = encoder(tick)
        shift_us = TICK_US * 24 // 100 * (1 if tick % 2 else -1)
        assert receiver.check(message, (tick + 1) * TICK_US + shift_us) is not None
    assert rejections(receiver) == {}


def test_a_value_out_of_range_is_counted_and_moves_nothing() -> None:
    receiver = checker()
    signal = ENCODER.signal("left_count")
    assert check(receiver, encoder(0, left=signal.high_raw + 1)) is None
    assert rejections(receiver) == {"range": 1}
    assert check(receiver, encoder(1)) is not None


def test_a_value_that_is_not_available_is_delivered_as_invalid() -> None:
    receiver = checker()
    sna = ENCODER.signal("left_count").invalid_raw
    assert sna is not None
    accepted = check(receiver, encoder(0, left=sna, right=7))
    assert accepted is not None
    assert accepted.invalid == ("left_count",)
    assert accepted.raw == {"left_count": sna, "right_count": 7}


@pytest.mark.parametrize(
    ("now_us", "is_accepted"),
    [
        (MAX_AGE_US, True),
        (MAX_AGE_US + 1, False),
        (0, True),
        (-1, False),
    ],
)
def test_a_stamp_too_old_or_in_the_future_is_counted_as_age(now_us: int, is_accepted: bool) -> None:
    receiver = checker()
    accepted = receiver.check(encoder(0), now_us)
    assert (accepted is not None) is is_accepted
    assert rejections(receiver) == ({} if is_accepted else {"age": 1})


@pytest.mark.parametrize("stamp", [math.nan, math.inf, -math.inf])
def test_a_stamp_that_is_no_time_is_counted_as_age(stamp: float) -> None:
    receiver = checker()
    message = encoder(0)
    message.timestamp = stamp
    assert receiver.check(message, 0) is None
    assert rejections(receiver) == {"age": 1}


def test_an_unprotected_message_is_checked_for_length_range_and_age() -> None:
    receiver = FrameChecker(PLAIN, ["WIDE"], max_age_us=MAX_AGE_US)
    wide = PLAIN.message("WIDE")
    assert wide.is_extended
    good = make_message(wide, wide.encode_scaled({"level": -100.0, "word": 200}), 0)
    for _ in range(3):  # no counter: a repetition is fine
        accepted = check(receiver, good)
        assert accepted is not None
        assert accepted.raw == {"level": -200, "word": 200}
        assert accepted.counter is None
    assert check(receiver, make_message(wide, wide.encode_raw({"level": -201}), 0)) is None
    assert check(receiver, make_message(wide, bytearray(3), 0)) is None
    assert check(receiver, good, MAX_AGE_US + 1) is None
    assert rejections(receiver) == {"range": 1, "length": 1, "age": 1}


def test_not_available_may_lie_inside_the_range() -> None:
    receiver = FrameChecker(PLAIN, ["WIDE"], max_age_us=MAX_AGE_US)
    wide = PLAIN.message("WIDE")
    accepted = check(receiver, make_message(wide, wide.encode_scaled({"word": "SNA"}), 0))
    assert accepted is not None
    assert accepted.invalid == ("word",)


@pytest.mark.parametrize("value", [math.nan, math.inf, 11.0])
def test_a_float_that_is_no_number_or_out_of_range_is_rejected(value: float) -> None:
    receiver = FrameChecker(PLAIN, ["REAL"], max_age_us=MAX_AGE_US)
    real = PLAIN.message("REAL")
    assert check(receiver, make_message(real, real.encode_raw({"value": value}), 0)) is None
    assert rejections(receiver) == {"range": 1}


def test_an_unknown_message_name_raises_at_once() -> None:
    with pytest.raises(CanBusError, match=r"chiplog.dbc has no message 'ODOMETER': it has ENCODER"):
        checker("ODOMETER")


def test_a_profile_that_cannot_be_checked_raises_at_once() -> None:
    text = PLAIN_DBC + (
        'BA_DEF_ BO_ "E2EProfile" STRING ;\nBA_DEF_DEF_ "E2EProfile" "";\n'
        'BA_ "E2EProfile" BO_ 102 "P05";\n'
    )
    foreign = parse_database(text, Path("foreign.dbc"))
    with pytest.raises(CanBusError, match=r"REAL: E2EProfile 'P05' cannot be computed here"):
        FrameChecker(foreign, ["REAL"], max_age_us=MAX_AGE_US)
    FrameChecker(foreign, ["WIDE"], max_age_us=MAX_AGE_US)


identifiers = st.one_of(
    st.sampled_from([spec.frame_id for spec in DATABASE.messages.values()]),
    st.integers(0, (1 << 29) - 1),
)


@st.composite
def stray_frames(draw: st.DrawFn) -> can.Message:
    """Anything a bus can deliver, and some that none should."""
    data = bytearray(draw(st.binary(max_size=64)))
    return can.Message(
        timestamp=draw(st.floats(-1.0, 1.0) | st.sampled_from([math.nan, math.inf])),
        arbitration_id=draw(identifiers),
        is_extended_id=draw(st.booleans()),
        is_remote_frame=draw(st.booleans()),
        is_error_frame=draw(st.booleans()),
        is_fd=draw(st.booleans()),
        dlc=draw(st.integers(0, 64)),
        data=data,
    )


@given(st.lists(stray_frames(), max_size=8))
def test_whatever_the_bus_delivers_nothing_raises_and_all_it_wants_is_counted(
    messages: list[can.Message],
) -> None:
    receiver = checker()
    accepted = [message for message in messages if receiver.check(message, 0) is not None]
    for_others = [message for message in messages if is_for_others(message)]
    judged = len(accepted) + sum(receiver.rejected.values())
    assert judged == len(messages) - len(for_others)


def is_for_others(message: can.Message) -> bool:
    spec = DATABASE.by_id(message.arbitration_id, message.is_extended_id)
    wanted = spec is None or spec.name in ("ENCODER", "IMU", "COMMAND")
    return not wanted and not message.is_error_frame


@given(st.data())
def test_random_bytes_in_protected_frames_are_range_checked(data: st.DataObject) -> None:
    spec: MessageSpec = data.draw(st.sampled_from(list(DATABASE.messages.values())))
    frame = bytearray(data.draw(st.binary(min_size=8, max_size=8)))
    protect(spec, frame, 0)
    receiver = checker(spec.name)
    accepted = receiver.check(make_message(spec, frame, 0), 0)
    values = spec.decode_raw(frame)
    payload = {signal.name: values[signal.name] for signal in spec.payload}
    invalid = tuple(n for n, raw in payload.items() if raw == spec.signal(n).invalid_raw)
    is_good = all(n in invalid or spec.signal(n).in_range(raw) for n, raw in payload.items())
    assert (accepted is not None) is is_good
    if accepted is not None:
        assert accepted.raw == payload
        assert accepted.invalid == invalid
    else:
        assert rejections(receiver) == {"range": 1}


def test_the_reasons_are_those_of_the_summary() -> None:
    assert set(REASONS) == {"length", "crc", "counter", "range", "age", "unknown_id"}
