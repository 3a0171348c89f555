"""Expectations: what counts as met, how long bus time is waited for, and what a failure shows."""

from collections.abc import Iterator
from typing import Any

import pytest

from can_bus import CanBusError
from hil_harness.rig import Rig


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


def test_expect_returns_the_frame_that_met_it(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5)
    frame = rig.expect("ODOMETRY_X", within_s=3.0, x_m=pytest.approx(0.5, abs=0.01))
    assert frame.name == "ODOMETRY_X"
    assert frame["x_m"] == pytest.approx(0.5, abs=0.01)
    assert frame.time_us == rig.now_us - rig.tick_period_us


def test_expect_stops_as_soon_as_it_is_met(rig: Rig) -> None:
    rig.expect("ENCODER", within_s=100.0)
    assert rig.now_us == 10_000


def test_only_frames_from_now_on_count(rig: Rig) -> None:
    rig.run_for(1.0)
    frame = rig.expect("ODOMETRY_X")
    assert frame.time_us == 1_000_000


def test_within_s_counts_bus_time(rig: Rig) -> None:
    with pytest.raises(AssertionError):
        rig.expect("ODOMETRY_X", within_s=0.5, x_m=1.0)
    assert rig.now_us == 500_000


def test_without_within_s_two_cycles_of_the_message_are_waited_for(rig: Rig) -> None:
    cycle_us = rig.database.message("STATUS").cycle_time_us
    assert cycle_us is not None
    with pytest.raises(AssertionError):
        rig.expect("STATUS", overflow=1)
    assert rig.now_us == 2 * cycle_us


def test_expect_none_lets_all_of_its_time_pass(rig: Rig) -> None:
    rig.expect_none("ODOMETRY_X", within_s=0.3, x_m=lambda x_m: x_m > 1.0)
    assert rig.now_us == 300_000


def test_expect_none_fails_at_the_first_frame_that_should_not_come(rig: Rig) -> None:
    with pytest.raises(AssertionError) as caught:
        rig.expect_none("ENCODER", within_s=1.0)
    assert "expected no ENCODER" in str(caught.value)
    assert "but it came:" in str(caught.value)
    assert rig.now_us == 10_000


@pytest.mark.parametrize("mode", ["gyro", 1])
def test_a_signal_with_a_value_table_can_be_expected_by_word_or_number(
    rig: Rig, mode: str | int
) -> None:
    assert rig.expect("STATUS", mode=mode).label("mode") == "gyro"


def test_none_expects_the_invalid_value(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=None)
    assert rig.expect("COMMAND", v_m_s=None)["v_m_s"] is None


def test_an_invalid_signal_equals_no_number(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=None)
    with pytest.raises(AssertionError, match="v_m_s = invalid"):
        rig.expect("COMMAND", within_s=0.01, v_m_s=lambda v_m_s: v_m_s == 0)


def test_a_failure_shows_what_came_instead(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5)
    with pytest.raises(AssertionError) as caught:
        rig.expect("ODOMETRY_X", within_s=0.1, x_m=pytest.approx(99.0))
    lines = str(caught.value).splitlines()
    assert lines[0] == (
        "no ODOMETRY_X with x_m = 99.0 ± 9.9e-05 within 0.1 s (0.000000 s to 0.100000 s): "
        "10 came, none of them so"
    )
    assert lines[1].startswith("  0.000000 s  x_m = ")
    assert lines[2] == "  …"
    assert lines[-1].startswith("  0.090000 s  x_m = ")
    assert lines[-1].endswith(" m")
    assert len(lines) == 6


def test_a_failure_says_what_else_was_on_the_bus_when_the_message_never_came(rig: Rig) -> None:
    with rig.fault("silence", node="ECU"), pytest.raises(AssertionError) as caught:
        rig.expect("ODOMETRY_X", within_s=0.1)
    assert "it never came; on the bus in that time: ENCODER (10), IMU (10)" in str(caught.value)


@pytest.mark.parametrize(
    ("message", "signals", "complaint"),
    [
        ("ODOMETRY", {}, "no message 'ODOMETRY'"),
        ("ODOMETRY_X", {"y_m": 1.0}, "ODOMETRY_X has no signal 'y_m'"),
        ("STATUS", {"mode": "sideways"}, "STATUS.mode = 'sideways': its named values are"),
    ],
)
def test_a_name_that_the_dbc_does_not_have_is_a_mistake_and_no_failure(
    rig: Rig, message: str, signals: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(CanBusError) as caught:
        rig.expect(message, **signals)
    assert complaint in str(caught.value)
    assert rig.now_us == 0
