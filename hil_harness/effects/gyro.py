"""Stage gyro: the inertial sensor, its ADC and its supply. The wheels do not see it.

The accelerometer sits on the same chip and passes the same converter, so it has this stage too.
"""

from typing import Final

from hil_harness.effects.model import Effect, Twins, Typical
from hil_harness.effects.plant_effect import moves, plant_effect
from hil_harness.effects.sources import COURSE_NOTES, GYRO_DATA_SHEETS, KOBUKI, MPU_6050, MSP430

_SENSOR: Final[tuple[Effect, ...]] = (
    plant_effect(
        "gyro_bias",
        "gyro",
        "Gyro heading drifts in proportion to time, at rest too; cross-track ½·v·b·t².",
        moves("bias", "gyro_bias_rad_s", Typical(0.01, 0.35, f"{KOBUKI}; {MPU_6050}")),
        twins=(Twins(("adc_offset",)),),
    ),
    plant_effect(
        "gyro_bias_walk",
        "gyro",
        "Gyro heading wanders off as t^1.5; the Allan deviation rises with slope +½.",
        moves("density", "gyro_bias_walk_rad_s_per_sqrt_s"),
        is_noise=True,
    ),
    plant_effect(
        "gyro_noise",
        "gyro",
        "Gyro heading wanders off as √t; the Allan deviation falls with slope −½.",
        moves("density", "gyro_noise_rad_per_sqrt_s", Typical(4.9e-5, 2.4e-4, GYRO_DATA_SHEETS)),
        is_noise=True,
    ),
    plant_effect(
        "gyro_scale",
        "gyro",
        "Gyro heading error in proportion to the signed turn.",
        moves("scale", "gyro_scale", Typical(0.001, 0.03, f"{COURSE_NOTES}; {MPU_6050}")),
        twins=(
            Twins(("adc_gain",)),
            Twins(("gyro_tilt",), "scale < 0"),
            Twins(("supply_ratio",), "the supply is constant"),
        ),
    ),
    plant_effect(
        "gyro_nonlinearity",
        "gyro",
        "The scale error depends on the turn rate's size.",
        moves("quadratic", "gyro_quadratic_s_per_rad", Typical(0.0, 4.6e-4, MPU_6050)),
        moves("cubic", "gyro_cubic_s2_per_rad2", Typical(0.0, 1.05e-4, MPU_6050)),
    ),
    plant_effect(
        "gyro_asymmetry",
        "gyro",
        "The scale differs between left and right turns.",
        moves("asymmetry", "gyro_asymmetry"),
    ),
    plant_effect(
        "gyro_g_sensitivity",
        "gyro",
        "The gyro reads a turn while the robot accelerates or takes a bend; encoders do not.",
        moves("x", "gyro_g_sensitivity_x_s_per_m", Typical(0.0, 1.8e-4, MPU_6050)),
        moves("y", "gyro_g_sensitivity_y_s_per_m", Typical(0.0, 1.8e-4, MPU_6050)),
    ),
    plant_effect(
        "gyro_tilt",
        "gyro",
        "On a flat floor a scale below one.",
        moves("roll", "gyro_roll_rad", Typical(0.0, 0.02, f"{MPU_6050} (cross axis)")),
        moves("pitch", "gyro_pitch_rad", Typical(0.0, 0.02, f"{MPU_6050} (cross axis)")),
        twins=(Twins(("gyro_scale",)),),
    ),
    plant_effect(
        "gyro_temperature_bias",
        "gyro",
        "The bias follows the temperature signal.",
        moves(
            "slope",
            "gyro_temperature_bias_rad_s_per_k",
            Typical(8.7e-5, 2.8e-3, f"{GYRO_DATA_SHEETS}; {MPU_6050}"),
        ),
        twins=(Twins(("gyro_bias",), "the temperature is constant"),),
    ),
    plant_effect(
        "gyro_temperature_scale",
        "gyro",
        "The scale follows the temperature signal.",
        moves("slope", "gyro_temperature_scale_per_k", Typical(0.0, 3.2e-4, MPU_6050)),
        twins=(Twins(("gyro_scale",), "the temperature is constant"),),
    ),
    plant_effect(
        "gyro_saturation",
        "gyro",
        "Turns faster than the limit are under-read; the codes have a flat top.",
        moves("limit", "gyro_saturation_rad_s", Typical(4.36, 5.24, f"{KOBUKI}; {MPU_6050}")),
    ),
    plant_effect(
        "gyro_lag",
        "gyro",
        "Gyro heading trails by the lag times the turn rate and catches up after the turn.",
        moves("time_constant", "gyro_lag_s", Typical(0.001, 0.02, f"{MPU_6050} (low-pass filter)")),
        twins=(Twins(("frame_latency",), "turns are slow; of the gyro's frame"),),
    ),
    plant_effect(
        "gyro_vibration",
        "gyro",
        "A bias that grows with the square of the wheels' speed and is gone at rest.",
        moves("coefficient", "gyro_vibration_s_per_rad"),
    ),
    plant_effect(
        "gyro_frozen",
        "gyro",
        "One code repeats for a while.",
        moves("start_s", "gyro_frozen_start_s"),
        moves("stop_s", "gyro_frozen_stop_s"),
    ),
)

