"""What one model fits, another of the same drive fits along columns of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

LOG = synthetic_recording(
    ROBOT, WIRE, scenario("calibration"), (), 5, reference=ReferenceNoise(rate_hz=20.0)
)
WHOLE = MotionModel(LOG, ROBOT, default_prior())
BLIND = replace(LOG, gyro_code=None, gyro_rate_rad_s=None)


@pytest.mark.parametrize("effect", ["reference_clock_skew", "reference_time_offset"])
def test_a_term_is_held_against_the_columns_of_the_model_that_takes_it(effect: str) -> None:
    """What is little of an effect is held at nothing beside it: by its place in the other model, it
    was another column, or none (IndexError in a sealed trial)."""
    other = MotionModel(BLIND, ROBOT, default_prior())
    assert other.columns.values.shape[-1] < WHOLE.columns.values.shape[-1]
    (theirs,) = (one for one in WHOLE.columns.terms if one.variant.effect == effect)
    (own,) = (one for one in other.columns.terms if one.variant.effect == effect)
    assert any(share == 0.0 for _, share in theirs.weights[0]), "else nothing is held"
    levels = other.level_prior.median
    expected = other.refit((own,), levels)
    taken = other.take(theirs)
    assert taken.weights[0][1:] == own.weights[0][1:]
    found = other.refit((taken,), levels)
    np.testing.assert_allclose(found.coefficients, expected.coefficients, rtol=0.02, atol=1e-7)
    assert found.log_evidence == pytest.approx(expected.log_evidence, abs=0.1)


def test_an_effect_that_the_other_model_does_not_have_is_taken_bare() -> None:
    other = MotionModel(BLIND, ROBOT, default_prior(), without=frozenset({"reference_clock_skew"}))
    (theirs,) = (t for t in WHOLE.columns.terms if t.variant.effect == "reference_clock_skew")
    taken = other.take(theirs)
    assert [share for _, share in taken.weights[0]] == [1.0]
