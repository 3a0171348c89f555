"""The covariance of the SE(2) recursion against many runs: the random part of the pose error.

Chong and Kleeman, ICRA (1997), let the variance of each wheel grow with its distance; Kelly, IJRR
23(2) (2004), propagates it to the pose. The normalised estimation error squared (NEES) eᵀP⁻¹e of a
right covariance is chi-square with three degrees of freedom (Barfoot 2017, chapter 5).
"""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, Series, dots, law, line
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    split_error,
    variance_interval,
    variance_tolerance,
)
from hil_harness.lesson import LessonParameters
from hil_harness.se2 import (
    normalised_squares,
    propagate_covariance,
)
from sim_plant import Mechanisms

DURATION_S = 20.0
NOISE_M_PER_SQRT_M = 1e-4
LARGE_NOISE_M_PER_SQRT_M = 6e-3
POSE_DIMENSIONS = 3


def _covariance(bench: Bench) -> Evidence:
    runs = bench.runs
    commands = bench.lesson_commands(DURATION_S)

    def sample(noise: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return random pose errors (runs, ticks, 3), their covariance, and the believed path."""
        contact = Mechanisms(
            micro_slip_left_m_per_sqrt_m=noise, micro_slip_right_m_per_sqrt_m=noise
        )
        journey = bench.drive(commands, contact, runs=count)
        quiet = bench.drive(commands)
        believed = bench.odometry(journey, "wheel")
        left_m = bench.wheel_radius_m * np.diff(bench.wheel_angle_rad(journey.left_count)[0])
        right_m = bench.wheel_radius_m * np.diff(bench.wheel_angle_rad(journey.right_count)[0])
        # Quantisation is the same in every run: the systematic part, known from the quiet run.
        errors = (believed - journey.truth) - (bench.odometry(quiet, "wheel") - quiet.truth)
        covariance = propagate_covariance(left_m, right_m, bench.wheelbase_m, noise**2)
        return errors, covariance, believed[0]

    errors, covariance, _ = sample(NOISE_M_PER_SQRT_M, runs)
    k = errors.shape[1] - 1
    checks: list[Check] = []
    for name, step in (("half_way", k // 2), ("end", k)):
        squares = normalised_squares(errors[:, step], covariance[step])
        checks.append(
            Check(
                law=f"se2_covariance_nees_{name}",
                predicted=float(POSE_DIMENSIONS),
                measured=float(np.mean(squares)),
                tolerance=variance_tolerance(POSE_DIMENSIONS, POSE_DIMENSIONS * runs),
                unit="1",
                derivation=f"chi-square with {POSE_DIMENSIONS * runs} degrees of freedom over "
                f"{runs} runs",
                false_alarm=FALSE_ALARM,
            )
        )
    for axis, name, unit in ((0, "x", "m²"), (1, "y", "m²"), (2, "heading", "rad²")):
        predicted = float(covariance[k, axis, axis])
        checks.append(
            Check(
                law=f"se2_covariance_{name}",
                predicted=predicted,
                measured=float(np.var(errors[:, k, axis], ddof=1)),
                tolerance=variance_tolerance(predicted, runs - 1),
                unit=unit,
                derivation=f"chi-square with {runs - 1} degrees of freedom",
                interval=variance_interval(errors[:, k, axis]),
                false_alarm=FALSE_ALARM,
            )
        )
    large_errors, large_covariance, large_believed = sample(LARGE_NOISE_M_PER_SQRT_M, runs)
    at = np.linspace(20, k, 40).astype(int)
    band = stats.chi2.ppf([0.025, 0.975], POSE_DIMENSIONS * runs) / runs
    path_m = LessonParameters().speed_m_s * bench.tick_s * at
    return Evidence(
        tuple(checks),
        (
            Panel(
                "NEES over the path",
                "distance driven [m]",
                "mean of eᵀP⁻¹e",
                (
                    Series(
                        "3, with its 95 % band",
                        path_m,
                        np.full(len(at), float(POSE_DIMENSIONS)),
                        "law",
                        0,
                        np.full(len(at), band[0]),
                        np.full(len(at), band[1]),
                    ),
                    line("0.1 mm/√m", path_m, _mean_nees(errors, covariance, at)),
                    line("6 mm/√m", path_m, _mean_nees(large_errors, large_covariance, at), 2),
                ),
                y_limits=(2.0, 8.0),
            ),
            Panel(
                "6 mm/√m: a banana, not an ellipse",
                "true x [m]",
                "true y [m]",
                (
                    dots(
                        "true ends",
                        large_believed[-1, 0] - large_errors[:400, -1, 0],
                        large_believed[-1, 1] - large_errors[:400, -1, 1],
                        2,
                    ),
                    dots("believed end", large_believed[-1:, 0], large_believed[-1:, 1], 1),
                    law("95 % ellipse", *_ellipse(large_believed[-1], large_covariance[-1])),
                ),
            ),
        ),
        "First: the normalised squared error of the pose over many runs, with the band in which "
        "its mean lies if the covariance is right. Small contact noise stays inside; noise sixty "
        "times as large leaves it. Second: there the true end points bend round in a banana that "
        "no ellipse describes.",
        tuple(
            split_error(errors[:, k, axis], f"{name} error after {k} steps", unit)
            for axis, name, unit in ((0, "x", "m"), (1, "y", "m"), (2, "heading", "rad"))
        ),
    )


def _mean_nees(errors: np.ndarray, covariance: np.ndarray, at: np.ndarray) -> np.ndarray:
    return np.array([np.mean(normalised_squares(errors[:, step], covariance[step])) for step in at])


def _ellipse(centre: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of the 95 % ellipse of a position."""
    angle = np.linspace(0, 2 * np.pi, 181)
    radius = math.sqrt(float(stats.chi2.ppf(0.95, 2)))
    points = np.linalg.cholesky(covariance[:2, :2]) @ np.stack([np.cos(angle), np.sin(angle)])
    return centre[0] + radius * points[0], centre[1] + radius * points[1]


LAWS = (
    Law(
        name="se2_covariance",
        title="The recursion's covariance describes the random part",
        formula="P' = F P Fᵀ + G Q Gᵀ, wheel variances in proportion to distance",
        validity="heading spread so small that S·σ_θ²/4 is hidden by the spread along the track",
        source="Kelly 2004; Chong & Kleeman 1997",
        measure=_covariance,
    ),
)
