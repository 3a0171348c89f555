"""A slip that wanders is noise: its level is told, and it hides no cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, some_of

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.whitening import SLIP_WANDER
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import Segment, SegmentProfile, scenario

SHARE = 0.004
WANDERS = EffectSetting("micro_slip", (("wander_left", SHARE), ("wander_right", SHARE)))
REFERENCE = ReferenceNoise(0.0005, 0.0005, 0.0, 0.0)


def drive(seed: int, *effects: EffectSetting) -> Recording:
    still = replace(scenario("calibration"), effects=())
    return synthetic_recording(ROBOT, WIRE, still, effects, seed, reference=REFERENCE)


def level_of(log: Recording) -> float:
    return float(MotionModel(log, ROBOT, default_prior()).no_effect_levels[SLIP_WANDER])


def test_what_slips_on_the_way_back_is_a_share_of_it_the_other_way_round() -> None:
    """As of a share of its path, which has no sign, what a wheel slips before and after it turns
    back seemed to jump: two healthy robots of 683 had a wheel that slips for some seconds (.93,
    .95)."""
    to_and_fro = [Segment(v_m_s, w_rad_s, 2.0) for v_m_s, w_rad_s in ((0.4, 0.0), (-0.4, 0.5))]
    still = replace(
        scenario("calibration"), effects=(), profile=SegmentProfile(to_and_fro), duration_s=4.0
    )
    log = synthetic_recording(ROBOT, WIRE, still, (), 1, reference=REFERENCE)
    model = MotionModel(log, ROBOT, default_prior())
    metres = model.nodes.motion.radius_m
    for way_m, path_m, step_rad in (
        (model.course.left_way_m, model.course.left_path_m, model.nodes.motion.left_step_rad),
        (model.course.right_way_m, model.course.right_path_m, model.nodes.motion.right_step_rad),
    ):
        gone = model.nodes.mean(np.cumsum(step_rad) * metres)
        assert way_m.sum() == pytest.approx(gone[-1] - gone[0])
        assert way_m.min() < -0.01 < 0.01 < way_m.max()
        assert (np.abs(way_m) <= path_m + 1e-12).all()


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
