"""Healthy robots that no code of the house drives: coarse counts, lost rows, mean speeds, GPS."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from motion_cases import ROBOT, Floats, nothing_of

from gap_diagnosis.explanations.reference import turn_rate_with_details
from gap_diagnosis.motion.evidence import score
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import fit_noise
from gap_diagnosis.motion.unknown import alternatives
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.reading.speeds import AddedUp, integrated_speed
from gap_diagnosis.recording import Recording, Reference
from hil_harness.robot import Robot

STEP_S = 0.001
ROW_S = 0.02
NEWS = 5.0
"""An effect that is not there gains so much [nat] once in thousands of logs."""


@dataclass(frozen=True)
class Drive:
    """A drive in steps of a millisecond: float64[n] each, ends of the steps."""

    t_s: Floats
    left_rad: Floats
    right_rad: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats


def driven() -> Drive:
    """Return starts, stops, arcs and slow turns on the spot."""
    t_s = np.arange(STEP_S, 80.0, STEP_S)
    going = np.clip(3.0 * np.sin(math.tau * t_s / 9.0), 0.0, 1.0)
    speed = 0.4 * going * np.sign(np.sin(math.tau * t_s / 36.0) + 0.6)
    rate = 0.9 * np.sin(math.tau * t_s / 7.0) * going + 0.06 * (going == 0.0)
    rate[t_s < 3.0] = speed[t_s < 3.0] = 0.0
    wheels = ROBOT.plant.wheels
    turn = 0.5 * rate * wheels.wheelbase_m
    heading = np.cumsum(rate) * STEP_S
    middle = heading - 0.5 * rate * STEP_S
    left, right = (
        np.cumsum(one) * STEP_S / wheels.radius_m for one in (speed - turn, speed + turn)
    )
    return Drive(
        t_s,
        left,
        right,
        np.cumsum(speed * np.cos(middle)) * STEP_S,
        np.cumsum(speed * np.sin(middle)) * STEP_S,
        heading,
    )


DRIVE = driven()


def recorded(robot: Robot, position_m: float = 5e-4, row_s: float = ROW_S) -> Recording:
    """Return the drive in rows, with the described gyro and a reference between the rows."""
    rng = np.random.default_rng(8)
    rows = np.arange(row_s, 79.0, row_s)
    encoder, gyro = robot.plant.encoder, robot.plant.gyro
    left, right = (
        np.floor(np.interp(rows, DRIVE.t_s, angle) / math.tau * encoder.ticks_per_rev + 0.4)
        for angle in (DRIVE.left_rad, DRIVE.right_rad)
    )
    heading = np.interp(rows, DRIVE.t_s, DRIVE.heading_rad)
    noise = gyro.noise_density_rad_per_sqrt_s / math.sqrt(row_s) * rng.standard_normal(len(rows))
    stamps = np.arange(0.013, 79.0, 0.02)
    x_m, y_m, turned = (
        np.interp(stamps, DRIVE.t_s, one) + sd * rng.standard_normal(len(stamps))
        for one, sd in (
            (DRIVE.x_m, position_m),
            (DRIVE.y_m, position_m),
            (DRIVE.heading_rad, 2e-3),
        )
    )
    rate = np.diff(heading, prepend=0.0) / row_s + noise
    return Recording(
        name="own",
        tick_period_s=row_s,
        t_s=rows,
        stamp_s=rows,
        tick=np.arange(len(rows)),
        left_ticks=left,
        right_ticks=right,
        gyro_rate_rad_s=rate,
        gyro_code=rate * gyro.sensitivity_lsb_per_rad_s + gyro.zero_rate_code,
        reference=Reference(stamps, x_m, y_m, turned),
    )


def with_ticks(ticks_per_rev: int) -> Robot:
    """Return the robot with another encoder, that rounds down and does nothing else."""
    encoder = ROBOT.plant.encoder.model_copy(
        update={"ticks_per_rev": ticks_per_rev, "noise_ticks": 0.0}
    )
    return replace(ROBOT, plant=ROBOT.plant.model_copy(update={"encoder": encoder}))


def gains(model: MotionModel, levels: Floats) -> dict[str, float]:
    """Return by how much each effect alone explains the log better than none [nat]."""
    gram = model.gram(levels)
    found: dict[str, float] = {}
    for term in model.columns.terms:
        gain = score(gram, [term], model.prior).log_evidence
        found[term.variant.effect] = max(gain, found.get(term.variant.effect, gain))
    return found


def test_the_rounding_of_coarse_counts_is_no_delay_no_slip_and_no_noise_of_the_gyro() -> None:
    robot = with_ticks(60)
    model = MotionModel(recorded(robot), robot, default_prior())
    levels = model.no_effect_levels
    assert max(gains(model, levels).values()) < NEWS
    noise = levels[LEVELS.index("gyro_noise_rad_per_sqrt_s")]
    assert noise < 2 * robot.plant.gyro.noise_density_rad_per_sqrt_s


def test_rows_that_are_lost_in_turns_are_no_noise_of_the_gyro() -> None:
    robot = with_ticks(4096)
    log = recorded(robot, row_s=0.033)
    lost = np.random.default_rng(2).random(len(log.t_s)) < 0.04
    assert log.gyro_rate_rad_s is not None
    left, right, rate = (
        np.where(lost, np.nan, one)
        for one in (log.left_ticks, log.right_ticks, log.gyro_rate_rad_s)
    )
    log = replace(log, left_ticks=left, right_ticks=right, gyro_rate_rad_s=rate)
    levels = MotionModel(log, robot, default_prior()).no_effect_levels
    gyro = robot.plant.gyro
    assert levels[LEVELS.index("gyro_noise_rad_per_sqrt_s")] < (
        1.5 * gyro.noise_density_rad_per_sqrt_s
    )
    assert levels[LEVELS.index("gyro_bias_walk_rad_s_per_sqrt_s")] < 1e-5


def test_a_gyro_that_is_read_in_a_moment_of_each_row_is_no_noisier() -> None:
    robot = with_ticks(4096)
    log = recorded(robot, row_s=0.04)
    turning = np.interp(log.t_s, DRIVE.t_s, np.gradient(DRIVE.heading_rad, STEP_S))
    gyro = robot.plant.gyro
    noise = gyro.noise_density_rad_per_sqrt_s / math.sqrt(0.04)
    read = turning + noise * np.random.default_rng(5).standard_normal(len(turning))
    levels = MotionModel(
        replace(log, gyro_rate_rad_s=read), robot, default_prior()
    ).no_effect_levels
    assert levels[LEVELS.index("gyro_noise_rad_per_sqrt_s")] < (
        1.25 * gyro.noise_density_rad_per_sqrt_s
    )
    assert levels[LEVELS.index("gyro_bias_walk_rad_s_per_sqrt_s")] < 1e-5


def test_speeds_that_are_means_since_the_row_before_are_not_late() -> None:
    robot = with_ticks(4096)
    log = recorded(robot, row_s=0.04)
    left, right = (
        integrated_speed(np.diff(one, prepend=one[0]) / 0.04, log.t_s, scale=1.0).ticks
        for one in (log.left_ticks, log.right_ticks)
    )
    log = replace(log, left_ticks=left, right_ticks=right, speed_cycle_s=0.04)
    model = MotionModel(log, robot, default_prior())
    assert max(gains(model, model.no_effect_levels).values()) < NEWS


def test_a_search_that_ends_at_better_levels_makes_no_noise_of_a_reference() -> None:
    model = MotionModel(recorded(ROBOT, position_m=0.03), ROBOT, default_prior())
    nothing = nothing_of(model, model.level_prior.median)
    fit = fit_noise(model, nothing, nothing, "reference_noise", ("reference_noise",))
    assert fit.log_evidence < NEWS


def on_the_road(robot: Robot) -> Recording:
    """Return a car's speeds: its tyres slip to and fro, and it turns as smoothly as it is heavy."""
    rng = np.random.default_rng(3)
    t_s = np.arange(STEP_S, 120.0, STEP_S)
    speed = 9.0 + 4.0 * np.sin(t_s / 7.0)
    bends = np.maximum(np.sin(math.tau * t_s / 15.0), 0.0) ** 6
    rate = 0.3 * bends * np.sign(np.sin(math.tau * t_s / 62.0))
    heading = np.cumsum(rate) * STEP_S
    x_m, y_m = (np.cumsum(speed * one(heading)) * STEP_S for one in (np.cos, np.sin))
    wheels, gyro, row_s = robot.plant.wheels, robot.plant.gyro, 0.02
    rows, stamps = np.arange(row_s, 119.0, row_s), np.arange(0.013, 119.0, 0.1)
    every = round(row_s / STEP_S)

    def told(side: float) -> AddedUp:
        slip = 4e-4 * np.sqrt(speed / STEP_S) * rng.standard_normal(len(t_s))
        wheel = np.cumsum(speed + side * 0.5 * wheels.wheelbase_m * rate + slip) * STEP_S
        mean = np.diff(np.interp(rows, t_s, wheel), prepend=wheel[0]) / row_s
        scale = robot.plant.encoder.ticks_per_rev / math.tau / wheels.radius_m
        return integrated_speed(np.round(mean, 2), rows, scale=scale)

    left, right = told(-1.0), told(1.0)
    turned = np.diff(heading[every - 1 :: every][: len(rows)], prepend=0.0) / row_s
    noise = gyro.noise_density_rad_per_sqrt_s / math.sqrt(row_s)
    turned += noise * rng.standard_normal(len(rows))
    return Recording(
        name="car",
        tick_period_s=row_s,
        t_s=rows,
        stamp_s=rows,
        tick=np.arange(len(rows)),
        left_ticks=left.ticks,
        right_ticks=right.ticks,
        gyro_rate_rad_s=turned,
        gyro_code=turned * gyro.sensitivity_lsb_per_rad_s + gyro.zero_rate_code,
        reference=Reference(
            stamps,
            *(
                np.interp(stamps, t_s, one) + 0.01 * rng.standard_normal(len(stamps))
                for one in (x_m, y_m)
            ),
            np.interp(stamps, t_s, heading) + 1e-3 * rng.standard_normal(len(stamps)),
        ),
        speed_cycle_s=row_s,
        unsure_ticks2=np.stack([left.unsure_ticks2, right.unsure_ticks2]),
    )


