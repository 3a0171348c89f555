"""When the gyro is believed, what replaces it, and what its offset is learnt from."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT, ZERO_CODE, config_of, drive, initialised

from firmware_model import (
    FRESH,
    INVALID,
    STALE,
    FirmwareDescription,
    FirmwareError,
    HeadingSource,
    Kernel,
    StatusBit,
    build_config,
    run_batch,
)
from firmware_model.kernel import Implementation

TICK_TURN = ROBOT.wheel_radius_m / (ROBOT.ticks_per_rev * ROBOT.wheelbase_m)
LSB_TURN = ROBOT.gyro_sensitivity_rad_s_per_lsb * ROBOT.tick_period_s / (2 * math.pi)
Q32 = 2.0**32


def turns(kernel: Kernel) -> float:
    return kernel.heading_turn_q32 / Q32


# Fallback --------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["gyro", "blend"])
@pytest.mark.parametrize(
    ("code", "validity", "bit"),
    [
        (40_000, STALE, StatusBit.GYRO_STALE),
        (40_000, INVALID, StatusBit.GYRO_INVALID),
        (ROBOT.gyro_min_code, FRESH, StatusBit.GYRO_SATURATED),
        (ROBOT.gyro_max_code, FRESH, StatusBit.GYRO_SATURATED),
        (-(1 << 63), FRESH, StatusBit.GYRO_SATURATED),
        ((1 << 63) - 1, FRESH, StatusBit.GYRO_SATURATED),
    ],
)
def test_without_the_gyro_the_wheels_turn_the_heading(
    mode: str, code: int, validity: int, bit: StatusBit
) -> None:
    kernel = initialised(mode=mode)
    kernel.step(10, 40, FRESH, code, validity)
    assert kernel.heading_source == HeadingSource.WHEELS
    assert kernel.status & bit
    assert kernel.status & StatusBit.WHEEL_FALLBACK
    assert turns(kernel) == pytest.approx(30 * TICK_TURN, abs=2 / Q32)
    kernel.step(10, 40, FRESH, ZERO_CODE + 1, FRESH)
    assert not kernel.status & (bit | StatusBit.WHEEL_FALLBACK)


def test_the_code_just_inside_the_rail_is_believed() -> None:
    kernel = initialised()
    kernel.step(40, 40, FRESH, ROBOT.gyro_max_code - 1, FRESH)
    assert kernel.heading_source == HeadingSource.GYRO
    assert turns(kernel) == pytest.approx((65_517 - ZERO_CODE) * LSB_TURN, abs=2 / Q32)


def test_without_the_encoder_the_gyro_turns_the_heading_with_the_offset_it_has() -> None:
    kernel = initialised()
    for tick in range(1, 11):
        kernel.step(0, 0, INVALID, ZERO_CODE + 1000, FRESH)
        assert kernel.heading_source == HeadingSource.GYRO
        assert turns(kernel) == pytest.approx(1000 * tick * LSB_TURN, abs=2 / Q32)


def test_a_gap_in_which_the_gyro_was_missing_too_takes_its_heading_from_the_wheels() -> None:
    """3 gyro ticks, 1 tick without either, then the wheels' count for the whole gap."""
    for mode in ("gyro", "blend"):
        kernel = initialised(mode=mode)
        for validity in (FRESH, FRESH, STALE, FRESH):
            kernel.step(0, 0, STALE, ZERO_CODE + 700, validity)
        kernel.step(100, 160, FRESH, ZERO_CODE + 700, FRESH)
        assert kernel.heading_source == HeadingSource.WHEELS
        assert kernel.status & StatusBit.WHEEL_FALLBACK
        assert turns(kernel) == pytest.approx(60 * TICK_TURN, abs=4 / Q32)
        kernel.step(140, 200, FRESH, ZERO_CODE + 1, FRESH)
        assert not kernel.status & StatusBit.WHEEL_FALLBACK


