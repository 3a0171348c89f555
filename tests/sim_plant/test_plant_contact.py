"""Wheel rotation to body motion: the lesson's laws and each mechanism's first order."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from quiet_robot import PERIOD_S, RADIUS_M, WHEELBASE_M, drive, held, quiet
from scipy.stats import chi2

from sim_plant import Mechanisms, simulate

TICKS = 501
STEPS = TICKS - 1
STRAIGHT = held(0.5, 0.0, TICKS)
SPIN = held(0.0, 1.0, TICKS)
ARC = held(0.5, 0.4, TICKS)
DISTANCE_M = 0.5 * STEPS * PERIOD_S

# A motor that obeys at once: the wheels turn by the described geometry, whatever the true one.
AT_ONCE = quiet(
    drive={
        "time_constant_s": 0.0,
        "max_wheel_rate_rad_s": 1e4,
        "max_wheel_acceleration_rad_s2": 1e6,
    }
)
# Its one acceleration step at the start, of 10 rad/s at 1e6 rad/s².
START_UP = 2e-5

scales = st.floats(-0.05, 0.05)


@given(scale=scales)
def test_radius_scale_stretches_every_distance_and_turn(scale: float) -> None:
    end = drive(ARC, Mechanisms(radius_scale=scale), description=AT_ONCE, ideal=False).truth[0, -1]
    plain = drive(ARC, description=AT_ONCE, ideal=False).truth[0, -1]
    assert end[2] == pytest.approx((1 + scale) * plain[2], rel=1e-12)
    straight = drive(
        STRAIGHT, Mechanisms(radius_scale=scale), description=AT_ONCE, ideal=False
    ).truth[0, -1]
    assert straight[0] == pytest.approx((1 + scale) * DISTANCE_M, rel=START_UP)
    assert straight[1] == straight[2] == 0.0


@given(mismatch=scales)
def test_radius_mismatch_turns_a_straight_into_an_arc(mismatch: float) -> None:
    end = drive(
        STRAIGHT, Mechanisms(radius_mismatch=mismatch), description=AT_ONCE, ideal=False
    ).truth[0, -1]
    # law 5: Δθ = r(ε_R − ε_L)Δφ/b
    turn = RADIUS_M * mismatch * (DISTANCE_M / RADIUS_M) / WHEELBASE_M
    assert end[2] == pytest.approx(turn, rel=START_UP, abs=1e-13)


@given(scale=scales)
def test_wheelbase_scale_divides_every_turn_and_leaves_straights(scale: float) -> None:
    wide = Mechanisms(wheelbase_scale=scale)
    end = drive(SPIN, wide, description=AT_ONCE, ideal=False).truth[0, -1]
    plain = drive(SPIN, description=AT_ONCE, ideal=False).truth[0, -1]
    assert end[2] == pytest.approx(plain[2] / (1 + scale), rel=1e-12)
    straight = drive(STRAIGHT, wide, description=AT_ONCE, ideal=False).truth
    assert np.array_equal(straight, drive(STRAIGHT, description=AT_ONCE, ideal=False).truth)


@given(left=scales, right=scales)
def test_payload_compresses_each_radius(left: float, right: float) -> None:
    loaded = Mechanisms(payload_left=abs(left), payload_right=abs(right))
    end = drive(STRAIGHT, loaded, description=AT_ONCE, ideal=False).truth[0, -1]
    turn = (abs(left) - abs(right)) * DISTANCE_M / WHEELBASE_M
    assert end[2] == pytest.approx(turn, rel=START_UP, abs=1e-13)


def test_tyre_drift_grows_the_radii_with_time() -> None:
    grown = Mechanisms(tyre_drift_per_s=1e-3)
    end = drive(STRAIGHT, grown, description=AT_ONCE, ideal=False).truth[0, -1]
    seconds = STEPS * PERIOD_S
    assert end[0] == pytest.approx(DISTANCE_M * (1 + 1e-3 * seconds / 2), rel=START_UP)


@pytest.mark.parametrize("ideal", [True, False])
def test_a_tyre_never_wears_down_to_nothing(ideal: bool) -> None:
    hours = held(0.5, 0.0, 2000)
    worn = simulate(
        quiet(),
        Mechanisms(tyre_drift_per_s=-1e-3),
        hours,
        [1],
        tick_period_us=1_000_000,
        drive="ideal" if ideal else "motor",
    ).truth[0, :, 0]
    last_step = 0.5 if ideal else 0.05
    assert worn[-1] - worn[-2] == pytest.approx(last_step, rel=1e-9)


def test_an_ideal_drive_makes_up_for_any_geometry() -> None:
    odd = Mechanisms(
        radius_scale=0.03, radius_mismatch=-0.02, wheelbase_scale=0.1, payload_left=0.1
    )
    assert drive(ARC, odd).truth == pytest.approx(drive(ARC).truth, abs=1e-12)


@given(left=scales, right=scales)
def test_slip_ratios_shorten_the_ground_steps_inside_their_window(
    left: float, right: float
) -> None:
    slipping = Mechanisms(
        slip_ratio_left=left, slip_ratio_right=right, slip_start_s=1.0, slip_stop_s=3.0
    )
    truth = drive(STRAIGHT, slipping).truth[0]
    turn = (left - right) * 0.5 * 2.0 / WHEELBASE_M
    assert truth[100, 2] == 0.0
    assert truth[300, 2] == pytest.approx(turn, abs=1e-12)
    assert truth[-1, 2] == truth[300, 2]


@pytest.mark.parametrize("v_m_s", [0.5, -0.5, 0.01])
def test_a_contact_offset_adds_to_each_step_in_which_the_wheel_turns(v_m_s: float) -> None:
    w_m = 3e-6
    commands = np.vstack([held(v_m_s, 0.0, 200), held(0.0, 0.0, 100)])
    offset = Mechanisms(contact_offset_left_m=w_m, contact_offset_right_m=w_m)
    # law 7, Δs_eff = Δs + w: in proportion to the steps, not to the distance
    end = drive(commands, offset).truth[0, -1]
    assert end[0] == pytest.approx(200 * (v_m_s * PERIOD_S + w_m), abs=1e-12)
    one_sided = drive(commands, Mechanisms(contact_offset_right_m=w_m)).truth[0, -1]
    assert one_sided[2] == pytest.approx(200 * w_m / WHEELBASE_M, abs=1e-12)


def _variance_interval(size: str) -> tuple[int, float, float]:
    runs = 4000 if size == "full" else 400
    # a variance from `runs` Gaussian ends is chi-square; both tails together one in 10 000
    low, high = chi2.ppf([5e-5, 1 - 5e-5], runs) / runs
    return runs, float(low), float(high)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("mechanism", "level", "variance_m2"),
    [
        ("micro_slip_step_{}_m", 1e-4, 1e-8 * STEPS),  # law 9: k·var
        ("micro_slip_{}_m_per_sqrt_m", 1e-3, 1e-6 * DISTANCE_M),
    ],
)
def test_micro_slip_is_a_random_walk_over_steps_or_over_distance(
    mechanism: str, level: float, variance_m2: float, side: str, size: str
) -> None:
    count, low, high = _variance_interval(size)
    on: dict[str, Any] = {mechanism.format(side): level}
    noisy = Mechanisms(**on)
    heading = drive(STRAIGHT, noisy, seeds=range(count), outputs="odometry").truth[:, -1, 2]
    ratio = (heading @ heading) / count / (variance_m2 / WHEELBASE_M**2)
    assert low < ratio < high


def test_micro_slip_over_distance_does_not_depend_on_how_fast_it_is_driven(size: str) -> None:
    count, low, high = _variance_interval(size)
    noisy = quiet(contact={"noise_m_per_sqrt_m": 1e-3})
    slow = drive(held(0.25, 0.0, 2 * STEPS + 1), description=noisy, seeds=range(count))
    heading = slow.truth[:, -1, 2]
    # both wheels slip on their own: twice one wheel's variance
    ratio = (heading @ heading) / count / (2e-6 * DISTANCE_M / WHEELBASE_M**2)
    assert low < ratio < high


def test_a_robot_at_rest_stays_where_it_is() -> None:
    restless = Mechanisms(
        contact_offset_left_m=1e-3,
        micro_slip_step_left_m=1e-3,
        micro_slip_right_m_per_sqrt_m=0.1,
        turn_scrub=0.5,
        longitudinal_slip_s2_per_m=0.1,
        grade_slip_ratio=0.5,
        cross_slope_ratio=0.5,
    )
    assert not drive(held(0.0, 0.0, 50), restless).truth.any()


@pytest.mark.parametrize("scrub", [0.02, 0.5])
def test_turn_scrub_is_full_in_a_spin_partial_on_an_arc_and_absent_on_a_straight(
    scrub: float,
) -> None:
    scrubbing = Mechanisms(turn_scrub=scrub)
    seconds = STEPS * PERIOD_S
    spin = drive(SPIN, scrubbing).truth[0, -1, 2]
    assert spin == pytest.approx(1.0 * seconds / (1 + scrub), rel=1e-12)
    arc = drive(ARC, scrubbing).truth[0, -1, 2]
    share = 0.4 * WHEELBASE_M / (0.4 * WHEELBASE_M + 2 * 0.5)
    assert arc == pytest.approx(0.4 * seconds / (1 + scrub * share), rel=1e-12)
    assert np.array_equal(drive(STRAIGHT, scrubbing).truth, drive(STRAIGHT).truth)


def test_the_size_of_micro_slip_is_no_speed_where_a_robot_scrubs_on_the_spot() -> None:
    """Taken for speed it would loosen the scrub, and the more so the shorter a tick is."""
    scrub, noise_m_per_sqrt_m = -0.5, 1e-3
    slipping = quiet(contact={"noise_m_per_sqrt_m": noise_m_per_sqrt_m})
    turned = drive(SPIN, Mechanisms(turn_scrub=scrub), description=slipping).truth[0, -1, 2]
    seconds = STEPS * PERIOD_S
    # law 7: each wheel's way is a random walk over distance.
    path_m = 0.5 * WHEELBASE_M * seconds
    sd_rad = noise_m_per_sqrt_m * math.sqrt(2.0 * path_m) / (WHEELBASE_M * (1 + scrub))
    assert turned == pytest.approx(seconds / (1 + scrub), abs=3 * sd_rad)


@pytest.mark.parametrize("direction", [1, -1])
def test_longitudinal_slip_loses_ground_speeding_up_and_wins_it_braking(direction: int) -> None:
    compliance = 0.01
    steps = [held(direction * v, 0.0, 1) for v in [0.1, 0.2, 0.3, 0.4, 0.4, 0.3, 0.2, 0.1, 0.0]]
    commands = np.vstack(steps)
    slipping = drive(commands, Mechanisms(longitudinal_slip_s2_per_m=compliance)).truth[0, :, 0]
    # ground step = wheel step·(1 − c·a·sign v), a = 10 m/s² up, −10 m/s² down
    gains = np.array([0, -1, -1, -1, 0, 1, 1, 1]) * compliance * 10
    exact = np.cumsum(commands[:8, 0] * PERIOD_S * (1 + gains))
    assert slipping[1:] == pytest.approx(exact, abs=1e-15)


def test_lateral_slip_goes_outward_in_proportion_to_v_and_omega() -> None:
    compliance = 0.03
    sliding = drive(ARC, Mechanisms(lateral_slip_s=compliance)).truth[0]
    rolling = drive(ARC).truth[0]
    # the body moves at angle −c·ω to its heading on a circle larger by √(1 + c²ω²)
    factor = math.hypot(1.0, compliance * 0.4)
    assert np.hypot(*sliding[-1, :2]) == pytest.approx(factor * np.hypot(*rolling[-1, :2]))
    turned = math.atan2(sliding[-1, 1], sliding[-1, 0]) - math.atan2(rolling[-1, 1], rolling[-1, 0])
    assert turned == pytest.approx(-math.atan(compliance * 0.4), abs=1e-12)
    assert np.array_equal(sliding[:, 2], rolling[:, 2])


def test_a_lateral_slip_at_a_speed_grows_with_the_speed() -> None:
    speed_m_s = float(ARC[0, 0])
    as_at = {
        share: drive(
            ARC, Mechanisms(lateral_slip_s=0.03, lateral_slip_speed_m_s=speed_m_s / share)
        ).truth[0]
        for share in (0.5, 1.0, 2.0)
    }
    for share, seen in as_at.items():
        alike = drive(ARC, Mechanisms(lateral_slip_s=0.03 * share)).truth[0]
        assert seen == pytest.approx(alike, abs=1e-12)


@pytest.mark.parametrize("heading_rad", [0.0, 0.9])
def test_cross_slope_drifts_sideways_by_the_sine_of_downhill_against_heading(
    heading_rad: float,
) -> None:
    ratio, direction = 0.04, -1.2
    turn = held(0.0, heading_rad / 0.1, 10)
    commands = np.vstack([turn, held(-0.5, 0.0, 101)])
    sloping = Mechanisms(cross_slope_ratio=ratio, cross_slope_direction_rad=direction)
    end = drive(commands, sloping).truth[0, -1]
    lateral = -end[0] * math.sin(heading_rad) + end[1] * math.cos(heading_rad)
    assert lateral == pytest.approx(ratio * 0.5 * math.sin(direction - heading_rad), abs=1e-12)


@pytest.mark.parametrize("v_m_s", [0.5, -0.5])
def test_grade_slip_runs_ahead_downhill(v_m_s: float) -> None:
    ratio, direction = 0.04, 0.6
    sloping = Mechanisms(grade_slip_ratio=ratio, grade_slip_direction_rad=direction)
    end = drive(held(v_m_s, 0.0, 101), sloping).truth[0, -1]
    sign = math.copysign(1.0, v_m_s)
    assert end[0] == pytest.approx(v_m_s * (1 + ratio * sign * math.cos(direction)), abs=1e-12)


def test_toe_rolls_to_the_left_of_the_body() -> None:
    end = drive(STRAIGHT, Mechanisms(wheel_toe_rad=0.02)).truth[0, -1]
    assert end[1] == pytest.approx(DISTANCE_M * math.tan(0.02), rel=1e-12)
    assert end[0] == pytest.approx(DISTANCE_M, rel=1e-12)


def test_an_eccentric_wheel_wobbles_once_a_turn_and_keeps_its_mean() -> None:
    amplitude, phase = 0.02, 0.7
    runs = drive(
        STRAIGHT,
        Mechanisms(wheel_eccentricity_left=amplitude, wheel_eccentricity_phase_left_rad=phase),
    )
    angle = 0.5 * np.arange(TICKS) * PERIOD_S / RADIUS_M
    # ∫ r·A·cos(φ + phase) dφ = r·A·(sin(φ + phase) − sin(phase))
    extra_m = RADIUS_M * amplitude * (np.sin(angle + phase) - math.sin(phase))
    assert runs.truth[0, :, 2] == pytest.approx(-extra_m / WHEELBASE_M, abs=1e-12)


@pytest.mark.parametrize("time_s", [1.0, 0.995])
def test_a_bump_moves_the_pose_once_and_no_encoder(time_s: float) -> None:
    bumped = Mechanisms(floor_bump_s=time_s, floor_bump_yaw_rad=0.1, floor_bump_forward_m=0.02)
    after, before = drive(STRAIGHT, bumped), drive(STRAIGHT)
    heading = after.truth[0, :, 2]
    assert np.array_equal(heading[:100], np.zeros(100))
    assert heading[100:] == pytest.approx(np.full(TICKS - 100, 0.1), abs=1e-15)
    middle = math.cos(0.05)
    assert after.truth[0, 100, 0] == pytest.approx(0.495 + (0.005 + 0.02) * middle, abs=1e-12)
    assert np.array_equal(after.left_count, before.left_count)
    assert np.array_equal(after.right_count, before.right_count)
