"""What each effect takes off the gap: Shapley values over the winning set.

The order in which effects are switched on changes what each seems to do; the Shapley value is the
mean over all orders (L. S. Shapley, "A value for n-person games", 1953), and adds up exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import combinations
from typing import Final

MOST_EFFECTS: Final = 8


def shapley_reductions(
    effects: Iterable[str], gap: Callable[[frozenset[str]], float]
) -> dict[str, float]:
    """Return how much each effect takes off: the values sum to gap(none) − gap(all).

    *gap* is called once for each subset. Raises ValueError for more than `MOST_EFFECTS`.
    """
    names = sorted(set(effects))
    if len(names) > MOST_EFFECTS:
        raise ValueError(f"{len(names)} effects: expected at most {MOST_EFFECTS}")
    known = {
        frozenset(subset): gap(frozenset(subset))
        for size in range(len(names) + 1)
        for subset in combinations(names, size)
    }
    total = math.factorial(len(names))
    reductions = {}
    for name in names:
        terms = []
        for subset, value in known.items():
            if name in subset:
                continue
            orders = math.factorial(len(subset)) * math.factorial(len(names) - len(subset) - 1)
            terms.append(orders / total * (value - known[subset | {name}]))
        reductions[name] = math.fsum(terms)
    return reductions