def test_tyres_that_slip_to_and_fro_under_a_heavy_car_are_no_lag_of_its_gyro() -> None:
    plant = ROBOT.plant
    wheels = plant.wheels.model_copy(update={"radius_m": 0.3, "wheelbase_m": 1.5})
    robot = replace(ROBOT, plant=plant.model_copy(update={"wheels": wheels}))
    model = MotionModel(on_the_road(robot), robot, default_prior())
    levels = model.no_effect_levels
    assert max(gains(model, levels).values()) < NEWS
    # On a straight they are all that the wheels turn: no unlisted turn either.
    assert max(one.log_evidence for one in alternatives(model, levels)) < NEWS


def test_a_car_that_turns_from_side_to_side_turns_as_smoothly_by_its_speeds() -> None:
    """A change of sides, taken for a moment of straight, is an edge: its details were 0.13 rad/s,
    and a gyro 80 ms late was told as a lag and an early reference."""
    plant = ROBOT.plant
    wheels = plant.wheels.model_copy(update={"radius_m": 0.3, "wheelbase_m": 1.5})
    robot = replace(ROBOT, plant=plant.model_copy(update={"wheels": wheels}))
    log = on_the_road(robot)
    assert log.gyro_rate_rad_s is not None
    assert log.reference is not None
    # Two waves without a common period: sides change at ever other speeds, and nothing is straight.
    angle = math.tau * log.t_s / 5.0
    rate = 0.1 * (np.sin(angle) + np.sin(angle / 0.618 + 1.0))
    half = 0.5 * wheels.wheelbase_m * rate * log.tick_s
    per_m = plant.encoder.ticks_per_rev / math.tau / wheels.radius_m
    ahead = 9.0 * log.tick_s
    heading = np.interp(log.reference.t_s, log.t_s, np.cumsum(rate) * log.tick_s)
    way = replace(log.reference, heading_rad=heading)
    log = replace(
        log,
        left_ticks=np.cumsum(ahead - half) * per_m,
        right_ticks=np.cumsum(ahead + half) * per_m,
        unsure_ticks2=np.zeros((2, len(log.t_s))),  # these ways are exact
        reference=way,
    )
    smooth = MotionModel(log, robot, default_prior()).nodes.smooth
    off = turn_rate_with_details(smooth) - rate
    assert np.abs(off[100:-100]).max() < 0.005
