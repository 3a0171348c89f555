"""What an ECU would read of the robot of `mujoco_world`: counters and gyro codes, written anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.trials.mujoco_engine import Driven, drive_through
from gap_diagnosis.trials.mujoco_world import World
from sim_plant import Mechanisms, MechanismSchedule, PlantDescription, PlantRuns

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass
class Engine:
    """A simulator as `run_with_effects` takes it; the last drive's states stay at hand.

    Attributes:
        world: the robot and its floor; of the plant's mechanisms only the room's warmth and
            the battery's sag are listened to.
        driven: the states behind the last run.
    """

    world: World
    driven: Driven | None = None

    def __call__(
        self,
        description: PlantDescription,
        mechanisms: Sequence[Mechanisms | MechanismSchedule],
        commands: Floats,
        seeds: Sequence[int],
        *,
        tick_period_us: int,
        **unused: Any,
    ) -> PlantRuns:
        """Drive once; each seed has its own noise of the sensors."""
        del unused
        driven = drive_through(self.world, description, commands, tick_period_us)
        self.driven = driven
        draws = [np.random.Generator(np.random.Philox(key=seed)) for seed in seeds]
        counts = [encoder_counts(driven.wheel_rad, description, draw) for draw in draws]
        rate = turn_rate(driven, tick_period_us * 1e-6)
        codes = [gyro_codes(rate, description, draw, tick_period_us * 1e-6) for draw in draws]
        still = np.ones((len(seeds), len(commands)), dtype=np.int64)
        around = [one if isinstance(one, Mechanisms) else one.pieces[0][1] for one in mechanisms]
        return PlantRuns(
            truth=driven.pose[np.newaxis],
            left_count=np.stack([one[:, 0] for one in counts]),
            right_count=np.stack([one[:, 1] for one in counts]),
            gyro_code=np.stack(codes),
            gyro_rate_rad_s=np.repeat(rate[np.newaxis], len(seeds), axis=0),
            accel_x_code=still * description.accelerometer.zero_code,
            accel_y_code=still * description.accelerometer.zero_code,
            temperature_code=np.stack(
                [temperature_codes(driven.time_s, description, one) for one in around]
            ),
            supply_code=np.stack([supply_codes(driven.time_s, description, one) for one in around]),
        )


def encoder_counts(wheel_rad: Floats, description: PlantDescription, draw: Any) -> Ints:
    """Return int64[n, 2]: whole counts below the angles, each read with the noise stated."""
    encoder = description.encoder
    turns = wheel_rad / (2 * np.pi) + draw.uniform(size=2)
    noisy = turns * encoder.ticks_per_rev + encoder.noise_ticks * draw.normal(size=turns.shape)
    return np.asarray(np.floor(noisy), dtype=np.int64) % (1 << encoder.counter_bits)


def turn_rate(driven: Driven, tick_s: float) -> Floats:
    """Return the mean turn rate of each tick, (t_{k−1}, t_k]: the floor is flat, so it is the
    heading's."""
    return np.diff(driven.pose[:, 2], prepend=driven.pose[0, 2]) / tick_s


def gyro_codes(rate_rad_s: Floats, description: PlantDescription, draw: Any, tick_s: float) -> Ints:
    """Return int64[n]: the sensor's noise, its range, and the nearest code."""
    gyro = description.gyro
    noise = gyro.noise_density_rad_per_sqrt_s / np.sqrt(tick_s) * draw.normal(size=len(rate_rad_s))
    seen = np.clip(rate_rad_s + noise, -gyro.range_rad_s, gyro.range_rad_s)
    return _nearest(gyro.zero_rate_code + gyro.sensitivity_lsb_per_rad_s * seen, description)


def temperature_codes(time_s: Floats, description: PlantDescription, around: Mechanisms) -> Ints:
    """Return int64[n]: of a thermometer that warms up from where it begins."""
    warm = description.temperature
    risen_k = around.temperature_rise_k * (1 - np.exp(-time_s / around.temperature_time_constant_s))
    above_k = warm.ambient_k + around.temperature_offset_k + risen_k - 298.15
    return _nearest(warm.code_at_298_k + warm.sensitivity_lsb_per_k * above_k, description)


def supply_codes(time_s: Floats, description: PlantDescription, around: Mechanisms) -> Ints:
    """Return int64[n]: of a voltmeter on a battery that runs down."""
    supply = description.supply
    left_v = supply.nominal_v + around.supply_offset_v + around.supply_drift_v_per_s * time_s
    return _nearest(supply.sensitivity_lsb_per_v * left_v, description)


def _nearest(level_lsb: Floats, description: PlantDescription) -> Ints:
    return np.asarray(np.clip(np.rint(level_lsb), 0, description.adc.max_code), dtype=np.int64)
