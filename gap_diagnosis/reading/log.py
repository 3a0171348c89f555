"""From a bus log to a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from can_bus import COUNTER_MODULO
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.reading.clock import fit_clock
from gap_diagnosis.reading.frames import MessageFrames, checked_frames
from gap_diagnosis.reading.log_columns import load_columns
from gap_diagnosis.reading.rows import hold, rows_of_ticks
from gap_diagnosis.reading.ticks import Ticks, unwrap_ticks
from gap_diagnosis.reading.wheels import (
    fastest_ticks,
    gyro_code_and_rate,
    integrated_speed,
    refuse_impossible_codes,
    running_count,
    ticks_per_unit,
)
from gap_diagnosis.recording import FrameTimes, Recording, Reference
from hil_harness.assembly import Wire
from hil_harness.robot import Robot
from hil_harness.sensor_frames import code_scale
from hil_harness.signal_map import MappedSignal
from hil_harness.signal_roles import Role
from hil_harness.wheel_counter import count_to_raw, wrap_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_US = 1e-6
_LEAST_FRAMES = 20
_LARGEST_SKEW = 0.1


class _Log:
    """One log under way to a recording."""

    def __init__(self, path: Path, robot: Robot, wire: Wire) -> None:
        self.path, self.plant, self.wire = path, robot.plant, wire
        self.period_s = wire.tick_period_us * _US
        columns = load_columns(path)
        self.frames, self.rejected = checked_frames(columns, wire.database)
        del columns
        anchor = self._anchor()
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
        self.rows = rows_of_ticks(ticks.tick, ticks.segment, self.period_s)

    def _anchor(self) -> MessageFrames:
        """Return the frames of the left wheel's message, whose cycle is the tick."""
        wheels = self.wire.signal_map["left_count"].message
        found = self.frames.get(wheels.name)
        if found is None or len(found) < _LEAST_FRAMES:
            there = ", ".join(self.frames) or "nothing that the DBC knows"
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
            apart_s = max(apart_s, float(np.median(np.diff(anchor.stamp_us))) * _US)
        if abs(apart_s / self.period_s - 1) > _LARGEST_SKEW:
            raise DiagnosisError(
                f"{self.path}: {anchor.spec.name} comes every {apart_s * 1e3:.3g} ms, "
                f"{self.wire.database.path.name} says {self.period_s * 1e3:.3g} ms: expected its "
                "GenMsgCycleTime in the DBC"
            )

    def _seconds(self, frames: MessageFrames) -> Floats:
        return np.asarray((frames.stamp_us - self.start_us) * _US, dtype=np.float64)

    def cycle_ticks(self, frames: MessageFrames) -> int:
        cycle_us = frames.spec.cycle_time_us or self.wire.tick_period_us
        return max(1, round(cycle_us / self.wire.tick_period_us))

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

    def _aligned(self, frames: MessageFrames) -> Ticks:
        """Unwrap another message's ticks, and count them as the left wheel's message does."""
        own = self._unwrapped(frames)
        stamps = self._seconds(frames)
        starts = self.clock.time_s(self._segment_starts(), np.arange(len(self.clock.start_s)))
        segment = np.maximum(np.searchsorted(starts, stamps, side="right") - 1, 0)
        away = self.clock.tick(stamps, segment) - own.tick
        tick = own.tick.copy()
        shared = _is_shared(frames) and _is_shared(self.anchor)
        for number in np.unique(segment):
            here = segment == number
            lag = float(np.median(away[here]))
            if frames.counter is not None and shared:
                wanted = self._counter_offset(int(number))
                wanted -= int(tick[here][0] - frames.counter[here][0])
                shift = wanted + COUNTER_MODULO * round((lag - wanted) / COUNTER_MODULO)
            else:
                shift = round(lag)
            tick[here] += shift
        return Ticks(tick, segment.astype(np.int64))

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
        """Return a role's raw values on the rows: the first frame of each tick, else NaN."""
        mapped = self.wire.signal_map.get(role)
        if mapped is None or mapped.message.name not in self.frames:
            return None
        name = mapped.message.name
        raw = self.frames[name].raw[mapped.signal.name]
        return mapped, self.rows.place(self.ticks[name].tick, raw)

    def held(self, role: Role) -> tuple[MappedSignal, Floats] | None:
        """Return a role's raw values held from frame to frame; NaN before the first."""
        mapped = self.wire.signal_map.get(role)
        if mapped is None or mapped.message.name not in self.frames:
            return None
        name = mapped.message.name
        raw = self.frames[name].raw[mapped.signal.name]
        return mapped, hold(self.ticks[name].tick, raw, self.rows.tick)


