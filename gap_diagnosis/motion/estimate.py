"""A smooth estimate of the true motion, about which everything else is linear."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.explanations.choices import frozen_runs
from gap_diagnosis.explanations.known import known_effects
from gap_diagnosis.explanations.reference import USUAL_S, averaged, likely_signal
from gap_diagnosis.explanations.standstill import dead_ticks
from gap_diagnosis.lattice import step_of_values
from gap_diagnosis.motion.blanks import blanks, lost_ways_m2, stretches
from gap_diagnosis.motion.counters import jumps_of
from gap_diagnosis.motion.course import bent_heading, dead_reckoned, slow
from gap_diagnosis.motion.gyro_steps import variance_of_steps
from gap_diagnosis.motion.missing import (
    between,
    filled,
    silences,
    unheld,
    variance_of_filled,
    variance_of_moments,
)
from gap_diagnosis.motion.smoothing import (
    FINE_RAD,
    heard_rad2_per_s,
    sharp_smoothing_s,
    turn_smoothing_s,
)
from gap_diagnosis.prediction import Motion, noise_of_speeds
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.standing import standing
from gap_diagnosis.wheel_speeds import WheelSpeed, WheelSpeeds, wheel_speed
from hil_harness.robot import Robot

_REFERENCE_K: Final = 298.15
_A_CODE: Final = 0.6
"""Rounding leaves half a code [LSB]."""
_OFTEN: Final = 20
"""So many codes at an end, or beyond it, are no spikes."""
_BY_CHANCE: Final = 3.0
"""Standard deviations of a sample's noise."""
NOTHING_SAID_RAD2: Final = 1.0
"""Variance of a tick's turn by a gyro that is silent or repeats its code. What it holds is
predicted to the bit: taken for a measurement, that would say that the wheels never slipped
meanwhile."""


def estimate_motion(
    recording: Recording, robot: Robot, *, reference_delay_s: Floats | float = 0.0
) -> Motion:
    """Return the motion of a recording: dead reckoning, bent slowly onto the reference.

    *reference_delay_s*, one or each sample's, is taken off the reference's stamps first. Only a
    linearisation point: the reference is smoothed here and nowhere else. Where one wheel alone
    counts, the way leads where the gyro turns, if the reference has no headings, or where these do,
    if there is no gyro.

    What is known beside the description acts in the first of its ways.

    Raises DiagnosisError when there are no wheel counts in the log, or fewer than three ticks.
    """
    if len(recording.t_s) < 3 or not np.isfinite(recording.left_ticks).any():
        raise DiagnosisError(
            f"{recording.name}: no wheel counts to follow: expected at least three ticks with "
            "left and right counts"
        )
    robot = _as_far_apart(robot, recording)
    motion = _estimated(recording, robot, reference_delay_s)
    known = known_effects(recording.granted, motion)
    motion = replace(motion, granted=tuple(one.ways[0] for one in known))
    reference = recording.reference
    dead = dead_ticks(motion)
    if reference is None or not dead.any():
        return motion
    if motion.gyro_turn_rad is None and reference.heading_rad is not None:
        heading = np.interp(motion.t_s, reference.t_s - reference_delay_s, reference.heading_rad)
    elif motion.gyro_turn_rad is not None and reference.heading_rad is None:
        heading = motion.gyro_turn_rad
    else:
        return motion
    turning = _with_turns_of(heading, recording, motion, dead)
    way = _estimated(turning, robot, reference_delay_s)
    return replace(
        motion,
        x_m=way.x_m,
        y_m=way.y_m,
        heading_rad=way.heading_rad,
        speed_m_s=way.speed_m_s,
        turn_rate_rad_s=way.turn_rate_rad_s,
        turning_s=way.turning_s,
        sharp_s=way.sharp_s,
        bent_over_s=way.bent_over_s,
    )


def _as_far_apart(robot: Robot, recording: Recording) -> Robot:
    """Return the robot with its wheels as far apart as they are known to stand: what their counts
    round off turns it by less, as the description's would."""
    farther = recording.granted.number("wheelbase_scale.scale")
    if farther == 0.0:
        return robot
    wheels = robot.plant.wheels
    wheels = wheels.model_copy(update={"wheelbase_m": wheels.wheelbase_m * (1.0 + farther)})
    return replace(robot, plant=robot.plant.model_copy(update={"wheels": wheels}))


