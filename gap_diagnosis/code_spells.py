"""In which part of a log codes show a fault of the converter that they do not show in the rest.

From some time on or up to some time: a part that reaches an end of the log.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats

_LEAST_SHARE: Final = 0.1
"""Of a log; in less, codes look like anything by chance."""
_LEAST_AT_TOP: Final = 20
_A_CODE: Final = 0.6
_TURNING: Final = 0.3
"""A turn of such a share of a limit tells how much of it a gyro reads."""
_FLAT: Final = 5
"""So many times as many codes are at a flat top as just below it."""
_BEYOND: Final = 1.03
"""Turns of so much more than a limit would show beyond it."""


def held_bit(code: Floats, bit: int, value: int) -> tuple[int, int] | None:
    """Return the rows, from the first to before the last, in which a bit of all codes is *value*:
    the longer of the parts at either end of a log; None for all of it, or hardly any, or where no
    code goes so far that the bit would change."""
    whole = np.rint(code).astype(np.int64)
    other = np.flatnonzero((whole >> bit & 1) != value)
    if not len(other):
        return None
    parts = [(0, int(other[0])), (int(other[-1]) + 1, len(code))]
    first, last = max(parts, key=lambda one: one[1] - one[0])
    if last - first < _LEAST_SHARE * len(code) or not np.ptp(whole[first:last] >> (bit + 1)):
        return None
    return first, last


def flat_top(away: Floats, told: Floats) -> tuple[int, int, float] | None:
    """Return the rows of a part in which no code goes beyond a top to which many go, and how far
    that is from the code of no turn; None where there is none but that of the whole log.

    *told*: how far the wheels say that codes should be. A gyro that reads too little does so
    elsewhere too: that is no top.
    """
    size, wheels_say = np.abs(away), np.abs(told)
    best: tuple[int, int, float] | None = None
    for is_reversed in (False, True):
        ordered, wheels = (size[::-1], wheels_say[::-1]) if is_reversed else (size, wheels_say)
        most = np.maximum.accumulate(ordered)
        for top in np.unique(most[most < most[-1]])[::-1].tolist():
            rows = int(np.searchsorted(most, top, side="right"))
            if rows < _LEAST_SHARE * len(size):
                break
            if not _is_crowded(ordered[:rows], top):
                continue
            read = abs(share_read(away, told, top))
            if _is_beyond(ordered[:rows], read * wheels[:rows], top):
                part = (len(size) - rows, len(size)) if is_reversed else (0, rows)
                if best is None or rows > best[1] - best[0]:
                    best = (*part, top)
                break
    return best


def share_read(away: Floats, told: Floats, top: float) -> float:
    """Return how much of what the wheels say the codes do that are not at a top."""
    other = (np.abs(np.abs(away) - top) > _A_CODE) & (np.abs(told) > _TURNING * top)
    if np.count_nonzero(other) < _LEAST_AT_TOP:
        return 1.0
    return float(np.median(away[other] / told[other]))


def _is_crowded(size: Floats, top: float) -> bool:
    """Tell whether many codes are at a top, and few just below."""
    at_top = size >= top - _A_CODE
    just_below: NDArray[np.bool_] = ~at_top & (size > top - 1.0 - _A_CODE)
    many = max(_LEAST_AT_TOP, _FLAT * int(np.count_nonzero(just_below)))
    return int(np.count_nonzero(at_top)) >= many


def _is_beyond(size: Floats, told: Floats, top: float) -> bool:
    """Tell whether many codes at a top should be beyond it."""
    beyond = (size >= top - _A_CODE) & (told > _BEYOND * top)
    return int(np.count_nonzero(beyond)) >= _LEAST_AT_TOP
