"""What every rival is given, and how it answers: files in, ``OUT.json`` out.

All get the same recording, the same held-out split, and the same measure of the gap; what they make
of it is theirs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.holdout import HoldOut, hold_out
from gap_diagnosis.gap.how_far import gap_of
from gap_diagnosis.gap.manoeuvres import kinds_of
from gap_diagnosis.gap.on_recording import compare_all, levels_of, windows_on
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.levels import level_prior
from gap_diagnosis.motion.offset import coarse_delay_s
from gap_diagnosis.prediction import Motion
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result import NO_GAP, UNKNOWN, Diagnosis, sort_stages
from gap_diagnosis.result_parts import (
    STAGES,
    Candidate,
    Gap,
    NumberEstimate,
    ParameterEstimate,
    StageOrNone,
    Structure,
    Where,
)
from hil_harness.assembly import Wire, load_wire
from hil_harness.effects import catalogue
from hil_harness.robot import Robot, load_robot

Effects = tuple[str, ...]
"""Sorted names; none for no gap."""

_LISTED: Final = 12
_QUANTILES: Final = (1.959964, 1.281552, 0.674490)
"""Of the normal law, for intervals of 95, 80 and 50 %."""


@dataclass(frozen=True)
class Job:
    """One case as a rival gets it.

    Attributes:
        recording, robot, wire: what was read.
        motion: the recording at tick level.
        delay_s: float64[s], by how much each sample of the reference is late, to about a tick.
        sides: which ticks a fit may use, and which are held out.
        without: effects that must not be named.
        started: when the clock of the answer began to run [s].
    """

    recording: Recording
    robot: Robot
    wire: Wire
    motion: Motion
    delay_s: Floats
    sides: HoldOut
    without: frozenset[str]
    started: float


def job_of(log: Path, robot: Path, reference: Path, without: Sequence[str]) -> Job:
    """Read a case; raises what reading raises."""
    started = time.monotonic()
    described, wire = load_robot(robot), load_wire()
    (recording,) = read_recordings([log], robot=described, wire=wire, references=[reference])
    delay_s = coarse_delay_s(recording, described)
    motion = estimate_motion(recording, described, reference_delay_s=delay_s)
    sides = hold_out(recording.t_s, kinds_of(recording, described))
    return Job(recording, described, wire, motion, delay_s, sides, frozenset(without), started)


def number(value: float, sd: float, unit: str) -> NumberEstimate:
    """Return an estimate with the normal law's intervals."""
    low95, low80, low50 = (value - z * sd for z in _QUANTILES)
    high95, high80, high50 = (value + z * sd for z in _QUANTILES)
    return NumberEstimate(
        estimate=value, unit=unit, sd=sd, ci50=(low50, high50), ci80=(low80, high80),
        ci95=(low95, high95),
    )  # fmt: skip


def named(effect: str, values: Mapping[str, tuple[float, float]]) -> dict[str, ParameterEstimate]:
    """Return estimates by ``effect.parameter`` from each parameter's value and sd."""
    known = catalogue()[effect]
    return {
        f"{effect}.{name}": number(value, sd, known.parameter(name).unit)
        for name, (value, sd) in values.items()
        if math.isfinite(value) and math.isfinite(sd)
    }


def softmax(scores: Mapping[Effects, float]) -> list[tuple[Effects, float]]:
    """Return probabilities in proportion to exp(score), largest first."""
    top = max(scores.values())
    weights = {effects: math.exp(score - top) for effects, score in scores.items()}
    total = math.fsum(weights.values())
    return sorted(((e, w / total) for e, w in weights.items()), key=lambda one: (-one[1], one[0]))


def answer(
    job: Job,
    ranked: Sequence[tuple[Effects, float]],
    settings: Sequence[Setting] = (),
    parameters: Mapping[str, ParameterEstimate] | None = None,
) -> dict[str, Any]:
    """Return OUT.json: *ranked* are answers with probabilities, the best first.

    *settings* are the winner's values, fitted on what is not held out, for the gap that they leave.
    """
    best = ranked[0][0]
    chances: dict[StageOrNone, float] = dict.fromkeys(STAGES, 0.0)
    for effects, probability in ranked:
        for stage in _stages(effects):
            chances[stage] += probability / len(_stages(effects))
    stage = max(_stages(best), key=lambda one: chances[one])
    kept = [one for one in ranked if one[0] or one[1] > 0][:_LISTED]
    entries = [
        Candidate(
            effects=effects or (NO_GAP,), probability=probability, group_probability=probability,
            parameters=dict(parameters or {}) if effects == best else {},
        )
        for effects, probability in kept
    ]  # fmt: skip
    for needed in (NO_GAP, UNKNOWN):
        if not any(one.effects == (needed,) for one in entries):
            entries.append(Candidate(effects=(needed,), probability=0.0, group_probability=0.0))
    found = Diagnosis(
        verdict="+".join(best) or NO_GAP,
        stage=stage,
        stage_probabilities=sort_stages(chances),
        which=tuple(entries),
        other=max(0.0, 1.0 - math.fsum(one.probability for one in entries)),
        where=Where(stages={}, segments=()),
        gap=_gap(job, stage, settings),
        structure=Structure(detectable={}),
        version=version("chiplog"),
        seconds=time.monotonic() - job.started,
    )
    return found.model_dump(mode="json", by_alias=True)


def _stages(effects: Effects) -> list[StageOrNone]:
    known = catalogue()
    return [cast(StageOrNone, known[effect].stage) for effect in effects] or ["none"]


def _gap(job: Job, stage: str, settings: Sequence[Setting]) -> Gap | None:
    """Return the gap on the held-out stretches before and after, as the diagnosis measures it."""
    if job.sides.why_not is not None:
        return None
    compared = compare_all(
        job.recording,
        job.robot,
        job.motion,
        windows_on(job.motion, job.sides.held_out),
        effects=settings,
        levels=levels_of(np.asarray(level_prior(job.robot).median), job.robot, job.motion),
    )
    return gap_of(compared, stage, "stretches")
