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
        products: of the whitened columns with each other, float64[c, c], and with the data,
            float64[c], where they are known.
    """

    log_evidence: float
    white: Floats
    log_variance: Floats
    products: tuple[Floats, Floats] | None = None


Weigh = Callable[[Floats], Weighed]
"""What a log says at levels, float64[levels]."""


def slopes(weigh: Weigh, here: Floats, seen: Weighed, silent: Set[int]) -> tuple[Floats, Floats]:
    """Return slope float64[levels] and information float64[levels, levels] of log evidence by the
    logarithms of levels; nothing of the *silent*.

    With whitened innovations w of log variance v, the information of levels i and j is the sum over
    rows of v_i v_j / 2 + (w_i + w v_i / 2) (w_j + w v_j / 2), indices for derivatives.
    """
    weights = leftover_weights(seen)
    left = seen.white @ weights
    slope = np.zeros(len(here))
    rows = np.zeros((len(here), 2, len(left)))
    for place in sorted(set(range(len(here))) - silent):
        moved = here.copy()
        moved[place] += _STEP
        there = weigh(np.exp(moved))
        slope[place] = (there.log_evidence - seen.log_evidence) / _STEP
        wider = (there.log_variance - seen.log_variance) / _STEP
        more = (there.white @ weights - left) / _STEP
        rows[place, 0] = wider / math.sqrt(2.0)
        rows[place, 1] = more + 0.5 * left * wider
    flat = rows.reshape(len(here), -1)
    return slope, np.asarray(flat @ flat.T)


def leftover_weights(seen: Weighed) -> Floats:
    """Return what to multiply data and columns by for what the columns leave over, float64[1 + c].

    By least squares; columns that are nearly the others' sums are held at little.
    """
    if seen.products is None:
        whole = seen.white.T @ seen.white
        inner, data = whole[1:, 1:], whole[1:, 0]
    else:
        inner, data = seen.products
    size = np.sqrt(np.maximum(np.diag(inner), np.finfo(np.float64).tiny))
    inner = inner / np.outer(size, size) + _RIDGE * np.eye(len(size))
    return np.append(1.0, -np.linalg.solve(inner, data / size) / size)
