"""A bus log by ticks: its frames, its clock, and each signal on the rows of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from can_bus import COUNTER_MODULO
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.clock import fit_clock, lower_edge, lowered
from gap_diagnosis.reading.frames import MessageFrames, checked_frames
from gap_diagnosis.reading.log_columns import load_columns
from gap_diagnosis.reading.pages import by_pages
from gap_diagnosis.reading.rows import hold, rows_of_ticks
from gap_diagnosis.reading.ticks import Ticks, unwrap_ticks
from hil_harness.assembly import Wire
from hil_harness.robot import Robot
from hil_harness.sensor_frames import SENSOR_ROLES
from hil_harness.signal_map import MappedSignal
from hil_harness.signal_roles import Role

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_US = 1e-6
_LEAST_FRAMES = 20
_LARGEST_SKEW = 0.1
_FASTER = 0.75
_EARLY_TICKS = 1.0
"""So far before the line of the earliest frames a stamp may lie: it jitters."""
_BACK_S = 1.0
"""Frames of several buses in one log may be out of order, but not by this much."""


def _refuse_backwards(path: Path, stamp_us: Ints) -> None:
    """Raise DiagnosisError for a log that goes back in time: two in one, or its clock was set."""
    back_us = np.maximum.accumulate(stamp_us) - stamp_us
    back = np.flatnonzero(back_us > _BACK_S / _US)
    if len(back):
        frame, first_s = int(back[0]), float(back_us[back[0]]) * _US
        raise DiagnosisError(
            f"{path}: frame {frame + 1:,} is stamped {first_s:.3f} s before an earlier one: "
            "expected one recording in the order of its stamps, by a clock that was not set "
            "meanwhile"
        )


class LogByTicks:
    """One log under way to a recording."""

    def __init__(self, path: Path, robot: Robot, wire: Wire) -> None:
        self.path, self.plant = path, robot.plant
        columns = load_columns(path)
        _refuse_backwards(path, columns.timestamp_us)
        frames, self.rejected = checked_frames(columns, wire.database)
        self.frames, self.wire = by_pages(frames, wire)
        del columns
        anchor = self._anchor()  # a log without frames says no cycle where the DBC says none
        self.period_s = self.wire.tick_period_us * _US
        self.start_us = int(anchor.stamp_us.min())
        ticks = self._unwrapped(anchor)
        self.first_tick = int(ticks.tick.min())
        self.clock = fit_clock(ticks.tick, ticks.segment, self._seconds(anchor), self.period_s)
        self._refuse_other_period(anchor)
        self.anchor, self.anchor_ticks = anchor, ticks
        self.ticks = {
            name: ticks if frames is anchor else self._aligned(frames)
            for name, frames in self.frames.items()
        }
        self.clock = lowered(self.clock, self._sampled_with_the_tick())
        self.rows = rows_of_ticks(ticks.tick, ticks.segment, self.period_s, str(path))

    def _anchor(self) -> MessageFrames:
        """Return the frames of the left wheel's message, whose cycle is the tick."""
        wheels = self.wire.signal_map["left_count"].message
        found = self.frames.get(wheels.name)
        if found is None or len(found) < _LEAST_FRAMES:
            is_empty = not self.frames and not any(self.rejected.values())
            nothing = "no frames" if is_empty else "nothing that the DBC knows"
            there = ", ".join(self.frames) or nothing
            refused = ", ".join(f"{why} {count}" for why, count in self.rejected.items() if count)
            raise DiagnosisError(
                f"{self.path}: {0 if found is None else len(found)} frames of {wheels.name}: "
                f"expected at least {_LEAST_FRAMES}, as the wheels lie in it; the log has {there}"
                + (f" (refused: {refused})" if refused else "")
            )
        return found

    def _refuse_other_period(self, anchor: MessageFrames) -> None:
        apart_s = self.clock.tick_s
        if anchor.counter is None:
            # Lost frames make the mean longer, stamps of 10 ms the median of what comes every 15.
            between_us = np.diff(anchor.stamp_us)
            apart_s = max(apart_s, min(np.median(between_us), np.mean(between_us)) * _US)
        if abs(apart_s / self.period_s - 1) > _LARGEST_SKEW:
            raise DiagnosisError(
                f"{self.path}: {anchor.spec.name} comes every {apart_s * 1e3:.3g} ms, "
                f"{self.wire.database.path.name} says {self.period_s * 1e3:.3g} ms: expected its "
                "GenMsgCycleTime in the DBC"
            )

    def _sampled_with_the_tick(self) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Yield ticks, segments and stamps of the left wheel's frames and of all sensors' that
        share its counter."""
        for spec in self.wire.signal_map.messages(SENSOR_ROLES):
            frames = self.frames.get(spec.name)
            if frames is None or self.is_faster(frames):
                continue
            if frames is self.anchor or _is_shared(frames, self.anchor):
                ticks = self.ticks[spec.name]
                yield ticks.tick, ticks.segment, self._seconds(frames)

    def _seconds(self, frames: MessageFrames) -> Floats:
        return np.asarray((frames.stamp_us - self.start_us) * _US, dtype=np.float64)

    def cycle_ticks(self, frames: MessageFrames) -> int:
        """Return the ticks from one frame of a message to the next; 1 where it is not cyclic."""
        cycle_us = frames.spec.cycle_time_us or self.wire.tick_period_us
        return max(1, round(cycle_us / self.wire.tick_period_us))

    def is_faster(self, frames: MessageFrames) -> bool:
        """Tell whether a message comes more often than the tick."""
        cycle_us = frames.spec.cycle_time_us
        return cycle_us is not None and cycle_us < _FASTER * self.wire.tick_period_us

    def _unwrapped(self, frames: MessageFrames) -> Ticks:
        stamps, counter, said = self._seconds(frames), frames.counter, frames.payload
        order = None
        if counter is None and np.any(np.diff(stamps) < 0):
            order = np.argsort(stamps, kind="stable")
            stamps, said = stamps[order], said[order]
        ticks = unwrap_ticks(
            stamps,
            counter,
            modulo=frames.modulo,
            cycle_ticks=self.cycle_ticks(frames),
            period_s=self.period_s,
            repeats=np.concatenate(([False], said[1:] == said[:-1])),
        )
        if order is None:
            return ticks
        back = np.argsort(order)
        return Ticks(ticks.tick[back], ticks.segment[back])

    def _aligned(self, frames: MessageFrames, *, is_never_early: bool = False) -> Ticks:
        """Unwrap another message's ticks, and count them as the left wheel's message does.

        Of whole rounds of the counter the nearest are taken; *is_never_early*: those by which the
        message comes after the clock's line, since that lies where the earliest frames do.
        """
        stamps = self._seconds(frames)
        starts = self.clock.time_s(self._segment_starts(), np.arange(len(self.clock.start_s)))
        segment = np.maximum(np.searchsorted(starts, stamps, side="right") - 1, 0)
        if self.is_faster(frames):
            # A frame up to half its cycle behind the wheels' is still of the same tick.
            late = 0.5 * (frames.spec.cycle_time_us or 0) / self.wire.tick_period_us
            within = np.ceil(self.clock.tick(stamps, segment) - late)
            return Ticks(within.astype(np.int64), segment.astype(np.int64))
        own = self._unwrapped(frames)
        away = self.clock.tick(stamps, segment) - own.tick
        tick = own.tick.copy()
        shared = _is_shared(frames, self.anchor)
        for number in np.unique(segment):
            here = segment == number
            lag = float(np.median(away[here]))
            if frames.counter is not None and shared:
                wanted = self._counter_offset(int(number))
                wanted -= int(tick[here][0] - frames.counter[here][0])
                away_rounds = (lag - wanted) / COUNTER_MODULO
                if is_never_early:
                    rounds = math.floor(away_rounds + _EARLY_TICKS / COUNTER_MODULO)
                else:
                    rounds = round(away_rounds)
                shift = wanted + COUNTER_MODULO * rounds
            else:
                shift = round(lag)
            tick[here] += shift
        return Ticks(tick, segment.astype(np.int64))

    def apart_s(self, name: str) -> float | None:
        """Return how much later the earliest frames of a message are than the wheels', as far as
        stamps and the counter that they share tell it: up to whole rounds. None where they share
        none."""
        frames = self.frames[name]
        if frames is self.anchor or self.is_faster(frames) or not _is_shared(frames, self.anchor):
            return None
        return self._earliest_s(frames, self.ticks[name]) - self._earliest_s(
            self.anchor, self.anchor_ticks
        )

    def _earliest_s(self, frames: MessageFrames, ticks: Ticks) -> float:
        stamps = self._seconds(frames)
        late_s = stamps - self.clock.time_s(ticks.tick, ticks.segment)
        return lower_edge(late_s, float(stamps[-1] - stamps[0]))

    def put_earlier(self, name: str, rounds: int) -> None:
        """Count a message's ticks from so many rounds of the counter before: its frames are as much
        later than was taken. What comes with the earliest frames is laid beside them anew."""
        ticks = self.ticks[name]
        moved = Ticks(ticks.tick - rounds * COUNTER_MODULO, ticks.segment)
        sure = {id(self.anchor), id(self.frames[name])}
        both = ((self.anchor, self.anchor_ticks), (self.frames[name], moved))
        self.clock = lowered(
            self.clock, [(own.tick, own.segment, self._seconds(one)) for one, own in both]
        )
        self.ticks = {
            other: self.ticks[other]
            if id(frames) in sure
            else self._aligned(frames, is_never_early=True)
            for other, frames in self.frames.items()
        } | {name: moved}
        self.clock = lowered(self.clock, self._sampled_with_the_tick())

    def _segment_starts(self) -> Ints:
        segment, tick = self.anchor_ticks.segment, self.anchor_ticks.tick
        return np.array([tick[segment == n].min() for n in range(int(segment.max()) + 1)])

    def _counter_offset(self, segment: int) -> int:
        assert self.anchor.counter is not None  # asked for shared counters only
        row = int(np.argmax(self.anchor_ticks.segment == segment))
        return int(self.anchor_ticks.tick[row] - self.anchor.counter[row])

    def log_seconds(self, ticks: Ticks) -> Floats:
        """Return the log time of ticks, jitter taken out."""
        return self.clock.time_s(ticks.tick, ticks.segment) + self.start_us * _US

    def on_rows(self, role: Role) -> tuple[MappedSignal, Floats] | None:
        """Return a role's raw values on the rows: the first frame of each tick, else NaN.

        Of a gyro that is faster than the tick it is the mean of those since the tick before.
        """
        mapped = self.wire.signal_map.get(role)
        if mapped is None or mapped.message.name not in self.frames:
            return None
        name = mapped.message.name
        raw, tick = self.frames[name].raw[mapped.signal.name], self.ticks[name].tick
        if role == "gyro" and self.is_faster(self.frames[name]):
            return mapped, self.rows.place_mean(tick, raw)
        return mapped, self.rows.place(tick, raw)

    def held(self, role: Role) -> tuple[MappedSignal, Floats] | None:
        """Return a role's raw values held from frame to frame; NaN before the first."""
        mapped = self.wire.signal_map.get(role)
        if mapped is None or mapped.message.name not in self.frames:
            return None
        name = mapped.message.name
        raw = self.frames[name].raw[mapped.signal.name]
        return mapped, hold(self.ticks[name].tick, raw, self.rows.tick)


def _is_shared(*messages: MessageFrames) -> bool:
    """Tell whether their counter is the tick counter that the frames of one tick share."""
    counters = [None if one.spec.e2e is None else one.spec.e2e.counter_signal for one in messages]
    has_counter = all(one.counter is not None for one in messages)
    return has_counter and set(counters) == {"tick_counter"}
