"""Yaw rate to code: each term of the chain, the noises' growth, and the converter."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from quiet_robot import PERIOD_S, RADIUS_M, WHEELBASE_M, drive, held, quiet
from scipy.stats import chi2

from sim_plant import Mechanisms, simulate
from sim_plant.adc import to_code
from sim_plant.records import build_parameters

RATES = st.floats(-3.0, 3.0)
LSB_PER_RAD_S = 131 * 180 / math.pi
ZERO = 32768


def rate_of(mechanisms: Mechanisms, w_rad_s: float, v_m_s: float = 0.0) -> float:
    """Return what the gyro reads in a steady turn [rad/s]."""
    rates = drive(held(v_m_s, w_rad_s, 40), mechanisms).gyro_rate_rad_s
    assert rates is not None
    return float(rates[0, -1])


def codes_of(mechanisms: Mechanisms, w_rad_s: NDArray[np.float64], **tables: Any) -> list[int]:
    """Return the codes of a run of rates, without tick 0."""
    commands = np.column_stack([np.zeros(len(w_rad_s) + 1), np.append(w_rad_s, 0.0)])
    code: list[int] = drive(commands, mechanisms, description=quiet(**tables)).gyro_code[0].tolist()
    return code[1:]


@given(w=RATES)
def test_a_neutral_gyro_reads_the_mean_rate_of_the_tick(w: float) -> None:
    assert rate_of(Mechanisms(), w) == pytest.approx(w, abs=1e-13)


@given(w=RATES, x=st.floats(-0.04, 0.04))
def test_bias_scale_and_bends_act_by_their_formulas(w: float, x: float) -> None:
    for mechanisms, expected in (
        (Mechanisms(gyro_bias_rad_s=x), w + x),
        (Mechanisms(gyro_scale=x), w * (1 + x)),
        (Mechanisms(gyro_quadratic_s_per_rad=x), w + x * w * abs(w)),
        (Mechanisms(gyro_cubic_s2_per_rad2=x), w + x * w**3),
        (Mechanisms(gyro_asymmetry=x), w + 0.5 * x * abs(w)),
        (Mechanisms(gyro_roll_rad=x, gyro_pitch_rad=0.2), w * math.cos(x) * math.cos(0.2)),
    ):
        assert rate_of(mechanisms, w) == pytest.approx(expected, abs=1e-12)


@given(w=st.floats(-2.0, 2.0))
def test_temperature_and_supply_move_bias_and_scale(w: float) -> None:
    world: dict[str, Any] = {"temperature_offset_k": 8.0, "supply_offset_v": -1.2}
    cases: tuple[tuple[dict[str, Any], float], ...] = (
        ({"gyro_temperature_bias_rad_s_per_k": 1e-3}, w + 8e-3),
        ({"gyro_temperature_scale_per_k": 1e-3}, w * 1.008),
        ({"supply_ratio": 0.5}, w * (1 + 0.5 * (10.8 / 12 - 1))),
    )
    for moved, expected in cases:
        assert rate_of(Mechanisms(**world, **moved), w) == pytest.approx(expected, abs=1e-12)


def test_g_sensitivity_follows_the_specific_force() -> None:
    turning = rate_of(Mechanisms(gyro_g_sensitivity_y_s_per_m=0.01), 0.5, v_m_s=0.8)
    assert turning == pytest.approx(0.5 + 0.01 * 0.8 * 0.5, abs=1e-12)
    commands = np.column_stack([np.linspace(0.0, 0.2, 41), np.zeros(41)])  # 0.5 m/s²
    rates = drive(commands, Mechanisms(gyro_g_sensitivity_x_s_per_m=0.01)).gyro_rate_rad_s
    assert rates is not None
    assert rates[0, 2:] == pytest.approx(np.full(39, 0.005), abs=1e-12)


def test_vibration_is_zero_at_rest_and_grows_with_the_wheels_squares() -> None:
    shaken = Mechanisms(gyro_vibration_s_per_rad=1e-4)
    assert rate_of(shaken, 0.0) == 0.0
    left, right = ((0.5 + side * 0.2 * WHEELBASE_M / 2) / RADIUS_M for side in (-1, 1))
    expected = 0.2 + 1e-4 * (left**2 + right**2) / 2
    assert rate_of(shaken, 0.2, v_m_s=0.5) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("lag_s", [0.004, 0.1])
def test_a_lagging_gyro_answers_a_step_exponentially(lag_s: float) -> None:
    rates = drive(held(0.0, 1.0, 60), Mechanisms(gyro_lag_s=lag_s)).gyro_rate_rad_s
    assert rates is not None
    # The angle that a first-order filter shows at each tick; a sample is its mean rate since then.
    time_s = np.arange(60) * PERIOD_S
    angle_rad = time_s - lag_s * (1 - np.exp(-time_s / lag_s))
    assert rates[0, 1:] == pytest.approx(np.diff(angle_rad) / PERIOD_S, abs=1e-12)


@pytest.mark.parametrize("lag_s", [0.004, 0.1])
@pytest.mark.parametrize("period_us", [1000, 5000, 10_000])
def test_the_heading_of_a_lagging_gyro_trails_by_the_lag_at_any_tick(
    lag_s: float, period_us: int
) -> None:
    commands = held(0.0, 1.0, 2_000_000 // period_us)
    cases = [Mechanisms(), Mechanisms(gyro_lag_s=lag_s)]
    rates = simulate(quiet(), cases, commands, [1, 1], tick_period_us=period_us).gyro_rate_rad_s
    assert rates is not None
    lost = (rates[0] - rates[1]).sum() * period_us * 1e-6
    assert lost == pytest.approx(lag_s, rel=1e-6)


@given(limit=st.floats(0.1, 10.0), w=st.floats(-8.0, 8.0))
def test_the_rate_clips_at_the_smaller_of_described_range_and_saturation(
    limit: float, w: float
) -> None:
    smaller = min(limit, 4.363323)
    expected = min(max(w, -smaller), smaller)
    assert rate_of(Mechanisms(gyro_saturation_rad_s=limit), w) == pytest.approx(expected, abs=1e-12)


def test_the_mean_heading_error_of_a_bias_is_bias_times_time() -> None:
    rates = drive(held(0.5, 0.1, 1001), Mechanisms(gyro_bias_rad_s=0.005)).gyro_rate_rad_s
    assert rates is not None
    drift = (rates[0, 1:].sum() - 0.1 * 1000) * PERIOD_S
    assert drift == pytest.approx(0.005 * 10.0, abs=1e-11)


def angles_after(mechanisms: Mechanisms, period_us: int, steps: int, runs: int) -> Any:
    """Return the integrated gyro of many runs at rest [rad]."""
    rates = simulate(
        quiet(), mechanisms, held(0.0, 0.0, steps + 1), range(runs), tick_period_us=period_us
    ).gyro_rate_rad_s
    assert rates is not None
    return rates[:, 1:].sum(axis=1) * period_us / 1e6


@pytest.mark.parametrize("period_us", [2_500, 10_000])
def test_noise_and_bias_walk_have_their_densities_at_any_rate(period_us: int, size: str) -> None:
    runs = 4000 if size == "full" else 400
    seconds = 2.0
    steps = round(seconds * 1e6 / period_us)
    # both tails together one in 10 000
    low, high = chi2.ppf([5e-5, 1 - 5e-5], runs) / runs

    # angle random walk: variance density²·t after time t
    angle = angles_after(Mechanisms(gyro_noise_rad_per_sqrt_s=0.003), period_us, steps, runs)
    assert low < (angle @ angle) / runs / (0.003**2 * seconds) < high

    # walk of the rate: density²·t³/3, which a sum of n steps exceeds by the factor (1+1/n)(1+1/2n)
    angle = angles_after(Mechanisms(gyro_bias_walk_rad_s_per_sqrt_s=0.01), period_us, steps, runs)
    variance = 0.01**2 * seconds**3 / 3 * (1 + 1 / steps) * (1 + 0.5 / steps)
    assert low < (angle @ angle) / runs / variance < high


def test_noise_levels_are_the_larger_of_described_and_given() -> None:
    described = quiet(gyro={"noise_density_rad_per_sqrt_s": 0.002})
    commands = held(0.0, 0.0, 50)
    plain = drive(commands, description=described).gyro_rate_rad_s
    below = drive(
        commands, Mechanisms(gyro_noise_rad_per_sqrt_s=0.001), description=described
    ).gyro_rate_rad_s
    above = drive(
        commands, Mechanisms(gyro_noise_rad_per_sqrt_s=0.004), description=described
    ).gyro_rate_rad_s
    assert plain is not None
    assert below is not None
    assert above is not None
    assert np.array_equal(plain, below)
    assert above == pytest.approx(2 * plain, rel=1e-12)


def test_the_code_is_the_nearest_to_the_described_line() -> None:
    w = np.linspace(-4.0, 4.0, 997)
    codes = np.array(codes_of(Mechanisms(), w))
    assert np.abs(codes - (ZERO + LSB_PER_RAD_S * w)).max() <= 0.5 + 1e-6


def test_the_adc_clips_only_at_its_rails() -> None:
    wide = {"range_rad_s": 100.0}
    w = np.array([-50.0, -4.3632, -4.3629, 0.0, 4.3629, 4.3632, 50.0])
    codes = codes_of(Mechanisms(), w, gyro=wide)
    level = np.floor(ZERO + LSB_PER_RAD_S * w + 0.5)
    assert (level < 0).sum() == 1
    assert (level > 65535).sum() == 1
    assert codes == np.clip(level, 0, 65535).astype(int).tolist()


@given(bits=st.integers(8, 16), level=st.floats(-1e18, 1e18))
def test_any_level_becomes_a_code_between_the_rails(bits: int, level: float) -> None:
    tables = {
        "adc": {"bits": bits},
        "gyro": {"zero_rate_code": 1},
        "accelerometer": {"zero_code": 1},
        "temperature": {"code_at_298_k": 1},
    }
    p = build_parameters(
        quiet(**tables), Mechanisms(), tick_s=0.01, drive_model="motor", encoder_model="counter"
    ).view(np.recarray)[0]
    code = to_code.py_func(p, level)
    top = 2**bits - 1
    assert code == min(max(math.floor(level + 0.5), 0), top)


def test_rounding_of_a_sweeping_rate_is_uniform_noise_of_one_lsb(size: str) -> None:
    count = 100_000 if size == "full" else 20_000
    w = 2.0 * np.sin(np.arange(count) * 0.01)
    error = np.array(codes_of(Mechanisms(), w)) - (ZERO + LSB_PER_RAD_S * w)
    assert error.mean() == pytest.approx(0.0, abs=4.5 * np.sqrt(1 / 12 / count))
    assert error.var() == pytest.approx(1 / 12, abs=4.5 * np.sqrt((1 / 80 - 1 / 144) / count))


SWEEP = np.linspace(-0.02, 0.02, 401)  # 300 codes about the middle
PLAIN = np.array(codes_of(Mechanisms(), SWEEP))


def test_adc_offset_shifts_every_code() -> None:
    assert np.array_equal(np.array(codes_of(Mechanisms(adc_offset_lsb=7.0), SWEEP)), PLAIN + 7)


def test_adc_gain_turns_about_the_described_zero_rate_code() -> None:
    w = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    gained = codes_of(Mechanisms(adc_gain=0.01), w)
    assert gained == np.floor(ZERO + 1.01 * LSB_PER_RAD_S * w + 0.5).astype(int).tolist()


def test_adc_inl_bows_by_its_peak_in_the_middle_and_nothing_at_the_rails() -> None:
    w = np.array([-4.363323, 0.0, 4.363323])
    plain = np.array(codes_of(Mechanisms(), w))
    bowed = np.array(codes_of(Mechanisms(adc_inl_lsb=20.0), w))
    assert (bowed - plain).tolist() == [0, 20, 0]


def test_a_missing_code_never_appears_and_the_next_stands_for_it() -> None:
    missing = PLAIN[150]
    codes = np.array(codes_of(Mechanisms(adc_missing_code=int(missing)), SWEEP))
    assert missing not in codes
    assert np.array_equal(codes, np.where(missing == PLAIN, missing + 1, PLAIN))


@pytest.mark.parametrize("bit", [0, 3, 15])
@pytest.mark.parametrize("value", [0, 1])
def test_a_stuck_bit_keeps_its_value(bit: int, value: int) -> None:
    codes = np.array(codes_of(Mechanisms(adc_stuck_bit=bit, adc_stuck_value=value), SWEEP))
    assert np.array_equal(codes, PLAIN | (1 << bit) if value else PLAIN & ~(1 << bit))


def test_a_frozen_gyro_repeats_its_code_and_recovers() -> None:
    frozen = Mechanisms(gyro_frozen_start_s=1.0, gyro_frozen_stop_s=2.0)
    codes = np.array(codes_of(frozen, SWEEP))
    assert np.array_equal(codes[:99], PLAIN[:99])  # codes[0] is tick 1
    assert set(codes[99:199].tolist()) == {PLAIN[98]}
    assert np.array_equal(codes[199:], PLAIN[199:])
