"""The robot of a case, as its owner describes it."""

from __future__ import annotations

from typing import Final

import numpy as np

Draw = np.random.Generator

FAMILIAR: Final = "familiar"
NEW: Final = "new"

_DPS: Final = 0.017453292519943295
_RANGES: Final = ((250.0, 131.0), (500.0, 65.5))
"""Full scale [°/s] and sensitivity [LSB per °/s], as on the MPU-6050's data sheet."""

_TEXT: Final = """\
schema = 1

[robot]
name = "trial"

[wheels]
radius_m = {radius_m:.6f}
wheelbase_m = {wheelbase_m:.6f}

[encoder]
ticks_per_rev = {ticks_per_rev:d}

[drive]
time_constant_s = {time_constant_s:.6f}

[gyro]
sensitivity_lsb_per_rad_s = {sensitivity:.6f}
range_rad_s = {range_rad_s:.6f}
noise_density_rad_per_sqrt_s = {noise:.9f}

[firmware]
mode = "{mode}"
integration = "{integration}"
"""


def robot_text(kind: str, draw: Draw, *, described_m: tuple[float, float] | None = None) -> str:
    """Return a robot.toml; *familiar* robots are like the shipped one, *new* ones are any size.

    *described_m*: radius and wheelbase of a robot that is there already.
    """
    low, high = (0.04, 0.065) if kind == FAMILIAR else (0.03, 0.12)
    radius_m = float(np.exp(draw.uniform(np.log(low), np.log(high))))
    ratio = draw.uniform(5.0, 7.0) if kind == FAMILIAR else draw.uniform(3.0, 9.0)
    ticks = (1024, 2048, 4096) if kind == FAMILIAR else (512, 1000, 3600, 8192)
    full_dps, lsb = _RANGES[int(draw.integers(len(_RANGES)))]
    radius_m, wheelbase_m = described_m or (radius_m, ratio * radius_m)
    return _TEXT.format(
        radius_m=radius_m,
        wheelbase_m=wheelbase_m,
        ticks_per_rev=int(draw.choice(ticks)),
        time_constant_s=draw.uniform(0.02, 0.1),
        sensitivity=lsb / _DPS,
        range_rad_s=full_dps * _DPS,
        noise=draw.uniform(1.5e-4, 2e-4),
        mode=str(draw.choice(["gyro", "wheel", "blend"])),
        integration=str(draw.choice(["euler_before", "midpoint"])),
    )
