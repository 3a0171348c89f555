"""Each effect does to the robot what its name, unit and sign say; measured on the plant's counts.

The described robot of these tests has no noise, so a law shows to within its quantisation: one
tick of a wheel, one code of the gyro.
"""

import math

import numpy as np
import pytest
from effect_drives import (
    BASE_M,
    QUIET,
    RADIUS_M,
    TICK_M,
    TICK_S,
    TICK_TURN_RAD,
    TICK_US,
    Drive,
    FloatArray,
    run,
)

from hil_harness.effects import apply_effects, parse_effect
from sim_plant import simulate

# --- geometry: the true body against what the described wheels count -------------------------


def test_a_larger_wheel_goes_farther_than_counted() -> None:
    seen = run("radius_scale.scale=0.01", v=0.5)
    assert seen.path_m / seen.counted_m == pytest.approx(1.01, abs=TICK_M / 5)


def test_more_ticks_per_turn_count_more_than_was_driven() -> None:
    seen = run("ticks_per_rev.scale=0.01", v=0.5)
    assert seen.counted_m / seen.path_m == pytest.approx(1.01, abs=TICK_M / 5)


def test_the_twins_radius_and_ticks_leave_the_same_counts() -> None:
    by_radius = run("radius_scale.scale=0.01", v=0.5, w=0.1)
    by_ticks = run(f"ticks_per_rev.scale={1 / 1.01 - 1}", v=0.5, w=0.1)
    for side in ("left", "right"):
        assert abs(by_radius.ticks(side) - by_ticks.ticks(side)) <= 1


def test_a_larger_right_wheel_turns_left_on_a_straight_command() -> None:
    seen = run("radius_mismatch.mismatch=0.01", v=0.5, drive="motor")
    assert seen.turn_rad == pytest.approx(0.01 * seen.path_m / BASE_M, rel=1e-3)
    assert abs(seen.counted_turn_rad) <= 2 * TICK_TURN_RAD


def test_a_longer_wheelbase_turns_less_than_counted() -> None:
    seen = run("wheelbase_scale.scale=0.1", w=1.0)
    assert seen.counted_turn_rad / seen.turn_rad == pytest.approx(1.1, abs=TICK_TURN_RAD)


def test_scrub_is_full_in_a_spin_and_none_on_a_straight() -> None:
    spin, straight = run("turn_scrub.scrub=0.5", w=1.0), run("turn_scrub.scrub=0.5", v=0.5)
    assert spin.counted_turn_rad / spin.turn_rad == pytest.approx(1.5, abs=TICK_TURN_RAD)
    assert straight.counted_m == pytest.approx(straight.path_m, abs=TICK_M)


def test_scrub_in_an_arc_is_in_proportion_to_the_turning_share() -> None:
    v, w = 0.3, 1.0
    seen = run("turn_scrub.scrub=0.5", v=v, w=w)
    described = w * BASE_M / (w * BASE_M + 2 * v)
    assert seen.counted_turn_rad / seen.turn_rad == pytest.approx(1 + 0.5 * described, abs=0.02)


def test_load_on_the_left_turns_left() -> None:
    seen = run("payload.compression_left=0.01", v=0.5, drive="motor")
    assert seen.turn_rad == pytest.approx(0.01 * 5.0 / BASE_M, rel=1e-2)


def test_a_tyre_that_grows_goes_ever_farther() -> None:
    seen = run("tyre_drift.rate=0.0005", v=0.5, seconds=20.0)
    assert seen.path_m - seen.counted_m == pytest.approx(0.5 * 0.0005 * 0.5 * 20.0**2, rel=0.02)


def test_an_eccentric_wheel_wobbles_the_body_once_per_turn_and_not_the_counts() -> None:
    effects = ("wheel_eccentricity.side=left", "wheel_eccentricity.amplitude=0.05")
    seen = run(*effects, v=0.5, drive="motor", seconds=20.0)
    wobble = np.diff(seen.pose[:, 2]) / TICK_S
    spectrum = np.abs(np.fft.rfft(wobble * np.hanning(len(wobble))))
    strongest_hz = np.fft.rfftfreq(len(wobble), TICK_S)[np.argmax(spectrum[3:]) + 3]
    assert strongest_hz == pytest.approx(0.5 / RADIUS_M / (2 * math.pi), abs=0.06)
    assert np.ptp(seen.tick_steps("left")[5:]) <= 1


def test_an_eccentric_encoder_wobbles_the_counts_and_not_the_body() -> None:
    effects = ("encoder_eccentricity.side=left", "encoder_eccentricity.amplitude=0.05")
    seen = run(*effects, v=0.5, drive="motor", seconds=20.0)
    assert np.ptp(seen.pose[:, 2]) < 1e-12
    true_ticks = 0.5 * np.arange(1, 2001) * TICK_S / TICK_M
    error_rad = (np.cumsum(seen.tick_steps("left")) - true_ticks) * 2 * math.pi / 2048
    assert np.ptp(error_rad) / 2 == pytest.approx(0.05, abs=0.005)


# --- contact ---------------------------------------------------------------------------------


