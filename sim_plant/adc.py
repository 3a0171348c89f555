"""The converter behind every analogue sensor: nearest code, and rails."""

from __future__ import annotations

import math
from typing import Any

from sim_plant.compiled import inlined
from sim_plant.description import PlantDescription
from sim_plant.mechanisms import Mechanisms

PARAMETERS = [("max_code", "i8"), ("top_rail_lsb", "f8")]


def parameters(
    description: PlantDescription, mechanisms: Mechanisms, tick_s: float
) -> dict[str, float]:
    """Return the values of `PARAMETERS`."""
    del mechanisms, tick_s
    return {"max_code": description.adc.max_code, "top_rail_lsb": description.adc.max_code}


@inlined
def to_code(p: Any, level_lsb: float) -> int:
    """Return the code nearest to a level (ties upwards), clipped at the rails 0 and max_code."""
    # Clip before the conversion: a float beyond int64 has no defined integer.
    top_lsb: float = p.top_rail_lsb
    return math.floor(min(max(level_lsb, 0.0), top_lsb) + 0.5)
