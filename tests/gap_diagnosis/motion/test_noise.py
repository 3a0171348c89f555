"""A larger level of noise is named where it is noise, not where something comes and goes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, model_of, nothing_of

from gap_diagnosis.hypothesis import Fit
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import _drawn, fit_noise
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import LevelPrior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

DISTURBANCE_RAD_S = 0.03


def fitted(share_of_time: float) -> Fit:
    """Return the fit of a gyro that is disturbed for a share of each ten seconds."""
    still = replace(scenario("figure8"), effects=())
    quiet = synthetic_recording(ROBOT, WIRE, still, (), 5, reference=ReferenceNoise())
    rate = quiet.gyro_rate_rad_s
    assert rate is not None
    disturbed = rate + disturbance(quiet.t_s, share_of_time)
    model = MotionModel(
        replace(quiet, gyro_rate_rad_s=disturbed), ROBOT, default_prior(), without=frozenset()
    )
    nothing = nothing_of(model)
    return fit_noise(model, nothing, nothing, "gyro_noise", ("gyro_noise",))


def disturbance(t_s: Floats, share_of_time: float) -> Floats:
    noise = DISTURBANCE_RAD_S * np.random.default_rng(3).standard_normal(len(t_s))
    return np.asarray(np.where(np.mod(t_s, 10.0) < 10.0 * share_of_time, noise, 0.0))


def test_noise_at_all_times_is_a_noise_of_the_gyro() -> None:
    fit = fitted(1.0)
    assert fit.log_evidence > 20
    tick_s = 0.01
    density = fit.parameters["gyro_noise.density"]
    described = ROBOT.plant.gyro.noise_density_rad_per_sqrt_s
    true = np.hypot(described, DISTURBANCE_RAD_S * np.sqrt(tick_s))
    assert density.value == pytest.approx(true, rel=0.15)


ONES = np.ones(2)
EITHER = LevelPrior(ONES, ONES, 1e-3 * ONES, 1e3 * ONES)


def test_where_others_would_go_beyond_belief_they_stay_and_the_level_is_drawn() -> None:
    """Of a level of which a log says next to nothing the others' way led beyond all numbers: the
    diagnosis ended in a traceback."""

    def value(levels: np.ndarray) -> float:
        assert np.isfinite(levels).all()
        assert (levels[1:] <= EITHER.high[1:]).all()
        return -0.5 * float(np.log(levels[0]) ** 2)

    draws = _drawn(value, ONES, np.array([1.0, 900.0]), 0, (0.0, 1.0, 50.0), EITHER)
    assert np.log(draws).std() == pytest.approx(1.0, rel=0.1)


def test_a_level_is_drawn_as_its_density_has_it_and_never_one_that_is_no_effect() -> None:
    """Draws were normal in the logarithm, on both sides: of walks of the bias that hardly showed,
    84 of 100 95 % intervals held the truth."""
    best, least = 1.2, 0.3

    def leaning(levels: Floats) -> float:
        over = np.log(levels[0] / best)
        return float(2.0 * over - 2.0 * np.exp(over))

    draws = _drawn(
        leaning, np.array([best, 5.0]), np.array([1.0, 0.0]), 0, (least, best, 50.0), EITHER
    )
    over = np.linspace(np.log(least / best), np.log(50.0 / best), 5000)
    density = np.exp(2.0 * over - 2.0 * np.exp(over))
    mean = np.sum(over * density) / np.sum(density)
    sd = np.sqrt(np.sum((over - mean) ** 2 * density) / np.sum(density))
    assert draws.min() >= least
    assert np.log(draws / best).mean() == pytest.approx(mean, abs=4.0 * sd / np.sqrt(len(draws)))
    assert np.log(draws / best).std() == pytest.approx(sd, rel=0.1)


def test_noise_in_one_tenth_of_the_time_is_none() -> None:
    fit = fitted(0.05)
    assert fit.log_evidence < 0
    assert not fit.parameters


def test_beside_each_effect_that_explains_the_same_a_noise_gains_nothing() -> None:
    """A bias and a bend of the converter are the same here: either leaves no walk of the bias."""
    setting = EffectSetting("gyro_bias", (("bias", 0.004),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), (setting,), 5, reference=ReferenceNoise(), duration_s=40.0
    )
    block = MotionBlock(model_of(log, "gyro_bias", "adc_inl"))
    walk = frozenset({"gyro_bias_walk"})
    assert block.fit(walk).log_evidence > 10
    for same in (frozenset({"gyro_bias"}), frozenset({"adc_inl"})):
        assert block.fit(same).log_evidence > 50
        assert block.fit(same | walk).log_evidence < block.fit(same).log_evidence


def test_a_walk_that_was_taken_for_rough_contact_is_found_from_a_larger_level() -> None:
    walk = EffectSetting("gyro_bias_walk", (("density", 0.00025),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (walk,), 5, reference=ReferenceNoise()
    )
    model = MotionModel(log, ROBOT, default_prior())
    levels = model.no_effect_levels.copy()
    place = LEVELS.index("gyro_bias_walk_rad_s_per_sqrt_s")
    levels[place] = model.level_prior.median[place]
    nothing = nothing_of(model, levels)
    fit = fit_noise(model, nothing, nothing, "gyro_bias_walk", ("gyro_bias_walk",))
    assert fit.log_evidence > 20
    assert fit.parameters["gyro_bias_walk.density"].value == pytest.approx(0.00025, rel=0.5)


@pytest.mark.full_size
def test_a_walk_beyond_the_end_of_its_prior_is_told_as_large_as_it_is() -> None:
    """It was cut off there, by four of what a log of a minute tells it to."""
    described = ROBOT.plant.gyro.bias_walk_density_rad_s_per_sqrt_s
    assert described < 1e-5
    walk = EffectSetting("gyro_bias_walk", (("density", 0.001),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (walk,), 5, reference=ReferenceNoise()
    )
    fit = MotionBlock(MotionModel(log, ROBOT, default_prior())).detail(frozenset({walk.effect}))
    found = fit.parameters["gyro_bias_walk.density"]
    assert found.sd is not None
    assert found.value == pytest.approx(0.001, abs=3.0 * found.sd)


def test_what_a_long_lag_leaves_for_want_of_exactness_is_no_walk_of_the_bias() -> None:
    """A lag of five ticks in sharp turns is explained to a fifth of its amplitude, not better."""
    lag = EffectSetting("gyro_lag", (("time_constant", 0.056),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("square"), (lag,), 5, reference=ReferenceNoise()
    )
    block = MotionBlock(model_of(log, "gyro_lag"))
    alone = block.fit(frozenset({"gyro_lag"})).log_evidence
    assert alone > 500
    for noise in ("gyro_bias_walk", "gyro_noise"):
        assert block.fit(frozenset({"gyro_lag", noise})).log_evidence < alone


def test_beside_a_large_effect_a_noise_too_loud_to_be_its_leftover_is_told() -> None:
    """Beside a play of 700 nats a gyro eleven times as noisy as described was not told; what a play
    leaves over is far less than that."""
    scale = EffectSetting("wheelbase_scale", (("scale", 0.05),))
    described = ROBOT.plant.gyro.noise_density_rad_per_sqrt_s
    noise = EffectSetting("gyro_noise", (("density", 6 * described),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (scale, noise), 5, reference=ReferenceNoise()
    )
    block = MotionBlock(model_of(log, "wheelbase_scale"))
    alone = block.fit(frozenset({"wheelbase_scale"})).log_evidence
    assert alone > 300
    assert block.fit(frozenset({"wheelbase_scale", "gyro_noise"})).log_evidence > alone + 5


@pytest.mark.parametrize(("position_m", "is_noise"), [(0.02, True), (0.5, False)])
def test_a_gps_is_no_noisy_reference_of_a_lab(position_m: float, is_noise: bool) -> None:
    """It measures to half a metre, and every healthy car was told to have a noisy reference (.81).
    Nor has a heading noise where there is no heading."""
    still = replace(scenario("figure8"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, still, (), 5, reference=ReferenceNoise(position_m=position_m, rate_hz=5.0)
    )
    assert log.reference is not None
    places = replace(log.reference, heading_rad=None)
    model = MotionModel(replace(log, reference=places), ROBOT, default_prior())
    nothing = nothing_of(model)
    fit = fit_noise(model, nothing, nothing, "reference_noise", ("reference_noise",))
    assert (fit.log_evidence > 0) == is_noise
    assert fit.parameters.keys() == ({"reference_noise.position"} if is_noise else set())


@pytest.mark.parametrize(
    ("noise", "effect", "is_worth"),
    [(1.6, 2990.0, True), (1.6, 100.0, False), (0.9, 2990.0, False), (4.0, 100.0, True)],
)
def test_a_noise_that_gains_little_is_fitted_beside_what_may_be_the_best_with_it(
    noise: float, effect: float, is_worth: bool
) -> None:
    """A walk worth 1.6 nats beside no effect was fitted beside ten, of which one explains 3,000:
    a quarter of a diagnosis."""
    block = MotionBlock.__new__(MotionBlock)
    block.scan = SimpleNamespace(  # type: ignore[assignment]
        found={frozenset(): 3000.0}, gained=lambda nats: (nats, nats)
    )
    assert block._is_worth(noise, effect) == is_worth
