"""Stage gyro: true mean yaw rate of a tick to ADC code."""

from __future__ import annotations

import math
from typing import Any

from sim_plant.adc import to_code
from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.environment import REFERENCE_K
from sim_plant.mechanisms import Mechanisms

PARAMETERS = [
    ("gyro_lag_share", "f8"),
    ("gyro_lag_trail", "f8"),
    ("gyro_quadratic", "f8"),
    ("gyro_cubic", "f8"),
    ("gyro_asymmetry", "f8"),
    ("gyro_gain", "f8"),
    ("gyro_temperature_scale_per_k", "f8"),
    ("gyro_supply_ratio", "f8"),
    ("gyro_g_x", "f8"),
    ("gyro_g_y", "f8"),
    ("gyro_bias_rad_s", "f8"),
    ("gyro_temperature_bias_rad_s_per_k", "f8"),
    ("gyro_vibration", "f8"),
    ("gyro_walk_step_rad_s", "f8"),
    ("gyro_noise_rad_s", "f8"),
    ("gyro_range_rad_s", "f8"),
    ("gyro_frozen_start_s", "f8"),
    ("gyro_frozen_stop_s", "f8"),
    ("gyro_zero_lsb", "f8"),
    ("gyro_lsb_per_rad_s", "f8"),
    ("gyro_adc_offset_lsb", "f8"),
    ("gyro_adc_inl_lsb", "f8"),
    ("gyro_adc_missing_code", "i8"),
    ("gyro_adc_stuck_bit", "i8"),
    ("gyro_adc_stuck_value", "i8"),
]

# Of the motion part: the anti-alias filter.
FILTER_STATE = [("gyro_filtered_rad_s", "f8")]

# The reading without bias walk and noise, and whether the code is held.
SAMPLE = [("gyro_rate_rad_s", "f8"), ("gyro_frozen", "i8")]

