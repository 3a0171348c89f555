"""The rest bus: every message of absent nodes, on time and valid, from any DBC."""

from collections import defaultdict
from pathlib import Path

import can
import e2e.p01
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import CanBusError, Database, FrameChecker, load_database, timestamp_us
from hil_harness.errors import HarnessError
from hil_harness.restbus import FrameBuilder, RestBus

SHIPPED = load_database()
FOREIGN = load_database(Path(__file__).parents[2] / "examples" / "foreign_dbc" / "vehicle.dbc")
TICK_US = 10_000


def sent_by(
    database: Database, restbus: RestBus, until_us: int, every_us: int = TICK_US
) -> dict[str, list[can.Message]]:
    """Run a rest bus and return what it sent, by message."""
    frames: dict[str, list[can.Message]] = defaultdict(list)
    for now_us in range(0, until_us, every_us):
        for frame in restbus.due(now_us):
            spec = database.by_id(frame.arbitration_id, frame.is_extended_id)
            assert spec is not None
            frames[spec.name].append(frame)
    return frames


@pytest.mark.parametrize("database", [SHIPPED, FOREIGN], ids=["shipped", "foreign"])
def test_every_cyclic_message_comes_at_its_cycle_time_from_its_start_delay_on(
    database: Database,
) -> None:
    restbus = RestBus(FrameBuilder(database, TICK_US), database.senders())
    frames = sent_by(database, restbus, 2_000_000)
    for spec in database.messages.values():
        if spec.cycle_time_us is None or spec.send_type == "CyclicIfActive":
            assert spec.name not in frames
            continue
        expected = range(spec.start_delay_us, 2_000_000, spec.cycle_time_us)
        stamps = [timestamp_us(frame) for frame in frames[spec.name]]
        assert [stamp for stamp in stamps if stamp < 1_990_000] == [
            stamp for stamp in expected if stamp < 1_990_000
        ]


def test_only_messages_of_the_named_senders_are_sent() -> None:
    restbus = RestBus(FrameBuilder(SHIPPED, TICK_US), ["HOST"])
    assert restbus.messages == ("COMMAND",)


def test_messages_that_another_already_sends_can_be_left_out() -> None:
    restbus = RestBus(FrameBuilder(FOREIGN, TICK_US), ["CHASSIS"], without=["WHEEL_PULSES"])
    assert restbus.messages == ("YAW_SENSOR", "BODY")


def test_a_cycle_shorter_than_the_tick_sends_several_frames_in_one() -> None:
    restbus = RestBus(FrameBuilder(FOREIGN, TICK_US), ["NAVIGATION"])
    frames = sent_by(FOREIGN, restbus, 200_000, every_us=60_000)
    assert [timestamp_us(frame) for frame in frames["POSITION"]] == list(range(0, 200_000, 20_000))


def test_frames_due_together_come_in_the_order_of_arbitration() -> None:
    restbus = RestBus(FrameBuilder(SHIPPED, TICK_US), ["ECU", "PLANT"])
    identifiers = [frame.arbitration_id for frame in restbus.due(0)]
    assert identifiers == sorted(identifiers)
    assert len(identifiers) > 1


def test_an_independent_implementation_accepts_every_counter_and_crc() -> None:
    restbus = RestBus(FrameBuilder(SHIPPED, TICK_US), ["HOST", "PLANT", "ECU"])
    for name, frames in sent_by(SHIPPED, restbus, 5_000_000).items():
        spec = SHIPPED.messages[name]
        assert spec.e2e is not None
        for frame in frames:
            assert e2e.p01.e2e_p01_check(
                frame.data, spec.e2e.data_id, data_id_mode=e2e.p01.E2E_P01_DATAID_BOTH
            )
        counters = [frame.data[1] & 0x0F for frame in frames]
        first = spec.start_delay_us // TICK_US
        assert counters == [(first + number) % 15 for number in range(len(frames))]


def test_a_receiver_rejects_no_frame_of_a_rest_bus() -> None:
    restbus = RestBus(FrameBuilder(SHIPPED, TICK_US), ["HOST", "PLANT", "ECU"])
    checker = FrameChecker(SHIPPED, SHIPPED.messages, max_age_us=TICK_US)
    for now_us in range(0, 5_000_000, TICK_US):
        for frame in restbus.due(now_us):
            assert checker.check(frame, now_us) is not None
    assert set(checker.rejected.values()) == {0}


