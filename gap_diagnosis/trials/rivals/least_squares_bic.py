"""Rival 1b: the same least squares, chosen by Schwarz's criterion and softmax.

Schwarz, *Estimating the dimension of a model* (Annals of Statistics 6, 1978): residuals are taken
to be independent and normal. A fit within its tolerance counts as no gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gap_diagnosis.trials.rivals.choosing import pooled, settings_of, values_of
from gap_diagnosis.trials.rivals.door import answer, job_of, softmax
from gap_diagnosis.trials.rivals.trajectory import Trajectories


def diagnose(log: Path, robot: Path, reference: Path, without: Sequence[str]) -> dict[str, Any]:
    """Return OUT.json; probabilities are exp(−BIC/2), normalised."""
    job = job_of(log, robot, reference, without)
    found = Trajectories(job).best()
    ranked = pooled(softmax({(one.effect,): -0.5 * one.bic for one in found}), found)
    winner = next(one for one in found if (one.effect,) == (ranked[0][0] or ("",)))
    if not winner.effect:
        return answer(job, ranked)
    return answer(job, ranked, settings_of(winner), values_of(winner))
