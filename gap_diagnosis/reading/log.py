"""From a bus log to a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from can_bus import COUNTER_MODULO
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.priors import default_prior
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.reading.fixes import reference_of
from gap_diagnosis.reading.left_out import faulty_messages
from gap_diagnosis.reading.log_ticks import LogByTicks
from gap_diagnosis.reading.speeds import AddedUp, integrated_speed
from gap_diagnosis.reading.ticks import Ticks
from gap_diagnosis.reading.wheels import (
    fastest_ticks,
    gyro_code_and_rate,
    refuse_impossible_codes,
    running_count,
    ticks_per_unit,
)
from gap_diagnosis.reading.whole_rounds import rounds_late
from gap_diagnosis.recording import FrameTimes, Recording, Reference
from hil_harness.assembly import Wire
from hil_harness.robot import Robot
from hil_harness.sensor_frames import code_scale
from hil_harness.signal_map import MappedSignal
from hil_harness.signal_roles import Role
from hil_harness.wheel_counter import count_to_raw, wrap_of

Floats = NDArray[np.float64]

_US = 1e-6
_IN_TIME_S = default_prior().of("frame_latency", "delay").tolerance
"""Frames of one tick queue behind each other; those that lie nearer than this are in time."""

_COUNTERS_BITS = 16
"""Counters of timers are no wider; what comes in more bits was added up by a program."""


def read_log_recording(path: Path, robot: Robot, wire: Wire) -> tuple[Recording, Reference | None]:
    """Read a bus log.

    Returns the recording without a reference, and the reference that its own frames hold, if any.
    Raises DiagnosisError in one line for a log that cannot be diagnosed, CanBusError for one that
    cannot be read, HarnessError where robot and DBC contradict each other.
    """
    log = LogByTicks(path, robot, wire)
    tick = log.rows.tick - log.rows.tick[0]
    unsure = half_row = None
    if _is_speed(log.wire.signal_map["left_count"]):
        left = _speed(log, "left_count", "right_count")
        right = _speed(log, "right_count", "left_count")
        left_ticks, right_ticks = left.ticks, right.ticks
        if not (left.is_counted and right.is_counted):
            unsure = np.stack([left.unsure_ticks2, right.unsure_ticks2])
            half_row = np.stack([left.half_row_ticks, right.half_row_ticks])
    else:
        left_ticks, right_ticks = _wheel(log, "left_count"), _wheel(log, "right_count")
    gyro = _gyro_beside(log, right_ticks - left_ticks)
    heading = _quantity(log.on_rows("odom_heading"))
    recording = Recording(
        name=path.name,
        tick_period_s=log.period_s,
        t_s=log.log_seconds(Ticks(log.rows.tick, log.rows.segment)),
        stamp_s=log.rows.place(log.anchor_ticks.tick, np.asarray(log.anchor.stamp_us * _US)),
        tick=tick,
        left_ticks=left_ticks,
        right_ticks=right_ticks,
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
        own_names=own_names(log.wire),
        rejected=log.rejected,
        counter_bits=_counter_bits(log.wire.signal_map["left_count"], robot),
        clock_skew=log.clock.skew,
        clock_skew_sd=log.clock.skew_sd,
        speed_cycle_s=log.period_s if _is_speed(log.wire.signal_map["left_count"]) else 0.0,
        unsure_ticks2=unsure,
        half_row_ticks=half_row,
        notes=(
            *faulty_messages(log.wire.database),
            *_boundless(log),
        ),
        doubts=_beyond_the_counter(log, robot),
    )
    return recording, _reference(log)


def own_names(wire: Wire) -> dict[str, str]:
    """Return what a bus calls ENCODER and IMU; nothing where one message carries both, or none."""
    wheels, gyro = wire.signal_map.get("left_count"), wire.signal_map.get("gyro")
    if wheels is None or gyro is None or gyro.message.name == wheels.message.name:
        return {}
    return {"ENCODER": wheels.message.name, "IMU": gyro.message.name}


def _wheel(log: LogByTicks, role: Role) -> Floats:
    mapped, raw = _readings(log, role)
    scale = ticks_per_unit(mapped.quantity, log.plant)
    if not mapped.signal.is_float:
        count_to_raw(mapped, log.plant)  # refuses a signal narrower than the counter
    wrap = None if mapped.signal.is_float else float(wrap_of(mapped)[0])
    return running_count(
        raw,
        log.rows.tick,
        wrap=wrap,
        scale=scale * mapped.si_per_lsb,
        fastest_per_tick=fastest_ticks(log.plant, log.period_s),
    )


def _speed(log: LogByTicks, role: Role, other: Role) -> AddedUp:
    scale = ticks_per_unit(log.wire.signal_map[role].quantity, log.plant)
    ecu_s = np.asarray(log.rows.tick * log.period_s, dtype=np.float64)
    return integrated_speed(_told(log, role), ecu_s, scale=scale, other=_told(log, other))


def _told(log: LogByTicks, role: Role) -> Floats:
    mapped, raw = _readings(log, role)
    return raw * mapped.si_per_lsb + mapped.signal.offset * mapped.si_factor


def _readings(log: LogByTicks, role: Role) -> tuple[MappedSignal, Floats]:
    mapped = log.wire.signal_map[role]
    name = mapped.message.name
    if name not in log.frames:
        raise DiagnosisError(
            f"{log.path}: no frames of {name}: expected them, as {role} lies in it"
        )
    found = log.on_rows(role)
    assert found is not None  # mapped and there
    return mapped, found[1]


def _is_speed(mapped: MappedSignal) -> bool:
    """Tell a wheel that says how fast it is, not how far it has come."""
    return mapped.quantity in ("speed", "turn rate")


def _counter_bits(mapped: MappedSignal, robot: Robot) -> int:
    if mapped.kind == "counts":
        return (int(wrap_of(mapped)[0]) - 1).bit_length()
    return robot.plant.encoder.counter_bits


def _boundless(log: LogByTicks) -> tuple[str, ...]:
    """Say which mapped signals have a range in the DBC that was not taken for theirs."""
    paths = [
        mapped.path
        for mapped in log.wire.signal_map.signals.values()
        if mapped.message.name in log.frames
        and mapped.signal.name in log.frames[mapped.message.name].boundless
    ]
    if not paths:
        return ()
    return (
        f"The DBC's range of {', '.join(paths)} cannot be right, as many frames lie outside or no "
        "frame can hold its ends: it was not checked.",
    )


def _beyond_the_counter(log: LogByTicks, robot: Robot) -> tuple[str, ...]:
    """Say that a wheel counts further than the described counter does.

    No reason to refuse the log: an ECU may go on counting on the bus where its own counter wraps,
    as the simulated one does on a wider signal. What is wider than a timer's counter always does.
    """
    described_bits = robot.plant.encoder.counter_bits
    for role in ("left_count", "right_count"):
        mapped, raw = _readings(log, role)
        if mapped.kind != "counts" or not np.isfinite(raw).any():
            continue
        signal_bits = (int(wrap_of(mapped)[0]) - 1).bit_length()
        low, high = int(np.nanmin(raw)), int(np.nanmax(raw))
        span = 1 << described_bits
        fits = (low >= 0 and high < span) or (-span // 2 <= low and high < span // 2)
        if fits or signal_bits > _COUNTERS_BITS:
            continue
        told = (
            f"{mapped.path} counts from {low} to {high}, encoder.counter_bits = {described_bits} "
            f"to {span - 1}: taken for an ECU that goes on counting on the bus; expected "
            f"encoder.counter_bits = {signal_bits} if it is the counter itself."
        )
        return (f"{robot.where(told)}: {told}",)
    return ()


def _gyro(log: LogByTicks) -> tuple[Floats, Floats] | None:
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


def _gyro_beside(log: LogByTicks, wheel_turn: Floats) -> tuple[Floats, Floats] | None:
    """Return the gyro's codes and rates, its frames late by as many rounds of their counter as its
    turns say beside the wheels': float64[n], in any unit."""
    found, mapped = _gyro(log), log.wire.signal_map.get("gyro")
    if found is None or mapped is None:
        return found
    apart_s = log.apart_s(mapped.message.name)
    if apart_s is None or abs(apart_s) <= _IN_TIME_S:
        return found
    steps = np.diff(wheel_turn, prepend=np.nan)
    rounds = rounds_late(steps, found[1], COUNTER_MODULO)
    if rounds == 0:
        return found
    log.put_earlier(mapped.message.name, rounds)
    return _gyro(log)


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


def _slow(log: LogByTicks, role: Role) -> Floats | None:
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


def _frame_times(log: LogByTicks, name: str) -> FrameTimes:
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


def _reference(log: LogByTicks) -> Reference | None:
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

    return reference_of(
        log.log_seconds(Ticks(ticks, segment)),
        (value(x), x.quantity),
        (value(y), y.quantity),
        None if heading is None else unwrapped(value(heading)),
        str(log.path),
        is_turned_round=heading is not None and heading.si_factor < 0,
    )
