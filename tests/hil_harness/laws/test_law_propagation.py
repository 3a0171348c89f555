"""The SE(2) recursion and its covariance against oracles that share no line with them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hil_harness.lesson import integrate
from hil_harness.se2 import (
    normalised_squares,
    propagate_covariance,
    propagate_error,
    second_order_bound_m,
)

STEPS = 12


def vectors(largest: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, STEPS, elements=st.floats(-largest, largest))


@given(vectors(2.0), vectors(1.0), vectors(1.0), vectors(1.0))
def test_the_recursion_is_the_derivative_of_the_midpoint_rule(
    distance_m: np.ndarray, turn_rad: np.ndarray, distance_error: np.ndarray, turn_error: np.ndarray
) -> None:
    # Central differences: their own error is of third order in h, below 1e-8 here.
    h = 1e-5
    ahead = integrate(distance_m + h * distance_error, turn_rad + h * turn_error, "midpoint")
    behind = integrate(distance_m - h * distance_error, turn_rad - h * turn_error, "midpoint")
    np.testing.assert_allclose(
        propagate_error(distance_m, turn_rad, distance_error, turn_error),
        (ahead - behind) / (2 * h),
        rtol=0,
        atol=1e-6,
    )


@given(vectors(2.0), vectors(1.0), vectors(0.5), vectors(0.2))
def test_the_true_error_stays_within_the_bound_of_the_remainder(
    distance_m: np.ndarray, turn_rad: np.ndarray, distance_error: np.ndarray, turn_error: np.ndarray
) -> None:
    true_error = integrate(
        distance_m + distance_error, turn_rad + turn_error, "midpoint"
    ) - integrate(distance_m, turn_rad, "midpoint")
    first_order = propagate_error(distance_m, turn_rad, distance_error, turn_error)
    gap_m = np.hypot(*(true_error - first_order)[:, :2].T)
    bound_m = second_order_bound_m(distance_m, distance_error, turn_error)
    assert np.all(gap_m <= bound_m + 1e-12)
    np.testing.assert_allclose(true_error[:, 2], first_order[:, 2], rtol=0, atol=1e-12)


def test_the_covariance_of_a_straight_is_chong_and_kleeman_s_closed_form() -> None:
    # Variances per metre q² of each wheel over a straight of length S: along q²S/2, in heading
    # 2q²S/b², across the heading's times S²/3, and half of it times S between the two.
    steps, step_m, base_m, variance = 4000, 0.005, 0.3, 1e-6
    wheel_m = np.full(steps, step_m)
    length_m = steps * step_m
    heading = 2 * variance * length_m / base_m**2
    covariance = propagate_covariance(wheel_m, wheel_m, base_m, variance)[-1]
    expected = np.array(
        [
            [variance * length_m / 2, 0, 0],
            [0, heading * length_m**2 / 3, heading * length_m / 2],
            [0, heading * length_m / 2, heading],
        ]
    )
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-18)


def test_the_covariance_does_not_depend_on_how_a_path_is_cut_into_steps() -> None:
    def end(steps: int) -> np.ndarray:
        wheel_m = np.full(steps, 6.0 / steps)
        return np.asarray(propagate_covariance(0.9 * wheel_m, 1.1 * wheel_m, 0.3, 1e-6)[-1])

    coarse, fine = end(2000), end(4000)
    np.testing.assert_allclose(coarse, fine, rtol=2e-3)


def test_the_covariance_is_that_of_the_recursion_on_random_steps() -> None:
    rng = np.random.default_rng(11)
    steps, base_m, noise, runs = 60, 0.3, 1e-5, 20000
    left_m, right_m = rng.uniform(0.02, 0.06, (2, steps))
    distance_m, turn_rad = (right_m + left_m) / 2, (right_m - left_m) / base_m
    left_error = noise * np.sqrt(left_m) * rng.normal(size=(runs, steps))
    right_error = noise * np.sqrt(right_m) * rng.normal(size=(runs, steps))
    ends = np.array(
        [
            propagate_error(distance_m, turn_rad, (right + left) / 2, (right - left) / base_m)[-1]
            for left, right in zip(left_error, right_error, strict=True)
        ]
    )
    squares = normalised_squares(ends, propagate_covariance(left_m, right_m, base_m, noise**2)[-1])
    # The mean of chi-square with 3 degrees over 20000 runs has deviation √(6/20000).
    assert np.mean(squares) == pytest.approx(3, abs=5 * np.sqrt(6 / runs))


def test_normalised_squares_are_the_quadratic_form() -> None:
    covariance = np.diag([4.0, 9.0, 0.25])
    errors = np.array([[2.0, 3.0, 0.5], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(normalised_squares(errors, covariance), [3.0, 4.0])
