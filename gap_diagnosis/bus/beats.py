"""Of which cycle a frame without a counter is, and whether stamps tell which of them are lost.

A frame that is lost leaves an interval of two cycles, and all after it lie on the beat of those
before. One that was held up leaves a long interval and a short one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.stats import binom

from gap_diagnosis.reading.ticks import unwrap_ticks

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_NEIGHBOURS: Final = 33
"""Frames over which a beat may wander off, as of two clocks and of a sender that was restarted."""
_ON_BEAT: Final = 0.25
"""Of a cycle: a frame that is no farther from its beat than this is surely of that beat."""
_NEARLY_ALL: Final = 0.99
"""Of the frames of a message that keeps its beat, so many are on it: some were held up."""
_SOON: Final = 2.0 / 3.0
"""Of the mean from one long interval to the next: a schedule has none sooner, and chance half."""
_BY_CHANCE: Final = 0.01
_OTHER_CYCLE: Final = 0.1
"""A cycle that is said and farther off than this from the usual interval is not believed."""


@dataclass(frozen=True)
class Beats:
    """The cycles of a message's frames.

    Attributes:
        tick: int64[f], in cycles since its first frame.
        cycle_s: from one to the next, on the log's clock.
        is_kept: no stamp leaves open which of them it is of, and each of them was due.
    """

    tick: Ints
    cycle_s: float
    is_kept: bool


def beats_of(stamp_s: Floats, doubled: Bools, cycle_s: float) -> Beats | None:
    """Return the cycles of frames without a counter; None for frames that come all at once.

    Args:
        stamp_s: float64[f], reception stamps in the log's order.
        doubled: bool[f], the frame came twice.
        cycle_s: as described; 0 for a message that says none.
    """
    order = np.argsort(stamp_s, kind="stable")
    stamps = stamp_s[order] - stamp_s[order[0]]
    seen_s = float(np.median(np.diff(stamps)))
    if not seen_s > 0 and not cycle_s > 0:
        return None
    is_described = cycle_s > 0 and abs(seen_s / cycle_s - 1) < _OTHER_CYCLE
    period_s = cycle_s if is_described or not seen_s > 0 else seen_s
    in_order = unwrap_ticks(
        stamps, None, modulo=0, cycle_ticks=1, period_s=period_s, repeats=doubled[order]
    )
    tick = np.empty(len(order), dtype=np.int64)
    tick[order] = in_order.tick
    # A line that is steep by a whole clock's error would lie aslant in a median.
    rate_s = float(stamps[-1]) / max(int(in_order.tick[-1]), 1)
    late_s = stamps - rate_s * in_order.tick
    away_s = np.abs(late_s - median_filter(late_s, _NEIGHBOURS, mode="nearest"))
    is_kept = float(np.quantile(away_s, _NEARLY_ALL)) < _ON_BEAT * rate_s
    return Beats(tick, rate_s, is_kept and not _skips_evenly(in_order.tick))


def _skips_evenly(tick: Ints) -> bool:
    """Tell whether cycles are missing more evenly than chance leaves them out, int64[f] in order.

    Then they were never due: of what is sent every 12 ms by a sender that looks every 10 ms, or in
    stamps of 10 ms, every sixth cycle is missing, and of what comes in bursts all between these.
    """
    steps = np.diff(tick)
    steps = steps[steps > 0]
    apart = np.diff(np.flatnonzero(steps > 1))
    if not len(apart):
        return False
    mean = float(np.mean(apart))
    soon = int(_SOON * mean)
    by_chance = 1.0 - (1.0 - 1.0 / mean) ** soon
    fewest = binom.cdf(np.count_nonzero(apart <= soon), len(apart), by_chance)
    return bool(fewest < _BY_CHANCE)
