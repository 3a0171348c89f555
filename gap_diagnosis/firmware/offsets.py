"""The kernel of a log that does not begin at power-on: it had learnt an offset before."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.firmware.replay import Program
from gap_diagnosis.firmware.workbench import Workbench

_NEIGHBOURS: Final = range(-2, 3)
_LEAST_ROWS: Final = 20


def offset_programs(bench: Workbench) -> list[Program]:
    """Return the described program with initial offsets that explain the heading's first drift.

    The offset counts until the kernel learns another in the log, so that it is found from the
    ticks before the replay's drift against the record changes: from the first half of them, and
    from all.
    """
    config, rows = bench.config, bench.windows.rows
    known = config.constants
    per_lsb = known.gyro_sensitivity_rad_s_per_lsb * known.tick_period_s
    replayed = bench.described[rows, 2]
    turning = bench.turning()
    active = np.cumsum(turning).astype(np.float64)
    drift = (bench.windows.pose[:, 2] - bench.windows.pose[0, 2]) - (replayed - replayed[0])
    unit = 1 << config.offset_frac_bits
    found: dict[int, Program] = {}
    for count in _prefixes(turning):
        ours, theirs = active[:count], drift[:count]
        if ours[-1] < 1.0:
            continue
        slope = float(ours @ theirs / (ours @ ours))
        offset_q = round((known.gyro_zero_rate_code - slope / per_lsb) * unit)
        for step in _NEIGHBOURS:
            found[offset_q + step] = Program(config, offset_lsb=(offset_q + step) / unit)
    return list(found.values())


def _prefixes(turning: NDArray[np.bool_]) -> list[int]:
    """Return numbers of rows after which to look: the end of the first drive, and of all."""
    moving = np.flatnonzero(turning)
    if len(moving) < _LEAST_ROWS:
        return []
    gaps = np.flatnonzero(np.diff(moving) > _LEAST_ROWS)
    first_end = int(moving[gaps[0]]) + 1 if len(gaps) else int(moving[-1]) + 1
    return sorted({first_end, len(turning)})
