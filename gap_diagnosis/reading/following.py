"""What wheels follow: a command comes before what they do, and what is measured comes after."""

from __future__ import annotations

from typing import Final

import numpy as np

from gap_diagnosis.reading.signals_found import FoundSignal
from gap_diagnosis.recording import Floats

STEP_S: Final = 0.02
_LONGEST_S: Final = 0.5
"""No wheel follows later."""
_ALIKE: Final = 0.9


def is_followed(signal: FoundSignal, grid_s: Floats, rate: Floats) -> bool:
    """Tell whether wheels do what a signal says, or its opposite, and do it later.

    *grid_s*, *rate*: float64[n], times every `STEP_S` and what wheels do there. A command holds
    until the next one.
    """
    lags = range(-round(_LONGEST_S / STEP_S), round(_LONGEST_S / STEP_S) + 1)
    if len(grid_s) < 4 * len(lags):
        return False
    held = signal.value[np.maximum(np.searchsorted(signal.time_s, grid_s, "right") - 1, 0)]
    alike = [abs(correlation(*_shifted(held, rate, lag))) for lag in lags]
    best = int(np.argmax(alike))
    return alike[best] > _ALIKE and lags[best] > 0


def _shifted(said: Floats, done: Floats, lag: int) -> tuple[Floats, Floats]:
    """Return what is said and what is done so many steps later."""
    return (said[:-lag], done[lag:]) if lag > 0 else (said[-lag:], done[: len(done) + lag])


def correlation(one: Floats, other: Floats) -> float:
    """Return the correlation of two series float64[n], -1 to 1; 0 where one never changes."""
    spread = float(np.std(one) * np.std(other))
    if spread == 0.0:
        return 0.0
    return float(np.mean((one - one.mean()) * (other - other.mean())) / spread)
