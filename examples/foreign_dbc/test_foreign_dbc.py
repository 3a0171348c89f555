"""Chiplog's plant and firmware on a bus that was not made for them."""

import pytest

from hil_harness.rig import Rig


def test_the_vehicle_reports_millimetres_and_degrees(chiplog_rig: Rig) -> None:
    chiplog_rig.send("DRIVE", Speed=500, TurnRate=30.0)
    chiplog_rig.expect("HEADING", within_s=4.0, Heading=pytest.approx(90.0, abs=0.5))
    assert chiplog_rig.odometry == pytest.approx(chiplog_rig.truth, abs=0.01)


def test_the_rest_of_the_vehicle_can_be_there_too(chiplog_rig: Rig) -> None:
    chiplog_rig.restbus("CHASSIS", BODY={"DoorOpen": "open"})
    frame = chiplog_rig.expect("BODY", within_s=1.0, DoorOpen="open")
    assert frame["CabinTemperature"] == 21.0  # the DBC's own start value


def test_frames_that_do_not_come_hold_the_position(chiplog_rig: Rig) -> None:
    chiplog_rig.send("DRIVE", Speed=500)
    chiplog_rig.run_for(1.0)
    with chiplog_rig.fault("drop", "WHEEL_PULSES", during_s=0.4):
        chiplog_rig.run_for(0.04)
        held_mm = chiplog_rig.latest("POSITION")["PosX"]
        chiplog_rig.expect_none("POSITION", within_s=0.3, PosX=lambda x_mm: x_mm != held_mm)
    chiplog_rig.run_for(0.5)
    assert chiplog_rig.odometry == pytest.approx(chiplog_rig.truth, abs=0.01)
