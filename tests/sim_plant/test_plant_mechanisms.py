"""Mechanisms: neutral ones change nothing, every other one acts, and only where it says."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from quiet_robot import PERIOD_US, held

from sim_plant import Mechanisms, PlantDescription, PlantError, PlantRuns, SensorCounts, simulate

# A drive with speeding up, turning both ways, a stop and a reverse.
COMMANDS = np.vstack(
    [held(0.6, 0.5, 120), held(0.0, 0.0, 60), held(-0.3, -0.8, 120), held(0.5, 0.0, 60)]
)
# A gyro and a supply that need not be at their described values for the slopes to show.
WARM: dict[str, Any] = {"temperature_offset_k": 10.0, "supply_offset_v": -1.0}

GYRO = {"gyro_code"}
LEFT, RIGHT = {"left_count"}, {"right_count"}
ACCEL = {"accel_x_code", "accel_y_code"}
CONTACT = {"gyro_code", "accel_y_code", "truth"}
COGGED = {"gyro_code", "accel_y_code", "truth"}
DRIVE = LEFT | RIGHT | GYRO | ACCEL | {"truth"}

# Each mechanism: a value that is felt, and all it may touch (with motors and streams on).
FELT: dict[str, tuple[float, set[str]]] = {
    "drive_gain_left": (0.02, LEFT | GYRO | ACCEL | {"truth"}),
    "drive_gain_right": (0.02, RIGHT | GYRO | ACCEL | {"truth"}),
    "drive_deadband_rad_s": (9.0, DRIVE),
    "drive_saturation_rad_s": (5.0, DRIVE),
    "drive_acceleration_limit_rad_s2": (20.0, DRIVE),
    "drive_lag_s": (0.05, DRIVE),
    "drive_delay_s": (0.033, DRIVE),
    "drive_cogging_left": (0.05, LEFT | COGGED),
    "drive_cogging_right": (0.05, RIGHT | COGGED),
    "drive_cogging_order": (7, LEFT | RIGHT | COGGED),
    "drive_cogging_phase_rad": (1.0, LEFT | RIGHT | COGGED),
    "backlash_left_rad": (0.05, CONTACT),
    "backlash_right_rad": (0.05, CONTACT),
    "radius_scale": (0.01, GYRO | ACCEL | {"truth"}),
    "radius_mismatch": (0.01, GYRO | ACCEL | {"truth"}),
    "wheelbase_scale": (0.01, CONTACT),
    "payload_left": (0.01, GYRO | ACCEL | {"truth"}),
    "payload_right": (0.01, GYRO | ACCEL | {"truth"}),
    "tyre_drift_per_s": (1e-3, GYRO | ACCEL | {"truth"}),
    "turn_scrub": (0.05, CONTACT),
    "slip_ratio_left": (0.02, CONTACT),
    "slip_ratio_right": (0.02, CONTACT),
    "slip_start_s": (1.0, CONTACT),
    "slip_stop_s": (1.0, CONTACT),
    "contact_offset_left_m": (1e-4, CONTACT),
    "contact_offset_right_m": (1e-4, CONTACT),
    "micro_slip_step_left_m": (1e-4, CONTACT),
    "micro_slip_step_right_m": (1e-4, CONTACT),
    "micro_slip_left_m_per_sqrt_m": (1e-3, CONTACT),
    "micro_slip_right_m_per_sqrt_m": (1e-3, CONTACT),
    "slip_wander_left": (0.01, CONTACT),
    "slip_wander_right": (0.01, CONTACT),
    "longitudinal_slip_s2_per_m": (0.02, CONTACT),
    "lateral_slip_s": (0.05, {"truth"}),
    "lateral_slip_speed_m_s": (0.1, {"truth"}),
    "cross_slope_ratio": (0.05, {"truth"}),
    "cross_slope_direction_rad": (1.0, {"truth"}),
    "grade_slip_ratio": (0.05, CONTACT),
    "grade_slip_direction_rad": (1.0, CONTACT),
    "wheel_toe_rad": (0.02, {"truth"}),
    "wheel_eccentricity_left": (0.01, CONTACT),
    "wheel_eccentricity_right": (0.01, CONTACT),
    "wheel_eccentricity_phase_left_rad": (1.0, CONTACT),
    "wheel_eccentricity_phase_right_rad": (1.0, CONTACT),
    "caster_kick_rad": (0.02, CONTACT),
    "caster_kick_length_m": (0.05, CONTACT),
    "floor_bump_s": (0.555, CONTACT),
    "floor_bump_yaw_rad": (0.05, CONTACT),
    "floor_bump_forward_m": (0.01, {"truth"}),
    "ticks_scale": (0.01, LEFT | RIGHT),
    "encoder_eccentricity_left_rad": (0.05, LEFT),
    "encoder_eccentricity_right_rad": (0.05, RIGHT),
    "encoder_eccentricity_phase_left_rad": (1.0, LEFT),
    "encoder_eccentricity_phase_right_rad": (1.0, RIGHT),
    "encoder_dead_left_s": (1.0, LEFT),
    "encoder_dead_right_s": (1.0, RIGHT),
    "missed_ticks_left": (0.05, LEFT),
    "missed_ticks_right": (0.05, RIGHT),
    "missed_ticks_threshold_rad_s": (8.0, LEFT | RIGHT),
    "extra_ticks_left_per_s": (20.0, LEFT),
    "extra_ticks_right_per_s": (20.0, RIGHT),
    "quadrature_left_rad": (0.5, LEFT),
    "quadrature_right_rad": (0.5, RIGHT),
    "encoder_wrap_bits": (8, LEFT | RIGHT),
    "gyro_bias_rad_s": (0.01, GYRO),
    "gyro_bias_walk_rad_s_per_sqrt_s": (0.01, GYRO),
    "gyro_noise_rad_per_sqrt_s": (0.001, GYRO),
    "gyro_scale": (0.01, GYRO),
    "gyro_quadratic_s_per_rad": (0.05, GYRO),
    "gyro_cubic_s2_per_rad2": (0.05, GYRO),
    "gyro_asymmetry": (0.05, GYRO),
    "gyro_g_sensitivity_x_s_per_m": (0.01, GYRO),
    "gyro_g_sensitivity_y_s_per_m": (0.01, GYRO),
    "gyro_roll_rad": (0.1, GYRO),
    "gyro_pitch_rad": (0.1, GYRO),
    "gyro_temperature_bias_rad_s_per_k": (1e-3, GYRO),
    "gyro_temperature_scale_per_k": (1e-3, GYRO),
    "gyro_saturation_rad_s": (0.3, GYRO),
    "gyro_lag_s": (0.05, GYRO),
    "gyro_vibration_s_per_rad": (1e-4, GYRO),
    "gyro_frozen_start_s": (1.0, GYRO),
    "gyro_frozen_stop_s": (2.0, GYRO),
    "supply_ratio": (0.5, GYRO),
    "adc_offset_lsb": (5.0, GYRO),
    "adc_gain": (0.01, GYRO),
    "adc_inl_lsb": (5.0, GYRO),
    "adc_missing_code": (32768, GYRO),
    "adc_stuck_bit": (3, GYRO),
    "adc_stuck_value": (1, GYRO),
    "accel_bias_x_m_s2": (0.1, {"accel_x_code"}),
    "accel_bias_y_m_s2": (0.1, {"accel_y_code"}),
    "accel_noise_m_s2_per_sqrt_hz": (0.05, ACCEL),
    "temperature_offset_k": (5.0, {"temperature_code"}),
    "temperature_rise_k": (5.0, {"temperature_code"}),
    "temperature_time_constant_s": (1.0, {"temperature_code"}),
    "supply_offset_v": (-1.0, {"supply_code"}),
    "supply_drift_v_per_s": (-0.01, {"supply_code"}),
    "clock_skew": (0.01, DRIVE),
}
# What must be on beside for some of them to be felt.
COMPANY: dict[str, dict[str, Any]] = {
    "slip_start_s": {"slip_ratio_left": 0.02},
    "slip_stop_s": {"slip_ratio_left": 0.02},
    "drive_cogging_order": {"drive_cogging_left": 0.05, "drive_cogging_right": 0.05},
    "drive_cogging_phase_rad": {"drive_cogging_left": 0.05, "drive_cogging_right": 0.05},
    "caster_kick_length_m": {"caster_kick_rad": 0.02},
    "missed_ticks_threshold_rad_s": {"missed_ticks_left": 0.05, "missed_ticks_right": 0.05},
    "lateral_slip_speed_m_s": {"lateral_slip_s": 0.05},
    "cross_slope_direction_rad": {"cross_slope_ratio": 0.05},
    "grade_slip_direction_rad": {"grade_slip_ratio": 0.05},
    "wheel_eccentricity_phase_left_rad": {"wheel_eccentricity_left": 0.01},
    "wheel_eccentricity_phase_right_rad": {"wheel_eccentricity_right": 0.01},
    "floor_bump_s": {"floor_bump_yaw_rad": 0.05},
    "floor_bump_yaw_rad": {"floor_bump_s": 0.555},
    "floor_bump_forward_m": {"floor_bump_s": 0.555},
    "encoder_eccentricity_phase_left_rad": {"encoder_eccentricity_left_rad": 0.05},
    "encoder_eccentricity_phase_right_rad": {"encoder_eccentricity_right_rad": 0.05},
    "gyro_temperature_bias_rad_s_per_k": WARM,
    "gyro_temperature_scale_per_k": WARM,
    "supply_ratio": WARM,
    "gyro_frozen_start_s": {"gyro_frozen_stop_s": 2.0},
    "gyro_frozen_stop_s": {"gyro_frozen_start_s": 1.0},
    "adc_stuck_value": {"adc_stuck_bit": 3},
    "temperature_time_constant_s": {"temperature_rise_k": 5.0},
}


def run(mechanisms: Mechanisms, commands: NDArray[np.float64] = COMMANDS) -> PlantRuns:
    return simulate(PlantDescription(), mechanisms, commands, [7], tick_period_us=PERIOD_US)


def changed(before: PlantRuns, after: PlantRuns) -> set[str]:
    names = ("truth", *SensorCounts._fields)
    return {
        name for name in names if not np.array_equal(getattr(before, name), getattr(after, name))
    }


def test_every_mechanism_has_a_row_here() -> None:
    assert list(FELT) == [item.name for item in fields(Mechanisms)]


@pytest.mark.parametrize("name", FELT)
def test_a_mechanism_acts_on_the_signals_of_its_stage_and_on_no_other(name: str) -> None:
    value, touched = FELT[name]
    beside = Mechanisms(**COMPANY.get(name, {}))
    switched: dict[str, Any] = {name: value}
    # commanded accelerations reach the rails of neither sensor, so nothing hides behind a clip
    assert changed(run(beside), run(replace(beside, **switched))) == touched


@pytest.mark.parametrize("item", fields(Mechanisms), ids=lambda item: item.name)
def test_a_neutral_value_given_in_any_type_changes_nothing(item: Any) -> None:
    as_given: dict[str, Any] = {item.name: np.float64(item.default)}
    if isinstance(item.default, int):
        as_given = {item.name: np.int64(item.default)}
    commands = COMMANDS[:20]
    assert not changed(run(Mechanisms(), commands), run(Mechanisms(**as_given), commands))


@pytest.mark.parametrize("item", fields(Mechanisms), ids=lambda item: item.name)
@pytest.mark.parametrize("wrong", [math.nan, "1", None, True, 1j])
def test_what_is_not_a_number_is_refused_in_one_line_that_names_the_field(
    item: Any, wrong: Any
) -> None:
    values: dict[str, Any] = {item.name: wrong}
    with pytest.raises(PlantError) as caught:
        Mechanisms(**values)
    message = str(caught.value)
    assert message.startswith(f"{item.name} = {wrong!r}: expected a ")
    assert "neutral" in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"radius_scale": -1}, "radius_scale = -1: expected a number from -0.9 to 9, neutral 0"),
        (
            {"gyro_bias_rad_s": -math.inf},
            "gyro_bias_rad_s = -inf: expected a number from -1000 to 1000 rad/s, neutral 0",
        ),
        (
            {"drive_saturation_rad_s": 0.0},
            "drive_saturation_rad_s = 0.0: expected a number of at least 1e-09 rad/s, neutral inf",
        ),
        (
            {"adc_stuck_bit": 2.0},
            "adc_stuck_bit = 2.0: expected a whole number from -1 to 15, neutral -1",
        ),
    ],
)
def test_a_value_out_of_range_is_answered_with_the_range(
    values: dict[str, Any], message: str
) -> None:
    with pytest.raises(PlantError) as caught:
        Mechanisms(**values)
    assert str(caught.value) == message
