"""The disjoint windows over which a gap is measured: 5 m or 10 s, whichever ends first.

No window is shorter than 5 s, however fast the vehicle: its first second is taken to find its start
pose, and a car of 10 m/s would have driven 5 m before that is over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats

WINDOW_M: Final = 5.0
WINDOW_S: Final = 10.0
LEAST_S: Final = 5.0
"""A window lasts as long at least: five times what its start pose is estimated from."""
ALIGN_S: Final = 1.0
"""The start pose of a window is estimated from this much of its beginning."""
_WHOLE_ENOUGH: Final = 0.5
_LEAST_LEFT_S: Final = 2.0
"""What is left at a run's end and lasts less is no window."""


@dataclass(frozen=True)
class Window:
    """One window.

    Attributes:
        start_s, stop_s: its ends.
        align_s: the time at which the start pose is known and the error begins to count.
    """

    start_s: float
    stop_s: float
    align_s: float


def windows_of(
    t_s: Floats, distance_m: Floats, inside: NDArray[np.bool_] | None = None
) -> tuple[Window, ...]:
    """Cut a log into windows.

    *t_s* and *distance_m* (way travelled until then, never falling) are float64[n]; *inside*,
    bool[n], are the ticks that may be used, and each run of them starts a window. What is left at a
    run's end counts when it is at least half a window long, in metres or in seconds.
    """
    windows: list[Window] = []
    for first, last in _runs(np.ones(len(t_s), np.bool_) if inside is None else inside):
        at = first
        while t_s[last] - t_s[at] >= _LEAST_LEFT_S:
            by_time = int(np.searchsorted(t_s, t_s[at] + WINDOW_S - 1e-9))
            by_way = int(np.searchsorted(distance_m, distance_m[at] + WINDOW_M))
            enough = int(np.searchsorted(t_s, t_s[at] + LEAST_S - 1e-9))
            stop = min(by_time, max(by_way, enough))
            if stop > last:
                long = (t_s[last] - t_s[at]) / WINDOW_S
                far = (distance_m[last] - distance_m[at]) / WINDOW_M
                if max(long, far) >= _WHOLE_ENOUGH - 1e-9:
                    windows.append(_window(t_s[at], t_s[last]))
                break
            windows.append(_window(t_s[at], t_s[stop]))
            at = stop
    return tuple(windows)


def segment_window(start_s: float, stop_s: float) -> Window:
    """Return a window over a stretch of any length: a shorter one is aligned in less time."""
    return Window(start_s, stop_s, start_s + min(ALIGN_S, 0.25 * (stop_s - start_s)))


def _window(start_s: float, stop_s: float) -> Window:
    return Window(float(start_s), float(stop_s), float(start_s) + ALIGN_S)


def _runs(inside: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(first), int(stop) - 1) for first, stop in edges.reshape(-1, 2)]
