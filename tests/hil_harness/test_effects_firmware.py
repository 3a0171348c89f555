"""Effects of stage firmware change the ECU's program as their names, units and signs say."""

import math

import numpy as np
import pytest
from array_runs import TICK_S, drive_once, robot, wire

from firmware_model import FirmwareChanges
from hil_harness.effect_runs import EffectRun
from hil_harness.firmware_program import FirmwareProgram
from hil_harness.robot import load_robot

WHEELS = robot(mode="wheel")


def path_m(seen: EffectRun) -> float:
    return float(np.hypot(*np.diff(seen.pose[:, :2], axis=0).T).sum())


def turn_rad(seen: EffectRun) -> float:
    return float(np.abs(np.diff(seen.pose[:, 2])).sum())


@pytest.mark.parametrize(
    ("constant", "path", "turn"),
    [
        ("wheel_radius", 1.02, 1.02),
        ("wheelbase", 1.0, 1 / 1.02),
        ("ticks_per_rev", 1 / 1.02, 1 / 1.02),
    ],
)
def test_a_constant_of_the_wheels_is_used_too_large(
    constant: str, path: float, turn: float
) -> None:
    effects = (f"firmware_constant.constant={constant}", "firmware_constant.scale=0.02")
    drives = [("straight", path_m, path), ("spin", turn_rad, turn)]
    for scenario, measure, expected in drives:
        plain, wrong = (drive_once(*e, scenario=scenario, of=WHEELS) for e in ((), effects))
        assert measure(wrong) / measure(plain) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("effects", "turn"),
    [
        (("firmware_constant.constant=gyro_sensitivity", "firmware_constant.scale=0.02"), 1 / 1.02),
        (("firmware_constant.constant=tick_period", "firmware_constant.scale=0.02"), 1.02),
        (("fixed_tick_period.scale=0.02",), 1.02),
    ],
)
def test_a_constant_of_the_gyro_scales_the_turn(effects: tuple[str, ...], turn: float) -> None:
    plain, wrong = (drive_once(*e, scenario="spin") for e in ((), effects))
    assert wrong.pose[-1, 2] / plain.pose[-1, 2] == pytest.approx(turn, rel=1e-6)


def test_euler_before_is_a_heading_one_tick_old_where_midpoint_is_described() -> None:
    midpoint = robot(integration="midpoint")
    by_rule = drive_once("euler_integration.heading=before", scenario="random", of=midpoint)
    by_age = drive_once("stale_heading.cycles=1", scenario="random", of=midpoint)
    np.testing.assert_array_equal(by_rule.pose, by_age.pose)


def test_a_stale_heading_rotates_the_path_by_the_turn_since() -> None:
    rate_rad_s, step_m = 0.5, 0.004
    program = FirmwareProgram(
        WHEELS,
        wire().signal_map,
        10_000,
        schedule=((-math.inf, FirmwareChanges(stale_heading_cycles=4)),),
    )
    described = FirmwareProgram(WHEELS, wire().signal_map, 10_000)
    half = rate_rad_s * TICK_S * 0.2985 / 2
    per_m = 2048 / (2 * math.pi * 0.05025)
    headings = []
    for tick in range(400):
        left, right = ((tick * (step_m + side * half)) * per_m for side in (-1, 1))
        for one in (described, program):
            one.step(round(left) & 0xFFFF, round(right) & 0xFFFF, 0, 32768, 0)
        headings.append([one.pose_q for one in (described, program)])
    (x0, y0, _), (x1, y1, _) = headings[-2]
    (x2, y2, _), (x3, y3, _) = headings[-1]
    before = math.atan2(y2 - y0, x2 - x0)
    stale = math.atan2(y3 - y1, x3 - x1)
    # one tick old is described, four are used; one count is a third of a milliradian
    assert before - stale == pytest.approx(3 * rate_rad_s * TICK_S, abs=1.5e-3)


def test_slow_turns_are_zeroed_and_fast_ones_are_whole() -> None:
    slow, fast = 0.5, 1.0  # the spin scenario turns at 0.75 and at 1.5 rad/s
    whole = drive_once(f"auto_zero.threshold={slow}", scenario="spin", ticks=2500)
    zeroed = drive_once(f"auto_zero.threshold={fast}", scenario="spin", ticks=2500)
    assert whole.pose[2400, 2] == pytest.approx(whole.truth[2400, 2], rel=0.02)
    assert abs(zeroed.pose[2400, 2]) < 0.01 * whole.truth[2400, 2]


