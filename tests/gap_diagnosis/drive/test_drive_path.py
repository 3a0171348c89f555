"""Where commands lead is held against wheels whose stamps are as late as they are."""

import pytest
from drive_recordings import ROBOT, simulated
from foreign_drives import table_of_executed_commands

from gap_diagnosis.drive.shapes import drive_beside_described
from gap_diagnosis.gap.drive_path import late_s_of
from gap_diagnosis.recording import Recording


def late_s(recording: Recording, **parameters: float) -> float:
    data = drive_beside_described(recording, ROBOT)
    assert data is not None
    known = {name.replace("__", "."): value for name, value in parameters.items()}
    return late_s_of(data, ROBOT, known)


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_row_that_tells_what_was_carried_out_in_it_is_mapped(seed: int) -> None:
    """Commands that rise within rows of 50 ms and are told at their ends lead by a tick of 10 ms,
    by half a one as its angles are added up, and by 20 ms as they are held. With that in it a right
    saturation left 12 mm of a gap of 7."""
    assert late_s(table_of_executed_commands(seed)) == pytest.approx(-0.035, abs=0.002)


def test_a_log_says_when_a_command_was_in_force() -> None:
    assert late_s(simulated(seed=1)) == pytest.approx(0.0, abs=0.002)
    slow = simulated({"drive_lag": {"time_constant": 0.1}}, seed=1)
    assert late_s(slow, drive_lag__time_constant=0.1) == pytest.approx(0.0, abs=0.002)


def test_no_more_is_mapped_than_stamps_leave_open() -> None:
    """What is later than that is an effect, and its gap is not mapped away."""
    late = simulated({"drive_delay": {"delay": 0.05}}, seed=1)
    assert late_s(late) == pytest.approx(0.008, abs=1e-3)