def read_log_recording(path: Path, robot: Robot, wire: Wire) -> tuple[Recording, Reference | None]:
    """Read a bus log.

    Returns the recording without a reference, and the reference that its own frames hold, if any.
    Raises DiagnosisError in one line for a log that cannot be diagnosed, CanBusError for one that
    cannot be read, HarnessError where robot and DBC contradict each other.
    """
    log = _Log(path, robot, wire)
    tick = log.rows.tick - log.rows.tick[0]
    gyro = _gyro(log)
    heading = _quantity(log.on_rows("odom_heading"))
    recording = Recording(
        name=path.name,
        tick_period_s=log.period_s,
        t_s=log.log_seconds(Ticks(log.rows.tick, log.rows.segment)),
        stamp_s=log.rows.place(log.anchor_ticks.tick, np.asarray(log.anchor.stamp_us * _US)),
        tick=tick,
        left_ticks=_wheel(log, "left_count"),
        right_ticks=_wheel(log, "right_count"),
        gyro_code=None if gyro is None else gyro[0],
        gyro_rate_rad_s=None if gyro is None else gyro[1],
        temperature_k=_slow(log, "temperature"),
        supply_v=_slow(log, "supply"),
        v_command_m_s=_quantity(log.held("v_command")),
        w_command_rad_s=_quantity(log.held("w_command")),
        odometry_x_m=_quantity(log.on_rows("odom_x")),
        odometry_y_m=_quantity(log.on_rows("odom_y")),
        odometry_heading_rad=None if heading is None else unwrapped(heading),
        frames={name: _frame_times(log, name) for name in log.frames},
        rejected=log.rejected,
        counter_bits=_counter_bits(log.wire.signal_map["left_count"], robot),
        clock_skew=log.clock.skew,
        clock_skew_sd=log.clock.skew_sd,
    )
    return recording, _reference(log)


def _is_shared(frames: MessageFrames) -> bool:
    """Tell whether the counter is the tick counter that the frames of one tick share."""
    e2e = frames.spec.e2e
    return frames.counter is not None and e2e is not None and e2e.counter_signal == "tick_counter"


def _wheel(log: _Log, role: Role) -> Floats:
    mapped = log.wire.signal_map[role]
    name = mapped.message.name
    if name not in log.frames:
        raise DiagnosisError(
            f"{log.path}: no frames of {name}: expected them, as {role} lies in it"
        )
    found = log.on_rows(role)
    assert found is not None  # mapped and there
    raw, rows = found[1], log.rows.tick
    scale = ticks_per_unit(mapped.quantity, log.plant)
    if mapped.quantity in ("speed", "turn rate"):
        speed = raw * mapped.si_per_lsb + mapped.signal.offset * mapped.si_factor
        return integrated_speed(speed, rows, scale=scale, period_s=log.period_s)
    if not mapped.signal.is_float:
        count_to_raw(mapped, log.plant)  # refuses a signal narrower than the counter
    wrap = None if mapped.signal.is_float else float(wrap_of(mapped)[0])
    return running_count(
        raw,
        rows,
        wrap=wrap,
        scale=scale * mapped.si_per_lsb,
        fastest_per_tick=fastest_ticks(log.plant, log.period_s),
    )


