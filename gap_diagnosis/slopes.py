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
_STAND_FOR: Final = 0.3
"""What columns have of a slope stands for all levels within half a standard deviation."""
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
Leave = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""What `Weighed.white` times weights, float64[1 + c], is at levels, float64[r], and the log
variances there: for a third of the work."""


class Slopes:
    """Slopes of log evidence by the logarithms of levels, and their information.

    At the columns' best coefficients a slope is that of what they leave (the envelope theorem), and
    what their own uncertainty has of it: about where that was seen it hardly changes.
    """

    def __init__(self, weigh: Weigh, leave: Leave | None, silent: Set[int]) -> None:
        """Prepare; on the *silent* levels nothing depends: their slope is not asked for."""
        self._weigh, self._leave, self._silent = weigh, leave, silent
        self._beside: tuple[Floats, Floats] | None = None

    def at(self, log_levels: Floats, seen: Weighed, besides: Set[int]) -> tuple[Floats, Floats]:
        """Return slope float64[levels] and information float64[levels, levels], nothing of the
        levels *besides*: of those once left out nothing is known until all are forgotten."""
        silent = self._silent | besides
        if self._leave is None or self._beside is None:
            slope, information, left = slopes(self._weigh, log_levels, seen, silent)
            self._beside = log_levels, slope - left
            return slope, information
        leave, weights = self._leave, leftover_weights(seen)

        def look(levels: Floats) -> Weighed:
            white, log_variance = leave(levels, weights)
            return Weighed(0.0, white[:, np.newaxis], log_variance)

        here = Weighed(0.0, (seen.white @ weights)[:, np.newaxis], seen.log_variance)
        _, information, left = slopes(look, log_levels, here, silent)
        slope = left + self._beside[1]
        slope[list(besides)] = 0.0
        return slope, information

    def forget(self) -> None:
        """Look at all columns next time."""
        self._beside = None

    def stand_for(self, log_levels: Floats, information: Floats) -> bool:
        """Tell whether what was last seen of the columns' uncertainty is good enough here; if not,
        it is forgotten."""
        if self._leave is None or self._beside is None:
            return True
        way = log_levels - self._beside[0]
        if way @ information @ way <= _STAND_FOR:
            return True
        self.forget()
        return False


def slopes(
    weigh: Weigh, here: Floats, seen: Weighed, silent: Set[int]
) -> tuple[Floats, Floats, Floats]:
    """Return slope float64[levels] and information float64[levels, levels] of log evidence by the
    logarithms of levels, and what of the slope is of the leftover alone; nothing of the *silent*.

    With whitened innovations w of log variance v, the information of levels i and j is the sum over
    rows of v_i v_j / 2 + (w_i + w v_i / 2) (w_j + w v_j / 2), indices for derivatives.
    """
    weights = leftover_weights(seen)
    left = seen.white @ weights
    slope, of_left = np.zeros(len(here)), np.zeros(len(here))
    rows = np.zeros((len(here), 2, len(left)))
    for place in sorted(set(range(len(here))) - silent):
        moved = here.copy()
        moved[place] += _STEP
        there = weigh(np.exp(moved))
        slope[place] = (there.log_evidence - seen.log_evidence) / _STEP
        wider = (there.log_variance - seen.log_variance) / _STEP
        more = (there.white @ weights - left) / _STEP
        of_left[place] = -float(left @ more + 0.5 * _STEP * more @ more + 0.5 * wider.sum())
        rows[place, 0] = wider / math.sqrt(2.0)
        rows[place, 1] = more + 0.5 * left * wider
    flat = rows.reshape(len(here), -1)
    return slope, np.asarray(flat @ flat.T), of_left


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
