"""A reference that has not found the robot yet, or no more, and says one pose until it has."""

from __future__ import annotations

from typing import Final

import numpy as np

from gap_diagnosis.recording import Reference

_ROWS: Final = 5
"""So many equal poses in a row are no measurement,"""
_LEAP_M: Final = 0.1
_STEPS: Final = 3.0
"""if the robot is so far away in the next one, and so many times what it ever goes between two."""
_EVER_PERCENT: Final = 99.0
_LEAST_SAMPLES: Final = 20


def without_unlocked_ends(reference: Reference) -> tuple[Reference, tuple[str, ...]]:
    """Return the reference from where it first sees the robot to where it does last, and a note of
    what was left out: as one that comes late or ends early, it has no gap there."""
    fresh = np.flatnonzero(~reference.said_again())
    if len(fresh) < _LEAST_SAMPLES:
        return reference, ()
    step_m = np.hypot(np.diff(reference.x_m), np.diff(reference.y_m))
    far_m = max(_LEAP_M, _STEPS * float(np.percentile(step_m[fresh[1:] - 1], _EVER_PERCENT)))
    first, last, rows = int(fresh[1]), int(fresh[-1]), len(reference.t_s)
    start = first if first > _ROWS and step_m[first - 1] > far_m else 0
    stop = last if rows - last > _ROWS and step_m[last - 1] > far_m else rows
    if stop - start == rows:
        return reference, ()
    kept = np.zeros(rows, dtype=np.bool_)
    kept[start:stop] = True
    note = (
        f"{rows - (stop - start):,} samples of the reference at its ends say one and the same "
        "pose, far from the next: it had not found the robot, and they were left out."
    )
    return reference.only(kept), (note,)
