"""How fast a wheel really turns that may lose counts.

How many counts are lost is chance, of 12 % of 20 counts a tick 1.5 more or less each time, so that
ramps are told by the other wheel and the gyro: by how much those are off (wheels of two sizes, a
gyro's scale and bias) the wheel's own counts tell, over the whole log. A cruise is told by the own
counts. The gyro's noise must not: a threshold amid a cruise would pick those ticks in which it asks
for more counts, and win 18 nats by that.

How long to average is told tick by tick: as long as longer means agree with shorter ones
(intersecting confidence intervals: Goldenshluger and Nemirovski 1997, Mathematical Methods of
Statistics 6). A cruise is averaged from end to end, the start of a ramp over a few ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from gap_diagnosis.bends import noise_by_bends
from gap_diagnosis.recording import Floats

Ints = NDArray[np.int64]

_REMEMBERED: Final = 8
_SHORTEST_TICKS: Final = 3
_LONGER: Final = 1.6
_LONGEST_S: Final = 8.0
_AGREE_SD: Final = 3.0
_COUNT_SD: Final = math.sqrt(1.0 / 12.0)
_LAID_ANEW: Final = 2
_CURVED: Final = 5.0
"""Means that agree within three standard deviations may be off by more than one: of 15 drives of
known speeds, ramps were off by 1.2 to 1.7 times what this says."""
_CRUISE_S: Final = 0.5
"""What may be averaged for so long is a cruise."""


@dataclass(frozen=True)
class OwnSpeed:
    """A wheel's speed, if it loses counts above a threshold.

    Attributes:
        rad_s: float64[n], its size.
        sd_rad_s: float64[n], how far that is off by chance.
        threshold_rad_s: that threshold.
    """

    rad_s: Floats
    sd_rad_s: Floats
    threshold_rad_s: float

    @cached_property
    def share_above(self) -> Floats:
        """The probability, float64[n], that it is above the threshold."""
        return np.asarray(ndtr((self.rad_s - self.threshold_rad_s) / self.sd_rad_s))


@dataclass(frozen=True)
class WheelSpeed:
    """What is known of one wheel's speed.

    Attributes:
        counted_rad_s: float64[n], as it counts, smoothed.
        known_rad_s: float64[n, k], what it goes with, smoothed alike: the other wheel's rate, the
            turn rate by the gyro and a constant; without a gyro the counts themselves.
        sharp_rad_s: the same, each tick averaged for as long as it may be.
        own_rad_s: float64[n], as it counts, averaged for as long.
        mean_s: float64[n], how long that is.
        sd_rad_s: float64[n], how far that is off by noise and rounding.
        rad_per_count: of the description.
    """

    counted_rad_s: Floats
    known_rad_s: Floats
    sharp_rad_s: Floats
    own_rad_s: Floats
    mean_s: Floats
    sd_rad_s: Floats
    rad_per_count: float

    @cached_property
    def _inverse(self) -> Floats:
        """Pseudo-inverse of the inner products: a robot that never turns says nothing of a gyro."""
        return np.asarray(np.linalg.pinv(self.known_rad_s.T @ self.known_rad_s))

    def losing(self, threshold_rad_s: float, probability: float) -> OwnSpeed:
        """Return the wheel's own speed if above a threshold each count is lost with *probability*.

        At counted rates that may be either it is the one that the other sources are nearer to.
        A fit asks for the same again and again: prediction, scatter and columns about one point.
        """
        return self._losing(threshold_rad_s, probability)

    @cached_property
    def _losing(self) -> Callable[[float, float], OwnSpeed]:
        return lru_cache(maxsize=_REMEMBERED)(self._lost)

    def _lost(self, threshold_rad_s: float, probability: float) -> OwnSpeed:
        counted = np.abs(self.own_rad_s)
        whole = counted / (1.0 - probability)
        seen = self._seen_rad_s(threshold_rad_s, probability)
        is_nearer = np.abs(seen - whole) < np.abs(seen - counted)
        loses = (counted > threshold_rad_s) | ((whole > threshold_rad_s) & is_nearer)
        cruises = np.where(loses, whole, counted)
        lost_rad_s = np.sqrt(np.abs(probability * cruises) * self.rad_per_count / self.mean_s)
        is_cruise = self.mean_s >= _CRUISE_S
        return OwnSpeed(
            np.where(is_cruise, cruises, seen),
            np.hypot(_CURVED * self.sd_rad_s, np.where(is_cruise, lost_rad_s, 0.0)),
            threshold_rad_s,
        )

    def _seen_rad_s(self, threshold_rad_s: float, probability: float) -> Floats:
        """Return the wheel's speed, float64[n], as the other sources see it."""
        counted = np.abs(self.counted_rad_s)
        if self.known_rad_s.shape[1] == 1:
            return np.abs(self.sharp_rad_s[:, 0])
        found: list[tuple[float, Floats]] = []
        for part in (0.0, 0.5, 1.0):
            fast = counted > threshold_rad_s * (1.0 - part * probability)
            for _ in range(_LAID_ANEW):
                turned = self.counted_rad_s / np.where(fast, 1.0 - probability, 1.0)
                weights = self._inverse @ (self.known_rad_s.T @ turned)
                seen = np.abs(self.sharp_rad_s @ weights)
                fast = seen > threshold_rad_s
            left = turned - self.known_rad_s @ weights
            found.append((float(left @ left), seen))
        return min(found, key=lambda one: one[0])[1]


