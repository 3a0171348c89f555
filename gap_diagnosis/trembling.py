"""Whether a sensor's codes change by themselves."""

from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats

_TREMBLES: Final = 2.0
"""Codes off the middle of those before and after, as a rule: of noise of 0.8 codes."""


def trembles(code: Floats) -> bool:
    """Tell whether codes float64[n] (NaN: none) change by themselves wherever they are.

    Where noise is less than a code, a sensor leaves the code that it is in the middle of here and
    there only, and says the same for as long as what it measures is steady.
    """
    known = code[np.isfinite(code)]
    return len(known) > 2 and bool(np.median(np.abs(np.diff(known, 2))) >= _TREMBLES)