def _with_turns_of(
    heading_rad: Floats, recording: Recording, motion: Motion, dead: NDArray[np.bool_]
) -> Recording:
    """Return the recording with the counts that a wheel which counts no more would have had, by the
    other one and the reference's headings at its ticks, float64[n]."""
    smooth = gaussian_filter1d(heading_rad, max(USUAL_S / motion.tick_s, 0.5))
    per_turn = motion.wheelbase_m / (motion.radius_m * motion.rad_per_count)
    turn = per_turn * np.diff(smooth, prepend=smooth[0])
    steps = (motion.left_step_rad, motion.right_step_rad)
    left, right = (step_rad / motion.rad_per_count for step_rad in steps)
    is_left = dead & (left == 0.0)
    missing_left = np.where(is_left, right - turn, 0.0)
    missing_right = np.where(dead & ~is_left, left + turn, 0.0)
    return replace(
        recording,
        left_ticks=recording.left_ticks + np.round(np.cumsum(missing_left)),
        right_ticks=recording.right_ticks + np.round(np.cumsum(missing_right)),
    )


def _estimated(recording: Recording, robot: Robot, reference_delay_s: Floats | float) -> Motion:
    """Return the same with every wheel as it is counted."""
    t_s = recording.t_s
    plant = robot.plant
    rad_per_count = math.tau / plant.encoder.ticks_per_rev
    dt_s = np.diff(t_s, prepend=t_s[0])
    step_s = float(np.median(dt_s[1:]))
    bits, jumps = jumps_of(recording, robot)
    left, right = (
        between(ticks - np.cumsum(jump), t_s) * rad_per_count
        for ticks, jump in zip((recording.left_ticks, recording.right_ticks), jumps, strict=True)
    )
    left, right = left - left[0], right - right[0]
    width = max(USUAL_S / step_s, 0.5)
    rates = [gaussian_filter1d(_slope(angle, t_s), width) for angle in (left, right)]
    accelerations = [gaussian_filter1d(np.gradient(rate, t_s), width) for rate in rates]
    radius_m, wheelbase_m = plant.wheels.radius_m, plant.wheels.wheelbase_m
    left_step, right_step = np.diff(left, prepend=0.0), np.diff(right, prepend=0.0)
    is_counted = recording.unsure_ticks2 is None
    rounding = (
        rad_per_count * np.array(recording.counts_per_step) if is_counted else np.full(2, FINE_RAD)
    )
    steady = [
        np.where(standing(angle, step_s, rounding_rad), 0.0, step)
        for angle, step, rounding_rad in zip(
            (left, right), (left_step, right_step), rounding, strict=True
        )
    ]
    forward_m = 0.5 * radius_m * (left_step + right_step)
    heading = heading_by_wheels = radius_m * (right - left) / wheelbase_m
    blank = blanks(recording)
    gyro_turn = _gyro_turn(recording, dt_s, heading)
    has_counters = any(one.modulo for one in recording.frames.values())
    gyro_rate = recording.gyro_rate_rad_s
    gyro_unsure = variance_of_filled(gyro_rate, t_s) * dt_s**2
    if gyro_rate is not None and not has_counters:
        density = plant.gyro.noise_density_rad_per_sqrt_s
        gyro_unsure += variance_of_moments(gyro_rate, t_s, density**2 / step_s) * dt_s**2
    if gyro_rate is not None:
        gyro_unsure[silences(gyro_rate, t_s) | blank] = NOTHING_SAID_RAD2
    reference = recording.reference
    bent, over_s = np.zeros(len(t_s)), 0.0
    if reference is None:
        x_m, y_m = dead_reckoned(forward_m, heading)
    else:
        stamps = reference.t_s - reference_delay_s
        bent[(t_s >= stamps[0]) & (t_s <= stamps[-1])] = 1.0
        heading, over_s = bent_heading(heading, t_s, stamps, reference, forward_m, step_s)
        x_m, y_m = dead_reckoned(forward_m, heading)
        off_x_m = reference.x_m - np.interp(stamps, t_s, x_m)
        off_y_m = reference.y_m - np.interp(stamps, t_s, y_m)
        x_m = x_m + slow(stamps, off_x_m, t_s, step_s, lost=stretches(blank))
        y_m = y_m + slow(stamps, off_y_m, t_s, step_s, lost=stretches(blank))
    turning_s = turn_smoothing_s(heading, np.abs(rates) * radius_m, wheelbase_m, step_s)
    unsure_rad2 = (
        np.zeros((2, len(t_s)))
        if recording.unsure_ticks2 is None
        else recording.unsure_ticks2 * rad_per_count**2
    )
    told_rad2_per_s = noise_of_speeds(unsure_rad2, radius_m / wheelbase_m, step_s)
    if gyro_turn is not None:
        told_rad2_per_s = heard_rad2_per_s(
            told_rad2_per_s,
            _slope(heading_by_wheels - gyro_turn, t_s),
            unsure_rad2.sum(axis=0) > 0.0,
            plant.gyro.noise_density_rad_per_sqrt_s**2,
            step_s,
        )
    lasting_s = turn_smoothing_s(
        heading, np.abs(rates) * radius_m, wheelbase_m, step_s, told_rad2_per_s
    )
    turn_rate = _turn_rate(_slope(heading, t_s), (turning_s, lasting_s), step_s, told_rad2_per_s)
    gyro_step_rad_s = 0.0
    if gyro_rate is not None:
        # What is put in between two samples is no multiple of a step.
        gyro_step_rad_s = step_of_values(gyro_rate[np.isfinite(gyro_rate)])
        told = filled(gyro_rate, t_s)
        gyro_unsure += variance_of_steps(told, gyro_step_rad_s, turn_rate, step_s) * dt_s**2
    middle = heading - 0.5 * np.diff(heading, prepend=heading[0])
    along = _slope(x_m, t_s) * np.cos(middle) + _slope(y_m, t_s) * np.sin(middle)
    temperature, supply = recording.temperature_k, recording.supply_v
    code, gyro = recording.gyro_code, plant.gyro
    gyro_code = None if code is None or gyro_turn is None else filled(code, t_s)
    noise_rad_s = gyro.noise_density_rad_per_sqrt_s / math.sqrt(step_s)
    noise_lsb = noise_rad_s * gyro.sensitivity_lsb_per_rad_s
    return Motion(
        t_s=t_s,
        dt_s=dt_s,
        left_step_rad=left_step,
        right_step_rad=right_step,
        left_jump_rad=jumps[0] * rad_per_count,
        right_jump_rad=jumps[1] * rad_per_count,
        wrap_bits=bits,
        left_angle_rad=left,
        right_angle_rad=right,
        left_steady_rad=steady[0],
        right_steady_rad=steady[1],
        left_rate_rad_s=rates[0],
        right_rate_rad_s=rates[1],
        left_acceleration_rad_s2=accelerations[0],
        right_acceleration_rad_s2=accelerations[1],
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading,
        speed_m_s=gaussian_filter1d(along, width),
        turn_rate_rad_s=turn_rate,
        acceleration_m_s2=0.5 * radius_m * (accelerations[0] + accelerations[1]),
        gyro_turn_rad=gyro_turn,
        wheel_unsure_rad2=unsure_rad2,
        told_rad2_per_s=told_rad2_per_s,
        lost_m2=lost_ways_m2(blank, t_s, forward_m, heading_by_wheels),
        gyro_unsure_rad2=gyro_unsure,
        gyro_code=None if gyro_code is None else np.clip(gyro_code, 0, plant.adc.max_code),
        gyro_is_filled=np.zeros(len(t_s), dtype=np.bool_) if code is None else ~np.isfinite(code),
        gyro_sensitivity_lsb_per_rad_s=plant.gyro.sensitivity_lsb_per_rad_s,
        gyro_zero_rate_code=plant.gyro.zero_rate_code,
        gyro_noise_lsb=noise_lsb,
        gyro_step_lsb=max(gyro_step_rad_s * gyro.sensitivity_lsb_per_rad_s, 1.0),
        adc_max_code=plant.adc.max_code,
        gyro_at_its_end=np.zeros(len(t_s), dtype=np.bool_)
        if gyro_code is None
        else _at_its_end(gyro_code, plant.gyro_code_limits, noise_lsb),
        warm_k=None if temperature is None else unheld(temperature, t_s) - _REFERENCE_K,
        supply_error=None if supply is None else unheld(supply, t_s) / plant.supply.nominal_v - 1.0,
        radius_m=radius_m,
        wheelbase_m=wheelbase_m,
        rad_per_count=rad_per_count,
        wheel_rounding_rad=rounding,
        turning_s=turning_s,
        bent=bent,
        bent_over_s=over_s,
        sharp_s=sharp_smoothing_s(turning_s),
        wheel_speeds=WheelSpeeds(
            partial(_wheel_speeds, (left, right), t_s, gyro_turn, robot, rounding, told_rad2_per_s)
        ),
        has_speeds=recording.speed_cycle_s > 0,
        has_counters=has_counters,
        are_rows_late=recording.stamped_by_host,
        own_names=recording.own_names,
    )


