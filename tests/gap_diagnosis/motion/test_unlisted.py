"""What a cause without a name depends on is found among the variables that it can depend on."""

from __future__ import annotations

from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.unknown import alternatives
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def test_each_wheels_slip_when_speeding_up_is_a_function_of_its_own_acceleration() -> None:
    """In a turn the wheels speed up against each other: of the body there is nothing to see."""
    slip = EffectSetting("longitudinal_slip", (("compliance", 0.03),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (slip,), 3, reference=ReferenceNoise()
    )
    model = MotionModel(log, ROBOT, default_prior(), without=frozenset({"longitudinal_slip"}))
    best, second = alternatives(model, model.no_effect_levels)[:2]
    assert (best.stage, best.variable) == ("wheel", "acceleration")
    assert best.log_evidence > 50
    assert best.log_evidence > second.log_evidence + 20


def test_what_drifts_with_the_supply_may_be_the_gyros_scale() -> None:
    ratio = EffectSetting("supply_ratio", (("coefficient", -0.16),))
    sagging = EffectSetting("supply_change", (("offset", -0.1), ("rate", -0.004)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (sagging, ratio), 3, reference=ReferenceNoise()
    )
    model = MotionModel(log, ROBOT, default_prior(), without=frozenset({"supply_ratio"}))
    best = alternatives(model, model.no_effect_levels)[0]
    assert best.stage == "gyro"
    assert best.variable in {"supply", "time"}
    assert best.log_evidence > 50
