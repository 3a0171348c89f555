"""The diagnosis of logs: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Final

from can_bus import CanBusError
from firmware_model import FirmwareError
from gap_diagnosis import no_news
from gap_diagnosis.advising import advice_for
from gap_diagnosis.agreement import contradiction, disagreements
from gap_diagnosis.analysis import Analysis, Progress, analyse
from gap_diagnosis.answer import candidates, estimates_by_log, stage_probabilities, unknown_part
from gap_diagnosis.effect_stages import stages_of
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.facts import (
    ASSUMPTIONS,
    beside_mistake,
    beside_unlisted,
    counts_again,
    input_files,
    log_facts,
    makes_worse,
    not_looked_for,
    not_replayed,
    notes_on,
    sizes_of_wheels,
    untrusted,
)
from gap_diagnosis.granted import NOTHING, Granted
from gap_diagnosis.granting import load_granted
from gap_diagnosis.how_far import Shrink, shrink, shrink_each, shrink_on
from gap_diagnosis.pictures import Report
from gap_diagnosis.picturing import residual_times
from gap_diagnosis.prepared import prepared
from gap_diagnosis.priors import Prior, default_prior, with_library
from gap_diagnosis.ranking import Ranking, rank
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.reading.cycle_times import wire_of_log
from gap_diagnosis.reading.log import own_names
from gap_diagnosis.recording import Recording
from gap_diagnosis.restarts import with_restarts
from gap_diagnosis.result import NO_GAP, UNKNOWN, Diagnosis, sort_candidates, sort_stages
from gap_diagnosis.result_parts import (
    Advice,
    Candidate,
    InputFile,
    KnownEffect,
    Metric,
    StageOrNone,
    Structure,
    Where,
)
from gap_diagnosis.structure import structure_of
from hil_harness.assembly import Wire, load_wire
from hil_harness.effects import catalogue
from hil_harness.effects.model import Effect
from hil_harness.effects.user_effects import load_effect_library
from hil_harness.errors import HarnessError
from hil_harness.robot import Robot, load_robot
from sim_plant import PlantError

_NOT_SIMULATED: Final = (CanBusError, DiagnosisError, FirmwareError, HarnessError, PlantError)
"""What a drive of a robot or on a bus of which not all fits together is refused with."""


def diagnose(
    logs: Sequence[Path],
    *,
    robot: Path | None = None,
    dbc: Path | None = None,
    signals: Path | None = None,
    references: Sequence[Path] = (),
    holdout: Path | None = None,
    holdout_reference: Path | None = None,
    effects: Path | None = None,
    effect_library: Path | None = None,
    progress: Progress = lambda step, share: None,
    every_drive: bool = False,
) -> Report:
    """Diagnose recorded logs; *progress* is told the step and the share that is done.

    *effects* states what is known of the robot beside its description: what an earlier diagnosis
    found. *every_drive*: advice beyond the verdict's group too, as in `advice_for`.
    Raises DiagnosisError, CanBusError or HarnessError in one line for what cannot be read.
    """
    started = time.monotonic()
    if not logs:
        raise DiagnosisError("no log: expected one or more to diagnose")
    if holdout is not None and holdout.resolve() in {one.resolve() for one in logs}:
        raise DiagnosisError(
            f"--holdout {holdout}: the fit sees this log too: expected one that it never saw"
        )
    described = load_robot(robot)
    known = {} if effect_library is None else load_effect_library(effect_library)
    granted = NOTHING if effects is None else load_granted(effects, known)
    progress("reading", 0.0)
    recordings = read_recordings(
        logs, robot=described, references=references, dbc=dbc, signals=signals
    )
    if robot is None:
        is_mapped = dbc is not None or signals is not None
        recordings = [
            one if one.frames and not is_mapped else _undescribed(one, described)
            for one in recordings
        ]
    held = None
    if holdout is not None:
        given = () if holdout_reference is None else (holdout_reference,)
        (held,) = read_recordings(
            [holdout], robot=described, references=given, dbc=dbc, signals=signals
        )
    wire = _wire(described, dbc, signals, logs, recordings)
    inputs = input_files(
        logs, robot, dbc, signals, references, holdout, holdout_reference, effects, effect_library
    )
    return diagnose_recordings(
        recordings,
        described,
        wire,
        held=held,
        granted=granted,
        library=known,
        inputs=inputs,
        started=started,
        progress=progress,
        every_drive=every_drive,
    )


def _undescribed(recording: Recording, robot: Robot) -> Recording:
    """Return a log of somebody's own signals with a note that nobody said whose they are."""
    wheels, encoder = robot.plant.wheels, robot.plant.encoder
    note = (
        f"No --robot describes this robot: it is taken for Chiplog's own, with wheels of "
        f"{wheels.radius_m:g} m radius, {wheels.wheelbase_m:g} m apart, and "
        f"{encoder.ticks_per_rev:,} counts a turn."
    )
    return replace(recording, notes=(note, *recording.notes))


