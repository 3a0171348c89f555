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
        rest_code: from which the gyro's code grows meanwhile.
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

    def left_count(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the left counter's gain after so many ticks, rounded up."""
        return -self._gained(-self.left_step, ticks)

    def right_count(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the right counter's gain after so many ticks, rounded down."""
        return self._gained(self.right_step, ticks)

    def _gained(self, step: int, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        if self.ramp_ticks:
            each = step / (2.0 * self.ramp_ticks * self.over_ticks)
            whole = ticks.astype(np.float64) ** 2 * each
            return np.floor(whole).astype(np.int64)
        start = int(ticks[0])
        gained = start * step // self.over_ticks  # of any size
        left_over = start * step - gained * self.over_ticks
        return gained + (left_over + (ticks - start) * step) // self.over_ticks

    def codes(self, ticks: NDArray[np.int64]) -> NDArray[np.int64] | int:
        """Return the gyro's code in each tick."""
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
            if one.frame_every > 0:
                part[ticks % one.frame_every == 0, 2] = FRESH
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
