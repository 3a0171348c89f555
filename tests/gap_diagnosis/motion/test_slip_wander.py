"""A slip that wanders is noise: its level is told, and it hides no cause."""

from __future__ import annotations

from dataclasses import replace

import pytest
from motion_cases import ROBOT, WIRE, some_of

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.whitening import SLIP_WANDER
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

SHARE = 0.004
WANDERS = EffectSetting("micro_slip", (("wander_left", SHARE), ("wander_right", SHARE)))
REFERENCE = ReferenceNoise(0.0005, 0.0005, 0.0, 0.0)


def drive(seed: int, *effects: EffectSetting) -> Recording:
    still = replace(scenario("calibration"), effects=())
    return synthetic_recording(ROBOT, WIRE, still, effects, seed, reference=REFERENCE)


def level_of(log: Recording) -> float:
    return float(MotionModel(log, ROBOT, default_prior()).no_effect_levels[SLIP_WANDER])


def test_by_how_much_wheels_slip_now_more_and_now_less_is_told(size: str) -> None:
    """Some 80 s in motion are 40 correlation times of either wheel: the spread of 80 values is told
    to 8 %; four of those, and what the usual level beforehand draws it to."""
    for seed in some_of(size, (1, 2, 3, 4), 2):
        assert level_of(drive(seed, WANDERS)) == pytest.approx(SHARE, rel=0.4)


def test_wheels_that_hold_slip_by_no_more_than_is_usual(size: str) -> None:
    for seed in some_of(size, (1, 2, 3, 4), 2):
        model = MotionModel(drive(seed), ROBOT, default_prior())
        assert model.no_effect_levels[SLIP_WANDER] <= model.level_prior.median[SLIP_WANDER]


@pytest.mark.full_size
def test_a_gyro_scale_needs_no_slip_for_company_where_slip_wanders(size: str) -> None:
    """Of a random walk alone a slip, and up to four more, gained 5, 27 and 35 nats beside it."""
    for seed in some_of(size, (3, 2)):
        log = drive(seed, WANDERS, EffectSetting("gyro_scale", (("scale", 0.03),)))
        scan = Scan(MotionModel(log, ROBOT, default_prior()))
        gained = {one: scan.gained(found)[0] for one, found in scan.found.items()}
        alone = gained[frozenset({"gyro_scale"})]
        assert alone > 50
        assert max(gained.values()) < alone + 6
