"""How what a log says goes with its noise levels."""

import numpy as np
import pytest

from gap_diagnosis.recording import Floats
from gap_diagnosis.slopes import Weighed, slopes

ROWS = 500
SAID = np.random.default_rng(3).standard_normal(ROWS)
COLUMN = np.linspace(-1.0, 1.0, ROWS)


def weigh(levels: Floats) -> Weighed:
    """Data and a column in noise of the first level's size; of the second nothing is seen."""
    white = np.column_stack([SAID, COLUMN]) / levels[0]
    gram = white.T @ white
    explained = 0.5 * gram[0, 1] ** 2 / gram[1, 1]
    log_variance = np.full(ROWS, 2.0 * np.log(levels[0]))
    height = -0.5 * gram[0, 0] + explained - 0.5 * log_variance.sum()
    return Weighed(float(height), white, log_variance)


@pytest.mark.parametrize("level", [0.5, 1.0, 2.0])
def test_slope_and_information_of_a_noises_size_are_the_textbooks(level: float) -> None:
    """By log size a normal sample's slope is the sum of squares less the rows, its information
    twice the rows; the slope's difference quotient is off by half a step of that."""
    here = np.log([level, 1.0])
    slope, information = slopes(weigh, here, weigh(np.exp(here)), frozenset({1}))
    left = SAID - COLUMN * (COLUMN @ SAID) / (COLUMN @ COLUMN)
    squares = float(left @ left) / level**2
    assert slope[0] == pytest.approx(squares - ROWS, abs=1.01e-3 * squares)
    assert information[0, 0] == pytest.approx(2.0 * ROWS, rel=1e-5)


def test_of_levels_that_are_not_asked_for_nothing_is_told() -> None:
    asked: list[Floats] = []

    def look(levels: Floats) -> Weighed:
        asked.append(levels)
        return weigh(levels)

    here = np.zeros(2)
    slope, information = slopes(look, here, weigh(np.exp(here)), frozenset({0}))
    assert slope[0] == 0.0
    assert not information[0].any()
    assert len(asked) == 1
