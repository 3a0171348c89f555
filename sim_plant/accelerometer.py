"""Accelerometer at the axle's middle: specific force along body x and y to ADC codes.

It feels the acceleration of rolling without slip (x) and the centripetal one v·ω (y); slip, tilt
and gravity are not modelled.
"""

from __future__ import annotations

import math
from typing import Any

from sim_plant.adc import to_code
from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

PARAMETERS = [
    ("accel_bias_x_m_s2", "f8"),
    ("accel_bias_y_m_s2", "f8"),
    ("accel_noise_m_s2", "f8"),
    ("accel_range_m_s2", "f8"),
    ("accel_zero_lsb", "f8"),
    ("accel_lsb_per_m_s2", "f8"),
]

SAMPLE = [("accel_x_m_s2", "f8"), ("accel_y_m_s2", "f8")]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`: described and deviation merged."""
    sensor = description.accelerometer
    density = max(sensor.noise_density_m_s2_per_sqrt_hz, mechanisms.accel_noise_m_s2_per_sqrt_hz)
    return {
        "accel_bias_x_m_s2": mechanisms.accel_bias_x_m_s2,
        "accel_bias_y_m_s2": mechanisms.accel_bias_y_m_s2,
        "accel_noise_m_s2": density / math.sqrt(tick_s),
        "accel_range_m_s2": sensor.range_m_s2,
        "accel_zero_lsb": sensor.zero_code,
        "accel_lsb_per_m_s2": sensor.sensitivity_lsb_per_m_s2,
    }


@inlined
def observe_accelerometer(p: Any, s: Any, out: Any) -> None:
    """Write the biased forces without noise."""
    out.accel_x_m_s2 = s.forward_acceleration_m_s2 + p.accel_bias_x_m_s2
    out.accel_y_m_s2 = s.lateral_acceleration_m_s2 + p.accel_bias_y_m_s2


@inlined
def accel_code(p: Any, force_m_s2: float, normal: float) -> int:
    """Return the code of one axis."""
    reading = force_m_s2 + p.accel_noise_m_s2 * normal
    clipped = min(max(reading, -p.accel_range_m_s2), p.accel_range_m_s2)
    return to_code(p, p.accel_zero_lsb + p.accel_lsb_per_m_s2 * clipped)
