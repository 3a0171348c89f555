"""Whether importance sampling can be trusted: the tail of its weights."""

from __future__ import annotations

import numpy as np
from scipy.stats import genpareto

from gap_diagnosis.recording import Floats


def tail_shape(log_weight: Floats) -> float:
    """Return the Pareto shape of the largest fifth of the weights, given by logarithms float64[n].

    Below 0.7 sums over the draws converge in practice (Vehtari et al. 2024, JMLR 25:72).
    """
    weight = np.sort(np.exp(log_weight - log_weight.max()))
    tail = weight[-len(weight) // 5 :]
    excess = tail[1:] - tail[0]
    if excess.max() <= 0:
        return 0.0
    return float(genpareto.fit(excess / excess.max(), floc=0)[0])
