"""First-order propagation of odometry errors on SE(2): the error itself and its covariance.

One step moves the pose by Δs along θ_m = θ + Δθ/2 and turns it by Δθ. Perturbing that map gives

    δx' = δx − Δs sin θ_m (δθ_pose + δθ/2) + cos θ_m δs
    δy' = δy + Δs cos θ_m (δθ_pose + δθ/2) + sin θ_m δs
    δθ_pose' = δθ_pose + δθ

(Kelly, "Linearized error propagation in odometry", IJRR 23(2), 2004; Barfoot, "State Estimation
for Robotics", 2017, chapter 8), and P' = F P Fᵀ + G Q Gᵀ for independent step noise of covariance Q
(Chong and Kleeman, ICRA 1997).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def propagate_error(
    distance_m: FloatArray,
    turn_rad: FloatArray,
    distance_error_m: FloatArray,
    turn_error_rad: FloatArray,
) -> FloatArray:
    """Return the first-order pose error (steps + 1, 3) in m, m, rad, zero at the start.

    Args:
        distance_m: body steps Δs about which the map is linearised, shape (steps,).
        turn_rad: heading steps Δθ, likewise.
        distance_error_m: δs of each step, shape (steps,).
        turn_error_rad: δθ of each step, shape (steps,).
    """
    middle_rad = np.cumsum(turn_rad) - turn_rad / 2
    heading_error_rad = np.concatenate([[0.0], np.cumsum(turn_error_rad)])
    lever_rad = heading_error_rad[:-1] + turn_error_rad / 2
    error = np.zeros((len(distance_m) + 1, 3))
    error[1:, 0] = np.cumsum(
        -distance_m * np.sin(middle_rad) * lever_rad + np.cos(middle_rad) * distance_error_m
    )
    error[1:, 1] = np.cumsum(
        distance_m * np.cos(middle_rad) * lever_rad + np.sin(middle_rad) * distance_error_m
    )
    error[:, 2] = heading_error_rad
    return error


def second_order_bound_m(
    distance_m: FloatArray,
    distance_error_m: FloatArray,
    turn_error_rad: FloatArray,
) -> FloatArray:
    """Return how far the first-order position error can be from the true one, (steps + 1,).

    With e = δθ_pose + δθ/2 a step (Δs + δs) along θ_m + e differs from its first order by at most
    |Δs|·e²/2 + |δs|·|e| (Taylor's remainder of sine and cosine), and the steps add up.
    """
    lever_rad = np.abs(np.cumsum(turn_error_rad) - turn_error_rad / 2)
    per_step_m = np.abs(distance_m) * lever_rad**2 / 2 + np.abs(distance_error_m) * lever_rad
    return np.concatenate([[0.0], np.cumsum(per_step_m)])


def propagate_covariance(
    left_m: FloatArray, right_m: FloatArray, wheelbase_m: float, variance_m2_per_m: float
) -> FloatArray:
    """Return the covariance (steps + 1, 3, 3) of the pose x_m, y_m, heading_rad.

    Args:
        left_m: steps of the left wheel, shape (steps,).
        right_m: steps of the right wheel, likewise.
        wheelbase_m: distance between the wheels.
        variance_m2_per_m: contact noise of each wheel: variance per distance it covers.
    """
    distance_m = (right_m + left_m) / 2
    turn_rad = (right_m - left_m) / wheelbase_m
    middle_rad = np.cumsum(turn_rad) - turn_rad / 2
    covariance = np.zeros((len(left_m) + 1, 3, 3))
    wheels_to_body = np.array([[0.5, 0.5], [-1 / wheelbase_m, 1 / wheelbase_m]])
    for k, (step_m, along_rad) in enumerate(zip(distance_m, middle_rad, strict=True)):
        sine, cosine = np.sin(along_rad), np.cos(along_rad)
        F = np.array([[1, 0, -step_m * sine], [0, 1, step_m * cosine], [0, 0, 1]])
        G = (
            np.array([[cosine, -step_m * sine / 2], [sine, step_m * cosine / 2], [0, 1]])
            @ wheels_to_body
        )
        Q = variance_m2_per_m * np.diag([abs(left_m[k]), abs(right_m[k])])
        covariance[k + 1] = F @ covariance[k] @ F.T + G @ Q @ G.T
    return covariance


def normalised_squares(errors: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return eᵀP⁻¹e (NEES), shape (runs,), of *errors* (runs, 3) under one *covariance* (3, 3)."""
    return np.asarray(np.einsum("ri,ri->r", errors, np.linalg.solve(covariance, errors.T).T))
