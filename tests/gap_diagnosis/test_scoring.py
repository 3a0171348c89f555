"""The search for noise levels: it ends at the best of them, wherever their bounds lie."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from gap_diagnosis.scoring import LevelPrior, _step, best_levels
from gap_diagnosis.slopes import Weighed

Weigh = Callable[[np.ndarray], Weighed]

ROWS = 2000
LOW, HIGH = np.array([1e-3, 0.05]), np.array([1.0, 5.0])
PRIOR = LevelPrior(np.array([0.01, 0.3]), np.array([1.5, 1.2]), LOW, HIGH)


def weigh_of(spread: float, memory_s: float) -> Weigh:
    """Noise whose variance is spread² / memory, as a rate error's is over steps far shorter than
    its memory; one of a hundred rows says the memory alone."""
    random = np.random.default_rng(5)
    few = ROWS // 100
    said = random.standard_normal(ROWS) * spread / math.sqrt(memory_s)
    said[:few] = random.standard_normal(few) * math.sqrt(memory_s)

    def weigh(levels: np.ndarray) -> Weighed:
        log_variance = np.full(ROWS, 2 * math.log(levels[0]) - math.log(levels[1]))
        log_variance[:few] = math.log(levels[1])
        white = said * np.exp(-0.5 * log_variance)
        return Weighed(-0.5 * float(np.sum(white**2 + log_variance)), white[:, None], log_variance)

    return weigh


def height(weigh: Weigh, levels: np.ndarray) -> float:
    return weigh(levels).log_evidence + PRIOR.log_density(np.log(levels))


@pytest.mark.parametrize("start", [(0.94, 4.85), (0.94, 0.06), (1e-3, 5.0), (0.03, 0.3)])
@pytest.mark.parametrize("memory_s", [0.2, 2.0, 5.0])
def test_two_levels_that_nearly_take_each_others_place_are_found_from_anywhere(
    start: tuple[float, float], memory_s: float
) -> None:
    weigh = weigh_of(0.05, memory_s)
    axes = [np.geomspace(*ends, 300) for ends in zip(LOW, HIGH, strict=True)]
    grid = np.stack(np.meshgrid(*axes))
    best = max(height(weigh, levels) for levels in grid.reshape(2, -1).T[::7])
    assert height(weigh, best_levels(weigh, PRIOR, np.array(start))) > best - 0.1


def test_of_two_that_take_each_others_place_one_at_its_bound_leaves_the_other_its_way() -> None:
    """Of a drive's noise the memory stood near its longest and the spread was far too large: a step
    that took both far up, cut to size, took the spread up too."""
    slope = np.array([-2450.0, 1235.0])
    information = np.array([[5000.0, -2499.9], [-2499.9, 1250.0]])
    reach = np.array([-6.9, -4.6]), np.array([0.06, 0.03])
    step = _step(slope, information, 0.0, np.array([True, True]), reach)
    assert step[1] == pytest.approx(0.03)
    assert step[0] == pytest.approx((slope[0] - information[0, 1] * 0.03) / information[0, 0])


def test_where_a_start_is_far_too_low_a_better_one_is_taken() -> None:
    weigh = weigh_of(0.5, 2.0)
    calls: list[int] = []

    def counted(levels: np.ndarray) -> Weighed:
        calls.append(1)
        return weigh(levels)

    start, near = np.array([1e-3, 0.3]), np.array([0.45, 2.2])
    found = best_levels(counted, PRIOR, start, elsewhere=[near])
    taken = len(calls)
    calls.clear()
    assert height(weigh, best_levels(counted, PRIOR, start)) == pytest.approx(
        height(weigh, found), abs=0.1
    )
    assert taken < 0.7 * len(calls)
