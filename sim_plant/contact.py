"""Stage wheel: rotation of the wheels to motion of the body, through the *true* geometry.

A wheel rolls r·Δφ; slip, offsets and noise make of it a ground step; both ground steps make
the body's step (Δs, Δθ), and the pose follows by the midpoint rule with exact Δs and Δθ.
"""

from __future__ import annotations

import math
from typing import Any

from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

PARAMETERS = [
    ("radius_left_m", "f8"),
    ("radius_right_m", "f8"),
    ("radius_drift_per_s", "f8"),
    ("wheelbase_m", "f8"),
    ("turn_scrub", "f8"),
    ("slip_left", "f8"),
    ("slip_right", "f8"),
    ("slip_start_s", "f8"),
    ("slip_stop_s", "f8"),
    ("offset_left_m", "f8"),
    ("offset_right_m", "f8"),
    ("step_noise_left_m", "f8"),
    ("step_noise_right_m", "f8"),
    ("noise_left_m_per_sqrt_m", "f8"),
    ("noise_right_m_per_sqrt_m", "f8"),
    ("wander_left", "f8"),
    ("wander_right", "f8"),
    ("wander_stays", "f8"),
    ("longitudinal_slip_s2_per_m", "f8"),
    ("lateral_slip_s", "f8"),
    ("lateral_slip_speed_m_s", "f8"),
    ("cross_slope_ratio", "f8"),
    ("cross_slope_direction_rad", "f8"),
    ("grade_slip_ratio", "f8"),
    ("grade_slip_direction_rad", "f8"),
    ("toe_slope", "f8"),
    ("eccentricity_left", "f8"),
    ("eccentricity_right", "f8"),
    ("eccentricity_phase_left_rad", "f8"),
    ("eccentricity_phase_right_rad", "f8"),
    ("kick_rad", "f8"),
    ("kick_length_m", "f8"),
    ("bump_s", "f8"),
    ("bump_yaw_rad", "f8"),
    ("bump_forward_m", "f8"),
]

_TURNING_RAD_S = 0.05  # slower is no turn that a caster follows
_WANDER_S = 2.0  # correlation time of a slip that comes and goes; a diagnosis assumes its own
_DRIVING_M_S = 0.02  # slower is no driving: who spins on the spot creeps to and fro

