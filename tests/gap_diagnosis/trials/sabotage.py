"""The present method on a small library, and five ways to spoil it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

import gap_diagnosis.motion.evidence
import gap_diagnosis.motion.model
import gap_diagnosis.motion.weighing
from gap_diagnosis.analysis import Analysis, analyse
from gap_diagnosis.answer import candidates, stage_probabilities
from gap_diagnosis.effect_stages import stages_of
from gap_diagnosis.explanations import twin_sets
from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.priors import default_prior
from gap_diagnosis.ranking import Ranking, rank
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Floats
from gap_diagnosis.result import sort_candidates
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.layout import LOG, REFERENCE, ROBOT
from hil_harness.assembly import load_wire
from hil_harness.effects import catalogue
from hil_harness.robot import load_robot

LIBRARY: Final = frozenset(
    {
        "adc_gain", "adc_offset", "frame_latency", "gyro_bias", "gyro_lag", "gyro_scale",
        "gyro_tilt", "lateral_slip", "longitudinal_slip", "radius_mismatch", "radius_scale",
        "reference_lever_arm", "reference_scale", "reference_time_offset", "reference_yaw",
        "ticks_per_rev", "turn_scrub", "wheel_toe", "wheelbase_scale",
    }
)  # fmt: skip
"""What may be named: few effects, so that all pairs of them cost little."""

_LEAST: Final = 1e-4
"""No sample is better than a tenth of a millimetre, or of a milliradian."""

Told = dict[str, Any]


@dataclass(frozen=True)
class Diagnosed:
    """A case as far as every method goes with it: all that ranking and answer need."""

    analysis: Analysis
    ranking: Ranking


def diagnosed(home: Path, without: frozenset[str] = frozenset()) -> Diagnosed:
    """Read and search a case with the small library."""
    robot, wire, prior = load_robot(home / ROBOT), load_wire(), default_prior()
    (recording,) = read_recordings(
        [home / LOG], robot=robot, wire=wire, references=[home / REFERENCE]
    )
    gone = frozenset(catalogue()) - LIBRARY | without
    found = analyse(recording, robot, wire, prior, without=gone)
    several = () if found.motion is None else found.motion.several
    return Diagnosed(
        found, rank([found.blocks], prior, stages_of([found], {}), found.unknown, several)
    )


def told(one: Diagnosed) -> Told:
    """Return what the present method answers, without the gap and the intervals."""
    which, _ = candidates(one.ranking, [])
    ordered = sort_candidates(which)
    chances = stage_probabilities(one.ranking, stages_of([one.analysis], {}))
    return {
        "verdict": "+".join(ordered[0].effects),
        "stage": max(chances, key=lambda stage: chances[stage]),
        "which": [each.model_dump(mode="json") for each in ordered],
        "seconds": 0.0,
        "gap": None,
    }


def without_prior(one: Diagnosed) -> Diagnosed:
    """Believe in proportion to the best likelihood: no prior of sizes, none of effects."""
    top = max(each.log_likelihood for each in one.ranking.sets)
    weights = [math.exp(each.log_likelihood - top) for each in one.ranking.sets]
    total = math.fsum(weights)
    sets = [
        replace(each, probability=weight / total)
        for each, weight in zip(one.ranking.sets, weights, strict=True)
    ]
    sets.sort(key=lambda each: -each.probability)
    return Diagnosed(one.analysis, Ranking(tuple(sets), dict.fromkeys(one.ranking.unknown, 0.0)))


def without_twins(found: Told) -> Told:
    """Keep silent about the names that would leave the same data."""
    which = []
    for each in found["which"]:
        twins = [sorted(twin) for twin in twin_sets(frozenset(each["effects"]) & LIBRARY)]
        others = [one for one in each["ambiguous_with"] if sorted(one) not in twins]
        which.append({**each, "ambiguous_with": others})
    return {**found, "which": which}


@contextmanager
def white_noise() -> Iterator[None]:
    """Take every sample's error to be its own: nothing accumulates, nothing wanders."""
    with pytest.MonkeyPatch.context() as patch:
        motion = gap_diagnosis.motion
        for module in (motion.evidence, motion.model, motion.weighing):
            patch.setattr(module, "whiten", _white)
        yield


def _white(columns: Floats, course: Course, levels: Floats, ticks: Floats) -> tuple[Floats, Floats]:
    """Weigh each channel by what its residual scatters from one block to the next."""
    rows, log_variance = [], []
    for channel in columns:
        seen = channel[np.isfinite(channel[:, 0])]
        if len(seen) > 1:
            sd = max(float(np.diff(seen[:, 0]).std()) / math.sqrt(2.0), _LEAST)
            rows.append(seen / sd)
            log_variance.append(np.full(len(seen), 2 * math.log(sd)))
    return np.ascontiguousarray(np.concatenate(rows)), np.concatenate(log_variance)


def shuffled(cases: Sequence[Case]) -> list[Case]:
    """Return for each case the next one."""
    return [*cases[1:], *cases[:1]]
