"""Turning and moving in integers: what carries, what wraps, what saturates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT, ZERO_CODE, config_of, drive, initialised

from firmware_model import FRESH, FirmwareDescription, Kernel, StatusBit, build_config

ROUNDINGS = ["floor", "half_up", "half_even", "toward_zero"]
POSITION = ("x_m_q", "y_m_q", "x_remainder_q", "y_remainder_q", "step_remainder_q")


def rounded(rounding: str, **firmware: Any) -> dict[str, Any]:
    """Return a table [firmware] in which every narrowing of distance uses *rounding*."""
    return {"position": {"rounding": rounding}, "step": {"rounding": rounding}, **firmware}


@pytest.mark.parametrize("rounding", ROUNDINGS)
@given(
    speeds=st.lists(st.integers(-100, 100), min_size=1, max_size=30),
    order=st.randoms(use_true_random=False),
    first_turn=st.integers(-120, 120),
)
@settings(max_examples=25)
def test_straight_forth_and_back_ends_exactly_at_the_start(
    rounding: str, speeds: list[int], order: Any, first_turn: int
) -> None:
    """Along any heading, in any order of steps: with carried remainders no bit is left over."""
    kernel = initialised(**rounded(rounding, mode="wheel"))
    drive(kernel, [(-first_turn, first_turn)])
    start = {name: kernel.state()[name] for name in POSITION}
    back = [-speed for speed in speeds]
    order.shuffle(back)
    drive(kernel, [(speed, speed) for speed in speeds + back])
    assert {name: kernel.state()[name] for name in POSITION} == start


def test_without_carry_the_same_drive_does_not_return() -> None:
    """The property above is about the carry: floor alone loses half a unit a step."""
    kernel = initialised(
        mode="wheel",
        position={"carry_remainder": False, "frac_bits": 16},
        step={"carry_remainder": False},
    )
    drive(kernel, [(-3, 4), *[(17, 17)] * 50, *[(-17, -17)] * 50])
    assert kernel.x_m_q < -20


@given(st.lists(st.integers(-250, 250), max_size=60))
def test_the_heading_is_the_exact_sum_of_turns_modulo_one_turn(differences: list[int]) -> None:
    kernel = initialised(mode="wheel")
    half = [(-(one // 2), one - one // 2) for one in differences]
    drive(kernel, half)
    config, state = kernel.config, kernel.state()
    exact = sum(differences) * config.tick_turn_q
    held = state["heading_turn_q"] << config.heading_shift
    held = (held + state["heading_remainder_q"]) << config.wheel_turn_shift
    held += state["wheel_turn_remainder_q"]
    one_turn = 1 << (config.heading_frac_bits + config.heading_shift + config.wheel_turn_shift)
    assert (held - exact) % one_turn == 0


def test_a_spin_of_many_turns_and_back_ends_at_heading_zero_exactly() -> None:
    kernel = initialised(mode="wheel")
    drive(kernel, [(-100, 100)] * 2_000)
    turned = 2_000 * 200 * ROBOT.wheel_radius_m / (ROBOT.ticks_per_rev * ROBOT.wheelbase_m)
    assert turned > 30
    expected = (turned + 0.5) % 1.0 - 0.5
    assert kernel.heading_turn_q / 2**32 == pytest.approx(expected, abs=2**-31)
    drive(kernel, [(100, -100)] * 2_000)
    assert kernel.heading_turn_q == 0
    assert not kernel.status & StatusBit.OVERFLOW  # an angle that wraps has not overflowed


def test_the_heading_wraps_from_just_below_half_a_turn_to_minus_half() -> None:
    kernel = initialised(mode="wheel")
    headings = []
    for _ in range(80):
        drive(kernel, [(-50, 50)])
        headings.append(kernel.heading_turn_q)
    assert max(headings) < 1 << 31
    assert min(headings) >= -(1 << 31)
    (wrap,) = [k for k in range(79) if headings[k + 1] < headings[k]]
    gained = headings[wrap + 1] - headings[wrap] + (1 << 32)
    assert gained == pytest.approx(headings[1] - headings[0], abs=1)


@pytest.mark.parametrize("rule", ["euler_before", "midpoint", "euler_after"])
def test_each_rule_takes_the_step_along_its_own_heading(rule: str) -> None:
    kernel = initialised(mode="wheel", integration=rule)
    drive(kernel, [(-50, 100)])
    turn_rad = 2 * math.pi * 150 * ROBOT.wheel_radius_m / (ROBOT.ticks_per_rev * ROBOT.wheelbase_m)
    share = {"euler_before": 0.0, "midpoint": 0.5, "euler_after": 1.0}[rule]
    step_m = math.pi * ROBOT.wheel_radius_m * 50 / ROBOT.ticks_per_rev
    assert kernel.x_m_q / 2**32 == pytest.approx(step_m * math.cos(share * turn_rad), abs=1e-8)
    assert kernel.y_m_q / 2**32 == pytest.approx(step_m * math.sin(share * turn_rad), abs=1e-8)


ROUNDED: dict[str, Callable[[Fraction], int]] = {
    "floor": math.floor,
    "half_up": lambda value: math.floor(value + Fraction(1, 2)),
    "half_even": round,
    "toward_zero": math.trunc,
}


@pytest.mark.parametrize("rounding", ROUNDINGS)
@pytest.mark.parametrize("first_turn", [0, 5, -3])
def test_the_direction_of_travel_is_the_exact_angle_rounded_once_to_the_headings_bits(
    rounding: str, first_turn: int
) -> None:
    """Sixteen directions, a sixteenth of one per encoder tick: heading plus half the turn."""
    robot = replace(
        ROBOT,
        wheel_radius_m=0.0625,
        wheelbase_m=0.25,
        ticks_per_rev=64,
        max_wheel_rate_rad_s=1_000.0,
    )
    heading = {"frac_bits": 4, "rounding": rounding}
    description = FirmwareDescription.from_table(
        {"mode": "wheel", "integration": "midpoint", "heading": heading}
    )
    config = build_config(description, robot)
    for turn in range(-64, 49):
        kernel = Kernel(config, "python")
        kernel.step(0, 0, FRESH, ZERO_CODE, FRESH)
        drive(kernel, [(0, first_turn)])
        x_m_q, y_m_q, _ = kernel.pose_q
        drive(kernel, [(50, 50 + turn)])
        angle_rad = math.atan2(kernel.y_m_q - y_m_q, kernel.x_m_q - x_m_q)
        expected = ROUNDED[rounding](Fraction(first_turn, 16) + Fraction(turn, 32))
        off_rad = math.remainder(angle_rad - expected * math.tau / 16, math.tau)
        assert abs(off_rad) < 1e-6, turn


def test_midpoint_converges_to_the_exact_arc() -> None:
    """A full circle of radius R: the chord rule ends where it began, to its second-order error."""
    kernel = initialised(mode="wheel", integration="midpoint", trig={"method": "cordic"})
    left, right = 30, 50
    ticks_for_a_turn = ROBOT.ticks_per_rev * ROBOT.wheelbase_m / ROBOT.wheel_radius_m
    steps = round(ticks_for_a_turn / (right - left))
    drive(kernel, [(left, right)] * steps)
    missing_rad = 2 * math.pi * (1 - steps * (right - left) / ticks_for_a_turn)
    radius_m = ROBOT.wheelbase_m / 2 * (right + left) / (right - left)
    distance = math.hypot(kernel.x_m_q, kernel.y_m_q) / 2**32
    assert distance == pytest.approx(abs(radius_m * missing_rad), abs=1e-6)


# Overflow --------------------------------------------------------------------------------------


def overflowing(mode: str) -> Kernel:
    """Return a kernel whose x holds ±1 m only: 20 bits with 19 fraction bits."""
    description = FirmwareDescription.from_table(
        {"mode": "wheel", "position": {"word_bits": 20, "frac_bits": 19, "overflow": mode}}
    )
    config = build_config(description, ROBOT, allow_overflow=True)
    kernel = Kernel(config, "python")
    kernel.step(0, 0, FRESH, ZERO_CODE, FRESH)
    return kernel


def test_a_position_that_saturates_stays_at_its_limit_says_so_and_counts() -> None:
    kernel = overflowing("saturate")
    drive(kernel, [(100, 100)] * 50)
    assert not kernel.status & StatusBit.OVERFLOW
    drive(kernel, [(100, 100)] * 50)
    assert kernel.x_m_q == (1 << 19) - 1
    assert kernel.status & StatusBit.OVERFLOW
    count = kernel.overflow_count
    assert count > 20
    drive(kernel, [(-100, -100)])
    assert kernel.x_m_q < (1 << 19) - 1
    assert kernel.status & StatusBit.OVERFLOW  # sticky
    assert kernel.overflow_count == count


def test_a_position_that_wraps_reappears_at_the_other_end_says_so_and_counts() -> None:
    kernel, wide = overflowing("wrap"), initialised(mode="wheel", position={"frac_bits": 19})
    for one in (kernel, wide):
        drive(one, [(100, 100)] * 100)
    assert kernel.x_m_q == (wide.x_m_q + (1 << 19)) % (1 << 20) - (1 << 19)
    assert kernel.x_m_q != wide.x_m_q
    assert kernel.overflow_count == 1
    assert kernel.status & StatusBit.OVERFLOW


def test_64_bit_positions_wrap_like_two_s_complement() -> None:
    kernel = initialised(mode="wheel")
    state = kernel.state()
    kernel.load_state({**state, "x_m_q": (1 << 63) - 10})
    drive(kernel, [(100, 100)])
    assert kernel.x_m_q < -(1 << 62)
    assert kernel.overflow_count == 1
    compiled = Kernel(kernel.config)
    compiled.load_state({**state, "x_m_q": (1 << 63) - 10})
    compiled.step(100, 100, FRESH, ZERO_CODE, FRESH)
    assert compiled.state() == kernel.state()


# Velocity --------------------------------------------------------------------------------------


def test_the_velocity_settles_to_that_of_the_wheels() -> None:
    kernel = initialised(mode="wheel")
    drive(kernel, [(35, 45)] * 100)
    tick_m = 2 * math.pi * ROBOT.wheel_radius_m / ROBOT.ticks_per_rev
    assert kernel.v_m_s_q / 2**20 == pytest.approx(40 * tick_m / 0.01, abs=1e-5)
    assert kernel.w_rad_s_q / 2**20 == pytest.approx(
        10 * tick_m / ROBOT.wheelbase_m / 0.01, abs=1e-5
    )
    assert kernel.v_is_valid
    assert kernel.w_is_valid


def test_unfiltered_velocity_is_that_of_the_last_tick() -> None:
    kernel = initialised(mode="wheel", velocity={"filter_log2": 0})
    drive(kernel, [(10, 10), (-20, -20)])
    tick_m = 2 * math.pi * ROBOT.wheel_radius_m / ROBOT.ticks_per_rev
    assert kernel.v_m_s_q / 2**20 == pytest.approx(-20 * tick_m / 0.01, abs=1e-6)


def test_a_tick_without_wheels_says_that_it_has_no_velocity() -> None:
    kernel = initialised(mode="wheel")
    drive(kernel, [(40, 40)])
    kernel.step(0, 0, 2, ZERO_CODE, FRESH)
    assert not kernel.v_is_valid
    assert not kernel.w_is_valid
    kernel.step(120, 120, FRESH, ZERO_CODE, FRESH)  # the gap's step is spread over two ticks
    assert not kernel.v_is_valid
    drive(kernel, [(40, 40)])
    assert kernel.v_is_valid


def test_default_formats_are_those_of_the_odometry_frames() -> None:
    config = config_of()
    assert config.position_frac_bits == 32
    assert config.heading_frac_bits == 32
