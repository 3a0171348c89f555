"""What the engine did, measured from its state: the lab's calibration, and a case's true answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.trials.mujoco_engine import Driven, highest_hold_share
from gap_diagnosis.trials.mujoco_world import World
from gap_diagnosis.trials.sizes import tolerances
from hil_harness.robot import Tolerance

HELD: Final = 0.1
"""Up to this share of what the floor gives wheels creep and do not slide."""
_HARDLY: Final = 0.001
"""A cause of which a drive has no more than this share, beside its others, it does not tell."""


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
    """Return radii and wheelbase by least squares on the turn and the way of each tick.

    How unlike the wheels are is told by the turn: by the way alone, an arc that fell a little short
    had wheels that are alike differ by 4 in 1,000.
    """
    steps = np.diff(driven.wheel_rad, axis=0)
    way = np.diff(driven.pose[:, :2], axis=0)
    turn = np.diff(driven.pose[:, 2])
    heading = driven.pose[:-1, 2] + 0.5 * turn
    ahead = way[:, 0] * np.cos(heading) + way[:, 1] * np.sin(heading)
    # turn = (r_r·φ_r − r_l·φ_l)/b and ahead = (r_l·φ_l + r_r·φ_r)/2
    shares, *_ = np.linalg.lstsq(steps * [-1.0, 1.0], turn, rcond=None)
    mean = float(shares.mean())
    rolled = steps @ shares / (2 * mean)
    radius = float(rolled @ ahead / (rolled @ rolled))
    return Calibrated(radius, float(shares[1] - shares[0]) / mean, radius / mean)


def truth_of(driven: Driven, world: World, described: Calibrated) -> dict[str, float]:
    """Return the engine's true answer in the catalogue's terms, real against described."""
    found = calibrated(driven)
    step_s = float(driven.time_s[1] - driven.time_s[0])
    turn_rate = np.gradient(driven.pose[:, 2], step_s)
    speed = found.radius_m * driven.wheel_rad_s.mean(1)
    downhill = world.downhill_rad - driven.pose[:, 2]
    drift = np.abs(speed) * np.sin(downhill)
    causes = np.column_stack([-speed * turn_rate, turn_rate, speed, drift])
    (slip, lever, toe, across), *_ = np.linalg.lstsq(causes, driven.sideways_m_s, rcond=_HARDLY)
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
        "off_the_floor": float((driven.normal_n <= 0.0).any(1).mean()),
        "share_of_hold": highest_hold_share(driven, world),
    }


def news_of(truth: Mapping[str, float], tolerance: Tolerance) -> dict[str, float]:
    """Return what of an engine's true answer is beyond what a description may be off by.

    Radii, wheelbase and lag: as robot.toml has it; slip and drift, of which it says nothing, as the
    catalogue's table of sizes does. Where a wheel slides, all of it is.
    """
    limits = {
        "radius_scale": tolerance.radius_scale,
        "radius_mismatch": tolerance.radius_mismatch,
        "wheelbase_scale": tolerance.wheelbase_scale,
        "creep_lag_s": tolerance.time_offset_s,
        "lateral_slip": tolerances("lateral_slip")["compliance"],
        "longitudinal_slip": tolerances("longitudinal_slip")["compliance"],
        "cross_slope_drift": tolerances("cross_slope_drift")["ratio"],
        "grade_slip": tolerances("grade_slip")["ratio"],
        "toe": tolerances("wheel_toe")["angle"],
        "slides_left": 0.0,
        "slides_right": 0.0,
        "off_the_floor": 0.0,
        "share_of_hold": HELD,
    }
    return {name: truth[name] for name, limit in limits.items() if abs(truth[name]) > limit}