def test_a_gap_in_which_the_gyro_was_there_keeps_the_gyros_heading() -> None:
    for mode in ("gyro", "blend"):
        kernel = initialised(mode=mode)
        for _ in range(4):
            kernel.step(0, 0, STALE, ZERO_CODE + 700, FRESH)
        kernel.step(100, 160, FRESH, ZERO_CODE + 700, FRESH)
        assert kernel.heading_source == HeadingSource.GYRO
        assert turns(kernel) == pytest.approx(5 * 700 * LSB_TURN, abs=4 / Q32)


@pytest.mark.parametrize(
    ("rule", "share"), [("euler_before", 0), ("midpoint", 1), ("euler_after", 2)]
)
def test_the_distance_of_a_gap_lies_along_the_heading_of_the_gap(rule: str, share: int) -> None:
    kernel = initialised(integration=rule)
    for _ in range(9):
        kernel.step(0, 0, STALE, ZERO_CODE + 3000, FRESH)
    kernel.step(500, 500, FRESH, ZERO_CODE + 3000, FRESH)
    angle = math.pi * share * 10 * 3000 * LSB_TURN
    assert math.atan2(kernel.y_m_q, kernel.x_m_q) == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize("weight", [0.0, 0.25, 1.0])
def test_the_blend_gives_the_gyro_its_weight(weight: float) -> None:
    kernel = initialised(mode="blend", blend_weight=weight)
    kernel.step(10, 40, FRESH, ZERO_CODE + 500, FRESH)
    assert kernel.heading_source == HeadingSource.BLEND
    expected = weight * 500 * LSB_TURN + (1 - weight) * 30 * TICK_TURN
    assert turns(kernel) == pytest.approx(expected, abs=2 / Q32)


# Stuck -----------------------------------------------------------------------------------------


@given(st.integers(-100, 100), st.integers(-100, 100), st.integers(0, 1000))
@settings(max_examples=40)
def test_a_noise_free_drive_at_constant_rate_never_looks_stuck(
    left_milli: int, right_milli: int, phase: int
) -> None:
    """True wheel speeds of any fraction of a tick, counted by a floor; the gyro's code constant."""
    ticks = np.arange(2_000)
    left = np.floor(left_milli * 0.917 * ticks + phase / 1000).astype(np.int64)
    right = np.floor(right_milli * 0.917 * ticks + phase / 777).astype(np.int64)
    codes = np.full_like(left, ZERO_CODE + 123)
    runs = run_batch(config_of(), left[None], right[None], codes[None], twin=False)
    assert runs.status is not None
    assert not np.any(runs.status & StatusBit.GYRO_STUCK)


