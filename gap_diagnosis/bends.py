"""How much noise a signal has, told by how it bends."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats

NORMAL_MAD: Final = 0.6745
"""Median of a normal's size over its standard deviation."""


def noise_by_bends(bends: Floats) -> float:
    """Return the standard deviation of one sample by a signal's second differences, float64[n]: six
    times its variance is theirs, and what the signal does itself bends in few places."""
    return float(np.median(np.abs(bends))) / (NORMAL_MAD * math.sqrt(6.0))
