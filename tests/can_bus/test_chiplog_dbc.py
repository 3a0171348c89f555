"""The shipped DBC is complete: every rule it follows is checked here."""

from itertools import pairwise
from typing import cast

import cantools.database.can as cantools
import pytest
from cantools.database import load_file

from can_bus import MessageSpec, SignalSpec, crc8_profile1, load_database
from can_bus.e2e import COUNTER_MODULO, crc8_start
from firmware_model import HeadingSource, StatusBit

DATABASE = load_database()
PARSED = cast("cantools.Database", load_file(DATABASE.path))
MESSAGES = list(DATABASE.messages.values())
SIGNALS = [signal for message in MESSAGES for signal in message.signals.values()]
PARSED_SIGNALS = [(message, signal) for message in PARSED.messages for signal in message.signals]

# Names that other programs rely on.
CONTRACT = {
    "ENCODER": ("left_count", "right_count"),
    "IMU": ("gyro_z_raw", "accel_x_raw", "accel_y_raw"),
    "ENVIRONMENT": ("temperature_raw", "supply_raw"),
    "ODOMETRY_X": ("x_m",),
    "ODOMETRY_Y": ("y_m",),
    "ODOMETRY_HEADING": ("heading_turn",),
    "ODOMETRY_VELOCITY": ("v_m_s", "w_rad_s"),
    "STATUS": (),
    "COMMAND": ("v_m_s", "w_rad_s"),
    "REFERENCE_POSE": ("x_m", "y_m", "heading_turn"),
}
TICK_RATE = ("ENCODER", "IMU", "ODOMETRY_X", "ODOMETRY_Y", "ODOMETRY_HEADING")

each_message = pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.name)
each_signal = pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.path)
each_parsed = pytest.mark.parametrize("message", PARSED.messages, ids=lambda m: m.name)
each_parsed_signal = pytest.mark.parametrize(
    ("message", "signal"), PARSED_SIGNALS, ids=lambda x: x.name
)


def tick_period_us() -> int:
    period = DATABASE.message("ENCODER").cycle_time_us
    assert period is not None
    return period


def is_own(signal: SignalSpec) -> bool:
    return signal.name in ("crc", "tick_counter")


def test_the_messages_and_signals_of_the_contract_are_there() -> None:
    assert set(DATABASE.messages) == set(CONTRACT)
    for name, signals in CONTRACT.items():
        assert {"crc", "tick_counter", *signals} <= set(DATABASE.message(name).signals)


@each_message
def test_every_message_is_a_classic_frame_of_eight_bytes(message: MessageSpec) -> None:
    assert message.length_bytes == 8
    assert not message.is_extended
    assert not message.is_fd
    assert message.is_plain


@each_message
def test_every_message_has_one_sender_and_receivers_that_exist(
    message: MessageSpec,
) -> None:
    assert len(message.senders) == 1
    assert set(message.senders) <= set(DATABASE.nodes)
    assert message.receivers
    assert set(message.receivers) <= set(DATABASE.nodes) - set(message.senders)


@each_parsed
def test_every_message_states_its_timing_and_protection_itself(message: cantools.Message) -> None:
    assert message.dbc is not None
    assert {
        "GenMsgCycleTime",
        "GenMsgStartDelayTime",
        "GenMsgSendType",
        "E2EProfile",
        "E2EDataId",
        "E2EMaxDeltaCounterInit",
        "E2EMaxNoNewOrRepeatedData",
        "E2ESyncCounterInit",
    } <= set(message.dbc.attributes)


@each_parsed_signal
def test_every_signal_states_its_initial_value_itself(
    message: cantools.Message, signal: cantools.Signal
) -> None:
    assert signal.dbc is not None
    assert "GenSigStartValue" in signal.dbc.attributes


@each_signal
def test_every_initial_value_is_in_range_or_not_available(signal: SignalSpec) -> None:
    assert signal.initial_raw == signal.invalid_raw or signal.in_range(signal.initial_raw)


@each_signal
def test_every_signal_has_unit_range_receivers_and_comment(signal: SignalSpec) -> None:
    assert signal.unit
    assert signal.minimum is not None
    assert signal.maximum is not None
    assert signal.minimum < signal.maximum
    assert signal.receivers
    assert len(signal.comment) > 20


@each_signal
def test_every_range_limit_is_exactly_a_raw_value(signal: SignalSpec) -> None:
    assert signal.to_scaled(signal.low_raw) == signal.minimum
    assert signal.to_scaled(signal.high_raw) == signal.maximum


@each_signal
def test_every_signal_can_say_not_available_outside_its_range(signal: SignalSpec) -> None:
    if signal.name == "crc" or signal.length_bits == 1:
        # Every code of a CRC is a CRC; a flag of the sender's own state is never unknown.
        assert signal.invalid_raw is None
        assert "no SNA" in signal.comment
    else:
        assert signal.invalid_raw is not None
        assert not signal.in_range(signal.invalid_raw)
        signal.to_bits(signal.invalid_raw)


@each_signal
def test_every_flag_and_every_state_has_a_value_table(signal: SignalSpec) -> None:
    is_state = signal.message == "STATUS" and signal.unit == "1" and not is_own(signal)
    if is_state:
        named = set(signal.choices) - {signal.invalid_raw}
        assert named == set(range(signal.low_raw, signal.high_raw + 1))


