"""No explanation is made of the noise that it would explain."""

from __future__ import annotations

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.unknown import basis
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ROBOT, WIRE = load_robot(), load_wire()


def model(kind: str) -> MotionModel:
    log = synthetic_recording(
        ROBOT, WIRE, scenario(kind), (), 24, reference=ReferenceNoise(), duration_s=20.0
    )
    return MotionModel(log, ROBOT, default_prior())


def test_codes_that_hardly_turn_beyond_their_noise_are_no_variable_of_the_gyros_error() -> None:
    assert basis(model("stop_and_go").nodes.smooth, "adc_code") == []
    assert len(basis(model("figure8").nodes.smooth, "adc_code")) > 0


def test_on_the_spot_no_scale_of_the_reference_is_tried() -> None:
    def effects(kind: str) -> set[str]:
        return {term.variant.effect for term in model(kind).columns.terms}

    assert "reference_scale" not in effects("spin")
    assert "reference_scale" in effects("calibration")
