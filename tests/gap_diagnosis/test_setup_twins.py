"""Mistakes of the set-up that leave the same log are equally likely, whichever was made."""

from __future__ import annotations

from structure_cases import PRIOR, ROBOT, drive

from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from hil_harness.effects import EffectSetting

NEAR_NATS = 5.0


def test_without_a_reference_wheels_that_are_swapped_look_like_a_gyro_of_other_sign() -> None:
    recording = drive("figure8", EffectSetting("setup_wheels_swapped", ()), reference=False)
    block = MotionBlock(MotionModel(recording, ROBOT, PRIOR, gross=True))
    swapped, sign = (
        block.fit(frozenset({one})).log_evidence for one in ("setup_wheels_swapped", "setup_sign")
    )
    assert swapped > 100
    assert abs(swapped - sign) < NEAR_NATS


def test_what_else_is_wrong_with_a_robot_tells_no_sign_from_swapped_wheels() -> None:
    """Beside a real robot's bias, lag and wide axle, swapped wheels were 80 nats likelier than the
    sign that a Kobuki's gyro was given, and an unlisted cause than both of them as they were."""
    real = (
        EffectSetting("setup_wheels_swapped", ()),
        EffectSetting("gyro_bias", (("bias", -0.01),)),
        EffectSetting("gyro_lag", (("time_constant", 0.05),)),
        EffectSetting("wheelbase_scale", (("scale", 0.04),)),
        EffectSetting("backlash", (("side", "both"), ("width", 0.015))),
    )
    recording = drive("figure8", *real, reference=False)
    block = MotionBlock(MotionModel(recording, ROBOT, PRIOR, gross=True))
    swapped, sign = (block.fit(frozenset({one})) for one in ("setup_wheels_swapped", "setup_sign"))
    assert abs(swapped.log_evidence - sign.log_evidence) < NEAR_NATS
    assert abs(swapped.log_likelihood - sign.log_likelihood) < NEAR_NATS
    alone, _ = block.scan.gained(block.scan.found[frozenset({"setup_wheels_swapped"})])
    assert swapped.log_evidence > alone + 100
    beside = block.beside_mistake(frozenset({"clock_skew", "setup_wheels_swapped"}))
    assert beside >= {"gyro_lag", "wheelbase_scale"}
    assert not block.beside_mistake(frozenset({"gyro_bias"}))
