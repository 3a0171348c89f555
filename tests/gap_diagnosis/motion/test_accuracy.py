"""Errors are as large as the fit says: a small part of `benchmarks/accuracy_motion.py`.

The sum of squares of error over stated standard deviation is a chi-square if the statement is
right. Its limit is passed by chance less than once in a thousand draws, and by a fit that states
too small deviations: half of them at the small size, seven tenths at the full one.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

from accuracy.fits import run_case

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
    rounds = 3 if size == "small" else 40
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


def test_errors_are_no_larger_than_stated(scores):
    assert float(np.square(scores).sum()) < chi2.ppf(0.999, len(scores))


def test_a_fit_that_states_too_little_would_not_pass(scores, size):
    share = 0.5 if size == "small" else 0.7
    assert float(np.square(np.array(scores) / share).sum()) > chi2.ppf(0.999, len(scores))
