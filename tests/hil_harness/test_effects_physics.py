"""Each effect does to the robot what its name, unit and sign say; measured on the plant's counts.

The described robot of these tests has no noise, so a law shows to within its quantisation: one
tick of a wheel, one code of the gyro.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hil_harness.effects import apply_effects, catalogue, parse_effect
from hil_harness.scenarios import Segment, SegmentProfile
from sim_plant import DriveModel, Mechanisms, PlantDescription, PlantRuns, simulate

FloatArray = NDArray[np.float64]
TICK_US = 10_000
TICK_S = 0.01

QUIET = PlantDescription.from_tables(
    {
        "encoder": {"noise_ticks": 0.0},
        "gyro": {"noise_density_rad_per_sqrt_s": 0.0},
        "accelerometer": {"noise_density_m_s2_per_sqrt_hz": 0.0},
        "drive": {"time_constant_s": 0.0, "max_wheel_acceleration_rad_s2": 1e6},
    }
)
RADIUS_M = QUIET.wheels.radius_m
BASE_M = QUIET.wheels.wheelbase_m
TICK_M = 2 * math.pi * RADIUS_M / QUIET.encoder.ticks_per_rev
TICK_TURN_RAD = TICK_M / BASE_M
TILT = math.cos(0.1) * math.cos(0.2)
CODE_RAD_S = 1 / QUIET.gyro.sensitivity_lsb_per_rad_s


@dataclass(frozen=True)
class Drive:
    """One run and what can be read from it."""

    runs: PlantRuns

    @property
    def pose(self) -> FloatArray:
        pose: FloatArray = self.runs.truth[0]
        return pose

    @property
    def path_m(self) -> float:
        return float(np.hypot(*np.diff(self.pose[:, :2], axis=0).T).sum())

    @property
    def turn_rad(self) -> float:
        return float(self.pose[-1, 2])

    @property
    def counted_m(self) -> float:
        return (self.ticks("left") + self.ticks("right")) / 2 * TICK_M

    @property
    def counted_turn_rad(self) -> float:
        return (self.ticks("right") - self.ticks("left")) * TICK_TURN_RAD

    @property
    def codes(self) -> FloatArray:
        """Gyro codes from the described zero, tick by tick."""
        codes: FloatArray = self.runs.gyro_code[0].astype(float) - QUIET.gyro.zero_rate_code
        return codes

    @property
    def gyro_turn_rad(self) -> float:
        return float(self.codes[1:].sum() * CODE_RAD_S * TICK_S)

    def ticks(self, side: str) -> int:
        return int(self.tick_steps(side).sum())

    def tick_steps(self, side: str) -> NDArray[np.int64]:
        counts = self.runs.left_count if side == "left" else self.runs.right_count
        steps = np.diff(counts[0].astype(np.int64))
        unwrapped: NDArray[np.int64] = (steps + 32768) % 65536 - 32768
        return unwrapped


def run(
    *effects: str,
    v: float = 0.0,
    w: float = 0.0,
    seconds: float = 10.0,
    drive: DriveModel = "ideal",
    robot: PlantDescription = QUIET,
    commands: FloatArray | None = None,
    seed: int = 1,
) -> Drive:
    if commands is None:
        commands = np.full((round(seconds / TICK_S) + 1, 2), (v, w))
    plant = apply_effects(parse_effect(text) for text in effects).plant
    runs = simulate(robot, plant, commands, [seed], tick_period_us=TICK_US, drive=drive)
    return Drive(runs)


def rich_commands() -> FloatArray:
    """Speed up, straight, arcs both ways, spin, reverse, rest: something for every effect."""
    profile = SegmentProfile(
        [
            Segment(0.0, 0.0, 1.0),
            Segment(0.6, 0.0, 3.0),
            Segment(0.5, 0.8, 3.0),
            Segment(0.5, -0.8, 2.0),
            Segment(0.0, 2.0, 2.0),
            Segment(-0.3, 0.2, 3.0),
            Segment(0.0, 0.0, 1.0),
        ]
    )
    return profile.rates(np.arange(0, 15.0, TICK_S))


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


# --- encoder ---------------------------------------------------------------------------------


def test_a_dead_encoder_freezes_its_count_for_good() -> None:
    seen = run("encoder_dead.side=right", "encoder_dead.start_s=4", v=0.5)
    assert seen.tick_steps("right")[401:].sum() == 0
    assert seen.tick_steps("right")[:399].sum() > 0
    assert seen.ticks("left") * TICK_M == pytest.approx(5.0, abs=2 * TICK_M)


# --- gyro and converter ----------------------------------------------------------------------


def mean_rate(
    *effects: str, w: float = 0.5, v: float = 0.0, robot: PlantDescription = QUIET
) -> float:
    """Return the mean rate by the described sensitivity, after the first second."""
    return float(run(*effects, v=v, w=w, robot=robot).codes[100:].mean() * CODE_RAD_S)


@pytest.mark.parametrize("w", [0.5, -0.5, 0.0])
@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        (["gyro_bias.bias=0.01"], lambda w: w + 0.01),
        (["gyro_scale.scale=0.02"], lambda w: w * 1.02),
        (["gyro_nonlinearity.quadratic=0.1"], lambda w: w + 0.1 * w * abs(w)),
        (["gyro_nonlinearity.cubic=0.1"], lambda w: w + 0.1 * w**3),
        (["gyro_asymmetry.asymmetry=0.02"], lambda w: w + 0.01 * abs(w)),
        (["gyro_tilt.roll=0.1"], lambda w: w * math.cos(0.1)),
        (["gyro_tilt.pitch=0.2", "gyro_tilt.roll=0.1"], lambda w: w * TILT),
        (["gyro_saturation.limit=0.3"], lambda w: max(min(w, 0.3), -0.3)),
        (["gyro_temperature_bias.slope=0.001", "warm_up.offset=10"], lambda w: w + 0.01),
        (["gyro_temperature_scale.slope=0.001", "warm_up.offset=10"], lambda w: w * 1.01),
        (["supply_ratio.coefficient=0.5", "supply_change.offset=1.2"], lambda w: w * 1.05),
        (["gyro_lag.time_constant=0.05"], lambda w: w),
        (["adc_offset.offset=100"], lambda w: w + 100 * CODE_RAD_S),
        (["adc_gain.gain=0.02"], lambda w: w * 1.02),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)  # fmt: skip
def test_a_steady_turn_is_measured_as_the_effect_says(
    effects: list[str], expected: Callable[[float], float], w: float
) -> None:
    assert mean_rate(*effects, w=w) == pytest.approx(expected(w), abs=0.6 * CODE_RAD_S)


def test_integral_nonlinearity_follows_the_code() -> None:
    peak = 40.0
    for w in (-1.0, 0.0, 1.0):
        code = QUIET.gyro.zero_rate_code + w / CODE_RAD_S
        expected = w + peak * math.sin(math.pi * code / 65535) * CODE_RAD_S
        assert mean_rate(f"adc_inl.peak={peak}", w=w) == pytest.approx(expected, abs=CODE_RAD_S)


def test_a_bend_to_the_left_pushes_left_and_speeding_up_pushes_forward() -> None:
    # a_y = v·ω: the body is accelerated towards the centre of its bend.
    bend = mean_rate("gyro_g_sensitivity.y=0.01", v=0.5, w=0.4)
    assert bend == pytest.approx(0.4 + 0.01 * 0.5 * 0.4, abs=CODE_RAD_S)
    up = np.column_stack([np.arange(201) * TICK_S * 0.5, np.zeros(201)])
    codes = run("gyro_g_sensitivity.x=0.01", commands=up).codes
    assert codes[5:200].mean() * CODE_RAD_S == pytest.approx(0.01 * 0.5, abs=CODE_RAD_S)


def test_vibration_is_a_bias_that_grows_with_the_wheels_and_is_gone_at_rest() -> None:
    wheel_rate = 0.5 / RADIUS_M
    driven = mean_rate("gyro_vibration.coefficient=0.0001", v=0.5, w=0.0)
    assert driven == pytest.approx(0.0001 * wheel_rate**2, rel=0.02)
    assert mean_rate("gyro_vibration.coefficient=0.0001", w=0.0) == 0.0


def test_a_lagging_gyro_trails_a_turn_that_begins() -> None:
    codes = run("gyro_lag.time_constant=0.1", w=0.5).codes * CODE_RAD_S
    assert codes[10] == pytest.approx(0.5 * (1 - math.exp(-1)), rel=0.06)
    lost = 0.5 * 10.0 - codes[1:].sum() * TICK_S
    assert lost == pytest.approx(0.5 * 0.1, rel=0.06)


def test_a_frozen_gyro_repeats_its_code_inside_the_window() -> None:
    wobble = np.column_stack([np.zeros(1001), np.sin(np.arange(1001) * 0.05)])
    codes = run("gyro_frozen.start_s=3", "gyro_frozen.stop_s=5", commands=wobble).codes
    assert np.ptp(codes[301:500]) == 0
    assert np.ptp(codes[101:300]) > 0
    assert np.ptp(codes[502:700]) > 0


def test_a_stuck_bit_is_the_same_in_every_code() -> None:
    wobble = np.column_stack([np.zeros(1001), np.sin(np.arange(1001) * 0.05)])
    for value in (0, 1):
        effects = ("adc_stuck_bit.bit=4", f"adc_stuck_bit.value={value}")
        seen = run(*effects, commands=wobble).runs.gyro_code[0]
        assert set((seen >> 4 & 1).tolist()) == {value}


def test_a_missing_code_never_appears_and_its_upper_neighbour_stands_for_it() -> None:
    zero = QUIET.gyro.zero_rate_code
    seen = run(f"adc_missing_code.code={zero}").runs.gyro_code[0]
    assert set(seen.tolist()) == {zero + 1}


def test_noise_levels_are_densities() -> None:
    # 10 000 samples: the spread of a spread is 0.7 %; five of those.
    still = run("gyro_noise.density=0.0005", seconds=100.0)
    assert np.std(still.codes[1:]) * CODE_RAD_S == pytest.approx(0.0005 * 10, rel=0.035)
    moving = run("accelerometer_noise.density=0.01", seconds=100.0).runs.accel_x_code
    assert moving is not None
    sensitivity = QUIET.accelerometer.sensitivity_lsb_per_m_s2
    assert np.std(moving[0, 1:]) / sensitivity == pytest.approx(0.01 * 10, rel=0.035)


def test_a_walking_bias_spreads_as_the_root_of_time() -> None:
    # 200 runs: the spread of a spread is 5 %; four of those.
    plant = apply_effects([parse_effect("gyro_bias_walk.density=0.001")]).plant
    runs = simulate(
        QUIET, plant, np.zeros((2501, 2)), list(range(200)), tick_period_us=TICK_US, drive="ideal"
    )
    spread = np.std(runs.gyro_code[:, -1]) * CODE_RAD_S
    assert spread == pytest.approx(0.001 * math.sqrt(25.0), rel=0.2)


def test_a_biased_accelerometer_reads_high() -> None:
    seen = run("accelerometer_bias.x=0.2", "accelerometer_bias.y=-0.1").runs
    accelerometer = QUIET.accelerometer
    for codes, bias in ((seen.accel_x_code, 0.2), (seen.accel_y_code, -0.1)):
        assert codes is not None
        measured = (codes[0, 5:] - accelerometer.zero_code) / accelerometer.sensitivity_lsb_per_m_s2
        assert measured == pytest.approx(bias, abs=1 / accelerometer.sensitivity_lsb_per_m_s2)


def test_warming_up_and_a_sinking_battery_show_in_their_own_signals() -> None:
    effects = ("warm_up.rise=20", "warm_up.time_constant=5", "supply_change.rate=-0.05")
    seen = run(*effects).runs
    assert seen.temperature_code is not None
    assert seen.supply_code is not None
    warmer_k = (seen.temperature_code[0, -1] - 32768) / QUIET.temperature.sensitivity_lsb_per_k
    assert warmer_k == pytest.approx(20 * (1 - math.exp(-2)), abs=0.01)
    sunk_v = seen.supply_code[0, -1] / QUIET.supply.sensitivity_lsb_per_v - 12.0
    assert sunk_v == pytest.approx(-0.5, abs=0.001)


# --- all of them ------------------------------------------------------------------------------

SIZES = {
    "drive_gain": "left=0.02",
    "drive_deadband": "rate=3",
    "drive_saturation": "limit=8",
    "drive_acceleration_limit": "limit=4",
    "drive_lag": "time_constant=0.2",
    "drive_delay": "delay=0.1",
    "radius_scale": "scale=0.01",
    "radius_mismatch": "mismatch=0.005",
    "wheelbase_scale": "scale=0.01",
    "turn_scrub": "scrub=0.1",
    "payload": "compression_left=0.005",
    "tyre_drift": "rate=0.0005",
    "wheel_eccentricity": "amplitude=0.02",
    "wheel_toe": "angle=0.01",
    "one_sided_slip": "ratio=0.05",
    "longitudinal_slip": "compliance=0.05",
    "lateral_slip": "compliance=0.02",
    "cross_slope_drift": "ratio=0.01",
    "grade_slip": "ratio=0.01",
    "floor_bump": "time=5 yaw=0.02",
    "contact_offset": "left=0.0001",
    "micro_slip": "left=0.001",
    "ticks_per_rev": "scale=0.01",
    "encoder_eccentricity": "amplitude=0.02",
    "encoder_dead": "start_s=5",
    "gyro_bias": "bias=0.01",
    "gyro_bias_walk": "density=0.001",
    "gyro_noise": "density=0.001",
    "gyro_scale": "scale=0.01",
    "gyro_nonlinearity": "cubic=0.01",
    "gyro_asymmetry": "asymmetry=0.01",
    "gyro_g_sensitivity": "y=0.01",
    "gyro_tilt": "roll=0.1",
    "gyro_temperature_bias": "slope=0.001",
    "gyro_temperature_scale": "slope=0.001",
    "gyro_saturation": "limit=1",
    "gyro_lag": "time_constant=0.02",
    "gyro_vibration": "coefficient=0.0001",
    "gyro_frozen": "start_s=4 stop_s=6",
    "adc_offset": "offset=50",
    "adc_gain": "gain=0.01",
    "adc_inl": "peak=40",
    "adc_missing_code": "code=32768",
    "adc_stuck_bit": "bit=5 value=1",
    "supply_ratio": "coefficient=1",
    "accelerometer_bias": "x=0.1",
    "accelerometer_noise": "density=0.01",
    "warm_up": "offset=5",
    "supply_change": "offset=-1",
}  # fmt: skip


def settings_of(name: str) -> list[str]:
    return [f"{name}.{part}" for part in SIZES[name].split()]


def outputs(seen: Drive) -> list[NDArray[Any]]:
    runs = seen.runs
    columns: list[NDArray[Any] | None] = [
        runs.truth,
        runs.left_count,
        runs.right_count,
        runs.gyro_code,
        runs.accel_x_code,
        runs.accel_y_code,
        runs.temperature_code,
        runs.supply_code,
    ]
    return [column for column in columns if column is not None]


def same(one: Drive, other: Drive) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(outputs(one), outputs(other), strict=True))


@pytest.mark.parametrize("name", list(catalogue()))
def test_every_effect_shows_in_the_data(name: str) -> None:
    # What follows temperature or supply shows where these are not as described.
    surroundings = ["warm_up.rise=10", "supply_change.rate=-0.01"]
    others = [text for text in surroundings if not text.startswith(name)]
    commands = rich_commands()
    without = run(*others, commands=commands, drive="motor")
    assert not same(without, run(*others, *settings_of(name), commands=commands, drive="motor"))


def test_at_neutral_all_effects_together_change_nothing_bit_for_bit() -> None:
    neutral = [
        f"{effect.name}.{parameter.name}={parameter.neutral}"
        for effect in catalogue().values()
        for parameter in effect.parameters
    ]
    assert apply_effects(parse_effect(text) for text in neutral).plant == Mechanisms()
    commands, robot = rich_commands(), PlantDescription()
    untouched = run(commands=commands, drive="motor", robot=robot)
    assert same(untouched, run(*neutral, commands=commands, drive="motor", robot=robot))


@hypothesis_settings(max_examples=30)
@given(st.sets(st.sampled_from(sorted(SIZES)), min_size=2), st.integers(0, 2**64 - 1))
def test_any_effects_run_together(names: set[str], seed: int) -> None:
    texts = [text for name in sorted(names) for text in settings_of(name)]
    seen = run(*texts, commands=rich_commands()[::3], drive="motor", seed=seed)
    assert np.all(np.isfinite(seen.pose))
