"""A robot whose sensors do not hiss, and the shortest ways to run it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_plant import Mechanisms, PlantDescription, PlantRuns, simulate

PERIOD_US = 10_000
PERIOD_S = 0.01
RADIUS_M = 0.05025
WHEELBASE_M = 0.2985
TICKS_PER_RAD = 2048 / (2 * np.pi)


def quiet(**tables: dict[str, Any]) -> PlantDescription:
    """Return the default robot without sensor noise, some fields of some tables replaced."""
    silent: dict[str, dict[str, Any]] = {
        "encoder": {"noise_ticks": 0.0},
        "gyro": {"noise_density_rad_per_sqrt_s": 0.0},
        "accelerometer": {"noise_density_m_s2_per_sqrt_hz": 0.0},
    }
    for table, fields in tables.items():
        silent[table] = silent.get(table, {}) | fields
    return PlantDescription.from_tables(silent)


def held(v_m_s: float, w_rad_s: float, ticks: int) -> NDArray[np.float64]:
    """Return one command, held for so many ticks of sampling."""
    return np.tile([v_m_s, w_rad_s], (ticks, 1)).astype(float)


def drive(
    commands: NDArray[np.float64],
    mechanisms: Mechanisms | Sequence[Mechanisms] | None = None,
    *,
    description: PlantDescription | None = None,
    seeds: Sequence[int] = (1,),
    ideal: bool = True,
    **options: Any,
) -> PlantRuns:
    """Run the quiet robot (or another) with an ideal drive (or its motors)."""
    return simulate(
        description or quiet(),
        mechanisms or Mechanisms(),
        commands,
        seeds,
        tick_period_us=PERIOD_US,
        drive="ideal" if ideal else "motor",
        **options,
    )


def unwrapped(count: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a wrapping 16-bit count as a running one, from its first value."""
    steps = np.diff(count.astype(np.int64), prepend=count[..., :1])
    signed: NDArray[np.int64] = np.remainder(steps + 32768, 65536) - 32768
    return np.cumsum(signed, axis=-1)
