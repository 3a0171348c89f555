"""The trial's plant: it integrates in steps that no diagnosis takes, then samples as the ECU does.

Wheels and contact go in fine steps; counts are sampled at the ticks; a gyro sample is the mean rate
over its tick, (t_{k−1}, t_k], through a converter that is written here a second time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hil_harness.effect_runs import Simulator
from sim_plant import Mechanisms, MechanismSchedule, PlantDescription, PlantRuns, simulate
from sim_plant.records import DriveModel, EncoderModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def finer(steps: int) -> Simulator:
    """Return a plant that takes *steps* steps in each tick."""

    def simulate_finely(
        description: PlantDescription,
        mechanisms: Sequence[Mechanisms | MechanismSchedule],
        commands: Floats,
        seeds: Sequence[int],
        *,
        tick_period_us: int,
        encoder_model: EncoderModel = "counter",
        noise: str = "streams",
        drive: DriveModel = "motor",
    ) -> PlantRuns:
        del noise
        if tick_period_us % steps:
            raise ValueError(f"{steps} steps do not divide a tick of {tick_period_us} µs")
        fine = simulate(
            description,
            mechanisms,
            np.repeat(commands, steps, axis=0),
            seeds,
            tick_period_us=tick_period_us // steps,
            encoder_model=encoder_model,
            drive=drive,
        )
        return _sampled(fine, description, mechanisms, steps, tick_period_us * 1e-6)

    return simulate_finely


def _sampled(
    fine: PlantRuns,
    description: PlantDescription,
    mechanisms: Sequence[Mechanisms | MechanismSchedule],
    steps: int,
    tick_s: float,
) -> PlantRuns:
    rates = fine.gyro_rate_rad_s
    assert rates is not None  # asked for
    ticks = rates.shape[1] // steps
    mean = rates[:, ::steps].copy()
    inner = rates[:, 1 : 1 + (ticks - 1) * steps].reshape(len(rates), ticks - 1, steps)
    mean[:, 1:] = inner.mean(axis=2)
    time_s = np.arange(ticks) * tick_s
    codes = np.stack(
        [_codes(one, time_s, description, m) for one, m in zip(mean, mechanisms, strict=True)]
    )

    return PlantRuns(
        truth=fine.truth[:, ::steps],
        left_count=fine.left_count[:, ::steps],
        right_count=fine.right_count[:, ::steps],
        gyro_code=codes,
        gyro_rate_rad_s=mean,
        accel_x_code=_coarse(fine.accel_x_code, steps),
        accel_y_code=_coarse(fine.accel_y_code, steps),
        temperature_code=_coarse(fine.temperature_code, steps),
        supply_code=_coarse(fine.supply_code, steps),
    )


def _coarse(values: Ints | None, steps: int) -> Ints | None:
    return None if values is None else values[:, ::steps]


def _codes(
    rate_rad_s: Floats,
    time_s: Floats,
    description: PlantDescription,
    mechanisms: Mechanisms | MechanismSchedule,
) -> Ints:
    """Return the codes of a run; mechanisms may change with time."""
    pieces = (
        mechanisms.pieces
        if isinstance(mechanisms, MechanismSchedule)
        else ((-math.inf, mechanisms),)
    )
    codes = np.zeros(len(rate_rad_s), dtype=np.int64)
    frozen = np.zeros(len(rate_rad_s), dtype=np.bool_)
    for start_s, m in pieces:
        since = time_s >= start_s
        codes[since] = _converted(rate_rad_s[since], description, m)
        frozen[since] = (time_s[since] >= m.gyro_frozen_start_s) & (
            time_s[since] < m.gyro_frozen_stop_s
        )
    last = np.maximum.accumulate(np.where(frozen, 0, np.arange(len(codes))))
    return codes[last]


def _converted(rate_rad_s: Floats, description: PlantDescription, m: Mechanisms) -> Ints:
    gyro, top = description.gyro, float(description.adc.max_code)
    per_rad_s = gyro.sensitivity_lsb_per_rad_s * (1.0 + m.adc_gain)
    level = gyro.zero_rate_code + per_rad_s * rate_rad_s + m.adc_offset_lsb
    level = level + m.adc_inl_lsb * np.sin(math.pi * level / top)
    codes = np.floor(np.clip(level, 0.0, top) + 0.5).astype(np.int64)
    codes += (codes == m.adc_missing_code) & (codes < top)
    if m.adc_stuck_bit >= 0:
        bit = 1 << m.adc_stuck_bit
        codes = codes | bit if m.adc_stuck_value != 0 else codes & ~bit
    return np.minimum(codes, int(top))
