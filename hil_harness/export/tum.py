"""Trajectories as TUM text: one row ``t x y z qx qy qz qw`` each."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def tum_text(time_s: NDArray[np.float64], poses: NDArray[np.float64]) -> str:
    """Return poses, float64[n, 3] (x_m, y_m, heading_rad), as the rows of a TUM file.

    17 digits give every float64 back bit for bit. The quaternion is a turn about z by the heading.
    """
    return "".join(
        f"{t:.17g} {x:.17g} {y:.17g} 0 0 0 {math.sin(h / 2):.17g} {math.cos(h / 2):.17g}\n"
        for t, (x, y, h) in zip(time_s.tolist(), poses.tolist(), strict=True)
    )
