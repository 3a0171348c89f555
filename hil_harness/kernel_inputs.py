"""From frames of any DBC to the whole numbers that the firmware's kernel takes."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from can_bus import MessageSpec
from can_bus.signals import Raw
from hil_harness.errors import HarnessError
from hil_harness.sensor_frames import code_scale
from hil_harness.signal_map import MappedSignal, SignalMap
from hil_harness.signal_roles import Role
from hil_harness.wheel_counter import CountConverter, raw_to_count
from sim_plant import PlantDescription

KERNEL_ROLES: Final[tuple[Role, ...]] = ("left_count", "right_count", "gyro")
"""What the kernel dead-reckons from."""

_MAX_CODE: Final = 65535
"""Largest code that the kernel takes."""


@dataclass(frozen=True)
class GyroCodes:
    """What the gyro codes that the kernel receives mean.

    Attributes:
        sensitivity_rad_s_per_lsb: turn rate per code.
        zero_rate_code: code at rest; need not be whole.
        min_code: at this code and below the sensor is at its limit.
        max_code: at this code and above the sensor is at its limit.
    """

    sensitivity_rad_s_per_lsb: float
    zero_rate_code: float
    min_code: int
    max_code: int


def described_gyro(plant: PlantDescription) -> GyroCodes:
    """Return the codes of the described gyro on the described ADC."""
    low, high = plant.gyro_code_limits
    return GyroCodes(
        sensitivity_rad_s_per_lsb=1 / plant.gyro.sensitivity_lsb_per_rad_s,
        zero_rate_code=plant.gyro.zero_rate_code,
        min_code=low,
        max_code=high,
    )


class KernelInputs:
    """Reads raw values of wheel and gyro signals as the kernel's counts and codes.

    Attributes:
        messages: the messages that carry them.
        gyro: what the gyro codes mean: the described sensor's where the signal is a converter
            code, the DBC's factor, offset and range where it is a turn rate.

    Raises HarnessError for a map without wheels, and for a turn rate the kernel cannot take.
    """

    def __init__(self, signal_map: SignalMap, plant: PlantDescription) -> None:
        """Prepare one conversion per input."""
        self.messages: tuple[MessageSpec, ...] = signal_map.messages(KERNEL_ROLES)
        self._left = raw_to_count(signal_map["left_count"], plant)
        self._right = raw_to_count(signal_map["right_count"], plant)
        gyro = signal_map.get("gyro")
        self.gyro = described_gyro(plant)
        self._gyro: Callable[[Raw], int] = int
        if gyro is not None and gyro.kind == "physical":
            if gyro.signal.is_float:
                self._gyro = _requantised(gyro, plant)
            else:
                self.gyro, self._gyro = _rate_codes(gyro, plant)

    def left_count(self, raw: Raw) -> int:
        """Return the left wheel's wrapping count; to be called with every accepted reading."""
        return _count(self._left, raw)

    def right_count(self, raw: Raw) -> int:
        """Return the right wheel's wrapping count; to be called with every accepted reading."""
        return _count(self._right, raw)

    def gyro_code(self, raw: Raw) -> int:
        """Return the gyro's code, in the codes of ``gyro``."""
        return self._gyro(raw)


def _count(convert: CountConverter | None, raw: Raw) -> int:
    return int(raw) if convert is None else convert(int(raw))


def _rate_codes(
    gyro: MappedSignal, plant: PlantDescription
) -> tuple[GyroCodes, Callable[[Raw], int]]:
    """Return the codes of a turn rate: its raw value, moved so that none is below 0.

    A signal with more than 16 bits keeps the 65536 codes about rest; rates beyond them read as the
    outermost code, which the kernel takes for a saturated sensor.
    """
    signal = gyro.signal
    sensitivity = abs(gyro.si_per_lsb)
    # A rate that counts clockwise is read from its negated raw value.
    sign = 1 if gyro.si_per_lsb > 0 else -1
    low, high = sorted((sign * signal.low_raw, sign * signal.high_raw))
    at_rest = -sign * signal.offset / signal.factor
    shift = min(low, 0)
    if high - shift > _MAX_CODE:
        shift = round(at_rest) - _MAX_CODE // 2
    swing = plant.gyro.range_rad_s / sensitivity
    codes = GyroCodes(
        sensitivity_rad_s_per_lsb=sensitivity,
        zero_rate_code=at_rest - shift,
        min_code=max(math.ceil(at_rest - swing), low, shift) - shift,
        max_code=min(math.floor(at_rest + swing), high, shift + _MAX_CODE) - shift,
    )
    if not codes.min_code < codes.zero_rate_code < codes.max_code:
        raise HarnessError(
            f"{signal.path}: no turn at raw value {sign * at_rest:g}: expected it inside the "
            f"signal's range, {signal.low_raw} to {signal.high_raw}"
        )
    return codes, lambda raw: min(max(sign * int(raw) - shift, 0), _MAX_CODE)


def _requantised(gyro: MappedSignal, plant: PlantDescription) -> Callable[[Raw], int]:
    """Return the way from a rate sent as a float to the nearest code of the described gyro."""
    si_per_code, si_at_zero = code_scale("gyro", plant)

    def code(raw: Raw) -> int:
        nearest = round((gyro.to_si(raw) - si_at_zero) / si_per_code)
        return min(max(nearest, 0), plant.adc.max_code)

    return code
