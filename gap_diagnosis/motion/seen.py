"""When a reference sees the robot: it may come late, end early, and lose it on the way."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats

_HOLE: Final = 3.0
"""Nor is it a hole where a reference has no sample for less than so many of its usual steps."""


def is_seen(
    ends_s: Floats, stamps_s: Floats, reach_s: float, lasts_s: float = 1.0
) -> NDArray[np.bool_]:
    """Return between which of the times float64[n] a reference sees the robot, bool[n - 1].

    Not before its first stamp, after its last, or in a hole between two that lasts for *lasts_s* or
    longer: samples are lost one at a time, and in bursts. Nor within *reach_s*, from how far
    averages take samples, of any of these. Both times and stamps ascend.
    """
    apart_s = np.diff(stamps_s)
    usual_s = float(np.median(apart_s)) if len(apart_s) else 0.0
    is_hole = apart_s > max(_HOLE * usual_s, lasts_s)
    begins = np.concatenate(([-np.inf], stamps_s[:-1][is_hole], stamps_s[-1:])) - reach_s
    stops = np.concatenate((stamps_s[:1], stamps_s[1:][is_hole], [np.inf])) + reach_s
    # As many unseen spells are over before a step as have begun by its end.
    begun = np.searchsorted(begins, ends_s[1:], "left")
    return np.asarray(begun <= np.searchsorted(stops, ends_s[:-1], "right"), dtype=np.bool_)