def test_a_slipping_left_wheel_falls_behind_and_the_robot_turns_left_inside_the_window() -> None:
    effects = ("side=left", "ratio=0.1", "start_s=2", "stop_s=6")
    seen = run(*(f"one_sided_slip.{part}" for part in effects), v=0.5, drive="motor")
    heading = seen.pose[:, 2]
    assert heading[200] == pytest.approx(0.0, abs=1e-9)
    assert heading[-1] == pytest.approx(0.1 * 0.5 * 4.0 / BASE_M, rel=0.01)
    assert heading[-1] == pytest.approx(heading[601], rel=0.01)
    assert abs(seen.counted_turn_rad) <= 2 * TICK_TURN_RAD


def test_slip_of_both_wheels_goes_less_far_than_counted() -> None:
    seen = run("one_sided_slip.side=both", "one_sided_slip.ratio=0.04", v=0.5, drive="motor")
    assert seen.path_m / seen.counted_m == pytest.approx(0.96, abs=1e-3)


def test_speeding_up_over_reads_and_braking_under_reads() -> None:
    acceleration = 0.5
    up = np.column_stack([np.minimum(np.arange(1001) * TICK_S, 1.0) * acceleration, np.zeros(1001)])
    seen = run("longitudinal_slip.compliance=0.1", commands=up, drive="motor")
    while_speeding_up = 100
    counted = seen.tick_steps("left")[:while_speeding_up].sum() * TICK_M
    driven = seen.pose[while_speeding_up, 0]
    assert driven / counted == pytest.approx(1 - 0.1 * acceleration, abs=0.01)
    braking = run("longitudinal_slip.compliance=0.1", commands=up[::-1], drive="motor")
    counted = braking.tick_steps("left")[-while_speeding_up:].sum() * TICK_M
    driven = braking.pose[-1, 0] - braking.pose[-1 - while_speeding_up, 0]
    assert driven / counted == pytest.approx(1 + 0.1 * acceleration, abs=0.01)


def sideways_m_s(seen: Drive) -> FloatArray:
    """Return the body's velocity to its left at each tick."""
    heading = (seen.pose[1:, 2] + seen.pose[:-1, 2]) / 2
    dx, dy = np.diff(seen.pose[:, :2], axis=0).T
    sideways: FloatArray = (-dx * np.sin(heading) + dy * np.cos(heading)) / TICK_S
    return sideways


def test_in_a_left_turn_the_robot_slides_to_its_right() -> None:
    seen = run("lateral_slip.compliance=0.1", v=0.5, w=0.4)
    assert sideways_m_s(seen)[5:] == pytest.approx(-0.1 * 0.5 * 0.4, rel=1e-3)


def test_where_tyres_yield_by_an_angle_the_slide_grows_with_the_square_of_the_speed() -> None:
    tyres = ("lateral_slip.compliance=0.1", "lateral_slip.speed=0.25")
    for v in (0.25, 0.5, -0.5):
        slide_m_s = -0.1 * (abs(v) / 0.25) * v * 0.4
        assert sideways_m_s(run(*tyres, v=v, w=0.4))[5:] == pytest.approx(slide_m_s, rel=1e-3)


def test_on_a_cross_slope_the_robot_slides_downhill() -> None:
    downhill = ("cross_slope_drift.ratio=0.02", f"cross_slope_drift.direction={math.pi / 2}")
    assert sideways_m_s(run(*downhill, v=0.5)) == pytest.approx(0.02 * 0.5, rel=1e-3)
    assert sideways_m_s(run(*downhill, v=-0.5)) == pytest.approx(0.02 * 0.5, rel=1e-3)


def test_downhill_a_wheel_goes_farther_than_counted_and_uphill_less() -> None:
    for direction, ratio in ((0.0, 1.02), (math.pi, 0.98)):
        effects = ("grade_slip.ratio=0.02", f"grade_slip.direction={direction}")
        seen = run(*effects, v=0.5, drive="motor")
        assert seen.path_m / seen.counted_m == pytest.approx(ratio, abs=1e-3)


def test_toe_to_the_left_rolls_to_the_left() -> None:
    seen = run("wheel_toe.angle=0.02", v=0.5)
    assert sideways_m_s(seen) == pytest.approx(0.5 * math.tan(0.02), rel=1e-3)


def test_a_bump_moves_the_body_once_unseen_by_the_encoders() -> None:
    effects = ("floor_bump.time=5", "floor_bump.yaw=0.05", "floor_bump.forward=0.01")
    seen = run(*effects, v=0.5)
    assert seen.turn_rad == pytest.approx(0.05, abs=1e-9)
    assert seen.path_m - seen.counted_m == pytest.approx(0.01, abs=2 * TICK_M)
    assert np.count_nonzero(np.abs(np.diff(seen.pose[:, 2])) > 1e-12) == 1
    assert abs(seen.counted_turn_rad) <= 2 * TICK_TURN_RAD


