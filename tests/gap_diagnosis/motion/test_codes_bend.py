"""A gyro that clips, or whose converter holds a bit: its constants act otherwise there."""

from __future__ import annotations

from dataclasses import replace

import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

COMPANIONS = frozenset({"gyro_bias", "gyro_scale", "gyro_nonlinearity", "gyro_asymmetry"})


@pytest.mark.parametrize("value", [0, 1])
def test_what_a_gyro_may_be_off_by_is_no_companion_of_a_stuck_bit(value: int) -> None:
    """About no effect a scale of 0.3 % bends nothing; where a bit is held it moves each step."""
    bias = 1e-4 if value == 0 else -1e-4
    effects = [
        EffectSetting("adc_stuck_bit", (("bit", 7), ("value", value))),
        EffectSetting("gyro_scale", (("scale", 0.003),)),
        EffectSetting("gyro_bias", (("bias", bias),)),
    ]
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), seed=3),
        effects,
        5,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    model = MotionModel(log, ROBOT, default_prior())
    own = COMPANIONS | {"adc_stuck_bit"}
    some = tuple(one for one in model.columns.terms if one.variant.effect in own)
    model.columns = replace(model.columns, terms=some)
    block = MotionBlock(model)
    alone = block.fit(frozenset({"adc_stuck_bit"})).log_evidence
    for effect in sorted(COMPANIONS):
        both = block.fit(frozenset({"adc_stuck_bit", effect})).log_evidence
        assert both < alone + 1.0, effect


def test_wheels_that_roll_roughly_do_not_tell_which_code_a_held_bit_hides() -> None:
    """A tick's rate varies by the contact's noise of that tick: by 90 codes here, not by a few."""
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), seed=3),
        [EffectSetting("adc_stuck_bit", (("bit", 8), ("value", 1)))],
        5,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=1e-3,
        duration_s=40.0,
    )
    model = MotionModel(log, ROBOT, default_prior())
    held = [one for one in model.columns.terms if one.variant.effect == "adc_stuck_bit"]
    levels = model.no_effect_levels
    fits = {
        term.variant.fixed["contact_m_per_sqrt_m"]: model.refit([term], levels) for term in held
    }
    best = max(fits, key=lambda contact: fits[contact].log_evidence)
    assert best == 1e-3
    assert fits[best].log_evidence > fits[0.0].log_evidence + 50.0
    # With that, jumps are noise of their own: a held bit makes no noisy gyro.
    noise = LEVELS.index("gyro_noise_rad_per_sqrt_s")
    assert fits[best].levels[noise] < 0.7 * fits[0.0].levels[noise]
