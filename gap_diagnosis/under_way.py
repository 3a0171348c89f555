"""How large errors of a reference usually are: stamps that are off show under way alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats

_AROUND: Final = 5
"""Samples on each side over which a path is left."""
_NORMAL: Final = 1.4826
"""Of a normal value, its standard deviation over its median size (Rousseeuw and Croux 1993)."""


def rate_of(path: Floats, t_s: Floats) -> Floats:
    """Return how fast a path is left at each time, over the samples around it, float64[s]."""
    place = np.arange(len(t_s))
    first, last = np.maximum(place - _AROUND, 0), np.minimum(place + _AROUND, len(t_s) - 1)
    return np.asarray((path[last] - path[first]) / (t_s[last] - t_s[first]))


def usual_size(size: Floats, speed: Floats) -> Floats:
    """Return the usual size of errors, standard deviations float64[s], at these speeds: of errors
    that grow with the speed in proportion, of others the same at any."""
    usual = _NORMAL * float(np.median(size))
    fast = speed > float(np.median(speed))
    if not fast.any():
        return np.full(len(size), usual)
    off_s = _NORMAL * float(np.median(size[fast] / speed[fast]))
    return np.asarray(np.maximum(usual, off_s * speed))