def diagnose_recordings(
    recordings: Sequence[Recording],
    robot: Robot,
    wire: Wire,
    *,
    held: Recording | None = None,
    granted: Granted = NOTHING,
    library: Mapping[str, Effect] = MappingProxyType({}),
    inputs: Sequence[InputFile] = (),
    prior: Prior | None = None,
    started: float | None = None,
    progress: Progress = lambda step, share: None,
    without: frozenset[str] = frozenset(),
    every_drive: bool = False,
) -> Report:
    """Diagnose recordings that are read already; *without* withholds effects from the library,
    *granted* are known beside the description, *library* adds a user's own, *every_drive* asks for
    advice beyond the verdict's group."""
    started = time.monotonic() if started is None else started
    granted.bus.require_messages(wire.database)
    robot = granted.robot(robot)
    # A table beside logs of a bus speaks of that bus's messages, or each would be told for itself.
    names = own_names(wire)
    recordings = [
        replace(one, granted=granted, own_names=one.own_names or names) for one in recordings
    ]
    if held is not None:
        held = replace(held, granted=granted, own_names=held.own_names or names)
    prior = with_library(prior or default_prior(), library)
    if held is not None:
        held = prepared(with_restarts(held, robot)[0], robot, without).recording
    parts = max(len(recordings), 1)
    analyses: list[Analysis] = []
    for place, recording in enumerate(recordings):

        def part(step: str, share: float, at: int = place) -> None:
            progress(step, 0.02 + 0.75 * (at + share) / parts)

        analyses.append(
            analyse(recording, robot, wire, prior, progress=part, without=without, library=library)
        )
    if not any(one.blocks for one in analyses):
        raise DiagnosisError(
            f"{recordings[0].name}: nothing to compare the wheels with: expected a gyro, a "
            "reference, commands, odometry frames of a firmware that needs none, or stamped bus "
            "frames"
        )
    stage_of = stages_of(analyses, library)
    blocks = [one.blocks for one in analyses]
    ranking = rank(
        blocks,
        prior,
        stage_of,
        _unknown(analyses),
        [some for one in analyses if one.motion is not None for some in one.motion.several],
        as_ever={
            stage: min(one.as_ever[stage] for one in analyses) for stage in analyses[0].as_ever
        },
    )
    progress("how far the gap shrinks", 0.8)
    effects = {**catalogue(), **library}
    split = disagreements(
        estimates_by_log(ranking.sets[0].effects if len(analyses) > 1 else frozenset(), analyses),
        prior,
        effects,
    )
    which, other = candidates(ranking, analyses, library, {one.parameter for one in split})
    ordered = sort_candidates(which)
    verdict = "+".join(ordered[0].effects)
    stages = stage_probabilities(ranking, stage_of)
    stage = _stage(verdict, ranking, stages, has_frames=_has_frames(analyses))
    found, metrics = _shrink(analyses, ranking, verdict, stage, robot, wire, held)
    progress("what to drive next", 0.95)
    structure = structure_of(analyses)
    advice, without_advice = _advice(
        ordered, robot, wire, analyses, structure if every_drive else None
    )
    diagnosis = Diagnosis(
        verdict=verdict,
        stage=stage,
        stage_probabilities=sort_stages(stages),
        which=ordered,
        other=other,
        where=Where(
            stages=found.stages,
            segments=found.segments,
            residuals=residual_times(found.pictures),
        ),
        unknown=unknown_part(analyses, stage, found.modelled, found.why_not)
        if verdict == UNKNOWN
        else None,
        gap=found.gap,
        waterfall=found.waterfall,
        structure=structure,
        advice=advice,
        assumptions=ASSUMPTIONS,
        notes=(
            *contradiction(
                split,
                [one.recording.name for one in analyses],
                effects,
                is_unknown=verdict == UNKNOWN,
            ),
            *untrusted(ordered[0]),
            *sizes_of_wheels(ordered[0]),
            *counts_again(ordered[0], analyses),
            *not_replayed(analyses, held, robot),
            *notes_on(
                analyses,
                (
                    *(
                        beside_unlisted(blocks, ranking.best.effects, stage)
                        if verdict == UNKNOWN
                        else ()
                    ),
                    *makes_worse(found.gap),
                    *beside_mistake(analyses, ranking.best.effects),
                    *found.notes,
                    *no_news.notes(blocks, prior, ranking.best.effects, ranking.small),
                    *without_advice,
                    *not_looked_for(library),
                ),
                unlisted_in=stage if verdict == UNKNOWN else "",
                beside=() if verdict in (NO_GAP, UNKNOWN) else ranking.beside,
            ),
        ),
        doubts=tuple(
            f"{one.recording.name}: {doubt}" for one in analyses for doubt in one.recording.doubts
        ),
        contradicting=tuple(one.parameter for one in split),
        granted=tuple(
            KnownEffect(
                effect=one.effect,
                values=dict(one.values),
                ci95=dict(one.ci95),
                file=granted.name,
            )
            for one in granted.settings
        ),
        logs=tuple(
            log_facts(one.recording, robot, own, found.unmeasured.get(place))
            for place, (one, own) in enumerate(zip(analyses, metrics, strict=True))
        ),
        inputs=tuple(inputs),
        version=version("chiplog"),
        seconds=time.monotonic() - started,
    )
    progress("done", 1.0)
    return Report(diagnosis, found.pictures)


