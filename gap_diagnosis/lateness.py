"""When stamps come later, or less late, from some time on."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FRAMES: Final = 501
_FEW_FRAMES: Final = 51
"""Of a message that comes seldom."""
_LEAST_BLOCKS: Final = 3
_MOST_CHANGES: Final = 2
_A_CHANGE_S: Final = 0.001
_A_CHANGE: Final = 8.0
"""A lasting change of lateness is larger than so many times the usual from one block of frames to
the next."""


def blocks_of(late_s: Floats, rows: Ints) -> tuple[Floats, Floats]:
    """Return where blocks of rows are in the middle, and the median of their latenesses; one block
    of few rows."""
    if not len(rows):
        return np.zeros(0), np.zeros(0)
    size = _FRAMES if len(rows) >= 2 * _FRAMES else _FEW_FRAMES
    blocks = np.array_split(rows, max(1, len(rows) // size) if len(rows) >= 2 * size else 1)
    where = np.array([float(np.mean(block)) for block in blocks])
    return where, np.array([float(np.median(late_s[block])) for block in blocks])


def lasting_changes(late_s: Floats, rows: Ints) -> list[int]:
    """Return the rows, of those int64[f] in the order of their ticks, from which on a lateness is
    another for good: none, one or two.

    What is slow is no change. Where there is one, a straight line through all stamps is tilted, and
    what that leaves looks like a poll, or another clock.
    """
    where, middle = blocks_of(late_s, rows)
    if len(middle) < _LEAST_BLOCKS:
        return []
    steps = np.diff(middle)
    # Along a tilted line all other steps are alike.
    beside = steps - np.median(steps)
    away = np.abs(beside)
    places = np.flatnonzero(away > max(_A_CHANGE * float(np.median(away)), _A_CHANGE_S))
    # Of a block in which it changes, both steps are one change.
    is_next = (np.diff(places) > 1) | (np.diff(np.sign(beside[places])) != 0)
    changes = np.split(places, np.flatnonzero(is_next) + 1) if len(places) else []
    if len(changes) > _MOST_CHANGES:
        return []
    found = []
    for own in changes:
        first = where[own[0] - 1] if own[0] > 0 else 0.0
        last = where[own[-1] + 2] if own[-1] + 2 < len(where) else math.inf
        around = rows[(rows >= first) & (rows <= last)]
        found.append(int(around[_change(late_s[around])]))
    return sorted(set(found))


def _change(values: Floats) -> int:
    """Return from which value on their mean is another, by least squares."""
    count = np.arange(1, len(values))
    before = np.cumsum(values - values.mean())[:-1]
    return 1 + int(np.argmax(before**2 / (count * (len(values) - count))))
