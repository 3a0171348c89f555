"""Which values of a constant leave the same odometry, to the last digit of the record.

A kernel holds its constants as whole numbers, so that each stands for a range of values, and no log
can tell between those.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

_FIRST_STEP: Final = 1e-14
_HALVINGS: Final = 12


def cell_about(
    value: float, same: Callable[[float], bool], low: float, high: float
) -> tuple[float, float]:
    """Return the ends of the values about *value* for which *same* holds, within low to high."""
    return _edge(value, same, low), _edge(value, same, high)


def _edge(value: float, same: Callable[[float], bool], end: float) -> float:
    """Return how far *same* holds from *value* towards *end*: doubling steps, then halving them."""
    way = 1.0 if end > value else -1.0
    inside, outside = 0.0, _FIRST_STEP * max(abs(value), 1.0)
    while same(value + way * outside):
        inside, outside = outside, 2.0 * outside
        if outside >= abs(end - value):
            return end
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if same(value + way * middle) else (inside, middle)
    return value + way * 0.5 * (inside + outside)