def _wire(
    robot: Robot,
    dbc: Path | None,
    signals: Path | None,
    logs: Sequence[Path],
    recordings: Sequence[Recording],
) -> Wire:
    """Return the wire; a map of table columns says nothing about frames."""
    for log, recording in zip(logs, recordings, strict=True):
        if recording.frames:
            return wire_of_log(Path(log), robot, dbc, signals)
    return (
        load_wire(dbc, leave_out_faulty=True)
        if dbc is not None and signals is None
        else load_wire()
    )


def _unknown(analyses: Sequence[Analysis]) -> dict[str, float]:
    """Return the log evidence of an unlisted cause by stage, added up over logs."""
    total: dict[str, float] = {}
    for one in analyses:
        for stage, value in one.unknown.items():
            total[stage] = total.get(stage, 0.0) + value
    return total


def _advice(
    which: Sequence[Candidate],
    robot: Robot,
    wire: Wire,
    analyses: Sequence[Analysis],
    structure: Structure | None,
) -> tuple[tuple[Advice, ...], tuple[str, ...]]:
    """Return what to drive next; where no drive can be simulated none, and a note that says why.

    The diagnosis is finished: it is not to be lost for what comes after it.
    """
    try:
        return advice_for(which, robot, wire, analyses, structure), ()
    except _NOT_SIMULATED as error:
        note = (
            "Nothing is said of what to drive next, as no drive can be simulated with this robot "
            f"and bus: {str(error).rstrip('.')}."
        )
        return (), (note,)


def _has_frames(analyses: Sequence[Analysis]) -> bool:
    return any(one.recording.frames for one in analyses)


def _stage(
    verdict: str,
    ranking: Ranking,
    stages: Mapping[StageOrNone, float],
    *,
    has_frames: bool,
) -> StageOrNone:
    """Return the most probable stage that goes with the verdict.

    Beside a mistake of the set-up nothing else is to be looked for. Of a table's clock and late
    columns nothing shows but what they do to the motion: beside a cause of another stage, theirs is
    not where the gap lies.
    """
    if verdict == NO_GAP:
        return "none"
    if verdict == UNKNOWN:
        named = {name: ranking.unknown.get(name, 0.0) for name in stages if name != "none"}
        return max(named, key=lambda name: named[name])
    real = {name: value for name, value in stages.items() if name != "none"}
    first = max(real, key=lambda name: real[name])
    known = catalogue()
    own = {known[one].stage for one in verdict.split("+") if one in known}
    if "setup" in own:
        return "setup"
    if first == "bus" and not has_frames and own - {"bus"}:
        return max((name for name in real if name != "bus"), key=lambda name: real[name])
    return first


def _shrink(
    analyses: Sequence[Analysis],
    ranking: Ranking,
    verdict: str,
    stage: StageOrNone,
    robot: Robot,
    wire: Wire,
    held: Recording | None,
) -> tuple[Shrink, list[dict[str, Metric]]]:
    """Return how far the gap shrinks, on *held* or else on one log, and each log's metrics."""
    effects = frozenset() if verdict in {NO_GAP, UNKNOWN} else frozenset(verdict.split("+"))
    if held is not None:
        found = shrink_on(analyses, effects, stage, robot, wire, held)
        return found, [{} for _ in analyses]
    if len(analyses) == 1:
        return shrink(analyses[0], effects, stage, robot, wire), [{}]
    return shrink_each(analyses, effects, stage, robot, wire)
