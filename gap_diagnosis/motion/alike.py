"""Which effects a log's columns hardly tell apart: a late gyro from a slow one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.recording import Floats

_ALIKE: Final = 0.98
"""The cosine from which two columns tell much the same."""


def single_column(term: Term) -> int | None:
    """Return the column of which a term is so much, if it is one."""
    if len(term.weights) != 1 or term.is_fixed:
        return None
    columns = [column for column, value in term.weights[0] if value == 1.0]
    mixed = [column for column, value in term.weights[0] if value not in (0.0, 1.0)]
    return columns[0] if len(columns) == 1 and not mixed else None


def alike(own: int, terms: Iterable[Term], inner: Floats) -> list[tuple[Term, int]]:
    """Return of each effect among *terms* the one that is most like the column *own*, with its
    column, the most alike first; *inner* are all columns' inner products, float64[c, c]."""
    size = np.sqrt(np.maximum(np.diag(inner), np.finfo(np.float64).tiny))
    near: dict[str, tuple[float, Term, int]] = {}
    for term in terms:
        column, effect = single_column(term), term.variant.effect
        if column is None or column == own:
            continue
        cosine = abs(float(inner[own, column])) / float(size[own] * size[column])
        if cosine > max(_ALIKE, near[effect][0] if effect in near else 0.0):
            near[effect] = cosine, term, column
    ranked = sorted(near.values(), key=lambda one: -one[0])
    return [(term, column) for _, term, column in ranked]
