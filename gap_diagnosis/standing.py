"""When a wheel stands."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from gap_diagnosis.recording import Floats

STANDS_S: Final = 1.0


def standing(angle_rad: Floats, tick_s: float, rad_per_count: float) -> NDArray[np.bool_]:
    """Tell the ticks of a wheel that stands, bool[n]: for a second its count is one of two.

    A wheel that stands on an edge of its encoder counts to and fro.
    """
    width = 2 * round(0.5 * STANDS_S / tick_s) + 1
    reach = maximum_filter1d(angle_rad, width) - minimum_filter1d(angle_rad, width)
    return np.asarray(minimum_filter1d(reach, width) < 1.5 * rad_per_count)
