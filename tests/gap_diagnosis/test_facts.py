"""What a diagnosis says of its logs beside the verdict."""

from dataclasses import replace

import numpy as np
from fake_blocks import analysis

from gap_diagnosis.facts import notes_on
from gap_diagnosis.recording import Recording

_ROWS = np.arange(4)
LOG = Recording("drive.csv", 0.01, _ROWS * 0.01, _ROWS * 0.01, _ROWS, _ROWS * 1.0, _ROWS * 1.0)


def test_what_reading_a_log_noted_is_said_under_its_name() -> None:
    noted = replace(LOG, notes=("3 values are missing.",))
    assert "drive.csv: 3 values are missing." in notes_on([analysis(noted)], ())
    assert not any(one.startswith("drive.csv") for one in notes_on([analysis(LOG)], ()))
