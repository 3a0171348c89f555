"""Which tick a frame belongs to: counters that count to fifteen, unwrapped with the stamps' help.

A shared counter says the tick modulo 15, and it is exact; the stamps say the rest, and they jitter.
From frame to frame the counter's step is taken as the one nearest to the message's cycle. Where the
stamps contradict it by more than half a round, either at least eight frames were lost (all frames
that follow are late by whole rounds) or they were held up (late for a while only): the *earliest*
of the frames that follow tell, since no delay is negative. They are held against the phase of the
whole log (stamp minus tick, modulo a round), which no lost frame changes, so that a wrong guess at
one place does not spoil what follows. Where that phase itself changes over a gap for good, the
sender began anew: a new segment.

Without a counter every frame is taken to be one cycle after the last, a round is one cycle, and the
same question is asked of every stamp that is half a cycle off.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_BLOCK: Final = 128
_SHORT_BLOCK: Final = 16
_WORST_CLOCK: Final = 0.01
"""Two clocks differ by less; what rises faster is lost frames."""
_WINDOW: Final = 64
_LONG_RUN: Final = 20
_RESTART_FRAMES: Final = 100
_RESTART_TICKS: Final = 0.5
_RESTART_PART: Final = 0.15
"""A lasting change of the phase by more ticks, or by more of a round, is no jitter."""
_CONCENTRATED: Final = 0.7
_DRIFT_ERROR: Final = 3e-4
"""How well the clock's rate is known while ticks are still being told apart."""
_GAP_CYCLES: Final = 3


@dataclass(frozen=True)
class Ticks:
    """The tick of each frame.

    Attributes:
        tick: int64[f]; the first frame's is its counter, 0 without one.
        segment: int64[f], 0 from the start, one more after each restart of the sender.
    """

    tick: Ints
    segment: Ints


def unwrap_ticks(
    stamp_s: Floats,
    counter: Ints | None,
    *,
    modulo: int,
    cycle_ticks: int,
    period_s: float,
    repeats: Bools | None = None,
) -> Ticks:
    """Return the tick of each frame of one message, in the order given.

    Args:
        stamp_s: float64[f], reception stamps; small numbers (a log's start taken off).
        counter: int64[f], tick modulo *modulo*; None where the frames have none.
        modulo: what the counter counts to.
        cycle_ticks: ticks from one frame to the next.
        period_s: duration of a tick.
        repeats: bool[f], the frame says what the one before it said; without a counter, one that
            comes in between is a duplicate.
    """
    steps, round_ticks = _steps(stamp_s, counter, modulo, cycle_ticks, period_s, repeats)
    first = 0 if counter is None or not len(counter) else int(counter[0])
    base = first + np.concatenate(([0], np.cumsum(steps)))[: len(stamp_s)].astype(np.int64)
    lost_are_rounds = counter is None or cycle_ticks > modulo / 2
    stamp_ticks = stamp_s / period_s
    stamp_ticks = stamp_ticks / (1 + _drift(stamp_ticks, base, round_ticks, lost_are_rounds))
    elapsed = np.diff(stamp_ticks)
    breaks = np.flatnonzero(np.abs(elapsed - steps) > round_ticks / 2) + 1
    phase = stamp_ticks - base
    gaps = breaks[elapsed[breaks - 1] > _GAP_CYCLES * cycle_ticks]
    starts = [
        0,
        *(
            place
            for place in gaps.tolist()
            if _restarts(phase, place, round_ticks, _DRIFT_ERROR * float(elapsed[place - 1]))
        ),
    ]
    tick, segment = base.copy(), np.zeros(len(base), dtype=np.int64)
    for number, (start, stop) in enumerate(pairwise([*starts, len(base)])):
        inside = breaks[(breaks > start) & (breaks < stop)] - start
        part = slice(start, stop)
        tick[part] += _shift(phase[part], inside, round_ticks)
        segment[part] = number
        if number:
            gone = round(float(stamp_ticks[start] - stamp_ticks[start - 1]))
            tick[part] += tick[start - 1] + max(gone, 1) - tick[start]
    return Ticks(tick, segment)


def off_beat(stamps: Floats, beats: Floats | Ints) -> float:
    """Return how far stamps of these beats lie from an even one, RMS in their unit."""
    line = np.polynomial.Polynomial.fit(beats, stamps, 1)
    return float(np.sqrt(np.mean((stamps - line(beats)) ** 2)))


def _steps(
    stamp_s: Floats,
    counter: Ints | None,
    modulo: int,
    cycle_ticks: int,
    period_s: float,
    repeats: Bools | None,
) -> tuple[Ints, int]:
    """Return the likeliest step from each frame to the next, and what it is known up to."""
    if counter is not None:
        half = modulo // 2
        return cycle_ticks + (np.diff(counter) - cycle_ticks + half) % modulo - half, modulo
    steps = np.full(max(len(stamp_s) - 1, 0), cycle_ticks, dtype=np.int64)
    if repeats is not None and len(steps) > 1:
        elapsed = np.diff(stamp_s) / (cycle_ticks * period_s)
        together = np.concatenate(([False], elapsed[:-1] + elapsed[1:] < 1.4))
        steps[repeats[1:] & together & (elapsed < 0.25)] = 0
    return steps, cycle_ticks


