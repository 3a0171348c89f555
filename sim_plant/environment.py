"""Temperature and supply: what the gyro feels and what the two slow sensors read."""

from __future__ import annotations

import math
from typing import Any

from sim_plant.adc import to_code
from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

REFERENCE_K = 298.15

PARAMETERS = [
    ("temperature_start_k", "f8"),
    ("temperature_rise_k", "f8"),
    ("temperature_time_constant_s", "f8"),
    ("temperature_lsb_per_k", "f8"),
    ("temperature_zero_lsb", "f8"),
    ("temperature_noise_k", "f8"),
    ("supply_nominal_v", "f8"),
    ("supply_start_v", "f8"),
    ("supply_drift_v_per_s", "f8"),
    ("supply_lsb_per_v", "f8"),
    ("supply_noise_v", "f8"),
]

SAMPLE = [("temperature_k", "f8"), ("supply_v", "f8")]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`: described and deviation merged."""
    del tick_s
    temperature, supply = description.temperature, description.supply
    return {
        "temperature_start_k": temperature.ambient_k + mechanisms.temperature_offset_k,
        "temperature_rise_k": mechanisms.temperature_rise_k,
        "temperature_time_constant_s": mechanisms.temperature_time_constant_s,
        "temperature_lsb_per_k": temperature.sensitivity_lsb_per_k,
        "temperature_zero_lsb": temperature.code_at_298_k,
        "temperature_noise_k": temperature.noise_k,
        "supply_nominal_v": supply.nominal_v,
        "supply_start_v": supply.nominal_v + mechanisms.supply_offset_v,
        "supply_drift_v_per_s": mechanisms.supply_drift_v_per_s,
        "supply_lsb_per_v": supply.sensitivity_lsb_per_v,
        "supply_noise_v": supply.noise_v,
    }


@inlined
def temperature_k(p: Any, time_s: float) -> float:
    """Return the true temperature at a time: start plus exponential warming."""
    reached_k: float = p.temperature_start_k
    if p.temperature_rise_k != 0.0:
        reached_k -= p.temperature_rise_k * math.expm1(-time_s / p.temperature_time_constant_s)
    return reached_k


@inlined
def supply_v(p: Any, time_s: float) -> float:
    """Return the true supply voltage at a time, never below 0."""
    reached_v: float = p.supply_start_v + p.supply_drift_v_per_s * time_s
    return max(reached_v, 0.0)


@inlined
def observe_environment(p: Any, out: Any, time_s: float) -> None:
    """Write the true temperature and supply."""
    out.temperature_k = temperature_k(p, time_s)
    out.supply_v = supply_v(p, time_s)


@inlined
def temperature_code(p: Any, m: Any, n: Any) -> int:
    """Return the thermometer's code of a sample."""
    reading_k = m.temperature_k + p.temperature_noise_k * n.temperature
    return to_code(p, p.temperature_zero_lsb + p.temperature_lsb_per_k * (reading_k - REFERENCE_K))


@inlined
def supply_code(p: Any, m: Any, n: Any) -> int:
    """Return the voltmeter's code of a sample."""
    return to_code(p, p.supply_lsb_per_v * (m.supply_v + p.supply_noise_v * n.supply))
