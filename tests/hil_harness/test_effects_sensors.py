"""Each effect on encoder, gyro, converter and the other sensors shows in the counts and codes."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from effect_drives import (
    CODE_RAD_S,
    QUIET,
    RADIUS_M,
    TICK_M,
    TICK_S,
    TICK_US,
    TILT,
    run,
)

from hil_harness.effects import apply_effects, parse_effect
from sim_plant import PlantDescription, simulate

# --- encoder ---------------------------------------------------------------------------------


def test_a_dead_encoder_freezes_its_count_for_good() -> None:
    seen = run("encoder_dead.side=right", "encoder_dead.start_s=4", v=0.5)
    assert seen.tick_steps("right")[401:].sum() == 0
    assert seen.tick_steps("right")[:399].sum() > 0
    assert seen.ticks("left") * TICK_M == pytest.approx(5.0, abs=2 * TICK_M)


# --- gyro and converter ----------------------------------------------------------------------


def mean_rate(
    *effects: str, w: float = 0.5, v: float = 0.0, robot: PlantDescription = QUIET
) -> float:
    """Return the mean rate by the described sensitivity, after the first second."""
    return float(run(*effects, v=v, w=w, robot=robot).codes[100:].mean() * CODE_RAD_S)


@pytest.mark.parametrize("w", [0.5, -0.5, 0.0])
@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        (["gyro_bias.bias=0.01"], lambda w: w + 0.01),
        (["gyro_scale.scale=0.02"], lambda w: w * 1.02),
        (["gyro_nonlinearity.quadratic=0.1"], lambda w: w + 0.1 * w * abs(w)),
        (["gyro_nonlinearity.cubic=0.1"], lambda w: w + 0.1 * w**3),
        (["gyro_asymmetry.asymmetry=0.02"], lambda w: w + 0.01 * abs(w)),
        (["gyro_tilt.roll=0.1"], lambda w: w * math.cos(0.1)),
        (["gyro_tilt.pitch=0.2", "gyro_tilt.roll=0.1"], lambda w: w * TILT),
        (["gyro_saturation.limit=0.3"], lambda w: max(min(w, 0.3), -0.3)),
        (["gyro_temperature_bias.slope=0.001", "warm_up.offset=10"], lambda w: w + 0.01),
        (["gyro_temperature_scale.slope=0.001", "warm_up.offset=10"], lambda w: w * 1.01),
        (["supply_ratio.coefficient=0.5", "supply_change.offset=1.2"], lambda w: w * 1.05),
        (["gyro_lag.time_constant=0.05"], lambda w: w),
        (["adc_offset.offset=100"], lambda w: w + 100 * CODE_RAD_S),
        (["adc_gain.gain=0.02"], lambda w: w * 1.02),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)  # fmt: skip
def test_a_steady_turn_is_measured_as_the_effect_says(
    effects: list[str], expected: Callable[[float], float], w: float
) -> None:
    assert mean_rate(*effects, w=w) == pytest.approx(expected(w), abs=0.6 * CODE_RAD_S)


def test_integral_nonlinearity_follows_the_code() -> None:
    peak = 40.0
    for w in (-1.0, 0.0, 1.0):
        code = QUIET.gyro.zero_rate_code + w / CODE_RAD_S
        expected = w + peak * math.sin(math.pi * code / 65535) * CODE_RAD_S
        assert mean_rate(f"adc_inl.peak={peak}", w=w) == pytest.approx(expected, abs=CODE_RAD_S)


def test_a_bend_to_the_left_pushes_left_and_speeding_up_pushes_forward() -> None:
    # a_y = v·ω: the body is accelerated towards the centre of its bend.
    bend = mean_rate("gyro_g_sensitivity.y=0.01", v=0.5, w=0.4)
    assert bend == pytest.approx(0.4 + 0.01 * 0.5 * 0.4, abs=CODE_RAD_S)
    up = np.column_stack([np.arange(201) * TICK_S * 0.5, np.zeros(201)])
    codes = run("gyro_g_sensitivity.x=0.01", commands=up).codes
    assert codes[5:200].mean() * CODE_RAD_S == pytest.approx(0.01 * 0.5, abs=CODE_RAD_S)


def test_vibration_is_a_bias_that_grows_with_the_wheels_and_is_gone_at_rest() -> None:
    wheel_rate = 0.5 / RADIUS_M
    driven = mean_rate("gyro_vibration.coefficient=0.0001", v=0.5, w=0.0)
    assert driven == pytest.approx(0.0001 * wheel_rate**2, rel=0.02)
    assert mean_rate("gyro_vibration.coefficient=0.0001", w=0.0) == 0.0


def test_a_lagging_gyro_trails_a_turn_that_begins() -> None:
    codes = run("gyro_lag.time_constant=0.1", w=0.5).codes * CODE_RAD_S
    assert codes[10] == pytest.approx(0.5 * (1 - math.exp(-1)), rel=0.06)
    lost = 0.5 * 10.0 - codes[1:].sum() * TICK_S
    assert lost == pytest.approx(0.5 * 0.1, rel=0.06)


def test_a_frozen_gyro_repeats_its_code_inside_the_window() -> None:
    wobble = np.column_stack([np.zeros(1001), np.sin(np.arange(1001) * 0.05)])
    codes = run("gyro_frozen.start_s=3", "gyro_frozen.stop_s=5", commands=wobble).codes
    assert np.ptp(codes[301:500]) == 0
    assert np.ptp(codes[101:300]) > 0
    assert np.ptp(codes[502:700]) > 0


def test_a_stuck_bit_is_the_same_in_every_code() -> None:
    wobble = np.column_stack([np.zeros(1001), np.sin(np.arange(1001) * 0.05)])
    for value in (0, 1):
        effects = ("adc_stuck_bit.bit=4", f"adc_stuck_bit.value={value}")
        seen = run(*effects, commands=wobble).runs.gyro_code[0]
        assert set((seen >> 4 & 1).tolist()) == {value}


def test_a_missing_code_never_appears_and_its_upper_neighbour_stands_for_it() -> None:
    zero = QUIET.gyro.zero_rate_code
    seen = run(f"adc_missing_code.code={zero}").runs.gyro_code[0]
    assert set(seen.tolist()) == {zero + 1}


def test_noise_levels_are_densities() -> None:
    # 10 000 samples: the spread of a spread is 0.7 %; five of those.
    still = run("gyro_noise.density=0.0005", seconds=100.0)
    assert np.std(still.codes[1:]) * CODE_RAD_S == pytest.approx(0.0005 * 10, rel=0.035)
    moving = run("accelerometer_noise.density=0.01", seconds=100.0).runs.accel_x_code
    assert moving is not None
    sensitivity = QUIET.accelerometer.sensitivity_lsb_per_m_s2
    assert np.std(moving[0, 1:]) / sensitivity == pytest.approx(0.01 * 10, rel=0.035)


def test_a_walking_bias_spreads_as_the_root_of_time() -> None:
    # 200 runs: the spread of a spread is 5 %; four of those.
    plant = apply_effects([parse_effect("gyro_bias_walk.density=0.001")]).plant
    runs = simulate(
        QUIET, plant, np.zeros((2501, 2)), list(range(200)), tick_period_us=TICK_US, drive="ideal"
    )
    spread = np.std(runs.gyro_code[:, -1]) * CODE_RAD_S
    assert spread == pytest.approx(0.001 * math.sqrt(25.0), rel=0.2)


def test_a_biased_accelerometer_reads_high() -> None:
    seen = run("accelerometer_bias.x=0.2", "accelerometer_bias.y=-0.1").runs
    accelerometer = QUIET.accelerometer
    for codes, bias in ((seen.accel_x_code, 0.2), (seen.accel_y_code, -0.1)):
        assert codes is not None
        measured = (codes[0, 5:] - accelerometer.zero_code) / accelerometer.sensitivity_lsb_per_m_s2
        assert measured == pytest.approx(bias, abs=1 / accelerometer.sensitivity_lsb_per_m_s2)


def test_warming_up_and_a_sinking_battery_show_in_their_own_signals() -> None:
    effects = ("warm_up.rise=20", "warm_up.time_constant=5", "supply_change.rate=-0.05")
    seen = run(*effects).runs
    assert seen.temperature_code is not None
    assert seen.supply_code is not None
    warmer_k = (seen.temperature_code[0, -1] - 32768) / QUIET.temperature.sensitivity_lsb_per_k
    assert warmer_k == pytest.approx(20 * (1 - math.exp(-2)), abs=0.01)
    sunk_v = seen.supply_code[0, -1] / QUIET.supply.sensitivity_lsb_per_v - 12.0
    assert sunk_v == pytest.approx(-0.5, abs=0.001)
