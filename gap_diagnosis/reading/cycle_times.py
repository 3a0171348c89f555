"""The wire of a log whose DBC says no cycle times: how often its messages come, the log says.

Few DBCs that are passed round for cars have GenMsgCycleTime.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus import LogColumns, MessageSpec, decode_columns, present_columns
from gap_diagnosis.reading.log_columns import load_columns
from gap_diagnosis.reading.ticks import off_beat
from hil_harness.assembly import Wire, load_wire
from hil_harness.robot import Robot
from hil_harness.signal_map import MappedSignal

_LEAST_FRAMES: Final = 20
_LONG: Final = 10
"""A silence of so many cycles says nothing of how long one is."""
_AGREES: Final = 0.1
"""Two clocks and a scheduler are never so far apart."""


def wire_of_log(log: Path, robot: Robot, dbc: Path | None, signals: Path | None) -> Wire:
    """Return DBC and map as `load_wire` does, with cycle times from the log where the DBC has none.

    A multiplexed message has the cycle of the page in which its first mapped signal lies.

    Raises DiagnosisError, CanBusError or HarnessError for what cannot be read, and for a DBC that
    says another tick than the one that *robot* is made for.
    """
    wire = load_wire(dbc, signals, leave_out_faulty=True)
    first: dict[str, MappedSignal] = {}
    for mapped in wire.signal_map.signals.values():
        first.setdefault(mapped.message.name, mapped)
    unsure = [one for one in first.values() if _is_unsure(one)]
    if not _is_unsure(wire.signal_map["left_count"]):
        robot.require_tick(wire.tick_period_us, wire.database.path.name)
    if not unsure:
        return wire
    columns = load_columns(log)
    return wire.with_messages({one.message.name: _timed(one, columns) for one in unsure})


def _is_unsure(mapped: MappedSignal) -> bool:
    """Tell whether the DBC leaves open how often a signal comes: a page may come more seldom than
    its message."""
    return not mapped.message.cycle_time_us or mapped.signal.multiplexer is not None


def _timed(mapped: MappedSignal, columns: LogColumns) -> MessageSpec:
    """Return the message with the cycle at which the frames come that carry a signal."""
    spec = mapped.message
    rows = columns.rows_of(spec)
    if mapped.signal.multiplexer is None:
        named = (columns.frame_id == spec.frame_id) & (columns.is_extended == spec.is_extended)
        rows = np.flatnonzero(named)
    elif len(rows):
        raw = decode_columns(spec, columns.data[rows])
        rows = rows[present_columns(spec, raw)[mapped.signal.name]]
    return replace(
        spec, cycle_time_us=page_cycle_us(spec.cycle_time_us, columns.timestamp_us[rows])
    )


def page_cycle_us(said_us: int | None, stamp_us: NDArray[np.int64]) -> int | None:
    """Return the cycle of frames with such stamps, those lost on the way not counted [µs].

    What the DBC *said* stands where the log agrees with it, or is too short to tell.
    """
    moments_us = np.unique(stamp_us)
    if len(moments_us) < _LEAST_FRAMES:
        return said_us
    apart_us = np.diff(moments_us)
    lost = np.rint(apart_us / np.median(apart_us))
    apart_us, lost = apart_us[lost < _LONG], lost[lost < _LONG]
    # Stamps that jitter by half a cycle look like losses; but then they lie nearer to the beat of
    # frames of which none was lost.
    came_us = np.cumsum(apart_us).astype(np.float64)
    beats = min((lost, np.ones(len(lost))), key=lambda one: off_beat(came_us, np.cumsum(one)))
    cycle_us = round(float(apart_us.sum() / beats.sum()))
    if said_us and abs(cycle_us / said_us - 1) <= _AGREES:
        return said_us
    return cycle_us
