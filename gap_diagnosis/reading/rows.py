"""One row per tick: where frames come to lie, and what is held between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_ROWS: Final = 10_000_000
"""Longest recording held in memory: 24 h at 100 Hz is 8.64 million ticks."""

LONGEST_FILLED_S: Final = 10.0
"""Ticks lost in a longer gap have no rows."""

_LEAST_FILLED: Final = 0.1
"""A sensor of which fewer ticks arrive does not come with that tick: every row costs time."""


@dataclass(frozen=True)
class Rows:
    """The rows of a recording.

    Attributes:
        tick: int64[n], strictly ascending.
        segment: int64[n], which line of the clock they lie on.
    """

    tick: Ints
    segment: Ints

    def place(self, tick: Ints, value: Floats) -> Floats:
        """Return float64[n]: the value of the first entry of each tick, NaN where none is."""
        result = np.full(len(self.tick), np.nan)
        row = np.searchsorted(self.tick, tick)
        row[row == len(self.tick)] = 0
        there = self.tick[row] == tick
        # Written last to first: of a frame that came twice the first one stands.
        result[row[there][::-1]] = value[there][::-1]
        return result

    def place_mean(self, tick: Ints, value: Floats) -> Floats:
        """Return float64[n]: the mean of the values of each tick, NaN where none is."""
        row = np.searchsorted(self.tick, tick)
        row[row == len(self.tick)] = 0
        good = (self.tick[row] == tick) & np.isfinite(value)
        count = np.bincount(row[good], minlength=len(self.tick))
        total = np.bincount(row[good], value[good], len(self.tick))
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def rows_of_ticks(tick: Ints, segment: Ints, period_s: float, name: str) -> Rows:
    """Return a row for every tick that has a frame, and for those lost between them.

    Raises DiagnosisError, with the *name* of the file, for more rows than are held in memory, and
    where nearly all of them would be empty.
    """
    there, first = np.unique(tick, return_index=True)
    steps = np.diff(there)
    filled = np.where(steps * period_s <= LONGEST_FILLED_S, steps, 1)
    starts = np.concatenate(([0], np.cumsum(filled)))
    if starts[-1] >= MAX_ROWS:
        raise DiagnosisError(
            f"{name}: {starts[-1] + 1} ticks: expected at most {MAX_ROWS}: a shorter log"
        )
    rows = int(starts[-1]) + 1
    if len(there) < _LEAST_FILLED * rows:
        raise DiagnosisError(
            f"{name}: {len(there):,} of {rows:,} ticks of {period_s * 1e3:.3g} ms have frames or "
            "rows of the wheels: expected them evenly in time, each once, not in bursts"
        )
    all_ticks = np.repeat(there, np.concatenate((filled, [1])))
    all_ticks += np.arange(len(all_ticks)) - np.repeat(starts, np.concatenate((filled, [1])))
    segments = np.repeat(segment[first], np.concatenate((filled, [1])))
    return Rows(all_ticks, segments)


def hold(tick: Ints, value: Floats, at: Ints) -> Floats:
    """Return float64[n]: the newest value of ticks up to *at*, NaN before the first.

    Of entries with one tick the first stands.
    """
    if len(tick) == 0:
        return np.full(len(at), np.nan)
    ticks, first = np.unique(tick, return_index=True)
    place = np.searchsorted(ticks, at, side="right") - 1
    held = value[first][np.maximum(place, 0)]
    held[place < 0] = np.nan
    return np.asarray(held, dtype=np.float64)
