"""Wheel counts on any wire: counters of other widths, wheel angles and wheel distances.

Inside, a wheel is a counter of 8 to 16 bits that wraps. On a foreign bus it may be a counter of
32 bits, or one from 0 to 9999, an angle from 0 to 360 degrees, or a distance in millimetres. All
wrap at some modulus, and one thing carries over: the signed difference of two readings.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil_harness.errors import HarnessError
from hil_harness.signal_map import MappedSignal
from sim_plant import PlantDescription

CountConverter = Callable[[int], int]
"""From a wheel's counter to a raw value, or back; those with a memory must see every reading."""

_TURN_RAD: Final = 2 * math.pi
_ONE_STEP: Final = 1.5
_ROUNDING: Final = 1e-12
"""A turn this close to a whole number of steps is one: decimal factors are not exact in binary."""


class Extender:
    """Follows a wrapping reading: how far it has come from its first value, all wraps undone.

    Half a period is the most it may move between two readings. A period that is no whole number
    (a turn in steps of a milliradian) adds up without error, as whole wraps are counted.
    """

    __slots__ = ("_last", "_period", "_wraps")

    def __init__(self, period: float) -> None:
        """Follow readings that begin again after *period*."""
        self._period = period
        self._last: int | None = None
        self._wraps = 0

    def follow(self, reading: int) -> float:
        """Return the reading without its wraps; a whole number where the period is one."""
        if self._last is not None:
            self._wraps -= round((reading - self._last) / self._period)
        self._last = reading
        return reading + self._wraps * self._period


def count_to_raw(mapped: MappedSignal, plant: PlantDescription) -> CountConverter | None:
    """Return the way from the plant's wrapping count to the raw value; None if they are the same.

    Raises HarnessError for a signal too narrow for the robot's counter.
    """
    _refuse_speed(mapped)
    counter_period = 1 << plant.encoder.counter_bits
    period, low = wrap_of(mapped)
    if mapped.kind == "counts" and period < counter_period:
        raise HarnessError(
            f"{mapped.path} counts to {period - 1} and back to 0, the robot's encoder to "
            f"{counter_period - 1}: expected encoder.counter_bits = "
            f"{max(int(period).bit_length() - 1, 1)} in robot.toml, or a wider signal"
        )
    if _is_the_count(mapped, plant):
        return None
    lsb_per_tick = 1 / _ticks_per_lsb(mapped, plant)
    offset = mapped.signal.offset / mapped.signal.factor
    extender = Extender(counter_period)

    def to_raw(count: int) -> int:
        step = round((extender.follow(count) * lsb_per_tick - offset - low) % period)
        return low if step >= period else step + low

    return to_raw


def raw_to_count(mapped: MappedSignal, plant: PlantDescription) -> CountConverter | None:
    """Return the way from the raw value to the robot's wrapping count; None if they are the same.

    Of a signal that measures an angle or a distance the nearest count is taken. A wider signal may
    jump by more than half of the robot's counter; folded into that counter, the jump could pass
    for a small step. It is given as half the counter instead, which the kernel always refuses as a
    jump.
    """
    _refuse_speed(mapped)
    counter_period = 1 << plant.encoder.counter_bits
    half = counter_period >> 1
    if _is_the_count(mapped, plant):
        return None
    ticks_per_lsb = _ticks_per_lsb(mapped, plant)
    offset = mapped.signal.offset / mapped.signal.factor
    extender = Extender(wrap_of(mapped)[0])
    last: int | None = None
    beyond = 0

    def to_count(raw: int) -> int:
        nonlocal last, beyond
        ticks = round((extender.follow(raw) + offset) * ticks_per_lsb)
        if last is not None and abs(ticks - last) >= half:
            beyond += ticks - last - half
        last = ticks
        return (ticks - beyond) % counter_period

    return to_count


def rounding_ticks(mapped: MappedSignal, plant: PlantDescription) -> float:
    """Return by how much more than a count a reading off the bus may be beside the wheel's way.

    A signal in steps of its own is as much off as such a step, and the nearest count is taken. One
    that steps by whole counts, from a whole one, tells them as they are, however wide it is.
    """
    offset = mapped.signal.offset / mapped.signal.factor
    ticks_per_lsb = abs(_ticks_per_lsb(mapped, plant))
    if mapped.kind == "counts" and ticks_per_lsb == 1.0 and offset == round(offset):
        return 0.0
    return ticks_per_lsb + 1.0


def over_the_bus(
    mapped: MappedSignal, plant: PlantDescription, counts: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return what a kernel counts, int64[ticks], where a wheel counts so, with the signal between.

    Raises HarnessError for a signal too narrow for the robot's counter.
    """
    to_raw, to_count = count_to_raw(mapped, plant), raw_to_count(mapped, plant)
    if to_raw is None or to_count is None:
        return counts
    return np.array([to_count(to_raw(one)) for one in counts.tolist()], dtype=np.int64)


def _refuse_speed(mapped: MappedSignal) -> None:
    if mapped.quantity in ("speed", "turn rate"):
        raise HarnessError(
            f"{mapped.path} is a wheel's speed, which can only be read from a log: expected "
            "counts, an angle or a distance"
        )


def _is_the_count(mapped: MappedSignal, plant: PlantDescription) -> bool:
    """Tell whether the raw value is the robot's own count, from 0 to its last and the same way."""
    whole_counter = (1 << plant.encoder.counter_bits, 0)
    return mapped.kind == "counts" and mapped.si_factor == 1.0 and wrap_of(mapped) == whole_counter


def _ticks_per_lsb(mapped: MappedSignal, plant: PlantDescription) -> float:
    if mapped.kind == "counts":
        return mapped.si_factor
    si_per_tick = _TURN_RAD / plant.encoder.ticks_per_rev
    if mapped.quantity == "length":
        si_per_tick *= plant.wheels.radius_m
    return mapped.si_per_lsb / si_per_tick


def wrap_of(mapped: MappedSignal) -> tuple[float, int]:
    """Return after how many raw steps the signal begins again, and its lowest raw value.

    An angle whose range is one turn, whether or not it holds both ends, wraps at the turn.
    """
    signal = mapped.signal
    if signal.is_float:
        raise HarnessError(f"{signal.path} is a float: a wheel needs a signal of whole numbers")
    period = signal.high_raw - signal.low_raw + 1
    if mapped.quantity == "angle":
        turn = _TURN_RAD / abs(mapped.si_per_lsb)
        if abs(period - turn) < _ONE_STEP and turn > 1:
            nearest = round(turn)
            return (nearest if abs(turn - nearest) < _ROUNDING * turn else turn), signal.low_raw
    return period, signal.low_raw
