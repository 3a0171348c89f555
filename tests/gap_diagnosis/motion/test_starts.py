"""A reference that is off by decimetres and wanders is found to be so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

GPS = ReferenceNoise(
    position_m=0.1,
    heading_rad=0.001,
    coloured_position_m=0.3,
    coloured_heading_rad=0.0005,
    correlation_time_s=10.0,
    rate_hz=10.0,
)


def test_the_wander_of_a_gps_is_the_references_and_not_the_floors() -> None:
    recording = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), 1, reference=GPS)
    model = MotionModel(recording, ROBOT, default_prior())
    found = dict(zip(LEVELS, model.no_effect_levels, strict=True))
    assert 0.08 < found["reference_position_m"] < 0.12
    assert 0.15 < found["reference_slow_position_m"] < 0.6
    assert found["reference_slow_s"] > 4.0
    assert found["lateral_m_per_sqrt_m"] < 1e-3


def test_wheels_that_skid_are_no_end_of_the_search_beside_a_gps() -> None:
    """A search that began in a room ended at wheels that skid by 0.2 m per root metre, and no start
    was likelier than that before it was sought from: a drive's gain of -10 % was unlisted (0.61).
    """
    seldom = replace(GPS, position_m=0.4, coloured_position_m=0.5, rate_hz=1.0)
    log = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), 1, reference=seldom)
    assert log.reference is not None
    blind = replace(log, reference=replace(log.reference, heading_rad=None))
    model = MotionModel(blind, ROBOT, default_prior())
    skids = np.array(model.no_effect_levels)
    skids[LEVELS.index("lateral_m_per_sqrt_m")] = 0.2
    skids[LEVELS.index("reference_slow_position_m")] = 0.01
    better = model.better_start((), skids)
    assert better is not None
    assert better[LEVELS.index("lateral_m_per_sqrt_m")] < 1e-3
