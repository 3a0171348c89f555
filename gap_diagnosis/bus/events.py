"""What happened to the frames of one message: lost, doubled, swapped, late."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import fisher_exact

from gap_diagnosis.bus.beats import beats_of
from gap_diagnosis.bus.counting import Runs
from gap_diagnosis.lateness import blocks_of, lasting_changes
from gap_diagnosis.recording import FrameTimes, Recording

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_TOGETHER: Final = 0.3
"""Of a cycle: a repeat that comes sooner is a duplicate where no counter tells."""
_BY_CHANCE: Final = 0.01
FEWEST_FRAMES: Final = 20
_AT_TICKS: Final = 0.9
"""Mean resultant length of latenesses that spread by 7 % of a tick about whole ones."""
_WANDERS_BACK: Final = 0.5
"""A change is none where all of a log wanders against it by more than this share of it."""
_RESTLESS: Final = 0.5
"""Of the spread of the most restless part of a log, another has as much that is no other."""
_STAMP_STEP_S: Final = 1e-6
"""Of a log; what stamps spread by less is its rounding."""
_EARLIEST: Final = 1e-3
"""One stamp in a thousand may be early by mistake."""


@dataclass(frozen=True)
class Message:
    """One message's frames, classified.

    Attributes:
        name: of the message.
        is_sensor: it carries a sensor.
        t_s: float64[f], stamps in the log's order.
        tick: int64[f], in ticks of the ECU (or cycles where there is no counter).
        cycle: ticks from frame to frame.
        cycle_s: the same in seconds.
        has_counter: the ticks come from counters.
        tells_losses: which frames are missing is known, by counters or by the beat of the stamps.
        doubled, swapped: bool[f].
        late_s: float64[f], stamp less the clock's line; NaN where there is no line.
        changes: bool[f], the payload differs from that of the frame before it.
        not_sent, sent_twice: ticks in which its sender said nothing, or spoke twice.
        known_late_s: by how much it is known to be late.
        usual_spread_s: up to which its lateness spreads on this bus, where that is known.
        part: int64[f], which of the parts, between lasting changes of its lateness, a frame is of.
        moved_s: float64[f], by how much its part is later than the log's median.
    """

    name: str
    is_sensor: bool
    t_s: Floats
    tick: Ints
    cycle: int
    cycle_s: float
    has_counter: bool
    tells_losses: bool
    doubled: Bools
    swapped: Bools
    late_s: Floats
    changes: Bools
    not_sent: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    sent_twice: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    known_late_s: float = 0.0
    usual_spread_s: float = 0.0
    part: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    moved_s: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def frames(self) -> int:
        """Frames that are no duplicates."""
        return int(np.count_nonzero(~self.doubled))

    def runs(self, windows: tuple[tuple[float, float], ...] = ()) -> Runs:
        """Return the losses outside windows (start, stop) of log time."""
        tick, first = np.unique(self.tick[~self.doubled], return_index=True)
        stamp = self.t_s[~self.doubled][first]
        if len(self.not_sent):
            stamp = np.interp(np.union1d(tick, self.not_sent), tick, stamp)
            tick = np.union1d(tick, self.not_sent)
        lost = np.rint(np.diff(tick) / self.cycle).astype(np.int64) - 1
        outside = np.ones(len(lost), dtype=np.bool_)
        for start, stop in windows:
            outside &= ~((stamp[:-1] <= start + 1e-3) & (stamp[1:] >= stop - 1e-3))
        lengths = lost[(lost > 0) & outside]
        return Runs(len(tick), lengths)

    @property
    def repeated(self) -> Bools:
        """Mark frames that came twice though they were sent once."""
        return self.doubled & ~np.isin(self.tick, self.sent_twice)

    def lost_ticks(self) -> Ints:
        """Return the ticks within its time whose frame never came."""
        came = np.unique(self.tick)
        return np.setdiff1d(np.arange(came[0], came[-1], self.cycle), came)

    def steady(self) -> Bools:
        """Mark frames whose stamps tell of jitter: neither doubled nor swapped."""
        good = ~self.doubled & ~self.swapped & np.isfinite(self.late_s)
        good[:-1] &= ~self.swapped[1:]
        return good

    def restless(self) -> Bools:
        """Mark the steady frames of those parts in which stamps spread most: all where a log has no
        parts, or these are alike."""
        good = self.steady()
        parts = np.unique(self.part)
        if len(parts) < 2:
            return good
        each = [_spread(self.late_s[good & (self.part == one)]) for one in parts]
        spread = np.maximum(each, _STAMP_STEP_S)
        return good & np.isin(self.part, parts[spread >= _RESTLESS * spread.max()])

    @property
    def changes_s(self) -> list[float]:
        """When its lateness changed for good."""
        return [float(one) for one in self.t_s[1:][np.diff(self.part) > 0]]

    @property
    def earliest_s(self) -> float:
        """What the earliest frames are late by: delays are never negative, so this is no jitter."""
        return _earliest((self.late_s + self.moved_s)[self.steady()])

    def earliest_within_s(self, start_s: float, stop_s: float) -> float:
        """Return what the earliest frames of a window are late by; NaN for too few.

        Of another message's window those of the part that most are of: when a lateness changed is
        told to a cycle, and a message that comes often is in time again before it.
        """
        inside = self.steady() & (self.t_s >= start_s) & (self.t_s < stop_s)
        if not inside.any():
            return math.nan
        inside &= self.part == np.bincount(self.part[inside]).argmax()
        late = (self.late_s + self.moved_s)[inside]
        return _earliest(late) if len(late) >= FEWEST_FRAMES else math.nan

    def unhindered(self) -> Bools:
        """Mark steady frames that none before them can have held up: all had come by then."""
        steady, earliest_s = self.steady(), np.zeros(len(self.t_s))
        for one in np.unique(self.part):
            own = self.part == one
            earliest_s[own] = _earliest(self.late_s[own & steady])
        sent_s = self.t_s - self.late_s + earliest_s
        before = np.maximum.accumulate(self.t_s)[:-1]
        good = self.restless()
        good[1:] &= before <= sent_s[1:]
        return good


def classify(
    name: str,
    frames: FrameTimes,
    recording: Recording,
    *,
    is_sensor: bool,
    changes_s: Sequence[float] = (),
) -> Message | None:
    """Classify the frames of one message; None for too few or without a cycle.

    *changes_s*: when others' lateness changed for good, for a message that does not show when its
    own did.
    """
    if len(frames.t_s) < 20:
        return None
    period = recording.tick_period_s
    has_counter = tells_losses = frames.modulo > 0
    changes = np.concatenate(([True], frames.payload[1:] != frames.payload[:-1]))
    if has_counter:
        tick = frames.counter
        doubled = _told_twice(tick)
        steps = np.diff(np.unique(tick))
        cycle = max(1, round(frames.cycle_s / period) if frames.cycle_s else int(np.median(steps)))
    else:
        doubled = _said_twice(frames.t_s, changes, frames.cycle_s)
        beats = beats_of(frames.t_s, doubled, frames.cycle_s)
        if beats is None:
            return None
        tick, period, cycle = beats.tick, beats.cycle_s, 1
        # A command may be sent when there is something to say.
        tells_losses = beats.is_kept and is_sensor
    highest = np.maximum.accumulate(np.concatenate(([tick[0]], tick[:-1])))
    swapped = (tick < highest) & ~doubled
    late = np.full(len(tick), np.nan)
    if has_counter:
        late = frames.t_s - _line(recording, tick)
        late = late if is_sensor else _late_by_the_bus(late, period)
    good = ~doubled & ~swapped & np.isfinite(late)
    part, moved = np.zeros(len(tick), dtype=np.int64), np.zeros(len(tick))
    if has_counter:
        part = _parts(late, frames.t_s - period * tick, good)
        if not part.any():
            part = np.searchsorted(changes_s, frames.t_s).astype(np.int64)
        moved = _moved(late, good, part)
        late = late - _wander(late, good, part) + np.median(late)
    return Message(
        name,
        is_sensor,
        frames.t_s,
        tick,
        cycle,
        cycle * period,
        has_counter,
        tells_losses,
        doubled,
        swapped,
        late,
        changes,
        part=part,
        moved_s=moved,
    )


def as_sent(messages: Sequence[Message], answers: Collection[str]) -> list[Message]:
    """Return the messages, those of the ECU with what it did not send, or sent twice.

    A bus loses and doubles each message on its own. What all of the ECU's answers show in the same
    tick it did itself: it missed the tick, or counted on while no encoder frame came. Of a single
    answer nobody can tell.
    """
    own = [one for one in messages if one.name in answers and one.has_counter]
    if not own:
        return list(messages)
    lost, twice = own[0].lost_ticks(), own[0].tick[own[0].doubled]
    for one in own[1:]:
        lost = np.intersect1d(lost, one.lost_ticks())
        twice = np.intersect1d(twice, one.tick[one.doubled])
    return [
        replace(one, not_sent=lost, sent_twice=np.unique(twice))
        if one.name in answers and one.has_counter
        else one
        for one in messages
    ]


def _late_by_the_bus(late_s: Floats, tick_period_s: float) -> Floats:
    """Return latenesses of what no sensor says less whole ticks, where nearly all are about these.

    The ECU answers at its ticks: a sensor's frame that comes after one is answered at the next.
    """
    there = late_s[np.isfinite(late_s)]
    turned = np.exp(2j * math.pi * there / tick_period_s)
    mean = turned.mean() if len(there) else 0.0
    if abs(mean) < _AT_TICKS:
        return late_s
    about_s = float(np.angle(mean)) * tick_period_s / (2 * math.pi)
    ticks = np.rint((late_s - about_s) / tick_period_s)
    return np.asarray(late_s - (ticks - np.nanmin(ticks)) * tick_period_s)


def _told_twice(tick: Ints) -> Bools:
    """Mark frames whose tick another one before them had."""
    doubled = np.ones(len(tick), dtype=np.bool_)
    doubled[np.unique(tick, return_index=True)[1]] = False
    return doubled


def _said_twice(stamp_s: Floats, changes: Bools, cycle_s: float) -> Bools:
    """Mark frames that say what the last one said too soon after it, where no counter tells."""
    doubled = np.zeros(len(stamp_s), dtype=np.bool_)
    apart_s = np.diff(stamp_s)
    soon, fresh = apart_s < _TOGETHER * (cycle_s or float(np.median(apart_s))), changes[1:]
    # Stamps that jitter bring frames together whatever they say: of a steering angle that rests all
    # of these looked doubled.
    again = [np.count_nonzero(soon & ~fresh), np.count_nonzero(~soon & ~fresh)]
    by_jitter = [np.count_nonzero(soon & fresh), np.count_nonzero(~soon & fresh)]
    if not by_jitter[0] or fisher_exact([again, by_jitter], "greater").pvalue < _BY_CHANCE:
        doubled[1:] = soon & ~fresh
    return doubled


def _line(recording: Recording, tick: Ints) -> Floats:
    """Return the log time of ticks by the recording's clock, continued beyond its rows."""
    rows, times = recording.tick, recording.t_s
    line = np.interp(tick, rows, times)
    rate = (times[-1] - times[0]) / max(int(rows[-1] - rows[0]), 1)
    line = np.where(tick < rows[0], times[0] + (tick - rows[0]) * rate, line)
    return np.where(tick > rows[-1], times[-1] + (tick - rows[-1]) * rate, line)


