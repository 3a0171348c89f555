"""The rig in lockstep: a robot on a bus, and a tester's hands on it."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import can
import pytest

from can_bus import CanBusError, make_message, protect, read_log
from hil_harness.errors import HarnessError
from hil_harness.rig import Rig

# One count of the shipped robot's encoder is 0.15 mm of way; a wheel that rests on the edge between
# two counts reads now the one, now the other.
ONE_COUNT_M = 0.00016


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


def test_bus_time_passes_only_when_the_test_lets_it(rig: Rig) -> None:
    assert rig.now_us == 0
    rig.run_for(0.25)
    assert rig.now_us == 250_000


def test_a_duration_between_two_ticks_runs_the_ticks_that_begin_in_it(rig: Rig) -> None:
    rig.run_for(0.015)
    assert rig.now_us == 20_000


@pytest.mark.parametrize("duration_s", [-0.1, float("nan"), float("inf")])
def test_a_duration_that_is_none_is_refused(rig: Rig, duration_s: float) -> None:
    with pytest.raises(HarnessError, match="expected seconds, 0 or more"):
        rig.run_for(duration_s)


@pytest.mark.parametrize("duration_s", ["1", None, True])
def test_a_duration_that_is_no_number_is_refused(rig: Rig, duration_s: Any) -> None:
    with pytest.raises(HarnessError, match=r"^duration_s = .*: expected a number of seconds$"):
        rig.run_for(duration_s)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"seed": "x"}, "seed = 'x': expected a whole number, 0 or more"),
        ({"seed": -1}, "seed = -1: expected a whole number, 0 or more"),
        ({"seed": 1.5}, "seed = 1.5: expected a whole number, 0 or more"),
        ({"effects": 3}, "effects = 3: expected texts such as"),
        ({"effects": [3]}, "effects = [3]: expected texts such as"),
        ({"effect_library": 3}, "effect_library = 3: expected a Python file"),
        ({"plant": "no"}, "plant = 'no': expected True or False"),
        ({"scenario": 3}, "scenario = 3: expected a name or a file"),
        ({"robot": 3}, "robot = 3: expected a robot or its file"),
        ({"dbc": 3}, "dbc = 3: expected a database or its file"),
        ({"signals": 3}, "signals = 3: expected a signal map or its file"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_one_clear_line(
    settings: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(HarnessError) as caught:
        Rig(**settings)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)


def test_a_lone_text_is_one_effect() -> None:
    def headings(effects: str | list[str]) -> tuple[float, float]:
        with Rig(effects=effects) as rig:
            rig.send("COMMAND", v_m_s=0.2)
            rig.run_for(1.0)
            return rig.odometry.heading_rad, rig.truth.heading_rad

    assert headings("gyro_bias.bias=0.01") == headings(["gyro_bias.bias=0.01"])
    assert headings("gyro_bias.bias=0.01") != headings([])


def test_a_robot_that_is_told_nothing_rests(rig: Rig) -> None:
    rig.run_for(1.0)
    assert rig.truth == (0.0, 0.0, 0.0)
    assert rig.odometry == pytest.approx((0.0, 0.0, 0.0), abs=2 * ONE_COUNT_M)
    assert rig.status["initialised"] == 1


def test_a_command_drives_the_robot_and_the_firmware_sees_it(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5, w_rad_s=0.1)
    rig.run_for(4.0)
    # While its wheels gather speed, 10 rad/s at 60 rad/s², the robot does not turn yet.
    assert rig.truth.heading_rad == pytest.approx(0.4, abs=0.02)
    assert rig.odometry == pytest.approx(rig.truth, abs=0.005)


def test_a_command_holds_until_the_next(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5)
    rig.run_for(2.0)
    rig.send("COMMAND", v_m_s=0.0)
    rig.run_for(1.0)
    stopped_at_m = rig.truth.x_m
    rig.run_for(1.0)
    assert rig.truth.x_m == pytest.approx(stopped_at_m, abs=1e-6)


def test_commands_at_any_rhythm_pass_the_receivers_counter_check(rig: Rig) -> None:
    for ticks in (1, 7, 30, 2, 150, 15):
        rig.send("COMMAND", v_m_s=0.1 * (1 + ticks % 3))
        rig.run_for(0.01 * ticks)
    rig.send("COMMAND", v_m_s=-0.3)
    rig.run_for(1.0)
    before_m = rig.truth.x_m
    rig.run_for(1.0)
    assert rig.truth.x_m - before_m == pytest.approx(-0.3, abs=0.001)


def test_a_scenario_drives_the_robot_instead() -> None:
    with Rig(scenario="spin") as rig:
        rig.run_for(5.0)
        assert abs(rig.truth.heading_rad) > 0.5
        assert rig.latest("COMMAND")["w_rad_s"] != 0.0


def test_effects_make_the_robot_differ_from_its_description() -> None:
    def heading_error_rad(*effects: str) -> float:
        with Rig(effects=effects) as rig:
            rig.send("COMMAND", v_m_s=0.2)
            rig.run_for(10.0)
            return rig.odometry.heading_rad - rig.truth.heading_rad

    bias_part_rad = heading_error_rad("gyro_bias.bias=0.005") - heading_error_rad()
    assert bias_part_rad == pytest.approx(0.05, abs=0.001)


def test_the_same_seed_gives_the_same_log_byte_for_byte(tmp_path: Path) -> None:
    logs = []
    for name in ("one.log", "two.log"):
        with Rig(seed=5, log=tmp_path / name) as rig:
            rig.send("COMMAND", v_m_s=0.3, w_rad_s=0.2)
            rig.fault("drop", "IMU", probability=0.2)
            rig.run_for(2.0)
        logs.append((tmp_path / name).read_bytes())
    assert logs[0] == logs[1]
    assert len(logs[0]) > 10_000


def test_the_log_holds_what_the_firmware_received_and_sent(tmp_path: Path) -> None:
    with Rig(log=tmp_path / "bus.log") as rig:
        rig.send("COMMAND", v_m_s=0.3)
        with rig.fault("drop", "IMU"):
            rig.run_for(0.1)
        database = rig.database
    names = [database.by_id(frame.arbitration_id) for frame in read_log(tmp_path / "bus.log")]
    counts = {spec.name: names.count(spec) for spec in names if spec is not None}
    assert counts["ENCODER"] == counts["ODOMETRY_X"] == 10
    assert "IMU" not in counts


def test_every_rig_has_a_channel_of_its_own() -> None:
    with Rig() as first, Rig() as second:
        assert first.channel != second.channel
        first.send("COMMAND", v_m_s=0.5)
        first.run_for(0.5)
        second.run_for(0.5)
        assert second.truth.x_m == 0.0


def test_a_raw_bus_meets_the_rig_on_its_channel(rig: Rig) -> None:
    with rig.open_bus() as bus:
        rig.run_for(0.02)
        identifiers = set()
        while (frame := bus.recv(0)) is not None:
            identifiers.add(frame.arbitration_id)
        assert rig.database.message("ENCODER").frame_id in identifiers
        assert rig.database.message("ODOMETRY_X").frame_id in identifiers


def test_frames_of_a_node_that_the_test_runs_itself_can_be_expected(rig: Rig) -> None:
    spec = rig.database.message("COMMAND")
    data = spec.encode_scaled({"v_m_s": 0.5})
    protect(spec, data, 0)
    with rig.open_bus() as bus:
        bus.send(make_message(spec, data, 0))
        rig.expect("COMMAND", v_m_s=pytest.approx(0.5))
    rig.run_for(1.0)
    assert rig.truth.x_m > 0.1


def test_garbage_on_the_bus_moves_nothing(rig: Rig) -> None:
    rig.fault("drop", "ENCODER")  # no flicker of counts: what moves now, garbage has moved
    with rig.open_bus() as bus:
        for spec in rig.database.messages.values():
            for data in (b"", b"\xff" * 8, bytes(8)):
                bus.send(can.Message(arbitration_id=spec.frame_id, is_extended_id=False, data=data))
        rig.run_for(0.1)
    assert (rig.odometry.x_m, rig.odometry.y_m) == (0.0, 0.0)
    assert rig.truth == (0.0, 0.0, 0.0)


def test_a_closed_rig_leaves_no_handle_on_its_channel() -> None:
    from can.interfaces.virtual import channels  # noqa: PLC0415

    rig = Rig()
    channel = rig.channel
    assert channel in channels
    rig.close()
    rig.close()
    assert channel not in channels


def test_a_rig_that_cannot_be_assembled_leaves_nothing_behind(tmp_path: Path) -> None:
    from can.interfaces.virtual import channels  # noqa: PLC0415

    before = set(channels)
    with pytest.raises(CanBusError):
        Rig(log=tmp_path / "missing" / "bus.log")
    assert set(channels) == before


def test_a_device_of_ones_own_takes_the_firmwares_place() -> None:
    class Deaf:
        def step(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
            return []

    with Rig(device=Deaf()) as rig:
        rig.expect_none("ODOMETRY_X", within_s=0.1)


def test_a_device_that_fails_in_mid_run_stops_the_test_with_one_line(tmp_path: Path) -> None:
    (tmp_path / "node.py").write_text(
        "class Node:\n"
        "    def step(self, now_us, frames):\n"
        "        if now_us == 30_000:\n"
        "            raise RuntimeError('stack overflow')\n"
        "        return []\n"
    )
    with (
        Rig(device="python:node.py:Node", folder=tmp_path, log=tmp_path / "bus.log") as rig,
        pytest.raises(HarnessError, match=r"^device Node: raised RuntimeError: stack overflow"),
    ):
        rig.run_for(1.0)
    assert len(list(read_log(tmp_path / "bus.log"))) >= 6


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"device": "none"}, "no ECU can reach the in-process interface 'virtual'"),
        ({"device": "lib:./no.so"}, "no such file"),
        ({"device": 42}, "device int: has no step"),
        ({"robot": "no_such.toml"}, "no_such.toml"),
        ({"scenario": "circel"}, "no such scenario: circel"),
        ({"effects": ["gyro_bais.bias=1"]}, "the nearest is gyro_bias"),
        ({"interface": "socketcan"}, "interface 'socketcan' needs a channel, for example vcan0"),
        ({"interface": "carrier_pigeon", "channel": "x"}, "no interface 'carrier_pigeon'"),
    ],
)
def test_what_does_not_fit_together_is_one_clear_line(
    arguments: dict[str, object], complaint: str
) -> None:
    with pytest.raises((HarnessError, CanBusError)) as caught:
        Rig(**arguments)  # type: ignore[arg-type]
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_last_frames_can_be_read_by_people(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5)
    rig.run_for(0.01)
    lines = rig.recent_frames(100)
    command = next(line for line in lines if "COMMAND" in line)
    assert command == "0.000000 s  HOST  COMMAND  v_m_s = 0.5 m/s, w_rad_s = 0 rad/s"
    assert any(line.startswith("0.000000 s  ECU  ODOMETRY_X  x_m = ") for line in lines)


def test_nothing_is_the_latest_before_anything_came(rig: Rig) -> None:
    with pytest.raises(AssertionError, match=r"no STATUS has come yet, at 0\.000000 s"):
        _ = rig.status
    with pytest.raises(CanBusError, match="no message 'STATE'"):
        rig.latest("STATE")
