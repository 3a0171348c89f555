"""The search for noise levels: it ends at the best of them, wherever their bounds lie."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from full_size import at_full_size

from gap_diagnosis.scoring import LevelPrior, _step, _Steps, best_levels, better_levels
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


@pytest.mark.parametrize(
    "start", [(0.94, 4.85), (1e-3, 5.0), *at_full_size(((0.94, 0.06),), ((0.03, 0.3),))]
)
@pytest.mark.parametrize("memory_s", [0.2, 5.0, *at_full_size(2.0)])
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


def test_a_search_from_several_starts_says_what_it_gained_on_the_best_of_them() -> None:
    weigh = weigh_of(0.05, 2.0)
    starts = [np.array([0.9, 0.1]), np.array([0.03, 0.5]), np.array([1e-3, 5.0])]
    levels, gained = better_levels(weigh, PRIOR, starts)
    best_start = max(height(weigh, one) for one in starts)
    assert gained == pytest.approx(height(weigh, levels) - best_start)
    assert gained > 1.0


def count_looks(weigh: Weigh, prior: LevelPrior, start: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the best levels and how often the log was asked for them."""
    looks: list[int] = []

    def counted(levels: np.ndarray) -> Weighed:
        looks.append(1)
        return weigh(levels)

    return best_levels(counted, prior, start), len(looks)


def noise_of(sizes: np.ndarray, *mixes: tuple[float, ...]) -> Weigh:
    """Rows whose variances are sums of squares: each level's by a share, and the last share's own.

    Every mix has as many rows, as scattered as *sizes* have them.
    """
    random = np.random.default_rng(2)

    def log_variance(levels: np.ndarray) -> np.ndarray:
        squares = np.append(levels, 1.0) ** 2
        return np.repeat([math.log(float(np.array(mix) ** 2 @ squares)) for mix in mixes], ROWS)

    said = random.standard_normal(ROWS * len(mixes)) * np.exp(0.5 * log_variance(sizes))

    def weigh(levels: np.ndarray) -> Weighed:
        variance = log_variance(levels)
        white = said * np.exp(-0.5 * variance)
        return Weighed(-0.5 * float(np.sum(white**2 + variance)), white[:, None], variance)

    return weigh


def test_levels_a_thousand_times_too_high_come_down_in_a_few_long_steps() -> None:
    """So far from there information has every level lowered by half of a logarithm: 34 looks."""
    prior = LevelPrior(np.array([0.1]), np.array([5.0]), np.array([1e-6]), np.array([1e3]))
    found, looks = count_looks(noise_of(np.array([0.1]), (1.0, 0.0)), prior, np.array([100.0]))
    assert found[0] == pytest.approx(0.1, rel=0.03)
    assert looks <= 24


def test_what_a_step_showed_of_how_slopes_change_is_known_in_the_next() -> None:
    """Of a level that other noise hides this log's slope changed several times as fast as on the
    mean of all logs, and steps went to and fro across its best."""
    random = np.random.default_rng(6)
    mean, more = (one @ one.T + np.eye(4) for one in random.standard_normal((2, 4, 4)))
    own = mean + 3.0 * more
    before, there = random.standard_normal((2, 4))
    steps = _Steps()
    steps.add(before, -own @ before, promised=1.0)
    bent = steps.bent(there, -own @ there, mean)
    np.testing.assert_allclose(bent @ (there - before), own @ (there - before))
    assert np.all(np.linalg.eigvalsh(bent) > 0)


def test_far_from_the_best_slopes_change_as_information_has_it() -> None:
    steps, mean = _Steps(), np.eye(2)
    steps.add(np.zeros(2), np.ones(2), promised=1000.0)
    np.testing.assert_array_equal(steps.bent(np.ones(2), np.zeros(2), mean), mean)


def test_a_level_that_its_bound_holds_is_asked_at_first_and_at_the_end_alone() -> None:
    low = np.array([1e-6, 0.5])
    prior = LevelPrior(np.array([1.0, 1.0]), np.array([5.0, 5.0]), low, np.array([1e3, 1e3]))
    quiet = noise_of(np.array([1.0, 0.01]), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    asked: list[np.ndarray] = []

    def weigh(levels: np.ndarray) -> Weighed:
        asked.append(levels)
        return quiet(levels)

    found = best_levels(weigh, prior, np.array([50.0, 0.5]))
    np.testing.assert_allclose(found, [1.0, 0.5], rtol=0.03)
    assert sum(levels[1] != 0.5 for levels in asked) == 2


def test_a_level_leaves_its_bound_once_another_is_right() -> None:
    """The rows of one are as many times wider as another is too high, which its own rows say."""
    low = np.array([1e-6, 0.2])
    prior = LevelPrior(np.array([1.0, 1.0]), np.array([5.0, 5.0]), low, np.array([1e3, 1e3]))
    random = np.random.default_rng(4)
    said = random.standard_normal(2 * ROWS)

    def weigh(levels: np.ndarray) -> Weighed:
        both = 2.0 * np.log([levels[0], levels[0] * levels[1]])
        variance = np.repeat(both, ROWS)
        white = said * np.exp(-0.5 * variance)
        return Weighed(-0.5 * float(np.sum(white**2 + variance)), white[:, None], variance)

    found = best_levels(weigh, prior, np.array([50.0, 0.2]))
    np.testing.assert_allclose(found, [1.0, 1.0], rtol=0.1)
