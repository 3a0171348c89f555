"""How what a log says goes with its noise levels; nothing here knows what they are levels of."""

from __future__ import annotations

import math
from collections.abc import Callable, Set
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEP: Final = 1e-3
"""Of a level's logarithm, for its slope."""
_RIDGE: Final = 1e-9


class Weighed(NamedTuple):
    """What a log says at one vector of levels.

    Attributes:
        log_evidence: of what is compared, without the levels' own density.
        white: whitened data and columns, float64[r, 1 + c].
        log_variance: of each row before it was whitened, float64[r].
    """

    log_evidence: float
    white: Floats
    log_variance: Floats


Weigh = Callable[[Floats], Weighed]
"""What a log says at levels, float64[levels]."""


def slopes(weigh: Weigh, here: Floats, seen: Weighed, silent: Set[int]) -> tuple[Floats, Floats]:
    """Return slope float64[levels] and information float64[levels, levels] of log evidence by the
    logarithms of levels; nothing of the *silent* ones.

    With whitened innovations w of log variance v, the information of levels i and j is the sum over
    rows of v_i v_j / 2 + (w_i + w v_i / 2) (w_j + w v_j / 2), indices for derivatives.
    """
    weights = leftover_weights(seen.white)
    left = seen.white @ weights
    slope = np.zeros(len(here))
    rows = np.zeros((2, len(left), len(here)))
    for place in sorted(set(range(len(here))) - silent):
        moved = here.copy()
        moved[place] += _STEP
        there = weigh(np.exp(moved))
        slope[place] = (there.log_evidence - seen.log_evidence) / _STEP
        wider = (there.log_variance - seen.log_variance) / _STEP
        rows[0, :, place] = wider / math.sqrt(2.0)
        rows[1, :, place] = (there.white @ weights - left) / _STEP + 0.5 * left * wider
    flat = rows.reshape(-1, len(here))
    return slope, np.asarray(flat.T @ flat)


def leftover_weights(white: Floats) -> Floats:
    """Return what to multiply data and columns by for what the columns leave over, float64[1 + c].

    By least squares; columns that are nearly the others' sums are held at little.
    """
    whole = white.T @ white
    size = np.sqrt(np.maximum(np.diag(whole)[1:], np.finfo(np.float64).tiny))
    inner = whole[1:, 1:] / np.outer(size, size) + _RIDGE * np.eye(len(size))
    return np.append(1.0, -np.linalg.solve(inner, whole[1:, 0] / size) / size)
