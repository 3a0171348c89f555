"""The C node of this folder on a simulated robot."""

from pathlib import Path
from typing import Any

import pytest
from build_node import build

from hil_harness.rig import Rig


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("c_node"))


@pytest.fixture
def chiplog_settings(library: Path) -> dict[str, Any]:
    """Put the node under test in every rig of this file."""
    return {"device": f"lib:{library}"}


def test_the_node_reports_the_way_that_the_robot_went(chiplog_rig: Rig) -> None:
    chiplog_rig.send("COMMAND", v_m_s=0.5, w_rad_s=0.2)
    chiplog_rig.run_for(10.0)
    assert chiplog_rig.odometry == pytest.approx(chiplog_rig.truth, abs=0.002)


def test_its_frames_say_what_the_library_itself_says(chiplog_rig: Rig) -> None:
    chiplog_rig.send("COMMAND", v_m_s=0.5, w_rad_s=-0.3)
    chiplog_rig.run_for(2.0)
    assert chiplog_rig.device.odometry() == pytest.approx(chiplog_rig.odometry, abs=1e-8)


def test_damaged_encoder_frames_do_not_move_it(chiplog_rig: Rig) -> None:
    chiplog_rig.send("COMMAND", v_m_s=0.5)
    chiplog_rig.run_for(1.0)
    before = chiplog_rig.odometry
    with chiplog_rig.fault("corrupt", "ENCODER"):
        chiplog_rig.run_for(0.5)
        assert chiplog_rig.odometry == before
    chiplog_rig.run_for(0.5)
    assert chiplog_rig.odometry == pytest.approx(chiplog_rig.truth, abs=0.002)
