"""Draws from a posterior are weighed as the effects act, not along straight lines."""

from __future__ import annotations

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.importance import log_weights
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.pareto import tail_shape
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

BENT = ("reference_lever_arm", "turn_scrub")
RECORDING = synthetic_recording(
    ROBOT,
    WIRE,
    scenario("calibration"),
    [
        EffectSetting("reference_lever_arm", (("x", 0.05), ("y", -0.02))),
        EffectSetting("turn_scrub", (("scrub", 0.1),)),
    ],
    3,
    reference=ReferenceNoise(0.001, 0.001, 0.0005, 0.0005, 1.0),
)
MODEL = MotionModel(RECORDING, ROBOT, default_prior())
TERMS = tuple(
    next(one for one in MODEL.columns.terms if one.variant.effect == name) for name in BENT
)
FIT = MODEL.refit(TERMS, MODEL.levels_for(TERMS, MODEL.level_prior.median))
SIZES = np.concatenate([np.array(one) for one in FIT.coefficients])


def test_where_the_lines_touch_the_effects_nothing_is_to_be_corrected() -> None:
    (weight,) = log_weights(MODEL, TERMS, FIT, SIZES[np.newaxis])
    assert weight == pytest.approx(0.0, abs=1e-6)


def test_a_weight_is_the_likelihood_as_the_effects_bend_over_that_along_the_lines() -> None:
    sizes = SIZES + np.array([0.02, -0.01, 0.05])
    (weight,) = log_weights(MODEL, TERMS, FIT, sizes[np.newaxis])
    values, nuisances, _ = MODEL.linearised(TERMS, FIT.coefficients)
    lines = values[..., len(nuisances) + 1 :]
    smooth = MODEL.nodes.smooth

    def changes(x: float, y: float, scrub: float) -> np.ndarray:
        settings = [(TERMS[0].variant, (x, y)), (TERMS[1].variant, (scrub,))]
        return residuals(MODEL.nodes, predict(smooth, settings))

    def likelihood(left: np.ndarray) -> float:
        known = values[..., 1 : len(nuisances) + 1]
        columns = np.ascontiguousarray(np.concatenate([left[..., np.newaxis], known], axis=-1))
        white = whiten(columns, MODEL.course, FIT.levels, MODEL.nodes.ticks)
        return gram_of(*white, nuisances, FIT.levels).log_nothing

    bent = values[..., 0] - lines @ SIZES + changes(*sizes) - changes(*SIZES)
    straight = values[..., 0] - lines @ sizes
    assert weight == pytest.approx(likelihood(bent) - likelihood(straight), rel=1e-6)
    assert abs(weight) > 1.0, "so far off the lines are astray"


def test_three_sizes_are_checked_by_draws_and_one_needs_none() -> None:
    others = frozenset(one.variant.effect for one in MODEL.columns.terms) - {*BENT}
    block = MotionBlock(MotionModel(RECORDING, ROBOT, default_prior(), without=others))
    checked = block.detail(frozenset(BENT)).pareto_k
    assert checked is not None
    assert checked < 0.7
    assert block.detail(frozenset({"turn_scrub"})).pareto_k is None


def test_a_heavy_tail_has_a_large_shape_and_a_light_one_a_small_one() -> None:
    """Weights whose 1/k-th moment is the first that diverges (Vehtari et al. 2024)."""
    draws = np.random.default_rng(2).pareto(1.0, 4000)
    assert tail_shape(np.log(draws)) == pytest.approx(1.0, abs=0.15)
    assert tail_shape(np.log(np.random.default_rng(2).uniform(0.5, 1.0, 4000))) < 0.0
    assert tail_shape(np.zeros(200)) == 0.0
