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

    *told*: how far the wheels say that codes should be.
    """
    size = np.abs(away)
    best: tuple[int, int, float] | None = None
    for is_reversed in (False, True):
        ordered, wheels = (size[::-1], np.abs(told[::-1])) if is_reversed else (size, np.abs(told))
        most = np.maximum.accumulate(ordered)
        for top in np.unique(most[most < most[-1]])[::-1].tolist():
            rows = int(np.searchsorted(most, top, side="right"))
            if rows < _LEAST_SHARE * len(size):
                break
            if _is_flat(ordered[:rows], wheels[:rows], top):
                part = (len(size) - rows, len(size)) if is_reversed else (0, rows)
                if best is None or rows > best[1] - best[0]:
                    best = (*part, top)
                break
    return best


def _is_flat(size: Floats, told: Floats, top: float) -> bool:
    at_top = size >= top - 0.6
    just_below: NDArray[np.bool_] = (size < top - 0.6) & (size > top - 1.6)
    many = max(_LEAST_AT_TOP, _FLAT * int(np.count_nonzero(just_below)))
    beyond = at_top & (told > _BEYOND * top)
    return bool(np.count_nonzero(at_top) >= many and np.count_nonzero(beyond) >= _LEAST_AT_TOP)
