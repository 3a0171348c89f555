"""All effects: each one shows, together they run, and at neutral they change nothing."""

from typing import Any

import numpy as np
import pytest
from effect_drives import Drive, rich_commands, run
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hil_harness.effects import Settings, apply_effects, catalogue, parse_effect
from sim_plant import PlantDescription

SIZES = {
    "drive_gain": "left=0.02",
    "drive_deadband": "rate=3",
    "drive_saturation": "limit=8",
    "drive_acceleration_limit": "limit=4",
    "drive_lag": "time_constant=0.2",
    "drive_delay": "delay=0.1",
    "drive_cogging": "amplitude=0.05",
    "backlash": "width=0.02",
    "radius_scale": "scale=0.01",
    "radius_mismatch": "mismatch=0.005",
    "wheelbase_scale": "scale=0.01",
    "turn_scrub": "scrub=0.1",
    "payload": "compression_left=0.005",
    "tyre_drift": "rate=0.0005",
    "wheel_eccentricity": "amplitude=0.02",
    "wheel_toe": "angle=0.01",
    "one_sided_slip": "ratio=0.05",
    "longitudinal_slip": "compliance=0.05",
    "lateral_slip": "compliance=0.02",
    "cross_slope_drift": "ratio=0.01",
    "grade_slip": "ratio=0.01",
    "caster_kick": "angle=0.02",
    "floor_bump": "time=5 yaw=0.02",
    "contact_offset": "left=0.0001",
    "micro_slip": "left=0.001",
    "ticks_per_rev": "scale=0.01",
    "encoder_eccentricity": "amplitude=0.02",
    "missed_ticks": "probability=0.05",
    "extra_ticks": "rate=20",
    "quadrature_phase": "error=0.5",
    "encoder_wrap": "bits=8",
    "encoder_dead": "start_s=5",
    "gyro_bias": "bias=0.01",
    "gyro_bias_walk": "density=0.001",
    "gyro_noise": "density=0.001",
    "gyro_scale": "scale=0.01",
    "gyro_nonlinearity": "cubic=0.01",
    "gyro_asymmetry": "asymmetry=0.01",
    "gyro_g_sensitivity": "y=0.01",
    "gyro_tilt": "roll=0.1",
    "gyro_temperature_bias": "slope=0.001",
    "gyro_temperature_scale": "slope=0.001",
    "gyro_saturation": "limit=1",
    "gyro_lag": "time_constant=0.02",
    "gyro_vibration": "coefficient=0.0001",
    "gyro_frozen": "start_s=4 stop_s=6",
    "adc_offset": "offset=50",
    "adc_gain": "gain=0.01",
    "adc_inl": "peak=40",
    "adc_missing_code": "code=32768",
    "adc_stuck_bit": "bit=5 value=1",
    "supply_ratio": "coefficient=1",
    "accelerometer_bias": "x=0.1",
    "accelerometer_noise": "density=0.01",
    "warm_up": "offset=5",
    "supply_change": "offset=-1",
    "clock_skew": "skew=0.01",
}  # fmt: skip


def settings_of(name: str) -> list[str]:
    return [f"{name}.{part}" for part in SIZES[name].split()]


def outputs(seen: Drive) -> list[NDArray[Any]]:
    runs = seen.runs
    columns: list[NDArray[Any] | None] = [
        runs.truth,
        runs.left_count,
        runs.right_count,
        runs.gyro_code,
        runs.accel_x_code,
        runs.accel_y_code,
        runs.temperature_code,
        runs.supply_code,
    ]
    return [column for column in columns if column is not None]


def same(one: Drive, other: Drive) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(outputs(one), outputs(other), strict=True))


def test_every_effect_of_the_plant_has_a_size_here() -> None:
    elsewhere = ("bus", "firmware", "reference", "setup")
    of_plant = [name for name, e in catalogue().items() if e.stage not in elsewhere]
    assert sorted(SIZES) == sorted([*of_plant, "clock_skew"])


@pytest.mark.parametrize("name", list(SIZES))
def test_every_effect_shows_in_the_data(name: str) -> None:
    # What follows temperature or supply shows where these are not as described.
    surroundings = ["warm_up.rise=10", "supply_change.rate=-0.01"]
    others = [text for text in surroundings if not text.startswith(name)]
    commands = rich_commands()
    without = run(*others, commands=commands, drive="motor")
    assert not same(without, run(*others, *settings_of(name), commands=commands, drive="motor"))


def test_at_neutral_all_effects_together_change_nothing_bit_for_bit() -> None:
    neutral = [
        f"{effect.name}.{parameter.name}={parameter.neutral}"
        for effect in catalogue().values()
        for parameter in effect.parameters
    ]
    assert apply_effects(parse_effect(text) for text in neutral) == Settings()
    commands, robot = rich_commands(), PlantDescription()
    untouched = run(commands=commands, drive="motor", robot=robot)
    assert same(untouched, run(*neutral, commands=commands, drive="motor", robot=robot))


@hypothesis_settings(max_examples=30)
@given(st.sets(st.sampled_from(sorted(SIZES)), min_size=2), st.integers(0, 2**64 - 1))
def test_any_effects_run_together(names: set[str], seed: int) -> None:
    texts = [text for name in sorted(names) for text in settings_of(name)]
    seen = run(*texts, commands=rich_commands()[::3], drive="motor", seed=seed)
    assert np.all(np.isfinite(seen.pose))
