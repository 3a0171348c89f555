"""Angles without their jumps."""

import numpy as np
from numpy.typing import NDArray


def unwrapped(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles without jumps of a turn; NaN stays NaN."""
    result = angle_rad.copy()
    known = np.isfinite(result)
    result[known] = np.unwrap(result[known])
    return result