def _counter_bits(mapped: MappedSignal, robot: Robot) -> int:
    if mapped.kind == "counts":
        return (int(wrap_of(mapped)[0]) - 1).bit_length()
    return robot.plant.encoder.counter_bits


def _gyro(log: _Log) -> tuple[Floats, Floats] | None:
    found = log.on_rows("gyro")
    if found is None:
        return None
    mapped, raw = found
    frames = log.frames[mapped.message.name]
    every = log.cycle_ticks(frames)
    value = raw if mapped.kind == "adc_code" else raw * mapped.si_per_lsb + _si_offset(mapped)
    if every > 1:
        value = _spread_back(value, every)
    return gyro_code_and_rate(value, mapped.kind, log.plant, mapped.path)


def _spread_back(value: Floats, every: int) -> Floats:
    """Give a sample that covers several ticks to each of them."""
    result = value.copy()
    for earlier in range(1, every):
        moved = np.append(value[earlier:], np.full(earlier, np.nan))
        result = np.where(np.isnan(result), moved, result)
    return result


def _si_offset(mapped: MappedSignal) -> float:
    return mapped.signal.offset * mapped.si_factor + mapped.si_offset


def _quantity(found: tuple[MappedSignal, Floats] | None) -> Floats | None:
    if found is None:
        return None
    mapped, raw = found
    return raw * mapped.si_per_lsb + _si_offset(mapped)


def _slow(log: _Log, role: Role) -> Floats | None:
    found = log.held(role)
    if found is None:
        return None
    mapped, raw = found
    known = np.flatnonzero(np.isfinite(raw))
    if len(known) == 0:
        return None
    raw[: known[0]] = raw[known[0]]  # what changes this slowly was the same a moment before
    if mapped.kind == "physical":
        return _quantity(found)
    refuse_impossible_codes(raw, log.plant, mapped.path)
    per_code, at_zero = code_scale(role, log.plant)
    return raw * per_code + at_zero


def _frame_times(log: _Log, name: str) -> FrameTimes:
    frames = log.frames[name]
    counter = np.full(len(frames), -1, dtype=np.int64)
    if frames.counter is not None:
        counter = log.ticks[name].tick - log.first_tick
    return FrameTimes(
        t_s=np.asarray(frames.stamp_us * _US),
        counter=counter,
        modulo=frames.modulo,
        cycle_s=(frames.spec.cycle_time_us or 0) * _US,
        payload=frames.payload,
    )


def _reference(log: _Log) -> Reference | None:
    """Return the reference that REFERENCE_POSE frames hold, stamped by their ticks."""
    x, y, heading = (
        log.wire.signal_map.get(role)
        for role in ("reference_x", "reference_y", "reference_heading")
    )
    if x is None or y is None or x.message.name not in log.frames:
        return None
    name = x.message.name
    ticks, first = np.unique(log.ticks[name].tick, return_index=True)
    frames, segment = log.frames[name], log.ticks[name].segment[first]

    def value(mapped: MappedSignal) -> Floats:
        if mapped.message.name != name:
            raise DiagnosisError(
                f"{log.path}: {mapped.path} and {x.path} are two messages: expected the pose of "
                "the reference in one"
            )
        return frames.raw[mapped.signal.name][first] * mapped.si_per_lsb + _si_offset(mapped)

    x_m, y_m = value(x), value(y)
    heading_rad = None if heading is None else unwrapped(value(heading))
    known = np.isfinite(x_m) & np.isfinite(y_m)
    if heading_rad is not None:
        known &= np.isfinite(heading_rad)
    if not known.any():
        return None
    return Reference(
        log.log_seconds(Ticks(ticks[known], segment[known])),
        x_m[known],
        y_m[known],
        None if heading_rad is None else heading_rad[known],
    )
