"""How much a sensor's codes change by themselves."""

import math
from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats

_TREMBLES_LSB: Final = 1.2
"""A code is as a rule two codes off the middle of those before and after."""


def tremble_lsb(code: Floats) -> float:
    """Return the standard deviation of codes float64[n] about their neighbours [LSB]."""
    second = np.diff(code, 2)
    return 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6) if len(second) else 0.0


def trembles(code: Floats) -> bool:
    """Tell whether codes float64[n] (NaN: none) change by themselves wherever they are.

    Where noise is less than a code, a sensor leaves the code that it is in the middle of here and
    there only, and says the same for as long as what it measures is steady.
    """
    return tremble_lsb(code[np.isfinite(code)]) >= _TREMBLES_LSB
