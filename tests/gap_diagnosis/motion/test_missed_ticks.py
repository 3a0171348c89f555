"""Counts are lost above a speed of the wheel's own, which the counts that are left do not show."""

from __future__ import annotations

import math

from motion_cases import ROBOT, WIRE, nodes_of, setting_of

from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Value
from gap_diagnosis.motion.edges import best_edges
from gap_diagnosis.motion.model import MotionModel
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
