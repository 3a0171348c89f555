"""Which tick a frame belongs to: counters that count to fifteen, unwrapped with the stamps' help.

A shared counter says the tick modulo 15, and it is exact; the stamps say the rest, and they jitter.
From frame to frame the counter's step is taken as the one nearest to the message's cycle. Where the
stamps contradict it by more than half a round, either at least eight frames were lost (the frames
that follow are late for good) or they were only held up (they are late for a while): the *earliest*
arrivals of the next frames tell, since a delay is never negative. Without a counter every frame
is one cycle after the last, and the same question is asked of every stamp that is half a cycle off.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_WINDOW = 64
"""Frames whose earliest arrival stands for "not held up"."""

_RESTART_TICKS = 2.0
"""A step of the phase that is this far from whole rounds is a counter that began anew."""


@dataclass(frozen=True)
class Ticks:
    """The tick of each frame.

    Attributes:
        tick: int64[f], the first frame's being its counter (0 without one).
        segment: int64[f], 0 from the start, one more after each restart of the counter.
    """

    tick: Ints
    segment: Ints


def unwrap_ticks(
    stamp_s: Floats, counter: Ints | None, *, modulo: int, cycle_ticks: int, period_s: float
) -> Ticks:
    """Return the tick of each frame of one message, in the order given.

    Args:
        stamp_s: float64[f], reception stamps; small numbers (a log's start taken off).
        counter: int64[f], tick modulo *modulo*; None where the frames have none.
        modulo: what the counter counts to.
        cycle_ticks: ticks from one frame to the next.
        period_s: duration of a tick.
    """
    frames = len(stamp_s)
    if counter is None:
        round_ticks = cycle_ticks
        steps = np.full(max(frames - 1, 0), cycle_ticks, dtype=np.int64)
        first = 0
    else:
        round_ticks = modulo
        half = modulo // 2
        surplus = (np.diff(counter) - cycle_ticks + half) % modulo - half
        steps = cycle_ticks + surplus
        first = int(counter[0]) if frames else 0
    base = first + np.concatenate(([0], np.cumsum(steps)))[:frames]
    for attempt in range(2):
        contradicted = np.abs(np.diff(stamp_s) / period_s - steps) > round_ticks / 2
        breaks = np.flatnonzero(contradicted) + 1
        ticks = _resolve(stamp_s / period_s, base, breaks, round_ticks, counter is not None)
        if attempt == 0:
            measured = _rate(stamp_s, ticks)
            if not 0.5 < measured / period_s < 2:
                break
            period_s = measured
    return ticks


def _resolve(
    stamp_ticks: Floats, base: Ints, breaks: NDArray[np.intp], round_ticks: int, has_counter: bool
) -> Ticks:
    """Decide at each break how many rounds were missed."""
    phase = stamp_ticks - base
    shift = np.zeros(len(base), dtype=np.int64)
    segment = np.zeros(len(base), dtype=np.int64)
    limits = [*breaks.tolist(), len(base)]
    for place, stop in pairwise(limits):
        before = slice(max(0, place - _WINDOW), place)
        now = int(shift[place - 1])
        jump = float(np.min(phase[place : place + _WINDOW])) - now
        jump -= float(np.min(phase[before] - shift[before]))
        rounds = round(jump / round_ticks)
        rest = jump - rounds * round_ticks
        restarted = has_counter and rounds >= 0 and abs(rest) > _RESTART_TICKS and jump > 0
        shift[place:stop] = now + (round(jump) if restarted else rounds * round_ticks)
        segment[place:stop] = segment[place - 1] + restarted
    return Ticks(base + shift, segment)


def _rate(stamp_s: Floats, ticks: Ticks) -> float:
    """Return the seconds of the log per tick in the longest segment, by the earliest arrivals."""
    longest = int(np.argmax(np.bincount(ticks.segment))) if len(stamp_s) else 0
    rows = np.flatnonzero(ticks.segment == longest)
    if len(rows) < 4:
        return float("nan")
    tick, stamp = ticks.tick[rows], stamp_s[rows]
    edge = max(1, min(_WINDOW * 4, len(rows) // 4))
    guess = (stamp[-1] - stamp[0]) / max(int(tick[-1] - tick[0]), 1)
    lateness = stamp - guess * tick
    first = int(np.argmin(lateness[:edge]))
    last = len(rows) - edge + int(np.argmin(lateness[-edge:]))
    span = int(tick[last] - tick[first])
    return float((stamp[last] - stamp[first]) / span) if span > 0 else float("nan")
