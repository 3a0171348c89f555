"""The node of this folder on a simulated robot."""

import pytest

from hil_harness.rig import Rig

pytestmark = pytest.mark.chiplog(device="python:node.py:WheelOdometry")


def test_the_node_reports_the_way_that_the_robot_went(chiplog_rig: Rig) -> None:
    chiplog_rig.send("COMMAND", v_m_s=0.5)
    chiplog_rig.run_for(10.0)
    assert chiplog_rig.truth.x_m == pytest.approx(5.0, abs=0.1)
    assert chiplog_rig.odometry == pytest.approx(chiplog_rig.truth, abs=0.001)


def test_the_node_survives_a_damaged_frame_without_losing_its_way(chiplog_rig: Rig) -> None:
    chiplog_rig.send("COMMAND", v_m_s=0.5, w_rad_s=0.5)
    chiplog_rig.run_for(1.0)
    chiplog_rig.fault("corrupt", "ENCODER", count=3)
    chiplog_rig.run_for(1.0)
    assert chiplog_rig.odometry == pytest.approx(chiplog_rig.truth, abs=0.001)


def test_the_node_says_nothing_before_it_has_seen_an_encoder(chiplog_rig: Rig) -> None:
    with chiplog_rig.fault("silence", node="PLANT"):
        chiplog_rig.expect_none("ODOMETRY_X", within_s=0.5)
    chiplog_rig.expect("ODOMETRY_X", within_s=0.02, x_m=pytest.approx(0.0, abs=1e-9))
