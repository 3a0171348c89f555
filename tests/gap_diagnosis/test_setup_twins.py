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