@each_message
def test_every_message_has_a_comment(message: MessageSpec) -> None:
    assert len(message.comment) > 20


def test_every_node_and_the_network_have_a_comment() -> None:
    assert all(node.comment and len(node.comment) > 20 for node in PARSED.nodes)
    assert [bus.comment for bus in PARSED.buses if bus.comment]


def test_the_network_states_its_bit_rate() -> None:
    assert PARSED.dbc is not None
    assert DATABASE.bitrate == PARSED.dbc.attributes["Baudrate"].value


def test_identifiers_are_in_rate_monotonic_order() -> None:
    for higher, lower in pairwise(MESSAGES):
        assert higher.cycle_time_us is not None
        assert lower.cycle_time_us is not None
        assert higher.frame_id < lower.frame_id
        assert higher.cycle_time_us <= lower.cycle_time_us


def test_at_the_tick_rate_go_encoder_imu_and_pose_and_no_others() -> None:
    fast = {m.name for m in MESSAGES if m.cycle_time_us == tick_period_us()}
    assert fast == set(TICK_RATE)


@each_message
def test_every_cycle_and_phase_is_a_whole_number_of_ticks(message: MessageSpec) -> None:
    assert message.cycle_time_us is not None
    assert message.cycle_time_us % tick_period_us() == 0
    assert message.start_delay_us % tick_period_us() == 0
    assert message.start_delay_us < message.cycle_time_us


@each_message
def test_the_shared_counter_advances_by_one_from_frame_to_frame(
    message: MessageSpec,
) -> None:
    assert message.cycle_time_us is not None
    assert message.cycle_time_us // tick_period_us() % COUNTER_MODULO == 1


def test_slow_frames_do_not_meet_in_one_tick_at_the_start() -> None:
    slow = [m.start_delay_us for m in MESSAGES if m.name not in TICK_RATE]
    assert len(set(slow)) == len(slow)


def test_the_first_command_comes_with_the_first_tick() -> None:
    assert DATABASE.message("COMMAND").start_delay_us == 0


def test_truth_is_on_the_bus_only_when_asked_for() -> None:
    assert DATABASE.message("REFERENCE_POSE").send_type == "CyclicIfActive"
    assert {m.send_type for m in MESSAGES if m.name != "REFERENCE_POSE"} == {"Cyclic"}


@each_message
def test_every_message_is_protected_by_profile_1(message: MessageSpec) -> None:
    assert message.is_protected
    assert message.e2e is not None
    assert message.e2e.crc_signal == "crc"
    assert message.e2e.counter_signal == "tick_counter"
    counter = message.signals["tick_counter"]
    assert (counter.low_raw, counter.high_raw) == (0, COUNTER_MODULO - 1)


def test_no_message_can_pass_for_another() -> None:
    # The CRC is linear: with equal bytes, two frames' CRCs differ by those of their data IDs alone.
    protections = [m.e2e for m in MESSAGES if m.e2e is not None]
    starts = {crc8_start(protection.data_id) for protection in protections}
    assert len(starts) == len(MESSAGES)
    for sender in MESSAGES:
        frame = sender.pack([signal.low_raw for signal in sender.payload], counter=3)
        passing = [p for p in protections if crc8_profile1(p.data_id, frame) == frame[0]]
        assert passing == [sender.e2e]


@each_signal
def test_raw_sensor_codes_have_factor_one(signal: SignalSpec) -> None:
    if signal.message in ("ENCODER", "IMU", "ENVIRONMENT") and not is_own(signal):
        assert (signal.factor, signal.offset) == (1.0, 0.0)
        assert (signal.low_raw, signal.high_raw) == (0, 2**16 - 1)


def test_odometry_has_the_full_resolution_of_the_default_accumulators() -> None:
    for message, name in (
        ("ODOMETRY_X", "x_m"),
        ("ODOMETRY_Y", "y_m"),
        ("ODOMETRY_HEADING", "heading_turn"),
    ):
        assert DATABASE.message(message).signal(name).factor == 2.0**-32
    heading = DATABASE.message("ODOMETRY_HEADING").signal("heading_turn")
    assert (heading.low_raw, heading.high_raw) == (-(2**31), 2**31 - 1)


def test_left_out_of_a_command_means_stand_still() -> None:
    command = DATABASE.message("COMMAND")
    assert command.decode_scaled(command.encode_raw({}))["v_m_s"] == 0.0
    assert command.decode_scaled(command.encode_raw({}))["w_rad_s"] == 0.0


def test_every_bit_of_the_firmwares_status_word_is_a_signal_at_its_place() -> None:
    flags = [s for s in DATABASE.message("STATUS").payload if s.length_bits == 1]
    assert [flag.name for flag in flags] == [bit.name.lower() for bit in StatusBit if bit.name]
    first = flags[0].start_bit
    assert [1 << flag.start_bit - first for flag in flags] == [bit.value for bit in StatusBit]


def test_the_heading_sources_have_the_firmwares_numbers() -> None:
    choices = DATABASE.message("STATUS").signal("heading_source").choices
    named = {name: raw for raw, name in choices.items() if name != "SNA"}
    assert named == {source.name.lower(): source.value for source in HeadingSource}
