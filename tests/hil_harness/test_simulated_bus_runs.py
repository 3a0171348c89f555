"""The loop on the simulated bus: frames take time, and faults strike where a file says."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest

from can_bus import load_database, read_log
from hil_harness import HarnessError, Rig, RunConfig, load_robot, load_wire, replay, run, scenario
from hil_harness.results import RunResult

SECONDS = 6.0
DATABASE = load_database()


def drive(interface: str, **arguments: object) -> RunResult:
    return run(
        RunConfig(
            scenario=scenario("lesson"),
            robot=load_robot(None),
            interface=interface,
            duration_s=SECONDS,
            **arguments,  # type: ignore[arg-type]
        )
    )


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, Path]:
    log = tmp_path_factory.mktemp("undisturbed") / "bus.log"
    return drive("chiplog", log=log), log


def test_a_bus_with_room_changes_no_pose(undisturbed: tuple[RunResult, Path]) -> None:
    result, _ = undisturbed
    on_virtual = drive("virtual")
    np.testing.assert_array_equal(result.firmware, on_virtual.firmware)
    assert result.kernel_state == on_virtual.kernel_state
    assert result.bus.frames == on_virtual.bus.frames
    assert not any(result.bus.rejected.values())


def test_the_log_has_each_frame_at_its_end_and_replays(
    undisturbed: tuple[RunResult, Path],
) -> None:
    result, log = undisturbed
    messages = list(read_log(log))
    encoder_id = DATABASE.message("ENCODER").frame_id
    first = next(m for m in messages if m.arbitration_id == encoder_id)
    # At least 111 bits without the intermission at 500 kbit/s, and no more than 132.
    assert 108 * 2e-6 <= first.timestamp <= 132 * 2e-6
    assert replay(log, load_robot(None), load_wire()).is_equal
    assert len(messages) == result.bus.frames


def test_the_same_seed_gives_the_same_log(
    undisturbed: tuple[RunResult, Path], tmp_path: Path
) -> None:
    drive("chiplog", log=tmp_path / "bus.log")
    assert (tmp_path / "bus.log").read_bytes() == undisturbed[1].read_bytes()


def faults(tmp_path: Path, text: str) -> dict[str, str]:
    path = tmp_path / "faults.toml"
    path.write_text(text)
    return {"faults": str(path)}


def test_corrupted_frames_are_sent_again_and_change_no_pose(
    undisturbed: tuple[RunResult, Path], tmp_path: Path
) -> None:
    text = '[[fault]]\nkind = "corruption"\nbits = [40]\nprobability = 0.02\n'
    log = tmp_path / "bus.log"
    result = drive("chiplog", bus_args=faults(tmp_path, text), log=log)
    np.testing.assert_array_equal(result.firmware, undisturbed[0].firmware)
    assert any(message.is_error_frame for message in read_log(log))
    assert replay(log, load_robot(None), load_wire()).is_equal
    assert result.bus.rejected["unknown_id"] > 0  # the error frames that the ECU saw


def test_lost_frames_of_the_gyro_leave_the_wheels(tmp_path: Path) -> None:
    imu = DATABASE.message("IMU").frame_id
    text = f'[[fault]]\nkind = "loss"\narbitration_id = {imu}\nstart_s = 2.0\nstop_s = 4.0\n'
    result = drive("chiplog", bus_args=faults(tmp_path, text), log=tmp_path / "bus.log")
    stamps = [m.timestamp for m in read_log(tmp_path / "bus.log") if m.arbitration_id == imu]
    assert not [stamp for stamp in stamps if 2.0 <= stamp < 4.0]
    assert np.all(np.isfinite(result.firmware))
    assert replay(tmp_path / "bus.log", load_robot(None), load_wire()).is_equal


def test_a_bus_too_slow_for_its_traffic_is_seen(tmp_path: Path) -> None:
    """At 40 kbit/s more is queued than the wire carries; sensors, most urgent, are still heard."""
    result = drive("chiplog", bitrate=40_000, log=tmp_path / "bus.log")
    assert result.bus.load is not None
    assert result.bus.load > 1.0
    encoder_id = DATABASE.message("ENCODER").frame_id
    stamps = [m.timestamp for m in read_log(tmp_path / "bus.log") if m.arbitration_id == encoder_id]
    assert len(stamps) >= round(SECONDS / 0.01) - 1  # one may be on the wire still
    late = [stamp % 0.01 for stamp in stamps]
    assert max(late) > 2 * min(late)  # behind whatever was on the wire


def test_a_rig_runs_on_it() -> None:
    with Rig(interface="chiplog", plant=True) as rig:
        frame = rig.expect("ODOMETRY_X", within_s=0.1)
        assert "x_m" in str(frame)
        with can.Bus(rig.channel, interface="chiplog") as listener:
            rig.run_for(0.05)
            assert listener.recv(0) is not None


def test_real_time_is_refused() -> None:
    with pytest.raises(HarnessError, match="that bus has a clock of its own"):
        drive("chiplog", time="real")
