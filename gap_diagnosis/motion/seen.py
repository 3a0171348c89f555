"""When a reference sees the robot: it may come late, end early, and lose it on the way."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats

_HOLE: Final = 3.0
"""Where a reference has no sample for so many times as long as it has them apart, or as what is
compared lasts, it sees nothing."""


def is_seen(ends_s: Floats, stamps_s: Floats, width_s: float) -> NDArray[np.bool_]:
    """Return between which of the times float64[n] a reference sees the robot, bool[n - 1].

    Not before its first stamp, after its last, or in a hole between two; nor within *width_s*, over
    which samples are averaged, of any of these.
    """
    apart_s = np.diff(stamps_s)
    is_hole = apart_s > _HOLE * max(width_s, float(np.median(apart_s)))
    begins = np.concatenate(([-np.inf], stamps_s[:-1][is_hole], stamps_s[-1:])) - width_s
    stops = np.concatenate((stamps_s[:1], stamps_s[1:][is_hole], [np.inf])) + width_s
    first, last = ends_s[:-1, np.newaxis], ends_s[1:, np.newaxis]
    unseen = ((last > begins) & (first < stops)).any(axis=1)
    return np.asarray(~unseen, dtype=np.bool_)