@dataclass(frozen=True)
class WheelSpeeds:
    """What is known of both wheels, told when it is first asked for: most motions are estimated for
    something else.

    Attributes:
        tell: returns it of the left and the right wheel.
    """

    tell: Callable[[], tuple[WheelSpeed, WheelSpeed]]

    @cached_property
    def both(self) -> tuple[WheelSpeed, WheelSpeed]:
        """Of the left and the right wheel."""
        return self.tell()


def wheel_speed(
    own: Floats,
    other: Floats,
    turning: Floats | None,
    *,
    smooth_ticks: float,
    tick_s: float,
    rad_per_count: float,
    rounding_rad: float,
    told_rad2_per_s: float = 0.0,
) -> WheelSpeed:
    """Return what is known of a wheel's speed.

    Args:
        own, other: float64[n], rates of both wheels as counted [rad/s].
        turning: float64[n], difference of both wheels' rates as the gyro tells it, with the sign
            that makes ``other + turning`` this wheel's; None without one.
        smooth_ticks: by how much the counts are smoothed.
        tick_s, rad_per_count, rounding_rad: of the counters.
        told_rad2_per_s: what noise of speeds adds to the variance of a wheel's turn in 1 s.
    """
    parts = [own] if turning is None else [other, turning, np.ones_like(own)]
    noise = 0.0 if turning is None else _noise(turning, own != 0)
    noise = math.hypot(noise, math.sqrt(told_rad2_per_s / tick_s))
    lengths = [_SHORTEST_TICKS]
    while lengths[-1] * _LONGER * tick_s <= _LONGEST_S:
        lengths.append(round(lengths[-1] * _LONGER))
    # Of a count both ends are rounded, however long it goes on.
    rounded = np.array([_COUNT_SD * math.sqrt(2.0) * rounding_rad / (n * tick_s) for n in lengths])
    sds = np.hypot(rounded, [noise / math.sqrt(n) for n in lengths])
    first, last, place = _longest(own if turning is None else other + turning, lengths, sds)
    return WheelSpeed(
        counted_rad_s=_smoothed(own, smooth_ticks),
        known_rad_s=np.column_stack([_smoothed(one, smooth_ticks) for one in parts]),
        sharp_rad_s=np.column_stack([_mean(one, first, last) for one in parts]),
        own_rad_s=_mean(own, first, last),
        mean_s=np.asarray((last - first) * tick_s),
        sd_rad_s=sds[place],
        rad_per_count=rad_per_count,
    )


def _noise(rates: Floats, moving: NDArray[np.bool_]) -> float:
    """Return the standard deviation of one sample while moving: of the sensor, and of wheels that
    slip a little to and fro."""
    bends = np.diff(rates, 2)[moving[2:]]
    return noise_by_bends(bends) if len(bends) else 0.0


def _longest(values: Floats, lengths: Sequence[int], sds: Floats) -> tuple[Ints, Ints, Ints]:
    """Return from where to where each tick may be averaged, int64[n] each, and which length that
    is: about it, up to it or from it on, whichever is the longest."""
    count = len(values)
    ticks = np.arange(count)
    found = (ticks.copy(), ticks + 1, np.full(count, -1))
    for share in (0.5, 1.0, 0.0):
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        for index, (length, sd) in enumerate(zip(lengths, sds, strict=True)):
            before = round((share if index else 0.5) * (length - 1))
            first = np.clip(ticks - before, 0, count - 1)
            last = np.clip(ticks - before + length, 1, count)
            mean = _mean(values, first, last)
            low = np.maximum(low, mean - _AGREE_SD * sd)
            high = np.minimum(high, mean + _AGREE_SD * sd)
            longer = (low <= high) & (index > found[2])
            for known, new in zip(found, (first, last, np.full(count, index)), strict=True):
                known[longer] = new[longer]
    return found


def _mean(values: Floats, first: Ints, last: Ints) -> Floats:
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((total[last] - total[first]) / (last - first))


def _smoothed(values: Floats, width: float) -> Floats:
    return np.asarray(gaussian_filter1d(values, width, mode="nearest"))
