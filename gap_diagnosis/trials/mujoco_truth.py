"""What the engine did, measured from its state: the lab's calibration, and a case's true answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gap_diagnosis.trials.mujoco_engine import Driven, highest_hold_share
from gap_diagnosis.trials.mujoco_world import World


@dataclass(frozen=True)
class Calibrated:
    """What a calibration drive gives.

    Attributes:
        radius_m: rolling radius, mean of both wheels.
        mismatch: (right − left)/mean.
        wheelbase_m: that turns the wheels' difference into the turn.
    """

    radius_m: float
    mismatch: float
    wheelbase_m: float


def calibrated(driven: Driven) -> Calibrated:
    """Return radii and wheelbase by least squares on the way and the turn of each tick."""
    steps = np.diff(driven.wheel_rad, axis=0)
    way = np.diff(driven.pose[:, :2], axis=0)
    turn = np.diff(driven.pose[:, 2])
    heading = driven.pose[:-1, 2] + 0.5 * turn
    ahead = way[:, 0] * np.cos(heading) + way[:, 1] * np.sin(heading)
    # ahead = (r_l·φ_l + r_r·φ_r)/2 and turn = (r_r·φ_r − r_l·φ_l)/b
    (left, right), *_ = np.linalg.lstsq(0.5 * steps, ahead, rcond=None)
    rolled = right * steps[:, 1] - left * steps[:, 0]
    wheelbase = float(rolled @ rolled / (rolled @ turn))
    radius = float(0.5 * (left + right))
    return Calibrated(radius, float((right - left) / radius), wheelbase)


def truth_of(driven: Driven, world: World, described: Calibrated) -> dict[str, float]:
    """Return the engine's true answer in the catalogue's terms, real against described."""
    found = calibrated(driven)
    step_s = float(driven.time_s[1] - driven.time_s[0])
    turn_rate = np.gradient(driven.pose[:, 2], step_s)
    speed = found.radius_m * driven.wheel_rad_s.mean(1)
    downhill = world.downhill_rad - driven.pose[:, 2]
    drift = np.abs(speed) * np.sin(downhill)
    causes = np.column_stack([-speed * turn_rate, turn_rate, speed, drift])
    (slip, lever, toe, across), *_ = np.linalg.lstsq(causes, driven.sideways_m_s, rcond=None)
    rolled = np.abs(speed) * np.cos(downhill)
    along = float(rolled @ driven.creep_m_s.mean(1) / (rolled @ rolled))
    wheel = found.radius_m * driven.wheel_rad_s
    speeding = np.gradient(wheel, step_s, axis=0)
    columns = np.column_stack([speeding.ravel(), (speeding * np.abs(wheel)).ravel()])
    (late, slipping), *_ = np.linalg.lstsq(columns, -driven.creep_m_s.ravel(), rcond=None)
    moving = np.abs(wheel) > 0.02
    sliding = np.abs(driven.creep_m_s) > 0.1 * np.abs(wheel)
    return {
        "radius_scale": found.radius_m / described.radius_m - 1,
        "radius_mismatch": found.mismatch,
        "wheelbase_scale": found.wheelbase_m / described.wheelbase_m - 1,
        "lateral_slip": float(slip),
        "turning_point_m": float(lever),
        "toe": float(toe),
        "cross_slope_drift": float(across),
        "grade_slip": along,
        "creep_lag_s": float(late),
        "longitudinal_slip": float(slipping),
        "slides_left": float((sliding & moving)[:, 0].mean()),
        "slides_right": float((sliding & moving)[:, 1].mean()),
        "share_of_hold": highest_hold_share(driven, world),
    }
