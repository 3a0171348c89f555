"""A gyro that clips, or whose converter holds a bit: its constants act otherwise there."""

from __future__ import annotations

from dataclasses import replace

import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
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