def _turn_rate(
    rate: Floats, widths_s: tuple[float, float], step_s: float, told_rad2_per_s: float
) -> Floats:
    """Return a turn rate smoothed by Gaussians of two widths: by the wider one, but where what that
    takes away is likelier the body's than noise of speeds, which adds *told_rad2_per_s* to the
    heading's variance.

    With that noise in it a turn that lasts has edges, and a gyro that shows none would lag.
    """
    little, much = (gaussian_filter1d(rate, max(width_s / step_s, 0.5)) for width_s in widths_s)
    if told_rad2_per_s == 0.0:
        return np.asarray(little)
    noise = averaged(told_rad2_per_s, max(widths_s[0], 0.5 * step_s))
    return np.asarray(much + likely_signal(little - much, noise, step_s) * (little - much))


def _wheel_speeds(
    angles: tuple[Floats, Floats],
    t_s: Floats,
    gyro_turn: Floats | None,
    robot: Robot,
    rounding: Floats,
    told_rad2_per_s: float,
) -> tuple[WheelSpeed, WheelSpeed]:
    """Return what is known of both wheels' speeds beside their own counts; noise of speeds adds
    *told_rad2_per_s* to the variance of the robot's turn."""
    plant, tick_s = robot.plant, float(np.median(np.diff(t_s)))
    per_turn = plant.wheels.wheelbase_m / plant.wheels.radius_m
    turning = None if gyro_turn is None else _slope(gyro_turn, t_s) * per_turn
    left, right = (_slope(angle, t_s) for angle in angles)

    def of(own: Floats, other: Floats, sign: float, rounding_rad: float) -> WheelSpeed:
        return wheel_speed(
            own,
            other,
            None if turning is None else sign * turning,
            smooth_ticks=max(USUAL_S / tick_s, 0.5),
            tick_s=tick_s,
            rad_per_count=math.tau / plant.encoder.ticks_per_rev,
            rounding_rad=rounding_rad,
            told_rad2_per_s=0.5 * per_turn**2 * told_rad2_per_s,
        )

    return of(left, right, -1.0, rounding[0]), of(right, left, 1.0, rounding[1])


