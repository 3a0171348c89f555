"""Wheel angles to counts: staircases, wraps, noise, and where rounding is uniform noise."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from quiet_robot import PERIOD_S, RADIUS_M, TICKS_PER_RAD, drive, held, quiet, unwrapped
from scipy.stats import chi2

from sim_plant import Mechanisms

TICKS_PER_M = TICKS_PER_RAD / RADIUS_M


@pytest.mark.parametrize("v_m_s", [0.001, -0.001, 0.0])
def test_the_count_of_a_slow_wheel_is_the_floor_of_its_ticks(v_m_s: float) -> None:
    count = unwrapped(drive(held(v_m_s, 0.0, 4001)).left_count)[0]
    ticks = v_m_s * PERIOD_S * np.arange(4001) * TICKS_PER_M
    count += np.int64(np.floor(ticks[1])) if v_m_s < 0 else 0  # the first step falls below 0
    # a running sum of 4001 equal steps may miss a whole tick by an ulp on either side
    away = np.abs(ticks - np.rint(ticks)) > 1e-9
    assert np.array_equal(
        (count - count[1])[away], (np.floor(ticks) - np.floor(ticks[1])).astype(int)[away]
    )
    assert set(np.diff(count[1:]).tolist()) <= {0, 1 if v_m_s > 0 else -1}


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("v_m_s", [2.0, -2.0])
def test_a_counter_wraps_at_its_width_and_nothing_else_changes(bits: int, v_m_s: float) -> None:
    commands = held(v_m_s, 0.0, 800)  # 16 m: 104 000 ticks
    wide = drive(commands).right_count[0]
    narrow = drive(commands, description=quiet(encoder={"counter_bits": bits})).right_count[0]
    assert np.array_equal(narrow, wide % 2**bits)
    assert wide.min() >= 0
    assert wide.max() <= 65535
    assert (np.abs(np.diff(wide)) > 32768).any()


@given(scale=st.floats(-0.05, 0.05))
def test_ticks_scale_stretches_the_count(scale: float) -> None:
    count = unwrapped(drive(held(0.5, 0.0, 301), Mechanisms(ticks_scale=scale)).left_count)[0, -1]
    assert abs(count - 1.5 * TICKS_PER_M * (1 + scale)) <= 1


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_eccentric_encoder_wobbles_once_a_turn_in_its_own_count(side: str) -> None:
    amplitude, phase = 0.05, 0.4
    on: dict[str, Any] = {
        f"encoder_eccentricity_{side}_rad": amplitude,
        f"encoder_eccentricity_phase_{side}_rad": phase,
    }
    runs = drive(held(0.5, 0.0, 301), Mechanisms(**on))
    angle = 0.5 * PERIOD_S * np.arange(301) / RADIUS_M
    shown = (angle + amplitude * np.sin(angle + phase)) * TICKS_PER_RAD
    count = getattr(runs, f"{side}_count")[0]
    assert np.abs(count - (shown - 0.5)).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_dead_encoder_keeps_its_last_count(side: str) -> None:
    on: dict[str, Any] = {f"encoder_dead_{side}_s": 1.0}
    dead = getattr(drive(held(0.5, 0.0, 301), Mechanisms(**on)), f"{side}_count")[0]
    alive = getattr(drive(held(0.5, 0.0, 301)), f"{side}_count")[0]
    assert np.array_equal(dead[:100], alive[:100])
    assert set(dead[100:].tolist()) == {alive[99]}


def test_the_counters_noise_is_white_on_the_count(size: str) -> None:
    runs = 4000 if size == "full" else 400
    noisy = quiet(encoder={"noise_ticks": 3.0})
    commands = held(0.37, 0.0, 200)
    count = unwrapped(drive(commands, description=noisy, seeds=range(runs)).left_count)
    ticks = 0.37 * PERIOD_S * np.arange(200) * TICKS_PER_M
    # from the first reading on, which carries noise too; floor takes 1/2 off each reading
    error = count - ticks - (count - ticks).mean(axis=1, keepdims=True)
    variance = (error**2).sum(axis=1) / 199
    # noise plus rounding, 1/12; independent from tick to tick
    expected = 9.0 + 1.0 / 12.0
    low, high = chi2.ppf([5e-5, 1 - 5e-5], runs * 199) / (runs * 199)
    assert low < variance.mean() / expected < high
    lag_one = (error[:, 1:] * error[:, :-1]).mean() / expected
    assert abs(lag_one + 1 / 200) < 4.5 / np.sqrt(runs * 199)


def test_rounding_is_uniform_noise_under_a_moving_rate(size: str) -> None:
    ticks = 100_000 if size == "full" else 20_000
    time_s = PERIOD_S * np.arange(ticks)
    v_m_s = 0.6 + 0.2 * np.sin(2 * np.pi * time_s / 7.3)
    runs = drive(np.column_stack([v_m_s, np.zeros(ticks)]))
    true = np.concatenate([[0.0], np.cumsum(v_m_s[:-1] * PERIOD_S)]) * TICKS_PER_M
    fraction = true - unwrapped(runs.left_count)[0]
    # law 8: mean 1/2 (floor), variance Δ²/12; a moving rate makes the fractions all but independent
    assert fraction.mean() == pytest.approx(0.5, abs=4.5 * np.sqrt(1 / 12 / ticks))
    # variance of a sample variance of a uniform: (1/80 − 1/144)/n
    assert fraction.var() == pytest.approx(1 / 12, abs=4.5 * np.sqrt((1 / 80 - 1 / 144) / ticks))


@pytest.mark.parametrize("v_m_s", [0.0, 40 / PERIOD_S / TICKS_PER_M])
def test_the_uniform_model_fails_at_rest_and_at_whole_ticks_a_step(v_m_s: float) -> None:
    runs = drive(held(v_m_s, 0.0, 1000))
    true = v_m_s * PERIOD_S * np.arange(1000) * TICKS_PER_M
    fraction = (true - unwrapped(runs.left_count)[0] + 1e-6) % 1.0
    assert fraction.var() < 1e-12


def test_the_lessons_counter_carries_the_rounded_increments() -> None:
    count = unwrapped(drive(held(0.6, 0.0, 101), encoder_model="lesson_counter").left_count)[0]
    increment = np.rint(0.6 * PERIOD_S * TICKS_PER_M)
    assert np.array_equal(count, increment * np.arange(101))


def test_the_lessons_counter_rounds_the_running_sum_half_to_even() -> None:
    noisy = quiet(encoder={"noise_ticks": 0.2})
    runs = drive(
        held(0.6, 0.3, 3000),
        description=noisy,
        seeds=[11],
        encoder_model="lesson_counter",
        noise="lesson",
    )
    draws = np.random.default_rng(11).standard_normal((2999, 3))
    for column, side, v_m_s in (
        (0, "right", 0.6 + 0.15 * 0.2985),
        (1, "left", 0.6 - 0.15 * 0.2985),
    ):
        steps = np.rint(v_m_s * PERIOD_S * TICKS_PER_M) + 0.2 * draws[:, column]
        expected = np.rint(np.concatenate([[0.0], np.cumsum(steps)]))
        count = unwrapped(getattr(runs, f"{side}_count"))[0]
        assert np.array_equal(count, expected)
