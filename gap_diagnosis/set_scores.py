"""The score of a set of effects: what the logs say of it, and how likely it was beforehand."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from gap_diagnosis.block_sums import Effects

Score = tuple[float, float, float]
"""Log evidence, log likelihood and log prior of a set."""
Scores = dict[Effects, Score]


def single_priors(owned: Sequence[str], stage_of: Mapping[str, str]) -> dict[str, float]:
    """Return log priors: even over stages, then over the effects of each."""
    members = Counter(stage_of[effect] for effect in owned)
    stages = max(len(members), 1)
    return {effect: -math.log(stages * members[stage_of[effect]]) for effect in owned}
