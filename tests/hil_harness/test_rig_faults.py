"""Faults: frames dropped, delayed, corrupted, duplicated; nodes silenced; all of it undone."""

from collections.abc import Iterator

import pytest

from can_bus import CanBusError
from hil_harness.errors import HarnessError
from hil_harness.rig import Rig


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


def test_dropped_gyro_frames_make_the_firmware_fall_back_to_its_wheels(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5, w_rad_s=0.5)
    rig.run_for(1.0)
    rig.fault("drop", "IMU")
    rig.run_for(0.5)
    rig.expect("STATUS", within_s=0.5, wheel_fallback=1, gyro_stale=1)
    assert rig.odometry == pytest.approx(rig.truth, abs=0.01)


def test_a_cleared_fault_is_over(rig: Rig) -> None:
    fault = rig.fault("drop", "IMU")
    rig.run_for(0.5)
    fault.clear()
    fault.clear()
    rig.run_for(0.5)
    rig.expect("STATUS", within_s=0.5, gyro_stale=0)


def test_a_fault_in_a_with_block_ends_with_it(rig: Rig) -> None:
    with rig.fault("silence", node="ECU"):
        rig.expect_none("ODOMETRY_X", within_s=0.2)
    rig.expect("ODOMETRY_X")


def test_clearing_one_fault_leaves_the_other_on(rig: Rig) -> None:
    rig.fault("drop", "ODOMETRY_X")
    rig.fault("drop", "ODOMETRY_Y").clear()
    rig.expect("ODOMETRY_Y")
    rig.expect_none("ODOMETRY_X", within_s=0.2)


def test_a_fault_may_end_after_a_time(rig: Rig) -> None:
    rig.fault("drop", "ODOMETRY_X", during_s=0.2)
    frame = rig.expect("ODOMETRY_X", within_s=1.0)
    assert frame.time_us == 200_000


def test_a_fault_may_end_after_so_many_frames(rig: Rig) -> None:
    rig.fault("drop", "ODOMETRY_X", count=3)
    assert rig.expect("ODOMETRY_X", within_s=1.0).time_us == 30_000


def test_corrupted_encoder_frames_hold_the_pose(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5)
    rig.run_for(1.0)
    before = rig.odometry
    with rig.fault("corrupt", "ENCODER"):
        rig.run_for(0.3)
        held = rig.odometry
    assert (held.x_m, held.y_m) == (before.x_m, before.y_m)
    rig.run_for(0.3)
    assert rig.odometry == pytest.approx(rig.truth, abs=0.01)


def test_a_duplicated_command_is_obeyed_once_and_does_no_harm(rig: Rig) -> None:
    rig.fault("duplicate", "ENCODER")
    rig.send("COMMAND", v_m_s=0.5)
    rig.run_for(1.0)
    assert rig.odometry == pytest.approx(rig.truth, abs=0.01)


def test_a_delayed_frame_comes_later(rig: Rig) -> None:
    rig.fault("delay", "ODOMETRY_X", count=1, delay_s=0.05)
    first = rig.expect("ODOMETRY_X", within_s=1.0)
    assert first.time_us == 10_000  # the second frame overtakes the first
    rig.run_for(0.03)
    frames = [line for line in rig.recent_frames(50) if "ODOMETRY_X" in line]
    rig.run_for(0.02)
    later = [line for line in rig.recent_frames(100) if "0.050000 s  ECU  ODOMETRY_X" in line]
    assert len(frames) == 4
    assert len(later) == 2


def test_a_silent_plant_leaves_the_firmware_where_it_was(rig: Rig) -> None:
    rig.send("COMMAND", v_m_s=0.5)
    rig.run_for(1.0)
    before = rig.odometry
    with rig.fault("silence", node="PLANT"):
        rig.run_for(0.2)
        rig.expect("STATUS", within_s=0.5, encoder_stale=1, position_held=1)
        assert rig.odometry == before


def test_a_fault_with_a_probability_strikes_the_same_frames_for_the_same_seed() -> None:
    def arrivals(seed: int) -> list[str]:
        with Rig(seed=seed) as rig:
            rig.fault("drop", "ODOMETRY_X", probability=0.5)
            rig.run_for(1.0)
            return [line.split()[0] for line in rig.recent_frames(1000) if "ODOMETRY_X" in line]

    assert arrivals(3) == arrivals(3)
    assert arrivals(3) != arrivals(4)
    assert 20 < len(arrivals(3)) < 80


@pytest.mark.parametrize(
    ("kind", "message", "node", "complaint"),
    [
        ("explode", "IMU", None, "no fault 'explode'"),
        ("silence", None, None, "needs the name of a node"),
        ("delay", "IMU", None, "delay_us = 0: expected more than 0"),
        ("drop", "IMUS", None, "no message 'IMUS'"),
        ("silence", None, "PLNT", "no node 'PLNT'"),
    ],
)
def test_a_fault_that_makes_no_sense_is_one_clear_line(
    rig: Rig, kind: str, message: str | None, node: str | None, complaint: str
) -> None:
    with pytest.raises(CanBusError) as caught:
        rig.fault(kind, message, node=node)  # type: ignore[arg-type]
    assert complaint in str(caught.value)


def test_a_fault_that_would_strike_everything_is_refused(rig: Rig) -> None:
    with pytest.raises(HarnessError, match=r"^fault 'drop': name a message or a node"):
        rig.fault("drop")
