"""Wheel counts on any wire: counters of other widths, wheel angles and wheel distances.

Inside, a wheel is a counter of 8 to 16 bits that wraps. On a foreign bus it may be a counter of
32 bits, or one from 0 to 9999, an angle from 0 to 360 degrees, or a distance in millimetres. All
wrap at some modulus, and one thing carries over: the signed difference of two readings.
"""

import math
from collections.abc import Callable
from typing import Final

from hil_harness.errors import HarnessError
from hil_harness.signal_map import MappedSignal
from sim_plant import PlantDescription

CountConverter = Callable[[int], int]
"""From a wheel's counter to a raw value, or back; those with a memory must see every reading."""

_TURN_RAD: Final = 2 * math.pi


class Extender:
    """Follows a wrapping reading: the sum of its signed differences, from its first value on."""

    __slots__ = ("_half", "_last", "_modulus", "total")

    def __init__(self, modulus: int) -> None:
        """Follow readings that wrap at *modulus*."""
        self._modulus = modulus
        self._half = modulus // 2
        self._last: int | None = None
        self.total = 0

    def follow(self, reading: int) -> int:
        """Return the reading without its wraps."""
        if self._last is None:
            self.total = reading
        else:
            step = (reading - self._last + self._half) % self._modulus - self._half
            self.total += step
        self._last = reading
        return self.total


def count_to_raw(mapped: MappedSignal, plant: PlantDescription) -> CountConverter | None:
    """Return the way from the plant's wrapping count to the raw value; None if they are the same.

    Raises HarnessError for a signal too narrow for the robot's counter.
    """
    counter_modulus = 1 << plant.encoder.counter_bits
    modulus, low = _wrap(mapped)
    if mapped.kind == "counts":
        if modulus == counter_modulus and low == 0:
            return None
        if modulus < counter_modulus:
            raise HarnessError(
                f"{mapped.path} counts to {modulus - 1} and back to 0, the robot's encoder to "
                f"{counter_modulus - 1}: expected encoder.counter_bits = "
                f"{max(modulus.bit_length() - 1, 1)} in robot.toml, or a wider signal"
            )
        extender = Extender(counter_modulus)
        return lambda count: (extender.follow(count) - low) % modulus + low
    lsb_per_tick = _si_per_tick(mapped, plant) / mapped.si_per_lsb
    offset = mapped.signal.offset / mapped.signal.factor
    extended = Extender(counter_modulus)
    return lambda count: (
        (round(extended.follow(count) * lsb_per_tick - offset) - low) % modulus + low
    )


def raw_to_count(mapped: MappedSignal, plant: PlantDescription) -> CountConverter | None:
    """Return the way from the raw value to the robot's wrapping count; None if they are the same.

    Of a signal that measures an angle or a distance the nearest count is taken.
    """
    counter_modulus = 1 << plant.encoder.counter_bits
    modulus, low = _wrap(mapped)
    if mapped.kind == "counts":
        if modulus == counter_modulus and low == 0:
            return None
        if modulus % counter_modulus == 0:
            return lambda raw: raw % counter_modulus
        counter = Extender(modulus)
        return lambda raw: counter.follow(raw) % counter_modulus
    ticks_per_lsb = mapped.si_per_lsb / _si_per_tick(mapped, plant)
    offset = mapped.signal.offset / mapped.signal.factor
    extender = Extender(modulus)
    return lambda raw: round((extender.follow(raw) + offset) * ticks_per_lsb) % counter_modulus


def _si_per_tick(mapped: MappedSignal, plant: PlantDescription) -> float:
    turn_per_tick = 1 / plant.encoder.ticks_per_rev
    if mapped.quantity == "length":
        return _TURN_RAD * plant.wheels.radius_m * turn_per_tick
    return _TURN_RAD * turn_per_tick


def _wrap(mapped: MappedSignal) -> tuple[int, int]:
    """Return after how many raw steps the signal begins again, and its lowest raw value.

    An angle whose range is one turn, whether or not it holds both ends, wraps at the turn.
    """
    signal = mapped.signal
    if signal.is_float:
        raise HarnessError(f"{signal.path} is a float: a wheel needs a signal of whole numbers")
    modulus = signal.high_raw - signal.low_raw + 1
    if mapped.quantity == "angle":
        turn = _TURN_RAD / abs(mapped.si_per_lsb)
        if abs(modulus - turn) <= 1 and round(turn) > 1:
            modulus = round(turn)
    return modulus, signal.low_raw