def test_signals_start_at_the_initial_value_of_the_dbc() -> None:
    restbus = RestBus(FrameBuilder(FOREIGN, TICK_US), ["CHASSIS"])
    body = FOREIGN.messages["BODY"]
    (frame,) = sent_by(FOREIGN, restbus, 500_000)["BODY"]
    assert body.decode_scaled(frame.data) == {"DoorOpen": 0.0, "CabinTemperature": 21.0}


def test_each_signal_can_be_overridden_from_the_start_and_later() -> None:
    restbus = RestBus(
        FrameBuilder(FOREIGN, TICK_US), ["CHASSIS"], {"BODY": {"CabinTemperature": 30.0}}
    )
    body = FOREIGN.messages["BODY"]
    seen = []
    for now_us in range(0, 1_500_000, TICK_US):
        if now_us == 700_000:
            restbus.set("BODY", DoorOpen="open")
        for frame in restbus.due(now_us):
            if frame.arbitration_id == body.frame_id:
                seen.append(body.decode_scaled(frame.data))
    assert seen == [
        {"DoorOpen": 0.0, "CabinTemperature": 30.0},
        {"DoorOpen": 0.0, "CabinTemperature": 30.0},
        {"DoorOpen": 1.0, "CabinTemperature": 30.0},
    ]


def test_none_sends_the_invalid_value() -> None:
    builder = FrameBuilder(SHIPPED, TICK_US)
    frame = builder.build("ENCODER", builder.raw_values("ENCODER", {"left_count": None}), 0)
    decoded = SHIPPED.messages["ENCODER"].decode_scaled(frame.data)
    assert decoded["left_count"] is None


def test_a_message_that_is_sent_only_when_active_waits_for_an_override() -> None:
    restbus = RestBus(FrameBuilder(SHIPPED, TICK_US), ["PLANT"])
    assert "REFERENCE_POSE" not in restbus.messages
    restbus.set("REFERENCE_POSE", x_m=1.0)
    assert "REFERENCE_POSE" in restbus.messages


def test_a_stopped_rest_bus_sends_nothing() -> None:
    restbus = RestBus(FrameBuilder(SHIPPED, TICK_US), ["HOST"])
    restbus.stop()
    assert restbus.due(10_000_000) == []


@given(st.floats(-7.9, 7.9), st.floats(-31.9, 31.9))
def test_an_overridden_value_arrives_to_half_a_step_of_its_signal(
    v_m_s: float, w_rad_s: float
) -> None:
    builder = FrameBuilder(SHIPPED, TICK_US)
    spec = SHIPPED.messages["COMMAND"]
    raw = builder.raw_values("COMMAND", {"v_m_s": v_m_s, "w_rad_s": w_rad_s})
    decoded = spec.decode_scaled(builder.build("COMMAND", raw, 0).data)
    for name, value in (("v_m_s", v_m_s), ("w_rad_s", w_rad_s)):
        arrived = decoded[name]
        assert arrived is not None
        assert abs(arrived - value) <= spec.signals[name].factor / 2


@pytest.mark.parametrize(
    ("senders", "overrides", "complaint"),
    [
        (["ROVER"], {}, "no node 'ROVER'"),
        (["HOST"], {"COMAND": {"v_m_s": 1}}, "does not send 'COMAND'; the nearest is COMMAND"),
        (["HOST"], {"COMMAND": {"speed": 1}}, "COMMAND has no signal 'speed'"),
        (["HOST"], {"COMMAND": {"v_m_s": 99.0}}, "COMMAND.v_m_s = 99.0 m/s: expected -7.9"),
        (["HOST"], {"COMMAND": {"crc": 1}}, "COMMAND.crc is the frame's own protection"),
        (["ECU"], {"STATUS": {"mode": "sideways"}}, "STATUS.mode = 'sideways': its named values"),
        (["ECU"], {"STATUS": {"standstill": None}}, "has no invalid value (SNA)"),
    ],
)
def test_what_does_not_fit_the_dbc_is_one_clear_line(
    senders: list[str], overrides: dict[str, dict[str, float]], complaint: str
) -> None:
    with pytest.raises((HarnessError, CanBusError)) as caught:
        RestBus(FrameBuilder(SHIPPED, TICK_US), senders, overrides)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_rest_bus_with_nothing_left_to_send_is_refused() -> None:
    with pytest.raises(HarnessError, match="nothing is left for a rest bus of HOST"):
        RestBus(FrameBuilder(SHIPPED, TICK_US), ["HOST"], without=["COMMAND"])
