"""What is within tolerance is told beside an effect as it is beside none, where that is nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, model_of

from gap_diagnosis.motion.constants_beside import free_about
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

BESIDE = (
    "backlash",
    "encoder_eccentricity",
    "grade_slip",
    "gyro_asymmetry",
    "gyro_lag",
    "lateral_slip",
    "one_sided_slip",
    "reference_lever_arm",
    "reference_time_offset",
    "turn_scrub",
    "wheel_eccentricity",
)


@pytest.fixture(scope="module")
def model() -> MotionModel:
    drive = replace(scenario("square"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, drive, (), 5, reference=ReferenceNoise(), duration_s=30.0
    )
    return model_of(log, *BESIDE)


@pytest.mark.parametrize("effect", BESIDE)
def test_beside_an_effect_of_no_size_constants_do_what_they_do_beside_none(
    model: MotionModel, effect: str
) -> None:
    """A gyro's lag was told along smooth turns beside an effect, and along sharp ones beside none:
    an eccentric wheel lost 31 nats by that, and was an unlisted cause (0.96)."""
    term = next(one for one in model.columns.terms if one.variant.effect == effect)
    none = tuple(0.0 for _ in term.variant.coefficients)
    columns = model.columns
    told = free_about(model.nodes, columns, 0.0, columns.nuisances, (term,), (none,))
    known = columns.within_tolerance
    for place in range(1, known.shape[-1]):
        size = np.linalg.norm(np.nan_to_num(known[..., place]))
        moved = np.linalg.norm(np.nan_to_num(told[..., place] - known[..., place]))
        assert moved < 3e-3 * size