def _wander(late: Floats, good: Bools, part: Ints) -> Floats:
    """Return the slow change of lateness within each part: block medians, joined."""
    slow = np.full(len(late), np.median(late[good]) if good.any() else 0.0)
    for one in np.unique(part):
        own = np.flatnonzero(part == one)
        where, middle = blocks_of(late, own[good[own]])
        if len(where):
            slow[own] = np.interp(own, where, middle)
    return slow


def _parts(late: Floats, by_described: Floats, good: Bools) -> Ints:
    """Return the parts of a log between lasting changes of lateness: int64[f].

    Stamps of a poll about as long as a tick wander through it and begin again: that is no change.
    *by_described*: stamps less their ticks as long as described.
    """
    part = np.zeros(len(late), dtype=np.int64)
    rows = np.flatnonzero(good)
    changes = lasting_changes(late, rows)
    if changes:
        steps, described = (np.diff(blocks_of(one, rows)[1]) for one in (late, by_described))
        usual = float(np.median(steps))
        change = float(steps[np.argmax(np.abs(steps - usual))])
        # A clock's line that is tilted by a change makes all wander, by the description nothing.
        wander = min(-math.copysign(1.0, change) * one for one in (usual, np.median(described)))
        if wander * len(steps) > _WANDERS_BACK * abs(change):
            return part
    for row in changes:
        part[row:] += 1
    return part


def _moved(late: Floats, good: Bools, part: Ints) -> Floats:
    """Return by how much each part is later than the log's median, float64[f]."""
    moved = np.zeros(len(late))
    for one in np.unique(part[good]):
        moved[part == one] = np.median(late[good & (part == one)]) - np.median(late[good])
    return moved


def _earliest(late_s: Floats) -> float:
    return float(np.quantile(late_s, _EARLIEST, method="lower")) if len(late_s) else math.nan


def _spread(late_s: Floats) -> float:
    """Return the robust standard deviation of latenesses."""
    return 1.4826 * float(np.median(np.abs(late_s - np.median(late_s)))) if len(late_s) else 0.0