def test_a_contact_offset_adds_so_much_per_tick_in_motion() -> None:
    effects = ("contact_offset.left=0.0001", "contact_offset.right=0.0001")
    seen = run(*effects, v=0.5, drive="motor")
    assert seen.path_m - seen.counted_m == pytest.approx(1000 * 0.0001, abs=3 * TICK_M)
    turning = run("contact_offset.right=0.0001", v=0.5, drive="motor")
    assert turning.turn_rad == pytest.approx(1000 * 0.0001 / BASE_M, rel=0.01)
    assert run(*effects, drive="motor").path_m == 0.0


@pytest.mark.parametrize(
    ("effect", "spread_m"),
    [
        ("micro_slip.left=0.002", 0.002 * math.sqrt(5.0)),
        ("micro_slip.step_left=0.0002", 0.0002 * math.sqrt(1000)),
    ],
)
def test_micro_slip_spreads_as_a_random_walk(effect: str, spread_m: float) -> None:
    # 200 runs: the spread of a spread is 1/√(2·200) = 5 %; four of those.
    plant = apply_effects([parse_effect(effect)]).plant
    commands = np.full((1001, 2), (0.5, 0.0))
    runs = simulate(QUIET, plant, commands, list(range(200)), tick_period_us=TICK_US, drive="motor")
    assert np.std(runs.truth[:, -1, 2]) == pytest.approx(spread_m / BASE_M, rel=0.2)


def test_a_slip_that_wanders_lasts_for_two_seconds() -> None:
    """Of the integral of a Gauss-Markov series u from u(0) = 0 over a time t, the variance is
    2 σ² T (t - 2 T (1 - e^(-t/T)) + T/2 (1 - e^(-2 t/T))); the spread of a spread of 200 runs is
    5 %; four of those."""
    level, lasts_s, speed_m_s, until_s = 0.02, 2.0, 0.5, 10.0
    plant = apply_effects([parse_effect(f"micro_slip.wander_left={level}")]).plant
    commands = np.full((round(until_s / TICK_S) + 1, 2), (speed_m_s, 0.0))
    runs = simulate(QUIET, plant, commands, list(range(200)), tick_period_us=TICK_US, drive="motor")
    seconds = np.array([1.0, until_s])
    gone = 1 - np.exp(-seconds / lasts_s)
    late = 0.5 * lasts_s * (1 - np.exp(-2 * seconds / lasts_s))
    expected = level * speed_m_s * np.sqrt(2 * lasts_s * (seconds - 2 * lasts_s * gone + late))
    seen = np.std(runs.truth[:, np.rint(seconds / TICK_S).astype(int), 2], axis=0)
    assert seen == pytest.approx(expected / BASE_M, rel=0.2)


# --- actuation: another path, counted as it is ----------------------------------------------


def test_a_faster_left_motor_turns_right_and_is_counted() -> None:
    seen = run("drive_gain.left=0.02", v=0.5, drive="motor")
    assert seen.turn_rad == pytest.approx(-0.02 * 5.0 / BASE_M, rel=0.01)
    assert seen.counted_turn_rad == pytest.approx(seen.turn_rad, abs=2 * TICK_TURN_RAD)


def test_below_the_deadband_nothing_moves_and_above_it_everything() -> None:
    rate = 0.5 / RADIUS_M
    assert run(f"drive_deadband.rate={rate * 1.01}", v=0.5, drive="motor").path_m == 0.0
    seen = run(f"drive_deadband.rate={rate * 0.99}", v=0.5, drive="motor")
    assert seen.path_m == pytest.approx(5.0, rel=0.01)


def test_a_saturated_drive_reaches_its_limit_and_no_more() -> None:
    seen = run("drive_saturation.limit=5", v=0.5, drive="motor")
    assert np.diff(seen.pose[:, 0]).max() / TICK_S == pytest.approx(5 * RADIUS_M, rel=1e-6)


def test_a_limited_acceleration_is_a_straight_slope() -> None:
    seen = run("drive_acceleration_limit.limit=4", v=0.5, drive="motor")
    speed = np.diff(seen.pose[:, 0]) / TICK_S
    assert np.diff(speed)[5:200] / TICK_S == pytest.approx(4 * RADIUS_M, rel=1e-3)


@pytest.mark.parametrize("effect", ["drive_lag.time_constant=0.2", "drive_delay.delay=0.2"])
def test_lag_and_delay_cost_their_time_once(effect: str) -> None:
    behind_m = run(v=0.5, drive="motor").path_m - run(effect, v=0.5, drive="motor").path_m
    assert behind_m == pytest.approx(0.2 * 0.5, rel=0.06)


def test_a_delay_keeps_corners_sharp_and_a_lag_rounds_them() -> None:
    delayed = np.diff(run("drive_delay.delay=0.2", v=0.5, drive="motor").pose[:, 0]) / TICK_S
    assert np.count_nonzero((delayed > 0.01) & (delayed < 0.49)) <= 1
    lagging = np.diff(run("drive_lag.time_constant=0.2", v=0.5, drive="motor").pose[:, 0]) / TICK_S
    assert lagging[20] == pytest.approx(0.5 * (1 - math.exp(-1)), rel=0.05)
