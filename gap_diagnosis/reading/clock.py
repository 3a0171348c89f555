"""The line from the ECU's ticks to the log's clock, through stamps that jitter.

Its slope is that of a line through the *middle* of the stamps. Jitter is one-sided with a long
tail, and a recorder that was busy stamps a whole burst late, so the middle is Tukey's biweight
(stamps beyond 4.685 spreads have no say), started from Huber's line, which has one solution only;
both are 95 % efficient where the jitter is normal (P. J. Huber, Robust Statistics, 1981). Where the
ECU restarted, the line has a step; its slope is shared.

Its height is that of the *earliest* stamps, of whichever message comes first: delays are never
negative, so that jitter, a poll or the latency of one message make frames late, and the line not.
What all frames of all messages are late by stays in it, and free in every fit.

The slope's standard deviation comes from the scatter of blocks of stamps, not of single ones, since
neighbouring frames are late together (a sandwich estimate clustered by blocks).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.lateness import lasting_changes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_HUBER = 1.345
_BIWEIGHT = 4.685
_NORMAL_SD_PER_MAD = 1.4826
_PASSES = 20
_CONVERGED = 1e-13
_BLOCKS = 60
_STAMP_STEP_S = 1e-6
"""Logs carry whole microseconds."""
_EARLIEST = 1e-3
"""One stamp in a thousand may be early by mistake."""
_A_PART = 0.02
"""So closely, as a share, a step is a part of a tick."""
_ANY_CLOCKS = 1e-4
"""By so much any two clocks may differ."""
_WANDERS_S = 60.0
"""Over a longer time two clocks do not keep one rate, and the earliest stamps are sought anew."""


@dataclass(frozen=True)
class Clock:
    """The fitted line.

    Attributes:
        start_s: float64[segments], log time of tick 0 as each segment would have it.
        tick_s: seconds of the log per tick.
        skew: ECU clock rate over log clock rate - 1.
        skew_sd: its standard deviation; NaN where the log is too short to tell.
        jitter_s: robust spread of the stamps about the line.
    """

    start_s: Floats
    tick_s: float
    skew: float
    skew_sd: float
    jitter_s: float

    def time_s(self, tick: Ints | Floats, segment: Ints | int = 0) -> Floats:
        """Return the log time of ticks."""
        return np.asarray(self.start_s[segment] + self.tick_s * tick, dtype=np.float64)

    def tick(self, time_s: Floats, segment: Ints | int = 0) -> Floats:
        """Return the (fractional) tick at log times."""
        return np.asarray((time_s - self.start_s[segment]) / self.tick_s, dtype=np.float64)


def fit_clock(tick: Ints, segment: Ints, stamp_s: Floats, period_s: float) -> Clock:
    """Return the line through stamps against ticks.

    Where frames come later from some time on, or less late, the line keeps its slope, and its
    height is that of the less late ones. Not where they wander through a tick, or a part of it, and
    begin again: a poll about as long does that.

    Args:
        tick: int64[f], in any order.
        segment: int64[f], 0 to s - 1, each present.
        stamp_s: float64[f]; small numbers (a log's start taken off).
        period_s: described duration of a tick.
    """
    clock = _line(tick, segment, stamp_s, period_s)
    order = np.argsort(stamp_s, kind="stable")
    late_s = stamp_s - clock.time_s(tick, segment)
    part = np.zeros(len(tick), dtype=np.int64)
    for row in lasting_changes(late_s[order], np.arange(len(order))):
        part[order[row:]] += 1
    _, first, stretch = np.unique(
        segment * (part.max() + 1) + part, return_index=True, return_inverse=True
    )
    if not part.any() or len(first) == len(clock.start_s):
        return clock
    bent = _line(tick, stretch.astype(np.int64), stamp_s, period_s)
    later_s = np.diff(bent.start_s)[np.diff(segment[first]) == 0]
    if abs(bent.skew) > max(abs(clock.skew), _ANY_CLOCKS) and _are_parts_of(period_s, later_s):
        return clock
    start_s = np.full(len(clock.start_s), np.inf)
    np.minimum.at(start_s, segment[first], bent.start_s)
    return replace(bent, start_s=start_s)


def _are_parts_of(period_s: float, steps_s: Floats) -> bool:
    """Tell whether steps are a whole tick each, or a half, or a third and so on."""
    parts = period_s / np.maximum(np.abs(steps_s), _STAMP_STEP_S)
    whole = np.maximum(np.rint(parts), 1.0)
    return bool(np.all(np.abs(parts - whole) < _A_PART * whole))


def _line(tick: Ints, segment: Ints, stamp_s: Floats, period_s: float) -> Clock:
    """Return the line with a height of its own in each segment."""
    count = int(segment.max()) + 1
    ecu_s = np.asarray(tick * period_s, dtype=np.float64)
    weight = np.ones(len(tick))
    slope, start = 1.0, np.zeros(count)
    spread = 0.0
    centred: Floats = ecu_s
    residual = stamp_s
    give: Floats = weight
    for turn in range(2 * _PASSES):
        total = np.bincount(segment, weight, count)
        mean_x = np.bincount(segment, weight * ecu_s, count) / total
        mean_y = np.bincount(segment, weight * stamp_s, count) / total
        centred = np.asarray(ecu_s - mean_x[segment], dtype=np.float64)
        power = float(np.sum(weight * centred**2))
        last = slope
        if power > 0:
            slope = float(np.sum(weight * centred * (stamp_s - mean_y[segment]))) / power
        start = mean_y - slope * mean_x
        residual = stamp_s - start[segment] - slope * ecu_s
        spread = _NORMAL_SD_PER_MAD * float(np.median(np.abs(residual)))
        size = np.abs(residual) / max(spread, _STAMP_STEP_S)
        if turn > _PASSES and abs(slope - last) < _CONVERGED:
            break
        if turn < _PASSES:
            weight = _HUBER / np.maximum(size, _HUBER)
        else:
            inside = 1 - (size / _BIWEIGHT) ** 2
            weight = np.maximum(inside, 1e-9) ** 2
            give = np.where(inside > 0, inside * (1 - 5 * (size / _BIWEIGHT) ** 2), 0.0)
    return Clock(
        start_s=start,
        tick_s=slope * period_s,
        skew=1 / slope - 1,
        skew_sd=_slope_sd(centred, weight * residual, give) / slope**2,
        jitter_s=spread,
    )


def lowered(clock: Clock, messages: Iterable[tuple[Ints, Ints, Floats]]) -> Clock:
    """Return the clock with its line where the earliest stamps lie, segment by segment.

    *messages*: of each message sampled with the tick, its frames' ticks, segments and stamps, as
    `fit_clock` takes them.
    """
    earliest = np.full(len(clock.start_s), np.inf)
    for tick, segment, stamp_s in messages:
        late_s = stamp_s - clock.time_s(tick, segment)
        for number in np.unique(segment):
            here = segment == number
            order = np.argsort(tick[here], kind="stable")
            at_s = clock.tick_s * tick[here][order]
            edge_s = lower_edge(late_s[here][order], float(at_s[-1] - at_s[0]))
            earliest[number] = min(earliest[number], edge_s)
    return replace(clock, start_s=clock.start_s + np.where(np.isfinite(earliest), earliest, 0.0))


def lower_edge(late_s: Floats, span_s: float) -> float:
    """Return where the earliest of stamps lie that are late by *late_s* over *span_s*: of those
    that come later from some time on, before that."""
    stretches = np.split(late_s, lasting_changes(late_s, np.arange(len(late_s))))
    return min(_edge(one, span_s * len(one) / len(late_s)) for one in stretches)


def _edge(late_s: Floats, span_s: float) -> float:
    parts = np.array_split(late_s, min(max(round(span_s / _WANDERS_S), 1), len(late_s)))
    return float(np.median([np.quantile(one, _EARLIEST, method="lower") for one in parts]))


def _slope_sd(centred: Floats, pull: Floats, give: Floats) -> float:
    """Return the slope's standard deviation, from each stamp's pull and how it gives way."""
    power = float(np.sum(give * centred**2))
    if len(centred) < 4 or power <= 0:
        return float("nan")
    blocks = min(_BLOCKS, len(centred) // 2)
    block = np.arange(len(centred)) * blocks // len(centred)
    score = np.bincount(block, centred * pull, blocks)
    clustered = float(np.sum(score**2)) * blocks / max(blocks - 2, 1)
    quantised = float(np.sum(centred**2)) * _STAMP_STEP_S**2 / 12
    return float(np.sqrt(clustered + quantised) / power)