_CONVERTER: Final[tuple[Effect, ...]] = (
    plant_effect(
        "adc_offset",
        "gyro",
        "A constant number of codes too many: the same as a bias.",
        moves("offset", "adc_offset_lsb", Typical(10.0, 30.0, MSP430)),
        twins=(Twins(("gyro_bias",)),),
    ),
    plant_effect(
        "adc_gain",
        "gyro",
        "Codes spread about the zero-rate code: the same as a scale.",
        moves("gain", "adc_gain", Typical(0.0002, 0.005, MSP430)),
        twins=(Twins(("gyro_scale",)),),
    ),
    plant_effect(
        "adc_inl",
        "gyro",
        "An error that repeats with the code.",
        moves("peak", "adc_inl_lsb", Typical(29.0, 35.0, MSP430)),
    ),
    plant_effect(
        "adc_missing_code",
        "gyro",
        "The histogram of codes has a gap and a spike beside it.",
        moves("code", "adc_missing_code"),
    ),
    plant_effect(
        "adc_stuck_bit",
        "gyro",
        "One bit of every code is the same: the histogram is a comb.",
        moves("bit", "adc_stuck_bit"),
        moves("value", "adc_stuck_value"),
    ),
    plant_effect(
        "supply_ratio",
        "gyro",
        "The scale follows the supply voltage.",
        moves("coefficient", "supply_ratio"),
        twins=(Twins(("gyro_scale",), "the supply is constant"),),
    ),
)

_ACCELEROMETER: Final[tuple[Effect, ...]] = (
    plant_effect(
        "accelerometer_bias",
        "gyro",
        "Integrated once it is a speed b·t, twice a distance ½·b·t²; odometry does not use it.",
        moves("x", "accel_bias_x_m_s2", Typical(0.0, 0.49, MPU_6050)),
        moves("y", "accel_bias_y_m_s2", Typical(0.0, 0.49, MPU_6050)),
    ),
    plant_effect(
        "accelerometer_noise",
        "gyro",
        "Integrated once its variance grows as t, twice as t³; odometry does not use it.",
        moves("density", "accel_noise_m_s2_per_sqrt_hz", Typical(0.0, 0.004, MPU_6050)),
        is_noise=True,
    ),
)

_SURROUNDINGS: Final[tuple[Effect, ...]] = (
    plant_effect(
        "warm_up",
        "gyro",
        "The thermometer shows another temperature, or an exponential rise; by itself nothing "
        "else changes, with a temperature slope the gyro follows.",
        moves("offset", "temperature_offset_k"),
        moves("rise", "temperature_rise_k"),
        moves("time_constant", "temperature_time_constant_s"),
    ),
    plant_effect(
        "supply_change",
        "gyro",
        "The voltmeter shows another supply, or a steady drift; by itself nothing else changes, "
        "with a ratiometric gyro the scale follows.",
        moves("offset", "supply_offset_v"),
        moves("rate", "supply_drift_v_per_s"),
    ),
)

EFFECTS: Final = _SENSOR + _CONVERTER + _ACCELEROMETER + _SURROUNDINGS
