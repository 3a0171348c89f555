"""How much surer a fit is of an effect than the spread of what is left of the log allows.

Where an explanation is not exact, a further effect gains what it makes of the rest. Of an effect
that is there, what each stretch of the log says of its size scatters as the noise does; of one that
is not, stretches contradict each other, some of them by far more. The variance that this scatter
gives an estimate, over the one that the likelihood states, is the factor by which its evidence is
too large (White 1982, Econometrica 50, theorem 3.2; with stretches as clusters: Liang and Zeger
1986, Biometrika 73, equation 2.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.recording import Floats

STRETCHES: Final = 40
_SAME: Final = 1e-12
"""Columns that differ by no more are one: which of them it is, no stretch can contradict."""
BY_CHANCE: Final = 3.0
"""Standard deviations by which the scatter of a right explanation may exceed what is expected."""


def excess(model: MotionModel, terms: Sequence[Term], fit: Refitted) -> Mapping[str, float]:
    """Return by effect how many times too large its evidence is, 1 where chance explains it."""
    data, columns, restraint, owners = model.at_fit(terms, fit)
    inverse = _inverse(columns.T @ columns + np.diag(restraint))
    left = data - columns @ (inverse @ (columns.T @ data))
    parts = np.array_split(np.arange(len(data)), STRETCHES)
    # How each row of the log pulls at each size, and by how much it may: float64[rows, sizes].
    influence = columns @ inverse
    pulls = np.array([influence[part].T @ left[part] for part in parts])
    allowed = np.array([np.einsum("rs,rs->s", influence[part], influence[part]) for part in parts])
    found = {}
    for effect, places in owners.items():
        ratios = [
            float(np.sum(pulls[:, place] ** 2))
            / (float(np.sum(allowed[:, place])) * _by_chance(allowed[:, place]))
            for place in places
            if allowed[:, place].any()
        ]
        found[effect] = max([1.0, *ratios])
    return found


def _inverse(inner: Floats) -> Floats:
    """Return the inverse float64[c, c] of inner products; what a log does not tell has none."""
    size = np.sqrt(np.diag(inner))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    even = np.linalg.pinv(scale[:, None] * inner * scale, rcond=_SAME, hermitian=True)
    return np.asarray(scale[:, None] * even * scale)


def _by_chance(allowed: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return the largest ratio that chance gives where so few stretches have a say."""
    total = float(np.sum(allowed))
    return 1.0 + BY_CHANCE * math.sqrt(2.0 * float(np.sum(allowed**2))) / total
