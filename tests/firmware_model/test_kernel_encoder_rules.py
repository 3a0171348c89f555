"""Which encoder samples move the robot: the rule of `firmware_model.encoder`, line by line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_cases import ZERO_CODE, config_of, drive, initialised, kernel_of

from firmware_model import FRESH, INVALID, STALE, EncoderDecision, Kernel, StatusBit

MODES = ["wheel", "gyro", "blend"]
FASTEST = config_of().max_step_ticks
GAP_LIMIT = config_of().gap_limit_ticks


def pose(kernel: Kernel) -> tuple[int, int, int]:
    return kernel.x_m_q, kernel.y_m_q, kernel.heading_turn_q


def decision(kernel: Kernel) -> int:
    return kernel.state()["encoder_decision"]


@pytest.mark.parametrize("mode", MODES)
def test_nothing_moves_before_the_first_fresh_sample_and_that_is_only_a_baseline(mode: str) -> None:
    kernel = kernel_of(mode=mode)
    for _ in range(3):
        kernel.step(1000, 2000, STALE, 40_000, FRESH)
        assert pose(kernel) == (0, 0, 0)
        assert kernel.status & StatusBit.INITIALISED == 0
        assert kernel.status & StatusBit.POSITION_HELD
    kernel.step(50_000, 3, FRESH, 40_000, FRESH)
    assert pose(kernel) == (0, 0, 0)
    assert kernel.status & StatusBit.INITIALISED
    assert decision(kernel) == EncoderDecision.REBASED


@given(st.lists(st.tuples(st.integers(-100, 100), st.integers(-100, 100)), max_size=40))
def test_a_wrapping_counter_moves_the_robot_like_an_unwrapped_one(
    steps: list[tuple[int, int]],
) -> None:
    """16 bits of any larger counter are the same counter: start each 3 ticks before the wrap."""
    wrapping, unwrapped = kernel_of(mode="wheel"), kernel_of(mode="wheel")
    left = right = 65_533
    for left_step, right_step in [(0, 0), *steps]:
        left, right = left + left_step, right + right_step
        wrapping.step(left % 65_536, right % 65_536, FRESH, ZERO_CODE, FRESH)
        unwrapped.step(left, right, FRESH, ZERO_CODE, FRESH)
    assert wrapping.state() == unwrapped.state()
    total = sum(one for one, _ in steps), sum(one for _, one in steps)
    assert (wrapping.state()["left_count"], wrapping.state()["right_count"]) == (
        (65_533 + total[0]) % 65_536,
        (65_533 + total[1]) % 65_536,
    )


@given(st.integers(2, GAP_LIMIT), st.integers(-FASTEST, FASTEST))
def test_a_gap_within_the_limit_loses_no_distance(gap: int, speed: int) -> None:
    """On a straight, one step of the whole gap ends where the ticks would have ended."""
    without, with_gap = initialised(mode="wheel"), initialised(mode="wheel")
    drive(without, [(speed, speed)] * gap)
    for _ in range(gap - 1):
        with_gap.step(77, 99, INVALID, ZERO_CODE, FRESH)
        assert pose(with_gap) == (0, 0, 0)
        assert with_gap.status & StatusBit.POSITION_HELD
        assert with_gap.status & StatusBit.ENCODER_INVALID
    with_gap.step(speed * gap, speed * gap, FRESH, ZERO_CODE, FRESH)
    assert pose(with_gap) == pose(without)
    assert not with_gap.status & (StatusBit.POSITION_DEGRADED | StatusBit.POSITION_HELD)


@pytest.mark.parametrize("mode", MODES)
def test_a_gap_beyond_the_limit_is_a_loss_that_sticks_and_moves_nothing(mode: str) -> None:
    kernel = initialised(mode=mode)
    for _ in range(GAP_LIMIT):
        kernel.step(0, 0, STALE, ZERO_CODE, FRESH)
        assert kernel.status & StatusBit.ENCODER_STALE
    kernel.step(1000, 1000, FRESH, ZERO_CODE, FRESH)
    assert pose(kernel) == (0, 0, 0)
    assert decision(kernel) == EncoderDecision.REBASED
    sticky = StatusBit.ENCODER_LOSS | StatusBit.POSITION_DEGRADED
    assert kernel.status & sticky == sticky
    x_before = kernel.x_m_q
    kernel.step(1010, 1010, FRESH, ZERO_CODE, FRESH)
    assert kernel.x_m_q > x_before  # from the new baseline on, it moves again
    assert kernel.status & sticky == sticky


def test_the_gap_limit_is_half_the_counters_range_at_the_fastest_believed_speed() -> None:
    assert FASTEST * GAP_LIMIT <= 32_767 < FASTEST * (GAP_LIMIT + 1)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("wheel", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_increment_beyond_the_wheels_speed_is_refused(mode: str, wheel: int, sign: int) -> None:
    kernel = initialised(mode=mode)
    counts = [0, 0]
    counts[wheel] = sign * (FASTEST + 1)
    kernel.step(*counts, FRESH, ZERO_CODE, FRESH)
    assert pose(kernel) == (0, 0, 0)
    assert kernel.status & StatusBit.ENCODER_JUMP
    assert kernel.status & StatusBit.POSITION_HELD
    counts[wheel] = sign * FASTEST
    kernel.step(*counts, FRESH, ZERO_CODE, FRESH)
    assert decision(kernel) == EncoderDecision.ACCEPTED


def test_a_single_wrong_reading_costs_nothing() -> None:
    clean, hit = initialised(mode="wheel"), initialised(mode="wheel")
    drive(clean, [(50, 50)] * 3)
    hit.step(50, 50, FRESH, ZERO_CODE, FRESH)
    hit.step(20_000, 100, FRESH, ZERO_CODE, FRESH)
    assert hit.status & StatusBit.ENCODER_JUMP
    hit.step(150, 150, FRESH, ZERO_CODE, FRESH)
    assert pose(hit) == pose(clean)
    assert not hit.status & (StatusBit.ENCODER_LOSS | StatusBit.ENCODER_JUMP)


def test_refused_samples_that_agree_with_each_other_become_the_new_baseline() -> None:
    kernel = initialised(mode="wheel", plausibility={"jump_confirm_samples": 5})
    for sample in range(5):
        kernel.step(10_000 + 40 * sample, 20_000 + 40 * sample, FRESH, ZERO_CODE, FRESH)
        rebased = decision(kernel) == EncoderDecision.REBASED
        assert rebased == (sample == 4)
    assert pose(kernel) == (0, 0, 0)
    assert kernel.status & StatusBit.ENCODER_LOSS
    kernel.step(10_200, 20_200, FRESH, ZERO_CODE, FRESH)
    assert decision(kernel) == EncoderDecision.ACCEPTED
    assert kernel.x_m_q > 0


def test_refused_samples_that_disagree_never_become_a_baseline() -> None:
    kernel = initialised(mode="wheel")
    for sample in range(40):
        far = 10_000 if sample % 2 else 25_000
        kernel.step(far, far, FRESH, ZERO_CODE, FRESH)
        assert decision(kernel) == EncoderDecision.NOT_USED
    assert not kernel.status & StatusBit.ENCODER_LOSS


def test_a_candidate_is_forgotten_when_its_successor_comes_too_late() -> None:
    kernel = initialised(mode="wheel", plausibility={"jump_confirm_samples": 2})
    kernel.step(20_000, 20_000, FRESH, ZERO_CODE, FRESH)
    for _ in range(GAP_LIMIT + 1):
        kernel.step(0, 0, INVALID, ZERO_CODE, FRESH)
    assert kernel.state()["candidate_samples"] == 0


def test_any_validity_but_fresh_and_stale_counts_as_invalid() -> None:
    for validity in (INVALID, 3, 127, -1):
        kernel = initialised()
        kernel.step(10, 10, validity, ZERO_CODE, FRESH)
        assert kernel.status & StatusBit.ENCODER_INVALID
        assert pose(kernel) == (0, 0, 0)


def test_each_refused_sample_must_agree_with_the_one_just_before_it() -> None:
    kernel = initialised(mode="wheel", plausibility={"jump_confirm_samples": 3})
    for count in (10_000, 10_000 + FASTEST, 10_000 + 2 * FASTEST + FASTEST // 2):
        kernel.step(count, count, FRESH, ZERO_CODE, FRESH)
        assert decision(kernel) == EncoderDecision.NOT_USED


def test_an_accepted_sample_in_between_starts_the_count_of_refused_ones_afresh() -> None:
    kernel = initialised(mode="wheel", plausibility={"jump_confirm_samples": 2})
    for count in (10_000, 0, 10_000, 0, 10_000):
        kernel.step(count, count, FRESH, ZERO_CODE, FRESH)
        assert decision(kernel) != EncoderDecision.REBASED
