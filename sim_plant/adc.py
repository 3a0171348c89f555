"""The converter behind every analogue sensor: nearest code, and rails."""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

PARAMETERS = [("max_code", "i8")]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`."""
    del mechanisms, tick_s
    return {"max_code": description.adc.max_code}


@njit()
def to_code(p: Any, level_lsb: float) -> int:
    """Return the code nearest to a level (ties upwards), clipped at the rails 0 and max_code."""
    # Clip before the conversion: a float beyond int64 has no defined integer.
    return math.floor(min(max(level_lsb, 0.0), float(p.max_code)) + 0.5)
