"""What is known of a robot beside its description: effects that an earlier diagnosis found.

The simulator has them in it already. What a log of the same robot then leaves is held against that:
nothing, or a further cause.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus import Disturbances
from firmware_model import FirmwareChanges
from hil_harness.effects import Effect, EffectSetting, Stage, Value, apply_effects, catalogue
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_SDS_IN_CI95: Final = 3.92
"""Standard deviations in the 95 % interval of a normal value."""
_THERE_OR_NOT: Final = frozenset(
    {"adc_missing_code", "adc_stuck_bit", "encoder_wrap", "gyro_saturation"}
)


@dataclass(frozen=True)
class Granted:
    """The known effects of a robot.

    Attributes:
        settings: effects with their values.
        library: a user's effects.
        name: of the file that states them.
    """

    settings: tuple[EffectSetting, ...] = ()
    library: Mapping[str, Effect] = field(default_factory=lambda: MappingProxyType({}))
    name: str = ""

    @cached_property
    def values(self) -> Mapping[str, Mapping[str, Value]]:
        """All parameters of each effect, those not set standing at neutral."""
        known = {**catalogue(), **self.library}
        return {one.effect: known[one.effect].neutral() | dict(one.values) for one in self.settings}

    @cached_property
    def sds(self) -> Mapping[str, float]:
        """Standard deviations by ``effect.parameter``; none of values that are exact."""
        return {
            f"{one.effect}.{name}": (high - low) / _SDS_IN_CI95
            for one in self.settings
            for name, (low, high) in one.ci95
        }

    def number(self, key: str, default: float = 0.0) -> float:
        """Return the value of ``effect.parameter``; the default where the effect is not known."""
        effect, _, parameter = key.partition(".")
        return float(self.values[effect][parameter]) if effect in self.values else default

    @property
    def there_or_not(self) -> frozenset[str]:
        """The known effects of which a second time is none."""
        return _THERE_OR_NOT & self.values.keys()

    @cached_property
    def firmware(self) -> FirmwareChanges:
        """How the program that is known to run differs from the described one."""
        return apply_effects(self._of_stage("firmware")).firmware

    @property
    def bus(self) -> Disturbances:
        """What the bus is known to do to frames."""
        return apply_effects(self._of_stage("bus")).bus

    def _of_stage(self, stage: Stage) -> list[EffectSetting]:
        stages = {name: effect.stage for name, effect in catalogue().items()}
        return [one for one in self.settings if stages.get(one.effect) == stage]

    def robot(self, described: Robot) -> Robot:
        """Return the description with what of drive and noise a description can say."""
        plant, of = described.plant, self.number
        drive = plant.drive.model_copy(
            update={
                "time_constant_s": plant.drive.time_constant_s + of("drive_lag.time_constant"),
                "delay_s": plant.drive.delay_s + of("drive_delay.delay"),
                "max_wheel_rate_rad_s": min(
                    plant.drive.max_wheel_rate_rad_s, of("drive_saturation.limit", math.inf)
                ),
                "max_wheel_acceleration_rad_s2": min(
                    plant.drive.max_wheel_acceleration_rad_s2,
                    of("drive_acceleration_limit.limit", math.inf),
                ),
            }
        )
        noise = plant.gyro.noise_density_rad_per_sqrt_s
        walk = plant.gyro.bias_walk_density_rad_s_per_sqrt_s
        gyro = plant.gyro.model_copy(
            update={
                # As the plant has it: what is known is no less than what is described.
                "noise_density_rad_per_sqrt_s": max(noise, of("gyro_noise.density")),
                "bias_walk_density_rad_s_per_sqrt_s": max(walk, of("gyro_bias_walk.density")),
            }
        )
        return replace(described, plant=plant.model_copy(update={"drive": drive, "gyro": gyro}))

    def turning(self, commanded: Floats) -> Floats:
        """Return the wheel rates that the drive makes of those *commanded* [rad/s], float64[2, n]:
        none within its dead band, and beyond by its gains."""
        least = self.number("drive_deadband.rate")
        gains = np.array([[1 + self.number(f"drive_gain.{side}")] for side in ("left", "right")])
        return np.where(np.abs(commanded) < least, 0.0, gains * commanded)


NOTHING: Final = Granted()
