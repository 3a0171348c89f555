"""How much a sensor's codes change by themselves."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.lattice import step_of_values
from gap_diagnosis.recording import Floats

_TREMBLES_LSB: Final = 1.2
"""A code is as a rule two codes off the middle of those before and after."""


def tremble_lsb(code: Floats, but: NDArray[np.bool_] | None = None) -> float:
    """Return the standard deviation of codes float64[n] about their neighbours [LSB], where none of
    them is one *but* for which they are asked, bool[n]; 0 where there are none."""
    second = np.diff(code, 2)
    if but is not None:
        second = second[~(but[:-2] | but[1:-1] | but[2:])]
    return 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6) if len(second) else 0.0


def trembles(code: Floats) -> bool:
    """Tell whether codes float64[n] (NaN: none) change by themselves wherever they are.

    Where noise is less than a code, a sensor leaves the code that it is in the middle of here and
    there only, and says the same for as long as what it measures is steady; so does one that is
    told in steps of several codes, of which its noise is less.
    """
    known = code[np.isfinite(code)]
    return tremble_lsb(known) >= _TREMBLES_LSB * max(step_of_values(known), 1.0)
