"""Signals that come in steps: counts of several, as of degrees or millimetres, and others."""

from __future__ import annotations

from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats

NO_STEP: Final = 1e-6
"""Counts: by less a sum of decimals is off."""
_FINEST: Final = 1e-9
"""Of the largest value: so much a decimal is off."""
_NEAR: Final = 0.2
"""Of a step, or a count: as near to a multiple of it"""
_ON_LATTICE: Final = 0.95
_OFTEN: Final = 5
_SEVERAL: Final = 3
"""are all but 5 % of the changes where counts come in steps; at least three multiples come five
times."""


def lattice_step(counts: Floats) -> float:
    """Return the step in which running counts, float64[n] with NaN, come; 1 where it is none.

    Rounded, degrees have steps of 57 and 58.
    """
    changes = np.abs(np.diff(counts[np.isfinite(counts)]))
    changes = changes[changes > NO_STEP]
    if len(changes) == 0 or changes.min() <= 1.0:
        return 1.0
    # A wheel that turns as fast all the time has one step, and no lattice.
    return _step_of(changes, most_off=1.0, least_multiples=_SEVERAL) or 1.0


def step_of_values(values: Floats) -> float:
    """Return the step in which a signal, float64[n], is told; 0 where it is in no such steps."""
    changes = np.abs(np.diff(values))
    finest = _FINEST * float(np.max(np.abs(values), initial=0.0))
    changes = changes[changes > finest]
    return _step_of(changes, most_off=np.inf, least_multiples=1) if len(changes) else 0.0


def _step_of(changes: Floats, most_off: float, least_multiples: int) -> float:
    """Return of what step changes, float64[k] above 0, are multiples, nearly all of them, to a part
    of it and to *most_off*, and of several kinds; 0 where there is none."""
    step = float(changes.min())
    for _ in range(2):  # rounded, the least is off by up to half a count
        step = float(np.median(changes / np.rint(changes / step)))
    times = np.rint(changes / step)
    near = min(_NEAR * step, most_off)
    is_lattice = np.mean(np.abs(changes - times * step) <= near) > _ON_LATTICE
    several = np.unique(times[times > 0], return_counts=True)[1]
    return step if is_lattice and np.sum(several >= _OFTEN) >= least_multiples else 0.0
