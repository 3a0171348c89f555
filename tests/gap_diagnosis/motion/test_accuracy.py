"""Errors are as large as the fit says: a small part of `benchmarks/accuracy_motion.py`.

The sum of squares of error over stated standard deviation is a chi-square if the statement is
right. Its limit is passed by chance less than once in a thousand draws, and by a fit that states
too small deviations: half of them at the small size, seven tenths at the full one.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from full_size import at_full_size
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

from accuracy.fits import noise_bounds, run_case
from accuracy.sizes import drawn_from_prior, faintest_noise, model_of, noise_of
from accuracy.worlds import draw_world

from gap_diagnosis.explanations import wheel
from gap_diagnosis.explanations.choices import leaves_out
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion import posterior

EFFECTS = (
    "radius_scale",
    "payload",
    "wheelbase_scale",
    "gyro_g_sensitivity",
    "cross_slope_drift",
    "grade_slip",
    "reference_lever_arm",
    "reference_time_offset",
)
SHORT_S = 30.0


@pytest.fixture(scope="module")
def scores(size: str) -> list[float]:
    """Return error over standard deviation of every parameter."""
    rounds = 2 if size == "small" else 40
    found = []
    for name in EFFECTS:
        for number in range(rounds):
            case = run_case("limit", name, number, duration_s=SHORT_S)
            if case["truth"] is None:
                continue
            for parameter in case["bound"]:
                estimate = case["found"][parameter]
                found.append(estimate["error"] / estimate["sd"])
    return found


def test_a_lateral_slip_has_one_size_in_either_form():
    """Its speed was taken for another size, of which no log tells."""
    cases = [run_case("limit", "lateral_slip", number, duration_s=SHORT_S) for number in (0, 6)]
    assert {case["truth"]["speed"] for case in cases} == {0, 1}
    for case in cases:
        assert set(case["bound"]) == {"compliance"}
        assert case["found"]["speed"]["right"] > 0.01


def test_errors_are_no_larger_than_stated(scores):
    assert float(np.square(scores).sum()) < chi2.ppf(0.999, len(scores))


def test_a_fit_that_states_too_little_would_not_pass(scores, size):
    share = 0.5 if size == "small" else 0.7
    assert float(np.square(np.array(scores) / share).sum()) > chi2.ppf(0.999, len(scores))


def test_what_a_fit_leaves_free_beside_an_eccentric_wheel_is_off_too():
    """Its encoder's own little eccentricity passes for the wheel's: were there none in the worlds,
    errors would be a third of what is stated."""
    world = draw_world("wheel_eccentricity", np.random.default_rng(2))
    world = replace(world, scenario=replace(world.scenario, duration_s=10.0))
    values = {"side": "left", "amplitude": 0.02, "phase": 0.0}
    centred = replace(world, off_centre=(0.0, 0.0))
    own, other = (one.recording("wheel_eccentricity", values) for one in (world, centred))
    assert np.any(own.left_ticks != other.left_ticks)
    assert np.array_equal(own.right_ticks, other.right_ticks)


def slip_in(side, start_s, stop_s):
    """Return a slip of one wheel in a window."""
    window = {"start_s": start_s, "stop_s": stop_s}
    return Variant("one_sided_slip", wheel.slip_left, ("ratio",), window, {"side": side, **window})


def test_a_slip_s_window_leaves_out_a_part_of_its_wheel_s_way():
    """One that does not is another wheel, and the search rightly takes it for none."""
    world = draw_world("one_sided_slip", np.random.default_rng(3))
    world = replace(world, scenario=replace(world.scenario, duration_s=20.0))
    model = model_of(world, world.recording(None, {}), "one_sided_slip")
    draw = np.random.default_rng(4)
    for _ in range(40):
        truth = drawn_from_prior(world, model, "one_sided_slip", draw)
        assert leaves_out(
            model.nodes.motion, slip_in(truth["side"], truth["start_s"], truth["stop_s"])
        )
        assert 0 < truth["start_s"] < truth["stop_s"] < 20


def test_a_noise_is_asked_for_where_it_can_be_told():
    """In ten seconds a bias that walks two times as far as described is not told from one that
    walks as described; white noise is."""
    world = draw_world("gyro_bias_walk", np.random.default_rng(1))
    world = replace(world, scenario=replace(world.scenario, duration_s=10.0))
    limits = {
        name: faintest_noise(world, model_of(world, world.recording(None, {}), name), name)
        for name in ("gyro_noise", "gyro_bias_walk")
    }
    assert limits["gyro_noise"] == pytest.approx(2.0, rel=0.05)
    assert limits["gyro_bias_walk"] > 4.0


def test_the_bound_of_a_noise_knows_nothing_of_its_prior():
    """Of ten seconds a walk of the bias is told within a factor of two at best."""
    world = draw_world("gyro_bias_walk", np.random.default_rng(1))
    world = replace(world, scenario=replace(world.scenario, duration_s=10.0))
    quiet = model_of(world, world.recording(None, {}), "gyro_bias_walk")
    truth = noise_of(quiet, "gyro_bias_walk", 2.0)
    model = model_of(world, world.recording("gyro_bias_walk", truth), "gyro_bias_walk")
    bound = noise_bounds(world, model, "gyro_bias_walk", truth)["density"]
    assert bound > math.log(2.0) * truth["density"]


@pytest.mark.parametrize(
    ("effect", "number"), [("reference_lever_arm", 42), *at_full_size(("one_sided_slip", 39))]
)
def test_what_is_within_tolerance_beside_a_large_effect_acts_as_it_does_there(effect, number):
    """Of five sixths of a wheel's way there is a sixth of its radius left, and an arm of half a
    metre is swung on while a reference is late: about none, 16 and 5 standard deviations were left
    here."""
    case = run_case("prior", effect, number)
    told = [one for name, one in case["found"].items() if name in {"ratio", "x", "y"}]
    assert told
    for one in told:
        assert abs(one["error"]) < 3 * one["sd"]


def test_an_interval_allows_for_what_the_likelihood_takes_for_known(monkeypatch):
    """Levels of noise are sought, columns are taken from counts: a percent."""
    told = run_case("limit", "gyro_bias", 0, duration_s=SHORT_S)["found"]["bias"]
    monkeypatch.setattr(posterior, "_TOO_SURE", 1.0)
    surer = run_case("limit", "gyro_bias", 0, duration_s=SHORT_S)["found"]["bias"]
    assert told["value"] == pytest.approx(surer["value"], rel=1e-3)
    assert told["sd"] / surer["sd"] == pytest.approx(1.01, rel=1e-3)


def test_the_bound_of_a_noise_does_not_go_with_the_log_s_own():
    """A walk that happens to be wide curves more: its own error would be measured by less."""
    world = draw_world("gyro_bias_walk", np.random.default_rng(1))
    world = replace(world, scenario=replace(world.scenario, duration_s=10.0))
    quiet = model_of(world, world.recording(None, {}), "gyro_bias_walk")
    truth = noise_of(quiet, "gyro_bias_walk", 4.0)
    narrow, wide = (
        model_of(
            world,
            world.recording("gyro_bias_walk", {"density": by * truth["density"]}),
            "gyro_bias_walk",
        )
        for by in (0.5, 2.0)
    )
    bounds = [noise_bounds(world, one, "gyro_bias_walk", truth) for one in (narrow, wide)]
    assert bounds[0] == bounds[1]
