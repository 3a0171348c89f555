"""How what a log says goes with its noise levels, looked at in as little time as will do."""

import numpy as np
import pytest

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import best_levels
from gap_diagnosis.slopes import Slopes, Weighed, slopes
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ROBOT, WIRE = load_robot(None), load_wire()
REFERENCE = ReferenceNoise(0.001, 0.001, 0.0005, 0.0005, 1.0)
RECORDING = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), 5, reference=REFERENCE)
MODEL = MotionModel(RECORDING, ROBOT, default_prior())
LEVELS = np.log(MODEL.no_effect_levels)
SILENT = MODEL.level_prior.silent
WEIGH = MODEL._of_levels(())


def test_what_columns_leave_is_whitened_as_they_are() -> None:
    levels = np.exp(LEVELS)
    weights = np.random.default_rng(1).standard_normal(WEIGH.values.shape[-1])
    white, log_variance = WEIGH.leave(levels, weights)
    seen = WEIGH(levels)
    np.testing.assert_allclose(white, seen.white @ weights, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(log_variance, seen.log_variance)


@pytest.mark.parametrize("seed", range(4))
def test_near_the_best_levels_slopes_of_what_is_left_stand_for_all(seed: int) -> None:
    """Half a standard deviation off, a step as they have it ends a fifth of a nat below the best
    at most."""
    quick = Slopes(WEIGH, WEIGH.leave, SILENT)
    _, information = quick.at(LEVELS, WEIGH(np.exp(LEVELS)), frozenset())
    information = information + np.diag(MODEL.level_prior.restraint())
    way = np.random.default_rng(seed).standard_normal(len(LEVELS))
    way = np.linalg.solve(np.linalg.cholesky(information).T, 0.5 * way / np.linalg.norm(way))
    near = np.maximum(LEVELS + way, np.log(MODEL.level_prior.low))
    assert quick.stand_for(near, information)
    found, told = quick.at(near, WEIGH(np.exp(near)), frozenset())
    exact, exactly, _ = slopes(WEIGH, near, WEIGH(np.exp(near)), SILENT)
    wrong = found - exact
    assert 0.5 * wrong @ np.linalg.solve(information, wrong) < 0.2
    np.testing.assert_allclose(told, exactly, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("deviations", "looks"), [(0.4, 0), (1.0, 1)])
def test_all_columns_are_looked_at_far_from_where_they_were_last(
    deviations: float, looks: int
) -> None:
    asked: list[Floats] = []

    def weigh(levels: Floats) -> Weighed:
        asked.append(levels)
        return WEIGH(levels)

    both = Slopes(weigh, WEIGH.leave, SILENT)
    _, information = both.at(LEVELS, WEIGH(np.exp(LEVELS)), frozenset())
    whole = len(asked)
    far = LEVELS.copy()
    far[0] += deviations / np.sqrt(information[0, 0])
    both.stand_for(far, information)
    both.at(far, WEIGH(np.exp(far)), frozenset())
    assert len(asked) == (1 + looks) * whole == (1 + looks) * (len(LEVELS) - len(SILENT))


def test_of_levels_that_are_not_asked_for_nothing_is_told() -> None:
    both = Slopes(WEIGH, WEIGH.leave, SILENT)
    both.at(LEVELS, WEIGH(np.exp(LEVELS)), frozenset())
    slope, information = both.at(LEVELS, WEIGH(np.exp(LEVELS)), frozenset({0, 6}))
    assert not slope[[0, 6]].any()
    assert not information[[0, 6]].any()


@pytest.mark.parametrize("seed", range(4))
def test_a_search_by_what_is_left_ends_as_high_as_one_by_all_columns(seed: int) -> None:
    prior = MODEL.level_prior
    away = prior.spread * np.random.default_rng(seed).standard_normal(len(LEVELS))
    start = np.clip(prior.median * np.exp(away), prior.low, prior.high)
    slowly = best_levels(WEIGH, prior, start)
    quickly = best_levels(WEIGH, prior, start, leave=WEIGH.leave)
    heights = [
        WEIGH(one).log_evidence + prior.log_density(np.log(one)) for one in (slowly, quickly)
    ]
    assert heights[1] > heights[0] - 0.15
