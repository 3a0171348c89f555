"""The clocks of a table: when each row was sampled, and which tick it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.clock import fit_clock, lowered

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

COUNTER_WRAPS_S: Final = (65.536, 2**32 * 1e-6, 2**32 * 1e-3)
"""Where ECU clocks begin again: 16 bits of milliseconds, 32 of microseconds, 32 of milliseconds."""

_WRAP_TOLERANCE: Final = 0.02
_RESTART_S: Final = 1.0
_STEP_S: Final = 1e-6
_SLOWEST_S: Final = 2.0
"""Between rows so far apart no wheel's motion is told."""
_BURSTS: Final = 0.1
"""Of a table with more rows that share a stamp, rows are of several sources and no bursts."""
_BURST_ROWS: Final = 4
_BACK_S: Final = 1.0
"""Rows of several sources may be out of order, but not by this much."""


@dataclass(frozen=True)
class TableClock:
    """When the rows of a table are.

    Attributes:
        order: int64[n], the rows in the order of time, repeated ones left out.
        t_s: float64[n], log time of these rows, without jitter where the table tells.
        tick: int64[n], strictly ascending from 0.
        period_s: duration of a tick.
        skew, skew_sd: as in `Recording`; NaN without an ECU clock.
    """

    order: Ints
    t_s: Floats
    tick: Ints
    period_s: float
    skew: float = float("nan")
    skew_sd: float = float("nan")


def table_clock(
    name: str,
    time_s: Floats | None,
    ecu_s: Floats | None,
    ecu_wrap_s: float | None,
    columns: Sequence[Floats] = (),
) -> TableClock:
    """Return the clock of a table; *columns* are what its rows say, float64[n] each.

    With an ECU clock the log's time is the line through its stamps against it, and rows are ordered
    by it. Without one a row is taken to be sampled when it says (what the counts tell of that:
    `stamp_jitter`). The tick is the median distance of rows.

    Raises DiagnosisError for a clock with missing values, one that stands still or is set back, and
    for rows too far apart to be of one drive.
    """
    for clock, values in (("time", time_s), ("ECU time", ecu_s)):
        if values is not None and not np.isfinite(values).all():
            row = int(np.argmax(~np.isfinite(values)))
            raise DiagnosisError(
                f"{name}: row {row + 2}: no {clock}: expected a number in every row"
            )
    if ecu_s is not None:
        ecu_s = unwrapped_clock(ecu_s, time_s, ecu_wrap_s)
    elif time_s is not None:
        _refuse_backwards(name, time_s)
    leading = ecu_s if ecu_s is not None else time_s
    assert leading is not None  # the map has at least one clock
    order, ordered = _in_order(leading, columns)
    steps = np.diff(ordered)
    if len(steps) == 0:
        raise DiagnosisError(f"{name}: {len(leading)} rows at one time: expected a clock that runs")
    period_s = float(np.round(np.median(steps), 6))
    if period_s > _SLOWEST_S:
        raise DiagnosisError(
            f"{name}: rows are {period_s:g} s apart: expected one every {_SLOWEST_S:g} s at least, "
            "by a clock in seconds (or is it in milliseconds?)"
        )
    tick = _ticks(ordered, period_s)
    if ecu_s is None or time_s is None:
        return TableClock(order, ordered, tick, period_s)
    origin = float(time_s[order[0]])
    ecu_us = np.rint((ordered - ordered[0]) / _STEP_S).astype(np.int64)
    one_line = np.zeros(len(order), dtype=np.int64)
    stamp_s = time_s[order] - origin
    line = fit_clock(ecu_us, one_line, stamp_s, _STEP_S)
    line = lowered(line, [(ecu_us, one_line, stamp_s)])
    t_s = line.time_s(ecu_us) + origin
    return TableClock(order, t_s, tick, period_s, line.skew, line.skew_sd)


def _refuse_backwards(name: str, time_s: Floats) -> None:
    """Raise DiagnosisError for a table that goes back in time: two in one, or its clock was set."""
    back_s = np.maximum.accumulate(time_s) - time_s
    back = np.flatnonzero(back_s > _BACK_S)
    if len(back):
        raise DiagnosisError(
            f"{name}: row {int(back[0]) + 2}: {back_s[back[0]]:.3f} s before an earlier row: "
            "expected one recording in the order of its time, by a clock that was not set meanwhile"
        )


def _in_order(stamp_s: Floats, columns: Sequence[Floats]) -> tuple[Ints, Floats]:
    """Return the rows in the order of time, int64[m], and their stamps, ascending, float64[m].

    Of rows with one stamp the first counts, but for a few that say something else: what waits for a
    bus comes in a burst.
    """
    step = np.round((stamp_s - stamp_s.min()) / _STEP_S)
    order = np.argsort(step, kind="stable")
    with_last = np.diff(step[order], prepend=-1.0) == 0.0
    says_else = np.zeros(len(order), dtype=np.bool_)
    for column in columns:
        own = column[order]
        says_else[1:] |= (own[1:] != own[:-1]) & np.isfinite(own[1:])
    burst = with_last & says_else
    if np.count_nonzero(with_last) > _BURSTS * len(order):
        burst[:] = False
    kept = ~with_last | burst
    order, burst = order[kept], burst[kept]
    place = np.arange(len(order))
    in_burst = place - np.maximum.accumulate(np.where(burst, 0, place))
    return order, np.asarray(stamp_s[order] + in_burst * _STEP_S)


def _ticks(t_s: Floats, period_s: float) -> Ints:
    """Return which tick each row is, int64[n], strictly ascending from 0.

    A stamp that is late makes one step long and the next one short: where a row seems lost, this
    step with the one before must say so too, and so must it with a few of those behind it.
    """
    steps = np.rint(np.diff(t_s) / period_s)
    lost = steps.copy()
    for more in range(1, min(_BURST_ROWS, len(steps) - 1) + 1):
        together = np.rint((t_s[1 + more :] - t_s[: -1 - more]) / period_s) - more
        lost[:-more] = np.minimum(lost[:-more], together)
        if more == 1:
            lost[1:] = np.minimum(lost[1:], together)
    steps = lost
    return np.concatenate(([0], np.cumsum(np.maximum(steps, 1.0)))).astype(np.int64)


def unwrapped_clock(ecu_s: Floats, time_s: Floats | None, wrap_s: float | None) -> Floats:
    """Return an ECU clock without its wraps.

    Where the wrap is not given, a step back of nearly one of COUNTER_WRAPS_S tells. The log's time,
    if there is one, says how many wraps a gap has lasted. An ECU clock that begins anew goes on
    where the log's time says.
    """
    steps = np.diff(ecu_s)
    expected = np.full(len(steps), float(np.median(steps)) if len(steps) else 0.0)
    if time_s is not None:
        expected = np.diff(time_s)
    back = float(-steps.min()) if len(steps) else 0.0
    if wrap_s is None:
        for known in COUNTER_WRAPS_S:
            if known * (1 - _WRAP_TOLERANCE) < back < known * (1 + _WRAP_TOLERANCE):
                wrap_s = known
                break
    if wrap_s is not None:
        steps = steps + wrap_s * np.rint((expected - steps) / wrap_s)
    restarted = (steps < -_RESTART_S) & (expected > steps + _RESTART_S)
    steps = np.where(restarted, np.maximum(expected, _STEP_S), steps)
    return np.asarray(np.concatenate((ecu_s[:1], ecu_s[0] + np.cumsum(steps))))
