"""The bound of x and y holds on any drive, and a word that does not hold it is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT

from firmware_model import (
    FRESH,
    INVALID,
    STALE,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    KernelConfig,
    build_config,
)
from firmware_model.integers import shift_round
from firmware_model.reach import Demand, counts_of, position_reach, require_position_holds

ROUNDING = st.sampled_from(["floor", "half_up", "half_even", "toward_zero"])
FORMAT = st.fixed_dictionaries({"rounding": ROUNDING, "carry_remainder": st.booleans()})


@given(FORMAT, FORMAT, st.integers(0, 20), st.integers(10, 28), st.integers(0, 2**32))
@settings(max_examples=60)
def test_no_drive_leaves_the_reach_of_its_counts(
    position: dict[str, Any], step: dict[str, Any], coarse: int, fine: int, seed: int
) -> None:
    table = {
        "mode": "wheel",
        "position": position | {"frac_bits": coarse},
        "step": step | {"frac_bits": fine},
        "trig": {"entries": 16},
    }
    config = build_config(FirmwareDescription.from_table(table), ROBOT)
    rng = np.random.default_rng(seed)
    fastest = int(rng.choice([1, 2, config.max_step_ticks]))
    steps = rng.integers(-fastest, fastest, endpoint=True, size=(100, 2))
    if rng.random() < 0.5:
        steps = np.abs(steps)  # straight on: all of the way is in x
    ways = np.abs(steps.sum(axis=1))
    ways[0] = 0
    kernel, counts = Kernel(config), np.cumsum(steps, axis=0).tolist()
    for ticks, ((left, right), moving) in enumerate(zip(counts, np.cumsum(ways), strict=True)):
        kernel.step(left, right, FRESH, 32768, FRESH)
        reach = position_reach(config, replace(Demand.believed(config, ticks), counts=int(moving)))
        assert max(abs(kernel.x_m_q), abs(kernel.y_m_q)) <= reach


def give_back(
    config: KernelConfig, ticks: int, counts: int, swing_rad: float, seed: int, rate: int = 0
) -> tuple[int, Demand]:
    """Return how far x went in a drive that takes remainders forward and gives them back backward,
    and what it asked of the kernel.

    Args:
        config: from `build_config`.
        ticks: how long it lasts.
        counts: right − left of a tick.
        swing_rad: how far it turns each way about the sideways direction; π: on and on.
        seed: of the ticks without a frame; 0: none.
        rate: code − nominal zero of the gyro to and fro; 0: it is invalid.
    """
    rng, kernel = np.random.default_rng(seed), Kernel(config)
    kernel.step(0, 0, FRESH, 32768, INVALID)
    left = right = used = way = most = deviation = 0
    side = 1
    for _ in range(ticks):
        state = kernel.state()
        heading = math.tau * state["heading_turn_q"] / 2**config.heading_frac_bits
        off = math.remainder(heading - math.pi / 2, math.tau)
        side = -side if side * off >= swing_rad else side
        wanted = np.sign(round(math.cos(heading) / max(math.sin(swing_rad), 0.9), 0))
        if swing_rad < 1.5:
            wanted = -np.sign(off) * (abs(off) >= swing_rad)
        choices = {0: 0.0}
        for more in (-1, 1):
            total = state["step_remainder_q"] + more * config.half_tick_m_q
            step = shift_round(total, config.step_shift, config.step_rounding)
            choices[more] = float(wanted * step) - 0.1
        more = max(choices, key=choices.__getitem__)
        turned = side * counts
        turned += (turned + more) % 2
        left, right = left + (more - turned) // 2, right + (more + turned) // 2
        frame = STALE if seed and rng.random() < 0.2 else FRESH
        code = 32768 + side * rate
        kernel.step(left, right, frame, code, FRESH if rate else INVALID)
        if frame == FRESH:
            used, way = left + right, way + abs(left + right - used)
        most = max(most, abs(turned))
        deviation = max(
            deviation, abs((code << config.offset_frac_bits) - state["gyro_offset_q"]) * bool(rate)
        )
    assert kernel.overflow_count == 0
    asked = replace(
        Demand.believed(config, ticks), counts=way, turn_counts=Fraction(most), rate_q=deviation
    )
    return max(abs(kernel.x_m_q), abs(kernel.y_m_q)), asked


@given(
    st.fixed_dictionaries(
        {
            "mode": st.sampled_from(["wheel", "gyro", "blend"]),
            "integration": st.sampled_from(["euler_before", "midpoint", "euler_after"]),
            "stale_heading_ticks": st.sampled_from([0, 0, 2]),
            "position": FORMAT,
            "turn_step": FORMAT,
            "heading": st.builds(dict.__or__, FORMAT, st.sampled_from([{}, {"frac_bits": 10}])),
            "trig": st.sampled_from(
                [{}, {"entries": 4, "interpolated": False}, {"method": "cordic", "iterations": 4}]
            ),
        }
    ),
    ROUNDING,
    st.sampled_from([0.1, 0.5, math.pi]),
    st.integers(1, 120),
    st.integers(0, 9),
    st.sampled_from([0, 30000]),
)
@settings(max_examples=30)
def test_no_remainder_given_back_leaves_the_reach(
    table: dict[str, Any], rounding: str, swing_rad: float, counts: int, seed: int, rate: int
) -> None:
    table["position"] |= {"frac_bits": 12}
    step = {"rounding": rounding, "frac_bits": 6}
    config = build_config(FirmwareDescription.from_table({**table, "step": step}), ROBOT)
    farthest, asked = give_back(config, 400, counts, swing_rad, seed, rate)
    assert farthest <= position_reach(config, asked)


def test_remainders_add_half_a_unit_for_each_radian_and_no_less() -> None:
    table = {"mode": "wheel", "step": {"frac_bits": 6}, "position": {"frac_bits": 12}}
    config = build_config(FirmwareDescription.from_table(table), ROBOT)
    farthest, asked = give_back(config, 3000, 96, 0.5, 0)
    turned_rad = 3000 * 96 * math.tau * ROBOT.wheel_radius_m / 2048 / ROBOT.wheelbase_m
    reach = position_reach(config, asked)
    assert 0.9 * reach < farthest <= reach < 1.1 * turned_rad / 2 * 2**6


def test_a_distance_is_so_many_counts_that_the_reach_is_not_below_it() -> None:
    config = build_config(FirmwareDescription(), ROBOT)
    asked = replace(Demand.believed(config, 10_000), counts=counts_of(config, 100.0))
    reach = position_reach(config, asked)
    assert 100.0 <= reach / 2**32 < 100.001


def test_what_would_be_right_is_said_and_is_right() -> None:
    def config(word_bits: int, frac_bits: int) -> Any:
        table = {"position": {"word_bits": word_bits, "frac_bits": frac_bits}}
        return build_config(FirmwareDescription.from_table(table), ROBOT)

    def require(word_bits: int, frac_bits: int, distance_m: float) -> None:
        one = config(word_bits, frac_bits)
        asked = replace(Demand.believed(one, 1000), counts=counts_of(one, distance_m))
        require_position_holds(one, position_reach(one, asked), f"{distance_m:g} m")

    with pytest.raises(FirmwareError, match=r"= 25: 10 m do not fit with 21 .* at least 26 bits$"):
        require(25, 21, 10.0)
    require(26, 21, 10.0)
    with pytest.raises(FirmwareError, match=r"do not fit with 48 .* at most 46 fraction bits$"):
        require(64, 48, 1e5)
    require(64, 46, 1e5)


@given(
    st.fixed_dictionaries(
        {
            "mode": st.sampled_from(["wheel", "gyro"]),
            "position": FORMAT,
            "step": FORMAT,
            "heading": FORMAT,
            "trig": st.sampled_from([{}, {"entries": 4, "interpolated": False}]),
        }
    ),
    st.sampled_from([(12, 6), (10, 12), (20, 20)]),
    st.integers(1, 3),
    st.sampled_from([0, 3000, 30000]),
    st.integers(0, 2**32),
)
@settings(max_examples=12)
def test_no_trembling_of_wheels_at_rest_leaves_the_reach(
    table: dict[str, Any], frac_bits: tuple[int, int], width: int, rate: int, seed: int
) -> None:
    """Each wheel counts to and fro within so many counts, as takes x farthest; the gyro turns."""
    table["position"] |= {"frac_bits": frac_bits[0]}
    table["step"] |= {"frac_bits": frac_bits[1]}
    config = build_config(FirmwareDescription.from_table(table), ROBOT)
    rng, kernel = np.random.default_rng(seed), Kernel(config)
    kernel.step(0, 0, FRESH, 32768, FRESH)
    choices = [(left, right) for left in range(width + 1) for right in range(width + 1)]
    deviation = abs(((32768 + rate) << config.offset_frac_bits) - config.zero_rate_code_q)
    ticks, wanted = 150, rng.choice([-1, 1])
    for tick in range(1, ticks + 1):
        before = kernel.state()
        best, far = choices[0], -math.inf
        for left, right in choices:
            kernel.step(left, right, FRESH, 32768 + rate, FRESH)
            gone = wanted * kernel.x_m_q + 0.1 * rng.random()
            if gone > far:
                best, far = (left, right), gone
            kernel.load_state(before)
        kernel.step(*best, FRESH, 32768 + rate, FRESH)
        asked = Demand(
            ticks=tick,
            counts=0,
            frame_counts=2 * width,
            turn_counts=Fraction(0),
            rate_q=deviation,
            jitter=Fraction(2 * width),
        )
        assert max(abs(kernel.x_m_q), abs(kernel.y_m_q)) <= position_reach(config, asked)
