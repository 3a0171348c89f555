"""Rival 1: least squares on the trajectory, one effect at a time; the smallest residual wins.

What a roboticist does today: simulate with each effect, fit its values so that the path lies on the
measured one, keep the effect that leaves least. A winner within its tolerance counts as no gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gap_diagnosis.trials.rivals.choosing import settings_of, values_of
from gap_diagnosis.trials.rivals.door import answer, job_of
from gap_diagnosis.trials.rivals.trajectory import Trajectories


def diagnose(log: Path, robot: Path, reference: Path, without: Sequence[str]) -> dict[str, Any]:
    """Return OUT.json; all probability is on the winner."""
    job = job_of(log, robot, reference, without)
    found = sorted(Trajectories(job).best(), key=lambda one: one.squares)
    winner = found[0]
    order = [(one.effect,) for one in found if one.effect]
    if not winner.is_news:
        ranked = [((), 1.0), *((effects, 0.0) for effects in order)]
        return answer(job, ranked)
    ranked = [(order[0], 1.0), *((effects, 0.0) for effects in order[1:]), ((), 0.0)]
    return answer(job, ranked, settings_of(winner), values_of(winner))
