"""No explanation is made of the noise that it would explain."""

from __future__ import annotations

from dataclasses import replace

from gap_diagnosis.explanations.choices import adc_inl, adc_stuck_bit
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.unknown import alternatives
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ROBOT, WIRE = load_robot(), load_wire()


GYRO_NOISE = LEVELS.index("gyro_noise_rad_per_sqrt_s")
BENT = (("quadratic", 0.02), ("cubic", 0.02))


def model(kind: str, *effects: EffectSetting) -> MotionModel:
    log = synthetic_recording(
        ROBOT, WIRE, scenario(kind), effects, 24, reference=ReferenceNoise(), duration_s=60.0
    )
    return MotionModel(log, ROBOT, default_prior())


def test_no_function_of_the_codes_explains_their_own_noise() -> None:
    """Noise ten times the described leaves less than a nat of news for any function."""
    noise = EffectSetting("gyro_noise", (("density", 0.002),))
    noisy = model("calibration", noise)
    levels = noisy.levels_for((), noisy.level_prior.median, free=(GYRO_NOISE,))
    found = {one.variable: one.log_evidence for one in alternatives(noisy, levels)}
    assert found["adc_code"] < 1.0
    scaled = model("calibration", noise, EffectSetting("gyro_nonlinearity", BENT))
    found = {one.variable: one.log_evidence for one in alternatives(scaled, levels)}
    assert found["adc_code"] > 20.0


def test_on_the_spot_no_scale_of_the_reference_is_tried() -> None:
    def effects(kind: str) -> set[str]:
        return {term.variant.effect for term in model(kind).columns.terms}

    assert "reference_scale" not in effects("spin")
    assert "reference_scale" in effects("calibration")


def test_physical_rates_have_no_converter_that_bends_or_sticks() -> None:
    motion = model("spin").nodes.motion
    assert motion.gyro_code is not None
    physical = replace(motion, gyro_code=motion.gyro_code + 0.3)
    for variants in (adc_inl, adc_stuck_bit):
        assert list(variants(motion))
        assert not list(variants(physical))


def test_a_stuck_bit_is_told_though_the_wheels_hardly_say_which_code_there_should_be() -> None:
    """A contact of half a millimetre per root metre moves the code by more than the bit's half."""
    slip = EffectSetting("micro_slip", (("left", 5e-4), ("right", 5e-4)))
    stuck = EffectSetting("adc_stuck_bit", (("bit", 6), ("value", 0)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (slip, stuck), 3, reference=ReferenceNoise()
    )
    model = MotionModel(log, ROBOT, default_prior())
    levels = model.no_effect_levels
    told = max(
        model.evidence_at((term,), levels)
        for term in model.columns.terms
        if term.variant.effect == "adc_stuck_bit"
    )
    assert told > model.evidence_at((), levels)
