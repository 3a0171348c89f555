"""A reference that is written at a higher rate than it measures: it says its last pose again."""

from __future__ import annotations

from typing import Final

import numpy as np

from gap_diagnosis.recording import Reference

_LEAST_STEPS: Final = 4.0
"""A robot that moves by fewer steps of the reference's digits may be told twice at one place."""
_OFTEN: Final = 20
"""Fewer times a reference may have lost the robot for a moment."""
_THE_RULE: Final = 0.25
"""If so many of the poses of a robot on its way are old, that is how the reference is written."""
_CYCLE_PERCENT: Final = 90.0


def without_held_poses(reference: Reference) -> tuple[Reference, tuple[str, ...]]:
    """Return the reference without poses that are only the last one said again, and a note of it.

    Each stands beside a stamp at which the robot was somewhere else by then: taken as measured,
    they are late by up to a cycle, and by half of one on average. What repeats for longer than a
    cycle is a robot at rest, or lost, and stays.
    """
    fresh = np.flatnonzero(~reference.said_again())
    rows = np.diff(fresh)
    steps_m = np.abs(np.concatenate((np.diff(reference.x_m), np.diff(reference.y_m))))
    least_m = _LEAST_STEPS * float(np.min(steps_m, where=steps_m > 0.0, initial=np.inf))
    way_m = np.hypot(np.diff(reference.x_m[fresh]), np.diff(reference.y_m[fresh]))
    on_its_way = rows[way_m > least_m]
    if np.count_nonzero(on_its_way > 1) < _OFTEN:
        return reference, ()
    cycle = round(float(np.percentile(on_its_way, _CYCLE_PERCENT)))
    within = np.minimum(on_its_way, cycle)
    if np.sum(within - 1) < _THE_RULE * np.sum(within):
        return reference, ()
    row = np.arange(len(reference.t_s))
    since = row - fresh[np.searchsorted(fresh, row, side="right") - 1]
    following = np.append(fresh, len(row) + cycle)
    until = following[np.searchsorted(fresh, row, side="right")] - row
    held = (since > 0) & ((since < cycle) | (until < cycle))
    note = (
        f"The reference says its last pose again in {np.count_nonzero(held):,} of {len(row):,} "
        "samples: it measures less often than it is written, and they were left out."
    )
    return reference.only(~held), (note,)
