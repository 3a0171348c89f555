"""How large each noise may be, and which levels a log asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize

from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.recording import Floats
from hil_harness.robot import Robot


@dataclass(frozen=True)
class LevelPrior:
    """Log-normal priors of the levels: medians and standard deviations of the logarithm."""

    median: Floats
    spread: Floats

    def log_density(self, log_levels: Floats, free: Sequence[int] = ()) -> float:
        """Return the log density; the levels in *free* are even over a factor of 50 instead."""
        score = (log_levels - np.log(self.median)) / self.spread
        terms = -0.5 * score**2 - np.log(self.spread) - 0.5 * math.log(math.tau)
        for index in free:
            terms[index] = -math.log(math.log(50.0))
        return float(terms.sum())


FLOORS: Final = (1e-4, 2e-5, 1e-6, 1e-7, 1e-4, 1e-4, 1e-5, 1e-5, 0.05)
"""No floor is smoother than 0.1 mm per root metre and no room measures better than 0.1 mm: without
these, data without noise would make any small misfit a certainty."""


def level_prior(robot: Robot) -> LevelPrior:
    """Return the prior: contact 0.1 to 3 mm per square root of a metre, gyro as described."""
    gyro = robot.plant.gyro
    contact = max(robot.plant.contact.noise_m_per_sqrt_m, 5e-4)
    noise = max(gyro.noise_density_rad_per_sqrt_s, 1e-5)
    walk = max(gyro.bias_walk_density_rad_s_per_sqrt_s, 3e-6)
    table = {
        "contact_m_per_sqrt_m": (contact, 0.9),
        "lateral_m_per_sqrt_m": (1e-4, 1.5),
        "gyro_noise_rad_per_sqrt_s": (noise, 0.35),
        "gyro_bias_walk_rad_s_per_sqrt_s": (walk, 0.5),
        "reference_position_m": (1e-3, 2.0),
        "reference_heading_rad": (1e-3, 2.0),
        "reference_slow_position_m": (3e-4, 2.0),
        "reference_slow_heading_rad": (3e-4, 2.0),
        "reference_slow_s": (1.0, 1.2),
    }
    rows = np.array([table[name] for name in LEVELS])
    return LevelPrior(rows[:, 0], rows[:, 1])


def best_levels(
    log_evidence: Callable[[Floats], float],
    prior: LevelPrior,
    start: Floats,
    *,
    rounds: int = 25,
    free: Sequence[int] = (),
) -> Floats:
    """Return the levels that maximise evidence times prior, from *start* (float64[9])."""

    def cost(log_levels: Floats) -> float:
        return -log_evidence(np.exp(log_levels)) - prior.log_density(log_levels, free)

    bounds = [(math.log(low), math.log(100.0)) for low in FLOORS]
    found = minimize(
        cost,
        np.log(np.maximum(start, FLOORS)),
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": rounds, "eps": 1e-3, "ftol": 1e-7},
    )
    return np.asarray(np.exp(found.x))
