"""What the firmware is told about its robot: the described values, handed in by the harness."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_model.errors import FirmwareError


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmwareConstants:
    """The robot as `robot.toml` and the DBC describe it.

    Attributes:
        wheel_radius_m: mean rolling radius [m].
        wheelbase_m: distance between the wheels' contact points [m].
        ticks_per_rev: encoder counts per wheel turn.
        counter_bits: width of the wrapping encoder counters, 4 to 32.
        tick_period_s: time of one tick [s].
        gyro_sensitivity_rad_s_per_lsb: rate per ADC code [rad/s/LSB].
        gyro_zero_rate_code: nominal code at rest [LSB]; need not be whole.
        gyro_min_code: this code and those below are out of the gyro's range [LSB].
        gyro_max_code: this code and those above are out of the gyro's range [LSB].
        max_wheel_rate_rad_s: fastest rate of a wheel [rad/s].

    Raises:
        FirmwareError: a value that no robot has; one line naming field, value and what is right.
    """

    wheel_radius_m: float
    wheelbase_m: float
    ticks_per_rev: int
    counter_bits: int
    tick_period_s: float
    gyro_sensitivity_rad_s_per_lsb: float
    gyro_zero_rate_code: float
    gyro_min_code: int
    gyro_max_code: int
    max_wheel_rate_rad_s: float

    def __post_init__(self) -> None:
        """Refuse values that no robot has."""
        for name, low, high, unit in (
            ("wheel_radius_m", 1e-4, 1e2, "m"),
            ("wheelbase_m", 1e-3, 1e3, "m"),
            ("tick_period_s", 1e-5, 10.0, "s"),
            ("gyro_sensitivity_rad_s_per_lsb", 1e-9, 10.0, "rad/s per LSB"),
            ("max_wheel_rate_rad_s", 1e-3, 1e5, "rad/s"),
        ):
            value = getattr(self, name)
            if not math.isfinite(value) or not low <= value <= high:
                raise FirmwareError(f"{name} = {value}: expected {low:g} to {high:g} {unit}")
        for name, lowest, highest in (
            ("ticks_per_rev", 1, 1 << 24),
            ("counter_bits", 4, 32),
            ("gyro_min_code", 0, 65535),
            ("gyro_max_code", 0, 65535),
        ):
            number = getattr(self, name)
            if not lowest <= number <= highest or number != int(number):
                raise FirmwareError(
                    f"{name} = {number}: expected a whole number from {lowest} to {highest}"
                )
        if not self.gyro_min_code < self.gyro_zero_rate_code < self.gyro_max_code:
            raise FirmwareError(
                f"gyro_zero_rate_code = {self.gyro_zero_rate_code}: expected a code between "
                f"gyro_min_code = {self.gyro_min_code} and gyro_max_code = {self.gyro_max_code}"
            )