STATE = [("gyro_walk_rad_s", "f8"), ("gyro_rate_rad_s", "f8"), ("gyro_code", "i8")]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`: described and deviation merged."""
    gyro = description.gyro
    m = mechanisms
    noise_density = max(gyro.noise_density_rad_per_sqrt_s, m.gyro_noise_rad_per_sqrt_s)
    walk_density = max(gyro.bias_walk_density_rad_s_per_sqrt_s, m.gyro_bias_walk_rad_s_per_sqrt_s)
    lag_share = -math.expm1(-tick_s / m.gyro_lag_s) if m.gyro_lag_s > 0.0 else 1.0
    # Of a gap that closes exponentially, the tick's mean is share·lag/tick of what it began with.
    lag_trail = lag_share * m.gyro_lag_s / tick_s
    tilt = math.cos(m.gyro_roll_rad) * math.cos(m.gyro_pitch_rad)
    return {
        "gyro_lag_share": lag_share,
        "gyro_lag_trail": lag_trail,
        "gyro_quadratic": m.gyro_quadratic_s_per_rad,
        "gyro_cubic": m.gyro_cubic_s2_per_rad2,
        "gyro_asymmetry": m.gyro_asymmetry,
        "gyro_gain": (1.0 + m.gyro_scale) * tilt,
        "gyro_temperature_scale_per_k": m.gyro_temperature_scale_per_k,
        "gyro_supply_ratio": m.supply_ratio,
        "gyro_g_x": m.gyro_g_sensitivity_x_s_per_m,
        "gyro_g_y": m.gyro_g_sensitivity_y_s_per_m,
        "gyro_bias_rad_s": m.gyro_bias_rad_s,
        "gyro_temperature_bias_rad_s_per_k": m.gyro_temperature_bias_rad_s_per_k,
        "gyro_vibration": m.gyro_vibration_s_per_rad,
        "gyro_walk_step_rad_s": walk_density * math.sqrt(tick_s),
        "gyro_noise_rad_s": noise_density / math.sqrt(tick_s),
        "gyro_range_rad_s": min(gyro.range_rad_s, m.gyro_saturation_rad_s),
        "gyro_frozen_start_s": m.gyro_frozen_start_s,
        "gyro_frozen_stop_s": m.gyro_frozen_stop_s,
        "gyro_zero_lsb": gyro.zero_rate_code,
        "gyro_lsb_per_rad_s": gyro.sensitivity_lsb_per_rad_s * (1.0 + m.adc_gain),
        "gyro_adc_offset_lsb": m.adc_offset_lsb,
        "gyro_adc_inl_lsb": m.adc_inl_lsb,
        "gyro_adc_missing_code": m.adc_missing_code,
        "gyro_adc_stuck_bit": m.adc_stuck_bit,
        "gyro_adc_stuck_value": m.adc_stuck_value,
    }


@inlined
def observe_gyro(p: Any, s: Any, out: Any, time_s: float, tick_s: float) -> None:
    """Write the analogue reading, without bias walk and noise, for the tick that ends now."""
    rate = s.yaw_rate_rad_s
    if p.gyro_lag_share < 1.0:
        # The tick's mean, as without a lag: the heading trails by the lag however fine the ticks.
        gap = s.gyro_filtered_rad_s - rate
        s.gyro_filtered_rad_s -= p.gyro_lag_share * gap
        rate += p.gyro_lag_trail * gap
    else:
        s.gyro_filtered_rad_s = rate

    magnitude = abs(rate)
    bent = p.gyro_quadratic * rate * magnitude + p.gyro_cubic * rate * rate * rate
    rate += bent + 0.5 * p.gyro_asymmetry * magnitude
    warm_k = out.temperature_k - REFERENCE_K
    supply_error = out.supply_v / p.supply_nominal_v - 1.0
    drifted = p.gyro_temperature_scale_per_k * warm_k + p.gyro_supply_ratio * supply_error
    rate *= p.gyro_gain * (1.0 + drifted)

    squares = s.step_left_rad * s.step_left_rad + s.step_right_rad * s.step_right_rad
    vibration = p.gyro_vibration * 0.5 * squares / (tick_s * tick_s)
    rate += p.gyro_bias_rad_s + p.gyro_temperature_bias_rad_s_per_k * warm_k + vibration
    rate += p.gyro_g_x * s.forward_acceleration_m_s2 + p.gyro_g_y * s.lateral_acceleration_m_s2
    out.gyro_rate_rad_s = rate
    out.gyro_frozen = p.gyro_frozen_start_s <= time_s < p.gyro_frozen_stop_s


@inlined
def convert(p: Any, rate_rad_s: float) -> int:
    """Return the gyro's code: the shared ADC with this channel's own faults."""
    level = p.gyro_zero_lsb + p.gyro_lsb_per_rad_s * rate_rad_s + p.gyro_adc_offset_lsb
    if p.gyro_adc_inl_lsb != 0.0:
        level += p.gyro_adc_inl_lsb * math.sin(math.pi * level / p.top_rail_lsb)
    code = to_code(p, level)
    if code == p.gyro_adc_missing_code and code < p.max_code:
        code += 1
    if p.gyro_adc_stuck_bit >= 0:
        bit = 1 << p.gyro_adc_stuck_bit
        code = (code | bit) if p.gyro_adc_stuck_value != 0 else (code & ~bit)
        code = min(code, p.max_code)
    return code


@inlined
def read_gyro(p: Any, s: Any, m: Any, n: Any, moved: bool) -> None:
    """Read a sample's rate and code into the state; `moved` is false at tick 0."""
    if moved:
        s.gyro_walk_rad_s += p.gyro_walk_step_rad_s * n.gyro_bias_walk
    rate = m.gyro_rate_rad_s + (s.gyro_walk_rad_s + p.gyro_noise_rad_s * n.gyro_noise)
    rate = min(max(rate, -p.gyro_range_rad_s), p.gyro_range_rad_s)
    s.gyro_rate_rad_s = rate
    if m.gyro_frozen == 0:
        s.gyro_code = convert(p, rate)