def test_an_offset_averaged_in_motion_drifts_by_the_mean_turn_rate() -> None:
    seen = drive_once(
        "moving_calibration.start_s=5", "moving_calibration.stop_s=10", scenario="spin", ticks=4000
    )
    inside = (seen.time_s >= 5) & (seen.time_s < 10)
    code = seen.gyro_code[inside].mean() - 32768
    drift_rad_s = -code / load_robot().plant.gyro.sensitivity_lsb_per_rad_s
    error = seen.pose[:, 2] - seen.truth[:, 2]
    moving = slice(1100, 2600)  # the heading is held at rest
    rate = np.polyfit(seen.time_s[moving], error[moving], 1)[0]
    assert rate == pytest.approx(drift_rad_s, rel=0.01)


def test_a_coarser_position_moves_in_coarser_steps() -> None:
    seen = drive_once("firmware_resolution.variable=position", "firmware_resolution.bits=22")
    steps = seen.pose[:, :2] * 2**10
    np.testing.assert_array_equal(steps, np.rint(steps))


def test_a_word_too_short_wraps_by_its_modulus_or_stays_at_its_end() -> None:
    # 32 fraction bits: a word of 33 bits ends at half a metre
    texts = ("firmware_overflow.variable=position", "firmware_overflow.bits=32")
    plain = drive_once(scenario="straight")
    wrapped = drive_once(*texts, scenario="straight")
    held = drive_once(*texts, "firmware_overflow.mode=saturate", scenario="straight")
    apart = plain.pose[:, 0] - wrapped.pose[:, 0]
    np.testing.assert_array_equal(apart, np.rint(apart))
    assert apart.max() >= 1.0
    assert held.pose[:, 0].max() < 0.5 < plain.pose[:, 0].max()


def test_a_coarse_table_errs_by_at_most_half_its_step_in_direction() -> None:
    entries = 8
    seen = drive_once(
        f"coarse_trig_table.entries={entries}",
        "coarse_trig_table.interpolated=0",
        scenario="random",
        ticks=3000,
    )
    plain = drive_once(scenario="random", ticks=3000)
    step = np.hypot(*np.diff(plain.pose[:, :2], axis=0).T)
    apart = np.hypot(*np.diff(seen.pose[:, :2] - plain.pose[:, :2], axis=0).T)
    largest = math.pi / 2 / entries / 2
    assert np.all(apart <= 1.01 * math.sqrt(2) * largest * step + 1e-8)
    assert apart.max() > 0.5 * largest * step[np.argmax(apart)]


def test_a_blend_leans_by_the_weight() -> None:
    blend = robot(mode="blend", blend_weight=0.5)
    effects = ("gyro_bias.bias=0.05", "gyro_bias.start_s=3")
    half, none = (
        drive_once(*effects, *e, scenario="straight", of=blend)
        for e in ((), ("blend_weight.weight=-0.5",))
    )
    drift = 0.05 * (half.time_s[-1] - 3)
    assert half.pose[-1, 2] == pytest.approx(0.5 * drift, rel=0.05)
    assert abs(none.pose[-1, 2]) < 0.02 * drift


def test_missed_ticks_of_the_ecu_lose_gyro_turns_and_no_distance() -> None:
    ticks, share = 6000, 0.05
    plain = drive_once(scenario="random", ticks=ticks)
    seen = drive_once(f"missed_deadline.probability={share}", scenario="random", ticks=ticks)
    missed = np.sum(~seen.executed)
    assert missed == pytest.approx(share * ticks, abs=5 * math.sqrt(share * ticks))
    assert path_m(seen) == pytest.approx(path_m(plain), rel=1e-3)
    turned = np.abs(np.diff(plain.truth[:, 2])).sum()
    lost = turned - np.abs(np.diff(seen.pose[:, 2])).sum()
    assert lost / turned == pytest.approx(share, abs=0.02)


def test_an_effect_that_ends_leaves_the_described_program() -> None:
    texts = ("firmware_constant.scale=0.1", "firmware_constant.stop_s=4")
    plain, seen = drive_once(scenario="straight"), drive_once(*texts, scenario="straight")
    later = slice(410, None)
    apart = seen.pose[later, 0] - plain.pose[later, 0]
    # the carried remainders differ from the change on: one unit of the step's format
    np.testing.assert_allclose(apart, apart[0], atol=2.0**-27)
    assert seen.pose[399, 0] == pytest.approx(1.1 * plain.pose[399, 0], rel=1e-4)