# The pose and the wheel angles at the end of a tick, and what the tick did to them.
STATE = [
    ("x_m", "f8"),
    ("y_m", "f8"),
    ("heading_rad", "f8"),
    ("angle_left_rad", "f8"),
    ("angle_right_rad", "f8"),
    ("step_left_rad", "f8"),
    ("step_right_rad", "f8"),
    ("yaw_rate_rad_s", "f8"),
    ("forward_acceleration_m_s2", "f8"),
    ("lateral_acceleration_m_s2", "f8"),
    ("sense", "f8"),
    ("turn_sense", "f8"),
    ("kick_sense", "f8"),
    ("kick_left_m", "f8"),
    ("wander_left", "f8"),
    ("wander_right", "f8"),
]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`: described and deviation merged."""
    m = mechanisms
    radius_m = description.wheels.radius_m * (1.0 + m.radius_scale)
    described_noise = description.contact.noise_m_per_sqrt_m
    return {
        "radius_left_m": radius_m * (1.0 - 0.5 * m.radius_mismatch) * (1.0 - m.payload_left),
        "radius_right_m": radius_m * (1.0 + 0.5 * m.radius_mismatch) * (1.0 - m.payload_right),
        "radius_drift_per_s": m.tyre_drift_per_s,
        "wheelbase_m": description.wheels.wheelbase_m * (1.0 + m.wheelbase_scale),
        "turn_scrub": m.turn_scrub,
        "slip_left": m.slip_ratio_left,
        "slip_right": m.slip_ratio_right,
        "slip_start_s": m.slip_start_s,
        "slip_stop_s": m.slip_stop_s,
        "offset_left_m": m.contact_offset_left_m,
        "offset_right_m": m.contact_offset_right_m,
        "step_noise_left_m": m.micro_slip_step_left_m,
        "step_noise_right_m": m.micro_slip_step_right_m,
        "noise_left_m_per_sqrt_m": max(described_noise, m.micro_slip_left_m_per_sqrt_m),
        "noise_right_m_per_sqrt_m": max(described_noise, m.micro_slip_right_m_per_sqrt_m),
        "wander_left": m.slip_wander_left,
        "wander_right": m.slip_wander_right,
        "wander_stays": math.exp(-tick_s / _WANDER_S),
        "longitudinal_slip_s2_per_m": m.longitudinal_slip_s2_per_m,
        "lateral_slip_s": m.lateral_slip_s,
        "lateral_slip_speed_m_s": m.lateral_slip_speed_m_s,
        "cross_slope_ratio": m.cross_slope_ratio,
        "cross_slope_direction_rad": m.cross_slope_direction_rad,
        "grade_slip_ratio": m.grade_slip_ratio,
        "grade_slip_direction_rad": m.grade_slip_direction_rad,
        "toe_slope": math.tan(m.wheel_toe_rad),
        "eccentricity_left": m.wheel_eccentricity_left,
        "eccentricity_right": m.wheel_eccentricity_right,
        "eccentricity_phase_left_rad": m.wheel_eccentricity_phase_left_rad,
        "eccentricity_phase_right_rad": m.wheel_eccentricity_phase_right_rad,
        "kick_rad": m.caster_kick_rad,
        "kick_length_m": m.caster_kick_length_m,
        "bump_s": m.floor_bump_s,
        "bump_yaw_rad": m.floor_bump_yaw_rad,
        "bump_forward_m": m.floor_bump_forward_m,
    }


@inlined
def radii_m(p: Any, time_s: float) -> tuple[float, float]:
    """Return the true rolling radii (left, right) at a time; wear ends at a tenth of the wheel."""
    growth = max(1.0 + p.radius_drift_per_s * time_s, 0.1)
    return p.radius_left_m * growth, p.radius_right_m * growth


@inlined
def ground_step_m(
    rolled_m: float,
    slip: float,
    offset_m: float,
    step_noise_m: float,
    noise_m_per_sqrt_m: float,
    step_normal: float,
    distance_normal: float,
) -> float:
    """Return the step over ground of a wheel that rolled so far: law 7, Δs_eff = Δs + w."""
    if rolled_m == 0.0:
        return 0.0  # a wheel at rest does not creep
    walk_m = noise_m_per_sqrt_m * math.sqrt(abs(rolled_m)) * distance_normal
    return rolled_m * (1.0 - slip) + offset_m + step_noise_m * step_normal + walk_m


@inlined
def eccentric_roll_m(
    radius_m: float, amplitude: float, phase_rad: float, angle_rad: float, step_rad: float
) -> float:
    """Return what r·(1 + A·cos(φ + phase)) rolls beyond r, integrated over a step ending at φ."""
    if amplitude == 0.0:
        return 0.0
    after = math.sin(angle_rad + phase_rad)
    before = math.sin(angle_rad - step_rad + phase_rad)
    return radius_m * amplitude * (after - before)


@inlined
def pressed_slip(
    p: Any, slip: float, rolled_m: float, acceleration_m_s2: float, heading_rad: float
) -> float:
    """Return the slip ratio with what acceleration and grade add to it."""
    direction = math.copysign(1.0, rolled_m)
    slip += p.longitudinal_slip_s2_per_m * acceleration_m_s2 * direction
    if p.grade_slip_ratio != 0.0:
        downhill = math.cos(p.grade_slip_direction_rad - heading_rad)
        slip -= p.grade_slip_ratio * direction * downhill
    return slip


@inlined
def wandered(stays: float, level: float, slip: float, normal: float) -> float:
    """Return a slip ratio one tick later: a first-order Gauss-Markov series, none at the start."""
    return stays * slip + level * math.sqrt(1.0 - stays * stays) * normal


@inlined
def caster_kick_rad(p: Any, s: Any, forward_m: float, turn_rad: float, tick_s: float) -> float:
    """Return the yaw of a caster that turns over after a reversal."""
    if abs(forward_m) > _DRIVING_M_S * tick_s:
        sense = math.copysign(1.0, forward_m)
        if sense * s.sense < 0.0:
            s.kick_left_m = p.kick_length_m
            s.kick_sense = s.turn_sense
        s.sense = sense
    if abs(turn_rad) > _TURNING_RAD_S * tick_s:
        s.turn_sense = math.copysign(1.0, turn_rad)
    rolled_m = min(abs(forward_m), s.kick_left_m)
    s.kick_left_m -= rolled_m
    kick_rad: float = s.kick_sense * p.kick_rad * rolled_m / p.kick_length_m
    return kick_rad


@inlined
def move(
    p: Any,
    s: Any,
    n: Any,
    time_s: float,
    tick_s: float,
    rolled: tuple[float, float],
    step: tuple[float, float],
    rate_before: tuple[float, float],
    rate: tuple[float, float],
) -> None:
    """Move the body by one tick that ends at `time_s`; pairs are (left, right).

    `n` holds the tick's normals, `rolled` is r·Δφ without slip [m], `step` the wheels' steps Δφ
    [rad], `rate_before` and `rate` the wheel rates at both ends of the tick [rad/s].
    """
    middle_s = time_s - 0.5 * tick_s
    radius_left_m, radius_right_m = radii_m(p, middle_s)
    s.angle_left_rad += step[0]
    s.angle_right_rad += step[1]

    slipping = p.slip_start_s <= middle_s < p.slip_stop_s
    accel_left_m_s2 = radius_left_m * (rate[0] - rate_before[0]) / tick_s
    accel_right_m_s2 = radius_right_m * (rate[1] - rate_before[1]) / tick_s
    slip_left = pressed_slip(
        p, p.slip_left if slipping else 0.0, rolled[0], accel_left_m_s2, s.heading_rad
    )
    slip_right = pressed_slip(
        p, p.slip_right if slipping else 0.0, rolled[1], accel_right_m_s2, s.heading_rad
    )
    if p.wander_left != 0.0:
        s.wander_left = wandered(p.wander_stays, p.wander_left, s.wander_left, n.slip_wander_left)
        slip_left += s.wander_left
    if p.wander_right != 0.0:
        s.wander_right = wandered(
            p.wander_stays, p.wander_right, s.wander_right, n.slip_wander_right
        )
        slip_right += s.wander_right
    left_m = ground_step_m(
        rolled[0]
        + eccentric_roll_m(
            radius_left_m,
            p.eccentricity_left,
            p.eccentricity_phase_left_rad,
            s.angle_left_rad,
            step[0],
        ),
        slip_left,
        p.offset_left_m,
        p.step_noise_left_m,
        p.noise_left_m_per_sqrt_m,
        n.micro_slip_step_left,
        n.micro_slip_left,
    )
    right_m = ground_step_m(
        rolled[1]
        + eccentric_roll_m(
            radius_right_m,
            p.eccentricity_right,
            p.eccentricity_phase_right_rad,
            s.angle_right_rad,
            step[1],
        ),
        slip_right,
        p.offset_right_m,
        p.step_noise_right_m,
        p.noise_right_m_per_sqrt_m,
        n.micro_slip_step_right,
        n.micro_slip_right,
    )

    forward_m = 0.5 * (left_m + right_m)
    difference_m = right_m - left_m
    wheelbase_m = p.wheelbase_m
    across_m = abs(rolled[1] - rolled[0])
    if p.turn_scrub != 0.0 and across_m != 0.0:
        # As the wheels roll: the size of micro-slip, as large as ticks are short, is no speed.
        spin = across_m / (across_m + abs(rolled[0] + rolled[1]))
        wheelbase_m *= 1.0 + p.turn_scrub * spin
    turn_rad = difference_m / wheelbase_m
    if p.kick_rad != 0.0:
        turn_rad += caster_kick_rad(p, s, forward_m, turn_rad, tick_s)
    bumped = time_s - tick_s < p.bump_s <= time_s
    if bumped:
        turn_rad += p.bump_yaw_rad

    yaw_rate_rad_s = turn_rad / tick_s
    middle_rad = s.heading_rad + 0.5 * turn_rad
    lateral_slip_s = p.lateral_slip_s
    if p.lateral_slip_speed_m_s > 0.0:
        speed_m_s = 0.5 * abs(rolled[0] + rolled[1]) / tick_s
        lateral_slip_s *= speed_m_s / p.lateral_slip_speed_m_s
    lateral_m = forward_m * p.toe_slope - lateral_slip_s * forward_m * yaw_rate_rad_s
    if p.cross_slope_ratio != 0.0:
        downhill = math.sin(p.cross_slope_direction_rad - middle_rad)
        lateral_m += p.cross_slope_ratio * abs(forward_m) * downhill
    s.lateral_acceleration_m_s2 = forward_m / tick_s * yaw_rate_rad_s
    if bumped:
        forward_m += p.bump_forward_m
    cosine = math.cos(middle_rad)
    sine = math.sin(middle_rad)
    s.x_m += forward_m * cosine - lateral_m * sine
    s.y_m += forward_m * sine + lateral_m * cosine
    s.heading_rad += turn_rad

    s.step_left_rad = step[0]
    s.step_right_rad = step[1]
    s.yaw_rate_rad_s = yaw_rate_rad_s
    s.forward_acceleration_m_s2 = 0.5 * (accel_left_m_s2 + accel_right_m_s2)
