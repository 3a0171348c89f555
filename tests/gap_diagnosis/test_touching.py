"""Which stage can touch which residual: what the table says is what effects do."""

import numpy as np
import pytest

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.touching import (
    TOUCHED_BY,
    WHEEL_HEADING_AGAINST_GYRO,
    WHEEL_HEADING_AGAINST_REFERENCE,
    WHEELS_AGAINST_REFERENCE,
    stages_that_touch,
)
from hil_harness.assembly import load_wire
from hil_harness.effects import catalogue
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ROBOT, WIRE = load_robot(None), load_wire()
CHANNELS = (
    WHEELS_AGAINST_REFERENCE,
    WHEELS_AGAINST_REFERENCE,
    WHEEL_HEADING_AGAINST_REFERENCE,
    WHEEL_HEADING_AGAINST_GYRO,
)
"""In the order of a model's columns."""


def moved(drive: str) -> dict[tuple[str, str], bool]:
    """Return by effect and residual whether any of its variants moves it on a drive."""
    log = synthetic_recording(ROBOT, WIRE, scenario(drive), (), 5, reference=ReferenceNoise())
    model = MotionModel(log, ROBOT, default_prior())
    found: dict[tuple[str, str], bool] = {}
    for term in model.columns.terms:
        for weight in term.weights:
            column = sum(share * model.columns.values[..., 1 + index] for index, share in weight)
            for residual, values in zip(CHANNELS, np.asarray(column), strict=True):
                key = term.variant.effect, residual
                found[key] = found.get(key, False) or bool(np.nanmax(np.abs(values)) > 0.0)
    return found


MOVED = moved("calibration")


@pytest.mark.parametrize("effect", sorted({effect for effect, _ in MOVED}))
def test_an_effect_moves_no_residual_that_its_stage_cannot_touch(effect: str) -> None:
    """Not by a rounding error: the columns are zero."""
    stage = catalogue()[effect].stage
    for residual in set(CHANNELS):
        if stage not in TOUCHED_BY[residual]:
            assert not MOVED[effect, residual]


@pytest.mark.parametrize("residual", sorted(set(CHANNELS)))
def test_each_stage_that_is_said_to_touch_a_residual_has_an_effect_that_does(residual: str) -> None:
    """But the bus, whose late frames have no column of their own."""
    known = catalogue()
    stages = {
        known[effect].stage
        for (effect, one), is_moved in MOVED.items()
        if is_moved and one == residual
    }
    assert stages == TOUCHED_BY[residual] - {"bus"}


def test_what_shows_only_where_a_gyro_is_compared_is_the_gyros() -> None:
    """The reading rule of the catalogue: in the wheels against the gyro and not against a
    reference."""
    assert set(stages_that_touch(WHEEL_HEADING_AGAINST_GYRO)) - set(
        stages_that_touch(WHEEL_HEADING_AGAINST_REFERENCE)
    ) == {"gyro"}


def test_a_residual_is_of_its_kind_whatever_it_is_along() -> None:
    along_x = stages_that_touch(f"{WHEELS_AGAINST_REFERENCE}, along x")
    assert along_x == stages_that_touch(WHEELS_AGAINST_REFERENCE)
