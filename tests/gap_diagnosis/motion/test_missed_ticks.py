"""Counts are lost above a speed of the wheel's own, which the counts that are left do not show."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from motion_cases import ROBOT, WIRE, nodes_of, setting_of
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.explanations.reference import USUAL_S
from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Value
from gap_diagnosis.motion.edges import best_edges
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

PROBABILITY = 0.12
CRUISES_RAD_S = 4.98


def test_a_wheel_that_counts_slower_than_the_threshold_may_be_faster() -> None:
    """At 5 % above the threshold 12 % were lost, and what was counted lay below it: of a whole
    drive none was put back."""

    def driven(*effects: EffectSetting) -> tuple[float, float, float]:
        log = synthetic_recording(
            ROBOT,
            WIRE,
            scenario("calibration"),
            effects,
            3,
            reference=ReferenceNoise(),
            duration_s=16.0,
        )
        motion = nodes_of(log).smooth
        settings = setting_of(motion, "missed_ticks", values) if effects else []
        put_back = predict(motion, settings).left_rad.sum()
        return float(put_back), float(motion.left_step_rad.sum()), motion.rad_per_count

    values: dict[str, Value] = {
        "side": "left",
        "probability": PROBABILITY,
        "threshold": CRUISES_RAD_S / 1.05,
    }
    true_rad, _, per_count_rad = driven()
    put_back_rad, counted_rad, _ = driven(EffectSetting("missed_ticks", tuple(values.items())))
    lost = (true_rad - counted_rad) / per_count_rad
    assert lost > 0.8 * PROBABILITY * true_rad / per_count_rad
    by_chance_rad = math.sqrt(lost / (1.0 - PROBABILITY)) * per_count_rad
    assert abs(put_back_rad - true_rad) < 4 * by_chance_rad


def test_a_threshold_is_found_wherever_the_search_begins() -> None:
    """This log drives at 1.5 and at 5 rad/s; from above the walk uphill ended where it began."""
    values = (("side", "left"), ("probability", 0.05), ("threshold", 3.0))
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        [EffectSetting("missed_ticks", values)],
        3,
        reference=ReferenceNoise(),
        duration_s=34.0,
    )
    others = frozenset(EXPLAINED) - {"missed_ticks"}
    model = MotionModel(log, ROBOT, default_prior(), without=others)
    left = [one for one in model.columns.terms if one.variant.report.get("side") == "left"]
    for term in (left[0], left[-1]):
        edged = best_edges(model, (term,), 0, ((0.02,),), model.level_prior.median)
        assert 1.5 < edged.term.variant.fixed["threshold"] < 5.0


THRESHOLD_RAD_S = 6.8
RAMP_RAD_S2 = 5.0


def passing() -> Motion:
    """Return the motion of a left wheel that passes the threshold upwards and downwards, losing
    counts above it."""
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (), 3, reference=ReferenceNoise(), duration_s=8.0
    )
    motion = nodes_of(log).smooth
    own_rad_s = np.minimum(RAMP_RAD_S2 * np.minimum(motion.t_s, 8.0 - motion.t_s), 9.0)
    counted_rad_s = own_rad_s * np.where(own_rad_s > THRESHOLD_RAD_S, 1 - PROBABILITY, 1.0)
    smoothed = gaussian_filter1d(counted_rad_s, USUAL_S / motion.tick_s)
    return replace(
        motion,
        left_rate_rad_s=smoothed,
        speed_m_s=own_rad_s * motion.radius_m,
        turn_rate_rad_s=np.zeros(len(own_rad_s)),
    )


def test_along_its_probability_counts_are_lost_where_they_were() -> None:
    """Where a little more loses them elsewhere too, a slope is as steep as the step is small: of
    0.002 it said 0.00005 as standard deviation."""
    motion = passing()
    values: dict[str, Value] = {
        "side": "left",
        "probability": PROBABILITY,
        "threshold": THRESHOLD_RAD_S,
    }
    ((variant, _),) = setting_of(motion, "missed_ticks", values)
    about = variant.smooth_about((PROBABILITY,))
    here, near = (
        predict(motion, [(about, (size,))]).left_rad for size in (PROBABILITY, PROBABILITY + 0.01)
    )
    grown = near[here != 0] / here[here != 0]
    expected = (1 - PROBABILITY) / (1 - PROBABILITY - 0.01)
    assert np.all(np.isclose(grown, 1.0) | np.isclose(grown, expected))
