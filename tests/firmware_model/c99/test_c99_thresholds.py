"""At each threshold of the kernel, one unit below, at it and one above: the same decision in C."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from kernel_cases import ROBOT, ZERO_CODE, config_of

from firmware_model import (
    FRESH,
    STALE,
    FirmwareDescription,
    Kernel,
    KernelConfig,
    StatusBit,
    build_config,
)
from firmware_model.kernel import IMPLEMENTATIONS, Implementation

Ticks = Iterable[tuple[int, int, int, int, int]]


def both_after_every_tick(config: KernelConfig, ticks: Ticks) -> list[StatusBit]:
    """Step oracle and twin; return the status of each tick."""
    oracle, twin = Kernel(config, "python"), Kernel(config, "c99")
    seen = []
    for tick in ticks:
        oracle.step(*tick)
        twin.step(*tick)
        assert twin.state() == oracle.state()
        seen.append(oracle.status)
    return seen


@pytest.mark.parametrize("beyond", [-1, 0, 1])
def test_a_gap_as_long_as_the_limit(beyond: int) -> None:
    config = config_of()
    silent = config.gap_limit_ticks - 1 + beyond
    ticks = [(0, 0, FRESH, ZERO_CODE, FRESH)]
    ticks += [(0, 0, STALE, ZERO_CODE + 50, FRESH)] * silent
    ticks += [(10, 10, FRESH, ZERO_CODE, FRESH)] * 2
    lost = [StatusBit.ENCODER_LOSS in one for one in both_after_every_tick(config, ticks)]
    assert lost[-2] == (beyond > 0)


@pytest.mark.parametrize("beyond", [-1, 0, 1])
def test_a_refused_reading_as_old_as_the_limit(beyond: int) -> None:
    config = config_of()
    ticks = [(0, 0, FRESH, ZERO_CODE, FRESH), (20_000, 0, FRESH, ZERO_CODE, FRESH)]
    ticks += [(0, 0, STALE, ZERO_CODE, FRESH)] * (config.gap_limit_ticks + beyond)
    ticks += [(20_000, 0, FRESH, ZERO_CODE, FRESH)]
    both_after_every_tick(config, ticks)


@pytest.mark.parametrize("beyond", [-1, 0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_increment_as_large_as_is_believed_and_a_new_baseline_as_near(
    beyond: int, sign: int
) -> None:
    config = config_of(plausibility={"jump_confirm_samples": 2})
    largest = sign * (config.max_step_ticks + beyond)
    for wheels in ((largest, 0), (0, largest)):
        far = [(20_000 + k * wheels[0], k * wheels[1]) for k in range(4)]
        counts = [(0, 0), wheels, *far]
        ticks = [(left, right, FRESH, ZERO_CODE, FRESH) for left, right in counts]
        status = both_after_every_tick(config, ticks)
        assert (StatusBit.ENCODER_JUMP in status[1]) == (beyond > 0)


def test_codes_about_the_rails_and_about_what_is_taken_for_rest() -> None:
    zeroing = 40 * ROBOT.gyro_sensitivity_rad_s_per_lsb
    config = config_of(
        gyro={"offset_frac_bits": 0, "auto_zero_rad_s": zeroing},
        standstill={"ticks": 2, "max_rate_rad_s": 2 * zeroing, "settle_ticks": 0, "block_log2": 0},
    )
    edges = [ZERO_CODE + sign * one for sign in (-1, 1) for one in (40, 41, 80, 81, 82)]
    edges += [config.gyro_min_code, config.gyro_max_code]
    codes = [edge + near for edge in edges for near in (-1, 0, 1)]
    ticks = [(30 * k, 10 * k, FRESH, code, FRESH) for k, code in enumerate(codes)]
    ticks += [(9_000, 9_000, FRESH, code, FRESH) for code in codes for _ in range(4)]
    both_after_every_tick(config, ticks)


@pytest.mark.parametrize("beyond", [-1, 0, 1])
def test_a_stuck_gyro_beside_wheels_that_turn_as_much_as_it_could_miss(beyond: int) -> None:
    config = config_of(stuck={"ticks": 3, "block_log2": 0, "span_ticks": 5})
    wide = config.stuck_span_ticks + beyond
    right = 0
    ticks = []
    for k in range(12):
        right += wide if k % 2 else 0
        ticks.append((0, right, FRESH, ZERO_CODE + 9, FRESH))
    stuck = [StatusBit.GYRO_STUCK in one for one in both_after_every_tick(config, ticks)]
    assert any(stuck) == (beyond > 0)


@pytest.mark.parametrize("tolerance", [0, 1, 2])
def test_wheels_that_move_as_much_as_counts_as_rest(tolerance: int) -> None:
    config = config_of(standstill={"ticks": 3, "tolerance_ticks": tolerance, "settle_ticks": 1})
    for edge in (tolerance, tolerance + 1, -tolerance, -tolerance - 1):
        counts = [0, 0, 0, 0, edge, edge, 0, 0, 0, 0]
        ticks = [(count, 0, FRESH, ZERO_CODE, FRESH) for count in counts]
        ticks += [(0, count, FRESH, ZERO_CODE, FRESH) for count in counts]
        both_after_every_tick(config, ticks)


@pytest.mark.parametrize("overflow", ["wrap", "saturate"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_position_that_stops_at_its_words_last_unit_and_one_that_goes_beyond(
    overflow: str, sign: int
) -> None:
    """Steps of a quarter of a unit reach each unit, the last one before the limit among them."""
    position = {"word_bits": 8, "frac_bits": 4, "overflow": overflow}
    config = config_of(position=position, mode="wheel")
    ticks = [(sign * 100 * k, sign * 100 * k, FRESH, ZERO_CODE, FRESH) for k in range(900)]
    status = both_after_every_tick(config, ticks)
    assert StatusBit.OVERFLOW in status[-1]


@pytest.mark.parametrize("overflow", ["wrap", "saturate"])
def test_steps_and_turns_about_the_limits_of_their_words(overflow: str) -> None:
    table = {
        "mode": "wheel",
        # Not even the fastest tick fits, 19 of 16 mm: so no gap is too long for it either.
        "step": {"word_bits": 8, "frac_bits": 13, "overflow": overflow, "carry_remainder": False},
        "turn_step": {"word_bits": 8, "frac_bits": 11, "overflow": overflow},
        "heading": {"frac_bits": 11},
        "position": {"frac_bits": 20},
        "velocity": {"frac_bits": 20},
    }
    config = build_config(FirmwareDescription.from_table(table), ROBOT, allow_overflow=True)
    fastest = config.max_step_ticks
    left = right = 0
    ticks = []
    for k in range(-fastest, fastest + 1):
        for left_step, right_step in ((k, k), (k, -k), (-k, k)):
            left, right = left + left_step, right + right_step
            ticks.append((left, right, FRESH, ZERO_CODE, FRESH))
    for gap in range(1, 60):  # steps of gaps are longer than those of ticks
        ticks += [(0, 0, STALE, ZERO_CODE, FRESH)] * (gap - 1)
        left, right = left + gap * fastest, right + (gap - 30) * fastest // 2
        ticks.append((left, right, FRESH, ZERO_CODE, FRESH))
    status = both_after_every_tick(config, ticks)
    assert StatusBit.OVERFLOW in status[-1]


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_a_velocity_saturates_when_it_is_read_and_no_word_has_overflowed(
    implementation: Implementation,
) -> None:
    """It is made of the filter for whoever asks, and nothing is made of it: no state changes."""
    description = FirmwareDescription.from_table({"mode": "gyro", "velocity": {"frac_bits": 24}})
    config = build_config(description, replace(ROBOT, gyro_sensitivity_rad_s_per_lsb=0.01))
    kernel = Kernel(config, implementation)
    kernel.run(np.array([[0, 0, FRESH, ZERO_CODE + 20_000, FRESH]] * 100))  # 200 rad/s
    before = kernel.state()
    assert kernel.w_rad_s_q == config.velocity_high_q
    assert kernel.state() == before
    assert kernel.overflow_count == 0