def _slope(values: Floats, t_s: Floats) -> Floats:
    """Return the mean slope over each tick, of which t_s is the end; the first is the second's."""
    slope = np.diff(values) / np.diff(t_s)
    return np.concatenate([slope[:1], slope])


def _at_its_end(code: Floats, limits: tuple[int, int], noise_lsb: float) -> NDArray[np.bool_]:
    """Tell where the gyro is at an end of its described range, or within its noise of one: where it
    does not show the end itself it shows what chance left below.

    Nowhere if it hardly ever gets there, nor if it goes beyond: the range is another one, and was
    perhaps left out of robot.toml. *code* is float64[n], lost ones filled in, *noise_lsb* a
    sample's.
    """
    low, high = limits
    beyond = np.maximum(low - code, code - high)
    at_an_end = beyond > -_A_CODE
    if np.count_nonzero(beyond > _A_CODE) >= _OFTEN or np.count_nonzero(at_an_end) < _OFTEN:
        return np.zeros(len(code), dtype=np.bool_)
    return np.asarray(beyond > -_A_CODE - _BY_CHANCE * noise_lsb)


def unsure_where_silent(motion: Motion) -> Motion:
    """Return the motion with a gyro that says nothing where it repeats its code or shows no more
    than the end of its described range."""
    silent = motion.gyro_at_its_end.copy()
    for first, last in frozen_runs(motion):
        silent[first : last + 1] = True
    return without_gyro(motion, silent)


def without_gyro(motion: Motion, silent: NDArray[np.bool_]) -> Motion:
    """Return the motion with a gyro that says nothing in the ticks *silent*, bool[n]: not even by
    how far it turned from the one side of them to the other."""
    return replace(
        motion, gyro_unsure_rad2=np.where(silent, NOTHING_SAID_RAD2, motion.gyro_unsure_rad2)
    )


def _gyro_turn(recording: Recording, dt_s: Floats, heading: Floats) -> Floats | None:
    """Return the turn by the gyro [rad], float64[n]; in a silence the wheels' own, *heading*.

    Counts go on while nobody hears of them, but what the gyro said is lost.
    """
    rate = recording.gyro_rate_rad_s
    if rate is None or np.isfinite(rate).sum() < 3:
        return None
    steps = filled(rate, recording.t_s) * dt_s
    silent = silences(rate, recording.t_s)
    steps[silent] = np.diff(heading, prepend=heading[0])[silent]
    return np.asarray(np.cumsum(steps) - steps[0])
