"""Rows of a table in which a counter has no news: they say again what it said last."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.lattice import NO_STEP, lattice_step
from gap_diagnosis.recording import Floats, Recording

_USUAL_ROWS: Final = 8
"""The speed before and after is that of so many rows, or of four times as long as nothing came."""
_LEAST_STEPS: Final = 4.0
"""A wheel of fewer steps of its signal in a row shows the same count twice by itself."""
_AS_FAR: Final = 0.4
"""What comes at last is what was missed, to this share of it."""
_HARDLY: Final = 0.25
_OFTEN: Final = 5
"""Fewer times a wheel may have stalled as long as it then made up for."""
_THE_RULE: Final = 0.25
"""A counter without news in more of a fast wheel's rows comes at a lower rate than the table."""


def with_news_only(recording: Recording) -> Recording:
    """Return a table's recording without counts that were only said again, as if those cells were
    empty, with a note."""
    left_ticks, left = without_said_again(recording.left_ticks)
    right_ticks, right = without_said_again(recording.right_ticks)
    if not left and not right:
        return recording
    if left and right:
        # Both are read at once: where nothing came of one wheel, what hardly moved of the other is
        # as old, or the robot would turn there and back.
        left_ticks, right_ticks = (
            np.where(np.isnan(other) & _hardly_moved(own), np.nan, told)
            for other, own, told in (
                (right_ticks, recording.left_ticks, left_ticks),
                (left_ticks, recording.right_ticks, right_ticks),
            )
        )
    note = (
        f"{left:,} rows of {len(recording.t_s):,} say the left wheel's last count again and "
        f"{right:,} the right one's, and the next makes up for it: they were taken as empty."
    )
    return replace(
        recording,
        left_ticks=left_ticks,
        right_ticks=right_ticks,
        notes=(*recording.notes, note),
    )


def _hardly_moved(counts: Floats) -> NDArray[np.bool_]:
    """Tell in which rows a wheel came by much less than its way in a row there, bool[n]."""
    known = np.flatnonzero(np.isfinite(counts))
    row = np.arange(len(counts))
    before, after = (np.interp(row + way * _USUAL_ROWS, known, counts[known]) for way in (-1, 1))
    usual = np.abs(after - before) / (2 * _USUAL_ROWS)
    return np.asarray(np.abs(np.diff(counts, prepend=np.nan)) < _HARDLY * usual)


def without_said_again(counts: Floats) -> tuple[Floats, int]:
    """Return running counts, float64[n], NaN where nothing came, without those that only say the
    last one again while the wheel goes on, and how many those are.

    A table at a higher rate than its counters, or of a producer that was late at times: each new
    count then leaps by all that was missed, as far as the speeds before and after say.
    """
    row = np.flatnonzero(np.isfinite(counts))
    value = counts[row]
    again = np.zeros(len(counts), dtype=np.bool_)
    if len(row) < 3:
        return counts, 0
    steps = np.abs(np.diff(value))
    changes = np.flatnonzero(steps > NO_STEP)
    # Not the least change: of a wheel that never is slow that is many of its steps.
    least_per_row = _LEAST_STEPS * lattice_step(value)
    starts, ends = changes[:-1] + 1, changes[1:]
    repeats = ends > starts
    last, fresh = starts[repeats], ends[repeats] + 1
    elapsed = (row[fresh] - row[last]).astype(np.float64)
    rows = np.maximum(_USUAL_ROWS, 4.0 * elapsed)
    before = (value[last] - np.interp(row[last] - rows, row, value)) / rows
    after = (np.interp(row[fresh] + rows, row, value) - value[fresh]) / rows
    usual = 0.5 * (before + after)
    off = np.abs(value[fresh] - value[last] - usual * elapsed)
    made_up = (np.abs(usual) >= least_per_row) & (off < _AS_FAR * np.abs(usual) * elapsed)
    if np.count_nonzero(made_up) < _OFTEN:
        return counts, 0
    for first, stop in zip(last[made_up] + 1, fresh[made_up], strict=True):
        again[row[first:stop]] = True
    speed = np.abs(
        np.interp(row + _USUAL_ROWS, row, value) - np.interp(row - _USUAL_ROWS, row, value)
    )
    fast = speed >= 2 * _USUAL_ROWS * least_per_row
    if np.count_nonzero(again) > _THE_RULE * np.count_nonzero(fast):
        # Of a slow wheel too: what lies within a cycle of a change is old.
        cycle = round(float(np.percentile(elapsed[made_up], 90)))
        for first, stop in zip(last + 1, fresh, strict=True):
            again[row[first : min(first + cycle - 1, stop)]] = True
            again[row[max(stop - cycle + 1, first) : stop]] = True
    return np.where(again, np.nan, counts), int(np.count_nonzero(again))
