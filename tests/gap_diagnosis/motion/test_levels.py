"""The noise levels a log asks for are found from far away, in as many looks as can be afforded."""

from __future__ import annotations

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, some_of

from gap_diagnosis.motion.levels import FLOORS
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import best_levels
from gap_diagnosis.slopes import Weighed
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

REFERENCE = ReferenceNoise(0.001, 0.001, 0.0005, 0.0005, 1.0)
RECORDING = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), 5, reference=REFERENCE)
MODEL = MotionModel(RECORDING, ROBOT, default_prior())
PRIOR = MODEL.level_prior


def height(levels: Floats) -> float:
    return MODEL.evidence_at((), levels) + PRIOR.log_density(np.log(levels))


def test_from_levels_two_spreads_off_the_same_top_is_reached(size: str) -> None:
    """Slopes alone (L-BFGS) ended 10 to 980 nats below, after 200 to 270 looks."""
    reached = height(MODEL.levels_for((), PRIOR.median))
    looks = 0
    weigh = MODEL._of_levels(())

    def counted(levels: Floats) -> Weighed:
        nonlocal looks
        looks += 1
        return weigh(levels)

    for seed in some_of(size, (3, 0, 1, 2), 2):
        away = 2.0 * PRIOR.spread * np.random.default_rng(seed).standard_normal(len(FLOORS))
        start = np.maximum(PRIOR.median * np.exp(away), FLOORS)
        looks = 0
        assert height(best_levels(counted, PRIOR, start)) > reached - 0.1
        assert looks <= 29 * len(FLOORS), "a round asks for the slope along each"


def test_a_fit_that_begins_at_levels_of_another_ends_as_high() -> None:
    """Five sets of one log each climbed the same 720 nats, in eight rounds each."""
    (term, *_) = (one for one in MODEL.columns.terms if one.variant.effect == "wheelbase_scale")
    far = PRIOR.median * 5.0
    slow = MODEL.refit((term,), far)
    quick = MODEL.refit((term,), far, known=(slow.levels,))
    assert quick.log_evidence == pytest.approx(slow.log_evidence, abs=0.3)
    np.testing.assert_allclose(quick.coefficients, slow.coefficients, rtol=0.05, atol=1e-5)


def test_no_step_is_tried_where_none_promises_anything() -> None:
    levels = MODEL.no_effect_levels
    looks = 0

    def counted(at: Floats) -> Weighed:
        nonlocal looks
        looks += 1
        return MODEL._of_levels(())(at)

    np.testing.assert_allclose(best_levels(counted, PRIOR, levels), levels, rtol=0.1)
    assert looks <= 2 * (1 + len(FLOORS)) + 1


def test_a_level_that_the_log_denies_ends_on_its_floor() -> None:
    """Data without noise: whatever is tried, less is better."""

    def weigh(levels: Floats) -> Weighed:
        white = np.zeros((400, 1))
        variance = np.full(400, 2 * np.log(levels[0]))
        return Weighed(-0.5 * float(variance.sum()), white, variance)

    found = best_levels(weigh, PRIOR, PRIOR.median)
    assert found[0] == pytest.approx(FLOORS[0])
    np.testing.assert_allclose(found[1:], PRIOR.median[1:], rtol=1e-3)


def test_levels_at_which_the_filter_runs_out_of_digits_are_left_as_they_are() -> None:
    def weigh(levels: Floats) -> Weighed:
        return Weighed(-1e15, np.full((9, 2), np.nan), np.full(9, np.nan))

    np.testing.assert_allclose(best_levels(weigh, PRIOR, PRIOR.median), PRIOR.median)