def swaying_drive(ticks: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return wheel counts of a drive that sways by ±0.1 rad/s within 20 s, as the lesson's."""
    turn_rad = np.cumsum(0.1 * np.sin(2 * np.pi * np.arange(ticks) / 2000) * 0.01)
    half = turn_rad / (2 * np.pi) / TICK_TURN / 2
    forward = 39.0 * np.arange(ticks)
    return np.floor(forward - half).astype(np.int64), np.floor(forward + half).astype(np.int64)


def test_a_gyro_that_repeats_its_code_in_a_swaying_drive_is_stuck_until_it_changes() -> None:
    left, right = swaying_drive(2_000)
    codes = np.full_like(left, ZERO_CODE + 5)
    codes[1_500:] += np.arange(500) % 2
    runs = run_batch(config_of(), left[None], right[None], codes[None])
    assert runs.status is not None
    assert runs.heading_source is not None
    stuck = (runs.status[0] & StatusBit.GYRO_STUCK) != 0
    first = int(np.argmax(stuck))
    assert 100 <= first <= 600  # noticed within six seconds of a gentle sway
    assert stuck[first:1_501].all()
    assert not stuck[1_501:].any()
    assert (runs.heading_source[0][first:1_501] == HeadingSource.WHEELS).all()


def test_a_live_gyro_in_the_same_drive_is_not_stuck() -> None:
    left, right = swaying_drive(2_000)
    rate = 0.1 * np.sin(2 * np.pi * np.arange(2_000) / 2000)
    codes = np.rint(ZERO_CODE + rate / ROBOT.gyro_sensitivity_rad_s_per_lsb).astype(np.int64)
    runs = run_batch(config_of(), left[None], right[None], codes[None])
    assert runs.status is not None
    assert not np.any(runs.status & StatusBit.GYRO_STUCK)


def test_a_gyro_too_coarse_to_see_a_sway_is_not_stuck() -> None:
    """An 8-bit gyro has an LSB of 2 °/s; a sway within half of it on each side changes no code."""
    lsb_rad_s = 8.726646 / 256
    coarse = replace(
        ROBOT,
        gyro_sensitivity_rad_s_per_lsb=lsb_rad_s,
        gyro_zero_rate_code=128,
        gyro_min_code=0,
        gyro_max_code=255,
    )
    rate = 0.45 * lsb_rad_s * np.sin(2 * np.pi * np.arange(4_000) / 2_000)
    half = np.cumsum(rate * 0.01) / (2 * np.pi) / TICK_TURN / 2
    left = np.floor(39.0 * np.arange(4_000) - half).astype(np.int64)
    right = np.floor(39.0 * np.arange(4_000) + half).astype(np.int64)
    codes = np.rint(128 + rate / lsb_rad_s).astype(np.int64)
    assert set(codes.tolist()) == {128}
    config = build_config(FirmwareDescription(), coarse)
    runs = run_batch(config, left[None], right[None], codes[None], twin=False)
    assert runs.status is not None
    assert not np.any(runs.status & StatusBit.GYRO_STUCK)


def test_dropouts_that_beat_with_the_counter_do_not_make_a_steady_gyro_look_stuck() -> None:
    """Two samples, one lost, again: single increments do not average out, so no block is built."""
    ticks = np.arange(6_000)
    left = 39 * ticks
    right = np.floor((39 + 1 / 3 + 0.0008) * ticks).astype(np.int64)
    codes = np.full_like(left, ZERO_CODE + 123)
    lost = np.where(ticks % 3 == 2, STALE, FRESH)
    runs = run_batch(config_of(), left[None], right[None], codes[None], lost[None], twin=False)
    assert runs.status is not None
    assert not np.any(runs.status & StatusBit.GYRO_STUCK)


def test_a_code_is_stuck_when_it_has_repeated_for_so_many_ticks_and_no_sooner() -> None:
    kernel = initialised(stuck={"ticks": 20, "block_log2": 1, "span_ticks": 1})
    kernel.step(0, 0, FRESH, ZERO_CODE + 7, FRESH)
    for repeated in range(1, 30):
        difference = 20 if (repeated - 1) % 4 < 2 else -20
        drive(kernel, [(30, 30 + difference)], code=ZERO_CODE + 7)
        assert bool(kernel.status & StatusBit.GYRO_STUCK) == (repeated >= 20)


# Standstill and offset -------------------------------------------------------------------------

STANDSTILL = {"ticks": 10, "settle_ticks": 5, "block_log2": 4, "max_log2": 6}
FIRST_ESTIMATE = 9 + 5 + 16 + 5  # at rest from the 10th tick: settle, sum, wait
OFFSET_Q = 1 << 16


def test_the_offset_is_learnt_at_rest_and_taken_into_use_only_after_the_wait() -> None:
    kernel = initialised(standstill=STANDSTILL)
    for still_ticks in range(1, FIRST_ESTIMATE + 20):
        drive(kernel, [(0, 0)], code=ZERO_CODE + 40)
        assert bool(kernel.status & StatusBit.STANDSTILL) == (still_ticks >= 10)
        assert bool(kernel.status & StatusBit.OFFSET_VALID) == (still_ticks >= FIRST_ESTIMATE)
        learnt = still_ticks >= FIRST_ESTIMATE
        assert kernel.gyro_offset_q == (ZERO_CODE + 40 * learnt) * OFFSET_Q


def test_the_heading_is_held_at_rest_and_follows_the_corrected_gyro_afterwards() -> None:
    kernel = initialised(standstill=STANDSTILL)
    drive(kernel, [(0, 0)] * 12, code=ZERO_CODE + 40)
    held = kernel.heading_turn_q
    drive(kernel, [(0, 0)] * 100, code=ZERO_CODE + 40)
    assert kernel.heading_turn_q == held
    assert kernel.heading_source == HeadingSource.HELD
    drive(kernel, [(40, 40)] * 50, code=ZERO_CODE + 40)
    assert kernel.heading_turn_q == held  # the bias is gone
    drive(kernel, [(40, 40)] * 50, code=ZERO_CODE + 140)
    assert (kernel.heading_turn_q - held) / Q32 == pytest.approx(5000 * LSB_TURN, abs=2 / Q32)


def test_a_longer_standstill_gives_a_better_estimate() -> None:
    """Means of 16, 32 and 64 codes follow each other; the error shrinks like 1/√n."""
    rng = np.random.default_rng(1)
    spreads = {}
    for ticks, samples in ((40, 16), (60, 32), (95, 64)):
        offsets = []
        for _ in range(200):
            kernel = Kernel(config_of(standstill=STANDSTILL))
            for code in np.rint(ZERO_CODE + 12.3 + rng.normal(0, 15, ticks)).astype(int).tolist():
                kernel.step(0, 0, FRESH, code, FRESH)
            assert kernel.state()["offset_samples_log2"] == samples.bit_length() - 1
            offsets.append(kernel.gyro_offset_q / OFFSET_Q - ZERO_CODE)
        mean, spread = np.mean(offsets), np.std(offsets)
        standard_error = 15 / math.sqrt(samples)
        assert abs(mean - 12.3) < 4 * standard_error / math.sqrt(200)
        assert 0.8 < spread / standard_error < 1.2  # 4 σ of a standard deviation of 200
        spreads[samples] = spread
    assert spreads[64] < spreads[16]


def test_the_offset_is_frozen_in_motion() -> None:
    kernel = initialised(standstill=STANDSTILL)
    drive(kernel, [(0, 0)] * 60, code=ZERO_CODE + 40)
    learnt = kernel.gyro_offset_q
    drive(kernel, [(5, 5)] * 500, code=ZERO_CODE + 900)
    assert kernel.gyro_offset_q == learnt
    assert kernel.status & StatusBit.OFFSET_VALID


def test_samples_taken_just_before_the_robot_moves_are_never_in_an_estimate() -> None:
    """The body turns for `settle_ticks` before the counters show it: no trace in the offset."""
    for rest in range(20, 120):
        kernel = initialised(standstill=STANDSTILL)
        drive(kernel, [(0, 0)] * rest, code=ZERO_CODE + 40)
        drive(kernel, [(0, 0)] * 5, code=ZERO_CODE + 600)
        drive(kernel, [(20, 20)] * 30, code=ZERO_CODE + 600)
        drive(kernel, [(0, 0)] * 18, code=ZERO_CODE + 40)  # too short for an estimate of its own
        offset = kernel.gyro_offset_q / OFFSET_Q
        assert offset in (ZERO_CODE, ZERO_CODE + 40), rest


def test_a_standstill_that_begins_again_starts_a_new_sum() -> None:
    kernel = initialised(standstill=STANDSTILL)
    drive(kernel, [(0, 0)] * 60, code=ZERO_CODE + 40)
    drive(kernel, [(20, 20)] * 10, code=ZERO_CODE + 900)
    drive(kernel, [(0, 0)] * 60, code=ZERO_CODE - 7)
    assert kernel.gyro_offset_q == (ZERO_CODE - 7) * OFFSET_Q


def test_jitter_of_one_tick_about_an_edge_is_still_rest() -> None:
    kernel = initialised(standstill=STANDSTILL)
    drive(kernel, [(1, 0), (-1, 1), (1, -1), (-1, 0)] * 15, code=ZERO_CODE + 40)
    assert kernel.status & StatusBit.OFFSET_VALID
    creeping = initialised(standstill=STANDSTILL)
    drive(creeping, [(1, 1), (0, 0), (0, 0), (0, 0)] * 30, code=ZERO_CODE + 40)
    assert not creeping.status & (StatusBit.OFFSET_VALID | StatusBit.STANDSTILL)


def test_a_robot_turned_by_hand_is_not_at_rest() -> None:
    kernel = initialised(standstill=STANDSTILL)
    too_fast = math.ceil(0.2 / ROBOT.gyro_sensitivity_rad_s_per_lsb) + 1
    drive(kernel, [(0, 0)] * 100, code=ZERO_CODE + too_fast)
    assert not kernel.status & (StatusBit.STANDSTILL | StatusBit.OFFSET_VALID)
    assert turns(kernel) == pytest.approx(100 * too_fast * LSB_TURN, abs=2 / Q32)


def test_an_estimate_that_waits_is_not_pushed_out_by_the_next() -> None:
    """Blocks of one sample come every tick, the wait is twenty: the first still gets its turn."""
    waiting = {"ticks": 1, "settle_ticks": 20, "block_log2": 0, "max_log2": 0}
    kernel = initialised(standstill=waiting)
    drive(kernel, [(0, 0)] * 60, code=ZERO_CODE + 40)
    assert kernel.gyro_offset_q == (ZERO_CODE + 40) * OFFSET_Q


def test_in_a_very_long_standstill_the_estimate_follows_the_drift() -> None:
    kernel = initialised(standstill={**STANDSTILL, "max_log2": 4})
    drive(kernel, [(0, 0)] * 100, code=ZERO_CODE + 40)
    assert kernel.gyro_offset_q == (ZERO_CODE + 40) * OFFSET_Q
    drive(kernel, [(0, 0)] * 60, code=ZERO_CODE + 50)
    assert kernel.gyro_offset_q == (ZERO_CODE + 50) * OFFSET_Q


def test_a_nudge_by_hand_starts_the_wait_for_rest_afresh() -> None:
    kernel = initialised(standstill=STANDSTILL)
    drive(kernel, [(0, 0)] * 9, code=ZERO_CODE)
    drive(kernel, [(0, 0)], code=ZERO_CODE + 5_000)
    drive(kernel, [(0, 0)] * 9, code=ZERO_CODE)
    assert not kernel.status & StatusBit.STANDSTILL
    drive(kernel, [(0, 0)], code=ZERO_CODE)
    assert kernel.status & StatusBit.STANDSTILL


def test_missing_gyro_samples_at_rest_only_delay_the_estimate() -> None:
    kernel = initialised(standstill=STANDSTILL)
    for tick in range(200):
        validity = FRESH if tick % 2 else INVALID
        kernel.step(0, 0, FRESH, ZERO_CODE + 40 if validity == FRESH else 9, validity)
    assert kernel.gyro_offset_q == (ZERO_CODE + 40) * OFFSET_Q


def test_the_lesson_starts_in_motion_so_its_offset_stays_nominal() -> None:
    left, right = swaying_drive(3_000)
    runs = run_batch(config_of(), left[None], right[None], np.full((1, 3_000), ZERO_CODE))
    assert runs.final_states["offset_is_valid"][0] == 0
    assert runs.final_states["gyro_offset_q"][0] == ZERO_CODE * OFFSET_Q


@pytest.mark.parametrize("implementation", ["python", "compiled", "c99"])
def test_an_offset_that_no_code_of_this_gyro_can_be_is_refused(
    implementation: Implementation,
) -> None:
    """Formats are proved for offsets in the gyro's range; beyond it the ways would differ."""
    ten_bits = replace(
        ROBOT,
        gyro_sensitivity_rad_s_per_lsb=0.02,
        gyro_zero_rate_code=512,
        gyro_min_code=1,
        gyro_max_code=1022,
    )
    kernel = Kernel(build_config(FirmwareDescription(), ten_bits), implementation)
    for code in (0.0, 1022.5, 65535.0, float("nan")):
        with pytest.raises(FirmwareError, match=r"expected a code from 1 to 1022"):
            kernel.set_gyro_offset(code)
    kernel.set_gyro_offset(1022.0)
    assert kernel.state()["gyro_offset_q"] == 1022 << 16
