"""A drive as stretches, each described by a few numbers, and the kernel's inputs of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import FRESH, STALE

CHUNK_TICKS: Final = 1 << 16


@dataclass(frozen=True)
class Stretch:
    """So many ticks of a drive: what the counters gain in them, and what arrives.

    Attributes:
        ticks: how many.
        left_step, right_step: gain of each counter in each `over_ticks` of them [encoder ticks]; on
            the way there the left one is rounded up and the right one down, so that an odd count
            of both goes to left and right in turn.
        frame_every: in each so manieth tick an encoder frame arrives, else none; 0: never.
        gyro_code: the gyro's code [LSB].
        gyro_validity: FRESH or INVALID.
        ramp_ticks: the speed grows evenly from zero to that gain within so many; 0: it is kept.
        rest_code: from which the gyro's code grows meanwhile; of a swing, the code on the way back.
        lead_counts: by half of so many each wheel is ahead of that, and no longer, in turn.
        lead_ticks, lead_over: for lead_ticks / lead_over ticks each.
        lead_start: how much of the first lead is over when the stretch begins [ticks / lead_over].
        is_swing: the wheels go to and fro, lead_ticks each way, with a ramp at both ends.
        pattern: over and over, a tick each: by how many counts left and right are ahead of that,
            and whether an encoder frame arrives; empty: none.
    """

    ticks: int
    left_step: int
    right_step: int
    frame_every: int
    gyro_code: int
    gyro_validity: int
    over_ticks: int = 1
    ramp_ticks: int = 0
    rest_code: int = 0
    lead_counts: int = 0
    lead_ticks: int = 1
    lead_over: int = 1
    lead_start: int = 0
    is_swing: bool = False
    pattern: tuple[tuple[int, int, bool], ...] = ()

    def left_count(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the left counter's gain after so many ticks, rounded up, with its lead."""
        return -self._gained(-self.left_step, ticks, -self._lead(ticks)) + self._ahead(ticks, 0)

    def right_count(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the right counter's gain after so many ticks, rounded down, with its lead."""
        return self._gained(self.right_step, ticks, self._lead(ticks)) + self._ahead(ticks, 1)

    def _ahead(self, ticks: NDArray[np.int64], wheel: int) -> NDArray[np.int64]:
        """Return by how many counts the pattern has a wheel ahead after so many ticks."""
        if not self.pattern:
            return np.zeros_like(ticks)
        one = np.array([place[wheel] for place in self.pattern], dtype=np.int64)
        return one[(ticks - 1) % len(one)]

    def arrivals(self, ticks: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return in which ticks an encoder frame arrives."""
        if self.frame_every == 0:
            return np.zeros(ticks.shape, dtype=np.bool_)
        arrives: NDArray[np.bool_] = ticks % self.frame_every == 0
        if self.pattern:
            one = np.array([place[2] for place in self.pattern])
            arrives &= one[(ticks - 1) % len(one)]
        return arrives

    def _lead(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return twice the lead of each wheel after so many ticks."""
        changes = (ticks * self.lead_over + self.lead_start) // self.lead_ticks
        return self.lead_counts * (1 - changes % 2)

    def _gained(
        self, step: int, ticks: NDArray[np.int64], half_counts: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return so many ticks' gain with so many half counts, rounded down."""
        if self.is_swing:
            ticks = self.lead_ticks - np.abs(self.lead_ticks - ticks % (2 * self.lead_ticks))
        if self.ramp_ticks:
            at_rate = self._ramped(ticks.astype(np.float64))
            whole = at_rate * step / self.over_ticks + half_counts / 2.0
            return np.floor(whole).astype(np.int64)
        start, over = int(ticks[0]), 2 * self.over_ticks
        gained = 2 * start * step // over  # of any size
        left_over = 2 * start * step - gained * over
        part = left_over + 2 * (ticks - start) * step + half_counts * self.over_ticks
        return gained + part // over

    def _ramped(self, ticks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how many ticks at the full speed go as far as so many with ramps."""
        up = np.minimum(ticks, self.ramp_ticks)
        down = np.zeros_like(ticks)
        if self.is_swing:
            down = np.maximum(ticks - (self.lead_ticks - self.ramp_ticks), 0.0)
        return ticks - up + (up**2 - down**2) / (2.0 * self.ramp_ticks)

    def codes(self, ticks: NDArray[np.int64]) -> NDArray[np.int64] | int:
        """Return the gyro's code in each tick."""
        if self.is_swing:
            is_back = (ticks - 1) // self.lead_ticks % 2 == 1
            return np.where(is_back, self.rest_code, self.gyro_code)
        if not self.ramp_ticks:
            return self.gyro_code
        return self.rest_code + (self.gyro_code - self.rest_code) * ticks // self.ramp_ticks


Drive = tuple[Stretch, ...]
"""From power-on, with counters at zero; before the first stretch comes one tick, the baseline."""


def drive_chunks(drive: Sequence[Stretch]) -> Iterator[NDArray[np.int64]]:
    """Yield the kernel's inputs int64[n, 5], at most CHUNK_TICKS at a time, however long it is."""
    first = drive[0]
    code = first.rest_code if first.ramp_ticks else first.gyro_code
    yield np.array([[0, 0, FRESH, code, first.gyro_validity]], dtype=np.int64)
    left = right = 0
    for one in drive:
        for start in range(0, one.ticks, CHUNK_TICKS):
            ticks = np.arange(start + 1, min(start + CHUNK_TICKS, one.ticks) + 1, dtype=np.int64)
            part = np.empty((ticks.size, 5), dtype=np.int64)
            part[:, 0] = left + one.left_count(ticks)
            part[:, 1] = right + one.right_count(ticks)
            part[:, 2] = STALE
            part[one.arrivals(ticks), 2] = FRESH
            part[:, 3], part[:, 4] = one.codes(ticks), one.gyro_validity
            yield part
        gains = gain(one)
        left, right = left + gains[0], right + gains[1]


def gain(one: Stretch) -> tuple[int, int]:
    """Return what the counters gain in a stretch, left and right [encoder ticks]."""
    last = np.array([one.ticks], dtype=np.int64)
    return int(one.left_count(last)[0]), int(one.right_count(last)[0])


def until(drive: Drive, ticks: int) -> Drive:
    """Return the first so many ticks of a drive, the baseline not counted."""
    kept: list[Stretch] = []
    for one in drive:
        if ticks <= 0:
            break
        kept.append(replace(one, ticks=min(one.ticks, ticks)))
        ticks -= one.ticks
    return tuple(kept)
