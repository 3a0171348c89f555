"""The Allan variance against its definition, and its degrees of freedom against samples."""

import numpy as np
import pytest

from hil_harness.laws.allan import overlapping_allan_variance, walk_freedom, white_freedom

SAMPLES = 600
RUNS = 1500


def by_definition(rate: np.ndarray, m: int) -> float:
    """Half the mean squared difference of neighbouring cluster means, at every start."""
    means = np.array([np.mean(rate[start : start + m]) for start in range(len(rate) - m + 1)])
    return float(np.mean((means[m:] - means[:-m]) ** 2) / 2)


@pytest.mark.parametrize("m", [1, 2, 7, 30])
def test_the_allan_variance_is_the_textbook_s(m: int) -> None:
    rate = np.random.default_rng(1).normal(size=100)
    assert overlapping_allan_variance(rate[None], 0.01, m)[0] == pytest.approx(
        by_definition(rate, m)
    )


def test_white_noise_and_a_random_walk_have_their_slopes() -> None:
    rng = np.random.default_rng(2)
    tick_s = 0.01
    white = rng.normal(size=(200, 4000))
    walk = np.cumsum(rng.normal(size=(200, 4000)), axis=1) * tick_s
    for m in (50, 200):
        tau_s = m * tick_s
        white_at = np.mean(overlapping_allan_variance(white, tick_s, m))
        walk_at = np.mean(overlapping_allan_variance(walk, tick_s, m))
        # N² = σ²·T; K² = (T per √T)² = T; both to a few per cent with 200 runs.
        assert white_at == pytest.approx(tick_s / tau_s, rel=0.05)
        assert walk_at == pytest.approx(tick_s * tau_s / 3, rel=0.1)


def test_a_constant_rate_has_no_allan_variance() -> None:
    assert overlapping_allan_variance(np.full((1, 64), 0.5), 0.01, 8)[0] == pytest.approx(
        0, abs=1e-25
    )


@pytest.mark.parametrize("m", [5, 20, 60])
def test_the_degrees_of_freedom_are_those_of_samples(m: int) -> None:
    """A chi-square mean has relative variance 2/freedom; 1500 runs know it to some 4 %."""
    rng = np.random.default_rng(3)
    white = rng.normal(size=(RUNS, SAMPLES))
    for rates, freedom in (
        (white, white_freedom(SAMPLES, m)),
        (np.cumsum(white, axis=1), walk_freedom(SAMPLES, m)),
    ):
        values = overlapping_allan_variance(rates, 1.0, m)
        measured = 2 * np.mean(values) ** 2 / np.var(values)
        # The formulas of NIST SP 1065 are themselves fits, good to about a tenth.
        assert measured == pytest.approx(freedom, rel=0.2)
