"""A robot that is described wrong in several ways is told each of them."""

from __future__ import annotations

import numpy as np
import pytest
from motion_cases import LEVELS, ROBOT, WIRE, model_of

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.beside import gains_beside
from gap_diagnosis.motion.evidence import score
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

WRONG = {
    "gyro_bias": ("bias", 0.01),
    "gyro_scale": ("scale", 0.02),
    "radius_mismatch": ("mismatch", 0.006),
    "reference_time_offset": ("offset", 0.04),
    "wheelbase_scale": ("scale", 0.02),
}
RIVALS = (
    "gyro_asymmetry",
    "gyro_lag",
    "lateral_slip",
    "radius_scale",
    "reference_clock_skew",
    "reference_lever_arm",
    "reference_scale",
    "turn_scrub",
)
"""What else might be told beside constants that are off."""
NO_NEWS = 6.0
"""Below this gain [nat] a sixth effect has not become likelier than none, with the prior."""


def test_five_constants_that_are_off_are_five_effects_of_the_right_sizes() -> None:
    settings = tuple(EffectSetting(effect, (size,)) for effect, size in WRONG.items())
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        settings,
        5,
        reference=ReferenceNoise(),
        duration_s=60.0,
    )
    found = Scan(model_of(log, *WRONG, *RIVALS)).found
    told = found[frozenset(WRONG)]
    assert max(one.log_evidence for one in found.values()) < told.log_evidence + NO_NEWS
    smaller = (one.log_evidence for one in found.values() if len(one.effects) < len(WRONG))
    assert max(smaller) < told.log_evidence - 50
    assert told.refitted is not None
    likeliest = int(told.refitted.scored.weights.argmax())
    variances = told.refitted.scored.covariances[likeliest].diagonal()
    for term, (size,), variance in zip(
        told.terms, told.refitted.coefficients, variances, strict=True
    ):
        assert abs(size - WRONG[term.variant.effect][1]) < 4 * variance**0.5


def test_beside_a_gyro_that_clips_a_scale_is_told_along_a_column_about_it() -> None:
    """Where it clips a scale changes nothing: the sum of both straight lines is off by that."""
    wrong = {"gyro_saturation": ("limit", 1.6), "gyro_scale": ("scale", -0.02)}
    settings = tuple(EffectSetting(effect, (size,)) for effect, size in wrong.items())
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), settings, 5, reference=ReferenceNoise()
    )
    model = MotionModel(log, ROBOT, default_prior())
    of = {one.variant.effect: one for one in model.columns.terms}
    clips, scale = of["gyro_saturation"], of["gyro_scale"]
    fit = model.refit([clips], LEVELS)
    rivals = {name: [of[name]] for name in ("gyro_scale", "gyro_bias", "gyro_g_sensitivity")}
    found = gains_beside(model, [clips], fit, rivals)
    beside = found["gyro_scale"]
    assert beside.log_evidence == max(one.log_evidence for one in found.values())
    summed = score(model.gram(fit.levels), [clips, scale], model.prior)
    size = float(summed.means[int(summed.weights.argmax()), 0])
    assert abs(beside.sizes[0] + 0.02) < 0.001
    assert abs(size + 0.02) > 0.002


@pytest.mark.full_size
def test_a_reference_far_off_in_time_whose_clock_drifts_brings_no_company() -> None:
    """A sample speaks of the tick that it was taken in; at that of its stamp, a quarter of a second
    later, three effects more made up for what wheels and floor had done meanwhile."""
    wrong = {"reference_time_offset": ("offset", 0.25), "reference_clock_skew": ("skew", 0.002)}
    settings = tuple(EffectSetting(effect, (size,)) for effect, size in wrong.items())
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        settings,
        5,
        reference=ReferenceNoise(),
        duration_s=50.0,
    )
    company = (
        "frame_latency",
        "grade_slip",
        "longitudinal_slip",
        "one_sided_slip",
        "radius_mismatch",
    )
    found = Scan(model_of(log, *wrong, *RIVALS, *company)).found
    told = found[frozenset(wrong)]
    assert max(one.log_evidence for one in found.values()) < told.log_evidence + NO_NEWS


def test_noise_levels_of_a_fit_do_not_depend_on_those_it_began_with() -> None:
    """They are sought on as long as that pays: a noisier reference is no place to stop."""
    wrong = {"reference_time_offset": ("offset", 0.25), "reference_clock_skew": ("skew", 0.002)}
    settings = tuple(EffectSetting(effect, (size,)) for effect, size in wrong.items())
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), settings, 5, reference=ReferenceNoise()
    )
    model = MotionModel(log, ROBOT, default_prior())
    terms = [one for one in model.columns.terms if one.variant.effect in wrong]
    noisy = LEVELS.copy()
    noisy[6:] *= 4.0
    usual, from_noisy = (model.refit(terms, levels).log_evidence for levels in (LEVELS, noisy))
    assert from_noisy == pytest.approx(usual, abs=10.0)


def test_effects_act_in_the_order_of_the_robot_not_in_that_in_which_they_are_named() -> None:
    """A bias is added behind the gyro's scale: it is not multiplied by it."""
    log = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), 5, duration_s=20.0)
    model = MotionModel(log, ROBOT, default_prior())
    by_effect = {one.variant.effect: one.variant for one in model.columns.terms}
    settings = [(by_effect["gyro_scale"], (0.02,)), (by_effect["gyro_bias"], (0.01,))]
    there = predict(model.nodes.smooth, settings).gyro_rad_s
    assert np.array_equal(predict(model.nodes.smooth, settings[::-1]).gyro_rad_s, there)
    at_rest = np.abs(model.nodes.smooth.turn_rate_rad_s) < 1e-6
    assert there[at_rest] == pytest.approx(0.01, abs=2e-6)


def test_what_two_clocks_are_apart_is_fitted_whatever_straight_lines_say() -> None:
    """Of a recorded robot's run, its stamps 10 ms astray, a line of delays through none amid the
    log gained 3 nats along straight lines and 107 once fitted: an unlisted cause, > 0.999."""
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (), 5, reference=ReferenceNoise(), duration_s=30.0
    )
    clocks = "reference_clock_skew", "reference_time_offset"
    found = Scan(model_of(log, *clocks, *RIVALS)).found[frozenset(clocks)]
    assert found.refitted is not None