def _drift(stamp_ticks: Floats, base: Ints, round_ticks: int, lost_are_rounds: bool) -> float:
    """Return how much longer a tick lasts on the log's clock than described, less 1.

    From the earliest arrivals of neighbouring blocks; the median passes over lost rounds. Where
    every lost frame is a round, the stamps are believed about them first, unless these jitter so
    much that they lie nearer to the beat of frames of which none was lost.
    """
    if lost_are_rounds and len(base) > 2:
        lost = np.rint((np.diff(stamp_ticks) - np.diff(base)) / round_ticks).astype(np.int64)
        believed = base + np.concatenate(([0], np.cumsum(lost))) * round_ticks
        base = min((believed, base), key=lambda one: off_beat(stamp_ticks, one))
    size = min(_BLOCK, max(_SHORT_BLOCK, len(base) // 16))
    blocks = len(base) // size
    if blocks < 2:
        return 0.0
    used = blocks * size
    phases = (stamp_ticks[:used] - base[:used]).reshape(blocks, size)
    row, earliest = np.arange(blocks), np.argmin(phases, axis=1)
    at = base[:used].reshape(blocks, size)[row, earliest].astype(np.float64)
    phase = phases[row, earliest]
    slope = _median_slope(at, phase, 1)
    # Without the steps of whole rounds, far blocks can be held against each other.
    flat = np.unwrap(phase - slope * at, period=round_ticks)
    return slope + _median_slope(at, flat, max(1, blocks // 4))


def _median_slope(x: Floats, y: Floats, lag: int) -> float:
    run, rise = x[lag:] - x[:-lag], y[lag:] - y[:-lag]
    slope = rise[run > 0] / run[run > 0]
    believable = slope[np.abs(slope) < _WORST_CLOCK]
    return float(np.median(believable)) if len(believable) else 0.0


def _centre(phase: Floats, round_ticks: int) -> tuple[float, float]:
    """Return the middle of phases modulo a round, and how concentrated they are, 0 to 1."""
    mean = np.mean(np.exp(2j * np.pi * phase / round_ticks))
    return float(np.angle(mean)) * round_ticks / (2 * np.pi), float(np.abs(mean))


def _restarts(phase: Floats, place: int, round_ticks: int, drifted: float) -> bool:
    """Tell whether the phase changes at *place* for good, and by more than it has *drifted*."""
    before = phase[max(0, place - 2 * _RESTART_FRAMES) : place]
    after = phase[place : place + 2 * _RESTART_FRAMES]
    if min(len(before), len(after)) < _RESTART_FRAMES:
        return False
    (was, sure_before), (now, sure_after) = (
        _centre(part, round_ticks) for part in (before, after[_WINDOW:])
    )
    sure = min(sure_before, sure_after)
    if sure < _CONCENTRATED:
        return False
    away = abs((now - was + round_ticks / 2) % round_ticks - round_ticks / 2)
    spread = round_ticks / (2 * np.pi) * np.sqrt(-2 * np.log(min(sure, 1.0)))
    least = min(_RESTART_TICKS, _RESTART_PART * round_ticks)
    return bool(away > least + drifted + 5 * spread / np.sqrt(_RESTART_FRAMES))


def _shift(phase: Floats, breaks: NDArray[np.intp], round_ticks: int) -> Ints:
    """Return the whole rounds, in ticks, by which each frame is later than its base says."""
    away = (phase - _tracked(phase, round_ticks)) / round_ticks
    rounds = np.rint(away).astype(np.int64)
    shift = np.zeros(len(phase), dtype=np.int64)
    for start, stop in pairwise([0, *breaks.tolist(), len(phase)]):
        if stop - start >= _LONG_RUN:
            seen = np.sort(rounds[start : min(stop, start + 8 * _WINDOW)])
            shift[start:stop] = seen[len(seen) // 10]
        else:
            shift[start:stop] = np.min(rounds[start : start + _WINDOW])
    return (shift - shift[0]) * round_ticks if len(shift) else shift


def _tracked(phase: Floats, round_ticks: int) -> Floats:
    """Return the slowly drifting middle of the phases, known up to whole rounds, per frame."""
    blocks = max(1, len(phase) // _BLOCK)
    edges = np.linspace(0, len(phase), blocks + 1).astype(np.int64)
    middles = [_centre(phase[a:b], round_ticks)[0] for a, b in pairwise(edges.tolist())]
    smooth = np.unwrap(np.array(middles), period=round_ticks)
    if blocks > 4:
        padded = np.pad(smooth, 2, mode="edge")
        smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    where = 0.5 * (edges[1:] + edges[:-1])
    return np.asarray(np.interp(np.arange(len(phase)), where, smooth))
