"""The wire of a log whose DBC says no cycle times: how often its messages come, the log says.

Few DBCs that are passed round for cars have GenMsgCycleTime.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from can_bus import LogColumns, MessageSpec
from gap_diagnosis.reading.log_columns import load_columns
from hil_harness.assembly import Wire, load_wire
from hil_harness.robot import Robot

_LEAST_FRAMES: Final = 20


def wire_of_log(log: Path, robot: Robot, dbc: Path | None, signals: Path | None) -> Wire:
    """Return DBC and map as `load_wire` does, with cycle times from the log where the DBC has none.

    Raises DiagnosisError, CanBusError or HarnessError for what cannot be read, and for a DBC that
    says another tick than the one that *robot* is made for.
    """
    wire = load_wire(dbc, signals)
    if wire.signal_map["left_count"].message.cycle_time_us:
        robot.require_tick(wire.tick_period_us, wire.database.path.name)
    mapped = wire.signal_map.signals
    untimed = {m.message.name: m.message for m in mapped.values() if not m.message.cycle_time_us}
    if not untimed:
        return wire
    columns = load_columns(log)
    return wire.with_messages({name: _timed(spec, columns) for name, spec in untimed.items()})


def _timed(spec: MessageSpec, columns: LogColumns) -> MessageSpec:
    """Return the message with the cycle at which it comes, frames lost on the way not counted."""
    named = (columns.frame_id == spec.frame_id) & (columns.is_extended == spec.is_extended)
    if np.count_nonzero(named) < _LEAST_FRAMES:
        return spec
    apart_us = np.diff(np.sort(columns.timestamp_us[named]))
    middle_us = max(float(np.median(apart_us)), 1.0)
    cycles = np.rint(apart_us / middle_us)
    whole = (cycles > 0) & (cycles < 10)
    cycle_us = round(float(apart_us[whole].sum() / cycles[whole].sum()))
    return replace(spec, cycle_time_us=cycle_us)
