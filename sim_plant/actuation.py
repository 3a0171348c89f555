"""Stage actuation: commanded body velocity to wheel rotation.

(v, w) → wheel-rate set points by the *described* geometry → pure delay → deadband → gain →
saturation → first-order lag with limited acceleration, solved exactly within each tick.
"""

from __future__ import annotations

import math
from typing import Any

from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

PARAMETERS = [
    ("described_radius_m", "f8"),
    ("described_wheelbase_m", "f8"),
    ("delay_ticks", "i8"),
    ("delay_rest_s", "f8"),
    ("deadband_rad_s", "f8"),
    ("gain_left", "f8"),
    ("gain_right", "f8"),
    ("max_rate_rad_s", "f8"),
    ("max_acceleration_rad_s2", "f8"),
    ("time_constant_s", "f8"),
    ("cogging_left", "f8"),
    ("cogging_right", "f8"),
    ("cogging_order", "f8"),
    ("cogging_phase_rad", "f8"),
    ("backlash_left_rad", "f8"),
    ("backlash_right_rad", "f8"),
]

# `play` is how far the motor is from where it drives the wheel forwards.
STATE = [
    ("rate_left_rad_s", "f8"),
    ("rate_right_rad_s", "f8"),
    ("motor_left_rad", "f8"),
    ("motor_right_rad", "f8"),
    ("motor_step_left_rad", "f8"),
    ("motor_step_right_rad", "f8"),
    ("play_left_rad", "f8"),
    ("play_right_rad", "f8"),
]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`: described and deviation merged."""
    drive = description.drive
    delay_s = drive.delay_s + mechanisms.drive_delay_s
    delay_ticks = math.floor(delay_s / tick_s)
    return {
        "described_radius_m": description.wheels.radius_m,
        "described_wheelbase_m": description.wheels.wheelbase_m,
        "delay_ticks": delay_ticks,
        "delay_rest_s": min(max(delay_s - delay_ticks * tick_s, 0.0), tick_s),
        "deadband_rad_s": mechanisms.drive_deadband_rad_s,
        "gain_left": 1.0 + mechanisms.drive_gain_left,
        "gain_right": 1.0 + mechanisms.drive_gain_right,
        "max_rate_rad_s": min(drive.max_wheel_rate_rad_s, mechanisms.drive_saturation_rad_s),
        "max_acceleration_rad_s2": min(
            drive.max_wheel_acceleration_rad_s2, mechanisms.drive_acceleration_limit_rad_s2
        ),
        "time_constant_s": drive.time_constant_s + mechanisms.drive_lag_s,
        "cogging_left": mechanisms.drive_cogging_left,
        "cogging_right": mechanisms.drive_cogging_right,
        "cogging_order": mechanisms.drive_cogging_order,
        "cogging_phase_rad": mechanisms.drive_cogging_phase_rad,
        "backlash_left_rad": mechanisms.backlash_left_rad,
        "backlash_right_rad": mechanisms.backlash_right_rad,
    }


@inlined
def set_point_rad_s(p: Any, commanded_rad_s: float, gain: float) -> float:
    """Return the rate a wheel settles at: deadband, then gain, then saturation."""
    if abs(commanded_rad_s) < p.deadband_rad_s:
        return 0.0
    limit: float = p.max_rate_rad_s
    return min(max(commanded_rad_s * gain, -limit), limit)


@inlined
def turn_wheel(p: Any, rate_rad_s: float, target_rad_s: float, dt_s: float) -> tuple[float, float]:
    """Return the wheel's rate after `dt_s` and the angle it turned meanwhile [rad].

    Exact for a constant target: while the lag asks for more than the largest acceleration the rate
    is a ramp, afterwards it is an exponential with the time constant (0: it stays on the target).
    """
    limit = p.max_acceleration_rad_s2
    lag_s = p.time_constant_s
    gap = target_rad_s - rate_rad_s
    angle_rad = 0.0
    if abs(gap) > limit * lag_s:
        ramp_s = min((abs(gap) - limit * lag_s) / limit, dt_s)
        slope = limit if gap > 0.0 else -limit
        angle_rad = (rate_rad_s + 0.5 * slope * ramp_s) * ramp_s
        rate_rad_s += slope * ramp_s
        dt_s -= ramp_s
        gap = target_rad_s - rate_rad_s
        if lag_s == 0.0 and dt_s > 0.0:
            rate_rad_s = target_rad_s
            gap = 0.0
    if dt_s > 0.0:
        closed = -math.expm1(-dt_s / lag_s) if lag_s > 0.0 else 1.0
        angle_rad += target_rad_s * dt_s - gap * lag_s * closed
        rate_rad_s += gap * closed
    return rate_rad_s, angle_rad


@inlined
def drive(p: Any, s: Any, v_m_s: float, w_rad_s: float, dt_s: float) -> tuple[float, float]:
    """Turn both wheels towards one command for `dt_s`; return their steps (left, right) [rad]."""
    turn_m_s = 0.5 * w_rad_s * p.described_wheelbase_m
    left = set_point_rad_s(p, (v_m_s - turn_m_s) / p.described_radius_m, p.gain_left)
    right = set_point_rad_s(p, (v_m_s + turn_m_s) / p.described_radius_m, p.gain_right)
    s.rate_left_rad_s, step_left_rad = turn_wheel(p, s.rate_left_rad_s, left, dt_s)
    s.rate_right_rad_s, step_right_rad = turn_wheel(p, s.rate_right_rad_s, right, dt_s)
    return step_left_rad, step_right_rad


@inlined
def cogged(p: Any, amplitude: float, angle_rad: float, step_rad: float) -> float:
    """Return a motor's step with the wave that its poles put on it."""
    if amplitude == 0.0:
        return step_rad
    middle_rad = angle_rad + 0.5 * step_rad
    wave = math.sin(p.cogging_order * middle_rad + p.cogging_phase_rad)
    return step_rad * (1.0 + amplitude * wave)


@inlined
def through_play(play_rad: float, width_rad: float, step_rad: float) -> tuple[float, float]:
    """Return how far the wheel turns with a motor's step, and the play left before it [rad]."""
    if width_rad == 0.0:
        return step_rad, 0.0
    left_rad = min(play_rad, width_rad) - step_rad
    if left_rad < 0.0:
        return -left_rad, 0.0
    if left_rad > width_rad:
        return width_rad - left_rad, width_rad
    return 0.0, left_rad


@inlined
def drive_train(p: Any, s: Any, step: tuple[float, float]) -> tuple[float, float]:
    """Turn both motors by steps (left, right); return the steps of the wheels behind them [rad]."""
    left = cogged(p, p.cogging_left, s.motor_left_rad, step[0])
    right = cogged(p, p.cogging_right, s.motor_right_rad, step[1])
    s.motor_step_left_rad = left
    s.motor_step_right_rad = right
    s.motor_left_rad += left
    s.motor_right_rad += right
    left, s.play_left_rad = through_play(s.play_left_rad, p.backlash_left_rad, left)
    right, s.play_right_rad = through_play(s.play_right_rad, p.backlash_right_rad, right)
    return left, right
