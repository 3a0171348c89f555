"""Accelerometer, thermometer and voltmeter: formulas, noise growth, rails."""

import numpy as np
import pytest
from numpy.typing import NDArray
from quiet_robot import PERIOD_S, drive, held, quiet
from scipy.stats import chi2

from sim_plant import Mechanisms, PlantDescription, PlantRuns

LSB_PER_M_S2 = 16384 / 9.80665


def force_m_s2(runs: PlantRuns, axis: str) -> NDArray[np.float64]:
    code = getattr(runs, f"accel_{axis}_code")
    force: NDArray[np.float64] = (code - 32768) / LSB_PER_M_S2
    return force


HALF_LSB = 0.5 / LSB_PER_M_S2


def test_the_accelerometer_feels_speeding_up_and_the_centripetal_force() -> None:
    v_m_s = np.concatenate([np.linspace(0.2, 1.0, 81), np.full(40, 1.0)])  # 1 m/s², then steady
    runs = drive(np.column_stack([v_m_s, np.full(121, 0.8)]))
    x, y = force_m_s2(runs, "x")[0], force_m_s2(runs, "y")[0]
    assert x[1] == 0.0  # an ideal drive is in motion from the start
    assert np.abs(x[2:82] - 1.0).max() <= HALF_LSB + 1e-9
    assert np.abs(x[82:]).max() <= HALF_LSB + 1e-9
    assert np.abs(y[1:] - 0.8 * v_m_s[:-1]).max() <= HALF_LSB + 1e-9


def test_the_integral_of_the_forward_force_is_the_speed_under_motors_too() -> None:
    runs = drive(held(0.5, 0.0, 301), ideal=False)
    speed = force_m_s2(runs, "x")[0].sum() * PERIOD_S
    assert speed == pytest.approx(0.5, abs=300 * HALF_LSB * PERIOD_S)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_an_accelerometer_bias_is_velocity_bt_and_position_half_bt2(axis: str) -> None:
    bias = Mechanisms(accel_bias_x_m_s2=0.3, accel_bias_y_m_s2=0.3)
    force = force_m_s2(drive(held(0.0, 0.0, 1001), bias), axis)[0, 1:]
    velocity = np.cumsum(force) * PERIOD_S
    position = np.cumsum(velocity - 0.5 * force * PERIOD_S) * PERIOD_S
    assert velocity[-1] == pytest.approx(0.3 * 10, abs=HALF_LSB * 10)
    assert position[-1] == pytest.approx(0.5 * 0.3 * 100, abs=HALF_LSB * 50)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_accelerometer_noise_has_its_density(axis: str, size: str) -> None:
    runs = 4000 if size == "full" else 400
    noisy = Mechanisms(accel_noise_m_s2_per_sqrt_hz=0.05)
    force = force_m_s2(drive(held(0.0, 0.0, 201), noisy, seeds=range(runs)), axis)[:, 1:]
    velocity = force.sum(axis=1) * PERIOD_S
    low, high = chi2.ppf([5e-5, 1 - 5e-5], runs) / runs
    # law 12: velocity variance density²·t; rounding adds 1/12 LSB² a sample, below 1e-6 of it
    assert low < (velocity @ velocity) / runs / (0.05**2 * 2.0) < high


def test_the_axes_noise_is_independent() -> None:
    noisy = Mechanisms(accel_noise_m_s2_per_sqrt_hz=0.05)
    runs = drive(held(0.0, 0.0, 10_001), noisy)
    correlation = np.corrcoef(force_m_s2(runs, "x")[0], force_m_s2(runs, "y")[0])[0, 1]
    assert abs(correlation) < 4.5 / np.sqrt(10_001)


def test_the_accelerometer_clips_at_its_range_and_the_adc_at_its_rail() -> None:
    pushed = Mechanisms(accel_bias_x_m_s2=50.0, accel_bias_y_m_s2=-50.0)
    runs = drive(held(0.0, 0.0, 3), pushed)
    # ±2 g at 16384 LSB per g about 32768: 0 and 65536, one beyond the rail
    assert runs.accel_x_code is not None
    assert runs.accel_y_code is not None
    assert runs.accel_x_code[0].tolist() == [65535] * 3
    assert runs.accel_y_code[0].tolist() == [0] * 3
    narrow = drive(
        held(0.0, 0.0, 3), pushed, description=quiet(accelerometer={"range_m_s2": 9.80665})
    )
    assert narrow.accel_x_code is not None
    assert narrow.accel_x_code[0].tolist() == [32768 + 16384] * 3


def test_the_thermometer_reads_a_warming_robot() -> None:
    warming = Mechanisms(
        temperature_offset_k=-5.0, temperature_rise_k=20.0, temperature_time_constant_s=2.0
    )
    code = drive(held(0.0, 0.0, 501), warming).temperature_code
    assert code is not None
    time_s = PERIOD_S * np.arange(501)
    expected = 32768 + 340 * (-5.0 + 20.0 * (1 - np.exp(-time_s / 2.0)))
    assert np.abs(code[0] - expected).max() <= 0.5 + 1e-6


def test_the_voltmeter_reads_a_sagging_battery_down_to_nothing() -> None:
    sagging = Mechanisms(supply_offset_v=-2.0, supply_drift_v_per_s=-4.0)
    code = drive(held(0.0, 0.0, 501), sagging).supply_code
    assert code is not None
    expected = 4096 * np.maximum(10.0 - 4.0 * PERIOD_S * np.arange(501), 0.0)
    assert np.abs(code[0] - expected).max() <= 0.5 + 1e-6


@pytest.mark.parametrize(
    ("table", "field", "name", "sigma_lsb"),
    [
        ("temperature", "noise_k", "temperature_code", 340 * 0.5),
        ("supply", "noise_v", "supply_code", 4096 * 0.05),
    ],
)
def test_slow_sensors_hiss_as_described(
    table: str, field: str, name: str, sigma_lsb: float
) -> None:
    level = {"noise_k": 0.5, "noise_v": 0.05}[field]
    described = PlantDescription.from_tables({table: {field: level}})
    code = getattr(drive(held(0.0, 0.0, 20_000), description=described), name)[0]
    low, high = chi2.ppf([5e-5, 1 - 5e-5], 20_000) / 20_000
    assert low < code.var() / (sigma_lsb**2 + 1 / 12) < high
