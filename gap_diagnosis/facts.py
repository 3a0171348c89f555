"""What a diagnosis was made from, what it takes for granted, and what the data cannot tell."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.block_sums import Effects
from gap_diagnosis.company import OWN_BLOCK
from gap_diagnosis.explanations.standstill import DEAD
from gap_diagnosis.firmware import lacks_the_gyro
from gap_diagnosis.hypothesis import Block
from gap_diagnosis.motion.whitening import STAMP, WHEELS_LATE
from gap_diagnosis.pareto import TRUSTED
from gap_diagnosis.priors import WHEELS
from gap_diagnosis.reading.ros_reference import ros_file
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import (
    Candidate,
    Gap,
    InputFile,
    LogFacts,
    Metric,
    NumberEstimate,
    Role,
)
from hil_harness.effects import Effect, catalogue
from hil_harness.robot import Robot

ASSUMPTIONS: Final = (
    "The wheels' contact is a random walk over distance, level estimated (0.1 to 3 mm/√m), and a "
    "slip that comes and goes within seconds, its share of the way estimated.",
    "The reference is off by white noise and by noise that lasts about a second, levels estimated.",
    "Constants within the tolerances of robot.toml are no news.",
    "At most six effects act, and one of the bus beside them, or one that is not in the library.",
    "Start pose and small offsets of clocks are free in every fit.",
)

_CHUNK: Final = 1 << 20


def input_files(
    logs: Sequence[Path],
    robot: Path | None,
    dbc: Path | None,
    signals: Path | None,
    references: Sequence[Path],
    holdout: Path | None,
    holdout_reference: Path | None,
    effects: Path | None,
    effect_library: Path | None,
) -> list[InputFile]:
    """Return every file that was read, with its SHA-256."""
    named: list[tuple[Role, Path | None]] = [("log", log) for log in logs]
    named += [("reference", one) for one in references]
    named += [
        ("robot", robot),
        ("dbc", dbc),
        ("signals", signals),
        ("holdout", holdout),
        ("holdout_reference", holdout_reference),
        ("effects", effects),
        ("effect_library", effect_library),
    ]
    return [
        InputFile(role=role, name=Path(path).name, sha256=_sha256(Path(path)))
        for role, path in named
        if path is not None
    ]


def _sha256(path: Path) -> str:
    recording = ros_file(path)
    path = path if recording is None else recording[0]
    digest = hashlib.sha256()
    for part in sorted(path.iterdir()) if path.is_dir() else [path]:  # a rosbag2 is a folder
        with part.open("rb") as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
    return digest.hexdigest()


def log_facts(
    recording: Recording,
    robot: Robot,
    metrics: Mapping[str, Metric],
    unmeasured: str | None = None,
) -> LogFacts:
    """Return what a log holds, with its own gap, where it has one, or why it has none."""
    rad = 2 * np.pi / robot.plant.encoder.ticks_per_rev
    steps = [
        np.abs(np.diff(ticks[np.isfinite(ticks)])).sum() * rad * robot.plant.wheels.radius_m
        for ticks in (recording.left_ticks, recording.right_ticks)
    ]
    turned = recording.right_ticks - recording.left_ticks
    turned = np.abs(np.diff(turned[np.isfinite(turned)])).sum() * rad
    skew = recording.clock_skew
    return LogFacts(
        name=recording.name,
        start_s=float(recording.t_s[0]),
        duration_s=recording.duration_s,
        ticks=len(recording.t_s),
        distance_m=float(np.mean(steps)),
        turned_rad=float(turned * robot.plant.wheels.radius_m / robot.plant.wheels.wheelbase_m),
        has_reference=recording.reference is not None,
        has_gyro=recording.gyro_rate_rad_s is not None,
        has_commands=recording.v_command_m_s is not None,
        has_odometry=recording.odometry_x_m is not None,
        clock_skew=float(skew) if np.isfinite(skew) else None,
        lost_ticks=int(recording.tick[-1] - recording.tick[0] + 1 - len(recording.tick))
        + int(np.isnan(recording.left_ticks).sum()),
        metrics=dict(metrics),
        unmeasured=unmeasured,
    )


_BESIDE: Final = {
    "actuation": "the wheels do not follow their commands as described",
    "bus": "frames come otherwise than described",
    "firmware": "the odometry frames are not what the described firmware gives",
}


def beside_mistake(analyses: Sequence[Analysis], effects: Effects) -> list[str]:
    """Say what else a log shows once the mistake of the set-up among *effects* is put right."""
    notes = []
    for analysis in analyses:
        motion = analysis.motion
        others = frozenset() if motion is None else motion.beside_mistake(effects)
        if others:
            notes.append(
                f"{analysis.recording.name}: with the set-up put right the motion looks like "
                f"{', '.join(sorted(others))} besides: mend it, and diagnose again."
            )
    return notes


def beside_unlisted(
    logs: Sequence[Sequence[Block]], effects: Effects, unlisted_in: str
) -> list[str]:
    """Say which of the listed *effects* act whatever the unlisted cause in a stage is: they show in
    blocks that it does not touch.

    A tyre that slid for six seconds hid motors that lag by three times what was described.
    """
    touched = OWN_BLOCK.get(unlisted_in, "motion")
    notes = []
    for effect in sorted(effects):
        told = [one for blocks in logs for one in blocks if effect in one.effects]
        gained = math.fsum(one.fit(frozenset({effect})).log_evidence for one in told)
        if all(one.name != touched for one in told) and gained > _CERTAIN:
            notes.append(
                f"Whatever that cause is, {effect} acts besides: it shows where no cause in stage "
                f"{unlisted_in} does."
            )
    return notes


_CERTAIN: Final = 20.0
"""So much likelier [nat] than that an effect does not act: one to five hundred million."""
_WORSE: Final = 2.0
"""So many times the gap or its floor is no chance of the stretches held out."""


def not_replayed(
    analyses: Sequence[Analysis], held: Recording | None, robot: Robot
) -> tuple[str, ...]:
    """Say which logs' odometry was made with a gyro that nobody recorded; *held* is held out."""
    logs = [one.recording for one in analyses if one.firmware is None]
    return tuple(
        f"{one.name}: the firmware turns by a gyro, and the log has none: its odometry is not "
        "replayed."
        for one in (*logs, *([] if held is None else [held]))
        if one.odometry_x_m is not None and lacks_the_gyro(one, robot)
    )


def sizes_of_wheels(leading: Candidate) -> tuple[str, ...]:
    """Say how large each wheel is, where the first candidate says it by mean and mismatch, both all
    along."""
    sizes = [leading.parameters.get(one) for one in _SIZES]
    mean, apart = (one.estimate if isinstance(one, NumberEstimate) else None for one in sizes)
    ends = {f"{effect}.{end}" for effect in WHEELS for end in ("start_s", "stop_s")}
    if mean is None or apart is None or ends & leading.parameters.keys():
        return ()
    return (
        "radius_scale and radius_mismatch together are two sizes of wheels: left "
        f"{100 * (mean - apart / 2):+.2f} %, right {100 * (mean + apart / 2):+.2f} % beside "
        "what is described.",
    )


_SIZES: Final = ("radius_scale.scale", "radius_mismatch.mismatch")


def counts_again(leading: Candidate, analyses: Sequence[Analysis]) -> tuple[str, ...]:
    """Say until when an encoder is dead that the first candidate names, of each log in which it
    counts again: its only moment is the one from which it does not."""
    if DEAD not in leading.effects:
        return ()
    notes = []
    for one in analyses:
        log, effects = one.recording, frozenset(leading.effects)
        from_s, until_s = (float(end) for end in log.t_s[[0, -1]])
        for variant, _ in () if one.motion is None else one.motion.settings(effects):
            stop_s = float(variant.fixed.get("stop_s", until_s))
            if variant.effect == DEAD and stop_s < until_s - log.tick_period_s:
                notes.append(
                    f"{log.name}: the {variant.report['side']} encoder counts again from "
                    f"{stop_s - from_s:.2f} s on, as of a plug that is loose."
                )
    return tuple(notes)


def untrusted(leading: Candidate) -> tuple[str, ...]:
    """Say that the weights behind the first candidate do not converge, where they do not."""
    shape = leading.pareto_k
    if shape is None or shape < TRUSTED:
        return ()
    return (
        f"{' + '.join(leading.effects)}: the effects bend within what is believed of their sizes, "
        "and weights as they act do not converge, so that its probability or its intervals are "
        f"those along straight lines (Pareto k {shape:.2f}, trusted below {TRUSTED}).",
    )


def notes_on(
    analyses: Sequence[Analysis],
    more: Sequence[str],
    *,
    unlisted_in: str = "",
    beside: Sequence[str] = (),
) -> tuple[str, ...]:
    """Return what these logs cannot tell; of a cause that is *unlisted_in* a stage, what was seen;
    in which stages something is left *beside* the verdict."""
    notes = [
        f"Beside the verdict, in stage {stage}: {_BESIDE[stage]}, and no listed effect explains it."
        for stage in beside
    ]
    recordings = [one.recording for one in analyses]
    for one in recordings:
        lost = {reason: count for reason, count in one.rejected.items() if count}
        if lost:
            parts = ", ".join(f"{count} by {reason}" for reason, count in sorted(lost.items()))
            notes.append(f"{one.name}: frames rejected: {parts}.")
        notes += [f"{one.name}: {note}" for note in one.notes]
    for analysis in analyses:
        if analysis.outliers:
            notes.append(
                f"{analysis.recording.name}: {analysis.outliers} samples of the reference lie far "
                "off their neighbours and were left out."
            )
        notes += _on_restarts(analysis)
        notes += _on_the_drive(analysis)
        notes += _on_the_reference(analysis)
        notes += _on_stamps(analysis)
        notes += _on_a_while(analysis, unlisted_in)
        if analysis.has_burst or unlisted_in == "wheel":
            notes += _on_burst(analysis)
        if unlisted_in == "wheel":
            notes += _on_pushes(analysis)
        if unlisted_in == "encoder":
            notes += _on_standstills(analysis)
    return (*notes, *more, *_missing(recordings))


def not_looked_for(library: Mapping[str, Effect]) -> list[str]:
    """Say which effects of *library* that are a user's own are simulated only."""
    names = [
        name
        for name, effect in library.items()
        if name not in catalogue() and effect.explain is None
    ]
    if not names:
        return []
    were = "which was" if len(names) == 1 else "which were"
    return [f"The effect library does not explain {', '.join(names)}, {were} not looked for."]


def _missing(recordings: Sequence[Recording]) -> list[str]:
    """Say what is not in the logs. Last: whoever recorded them knows, and a terminal shows few."""
    notes = []
    if all(one.reference is None for one in recordings):
        notes.append(
            "No reference: what bends wheels and gyro alike, and whether wheelbase or gyro scale "
            "is wrong, cannot be known."
        )
    elif any(one.reference is not None and one.reference.heading_rad is None for one in recordings):
        notes.append("The reference has no orientation: headings are compared by its course only.")
    if all(one.gyro_rate_rad_s is None for one in recordings):
        notes.append("No gyro in the log: nothing is said of it.")
    if all(one.v_command_m_s is None for one in recordings):
        notes.append("No commands in the log: nothing is said of the drive.")
    if all(one.odometry_x_m is None for one in recordings):
        notes.append("No odometry frames: a replay has nothing to be compared with.")
    return notes


def _on_restarts(analysis: Analysis) -> list[str]:
    """Say where counts leapt, in seconds from the log's start."""
    found, from_s = analysis.restarts, float(analysis.recording.t_s[0])
    return [
        f"{analysis.recording.name}: the counts leap by {left:.0f} and {right:.0f} at "
        f"{t_s - from_s:.2f} s, farther than wheels turn in that time, as of a controller that "
        "restarts; they were put back."
        for t_s, left, right in zip(found.t_s, found.left, found.right, strict=True)
    ]


def _on_the_drive(analysis: Analysis) -> list[str]:
    """Say how a drive answers that nobody described, and which limits of a description the wheels
    outrun."""
    drive = analysis.drive
    notes = []
    if drive is not None and drive.answers is not None:
        answers = drive.answers.plant.drive
        notes.append(
            f"{analysis.recording.name}: the robot's description has no time_constant_s and no "
            "delay_s in [drive], and its drive answers as no listed one: by this log with a lag of "
            f"{1000 * answers.time_constant_s:.0f} ms and a delay of {1000 * answers.delay_s:.0f} "
            "ms, and otherwise in its own way, which is taken for no gap."
        )
    return notes + [
        f"{analysis.recording.name}: its wheels outrun drive.{key} of the robot's description, "
        "which is taken for no limit of theirs."
        for key in sorted(drive.data.limits if drive is not None else ())
    ]


def _on_the_reference(analysis: Analysis) -> list[str]:
    """Say what of the reference had to be mended before it could be used, and when: in seconds
    from the log's start, as nobody counts on a wall clock."""
    name, lost = analysis.recording.name, analysis.lost
    from_s = float(analysis.recording.t_s[0])
    notes = []
    mistake = analysis.mistake
    turned = 0 if mistake is None else mistake.quarter_turns
    if mistake is not None and mistake.signal == "reference_position":
        if turned % 2:
            notes.append(f"{name}: beside its heading the reference's x and y are exchanged.")
    elif turned:
        # Ahead by three quarters is behind by one.
        degrees = 90 * (turned - 4 * (turned > 2))
        compass = ", as of a compass beside east and north" if degrees == -90 else ""
        notes.append(
            f"{name}: the reference's heading runs clockwise and, mirrored, stays {degrees:+d} "
            f"degrees off the frame of its positions{compass}; it was turned into that."
        )
    if analysis.late_s:
        early = "late" if analysis.late_s > 0 else "early"
        notes.append(
            f"{name}: the reference's stamps are {abs(analysis.late_s):.3f} s {early}, as of a "
            "clock that was never set; they were moved by that, and what it is late by besides "
            "cannot be known."
        )
    if lost.frozen:
        notes.append(
            f"{name}: {lost.frozen} samples of the reference repeat an older pose while the wheels "
            "drive on, and were left out."
        )
    for start_s, stop_s in lost.holes:
        notes.append(
            f"{name}: the reference has no samples from {start_s - from_s:.2f} s to "
            f"{stop_s - from_s:.2f} s, while the wheels drive on."
        )
    for leap in lost.leaps:
        notes.append(
            f"{name}: the reference leaps by {1e3 * math.hypot(leap.x_m, leap.y_m):.0f} mm and "
            f"{math.degrees(leap.heading_rad):.1f} degrees at {leap.t_s - from_s:.2f} s; what "
            "follows was put back."
        )
    return notes


_OFF: Final = 5.0
"""Stamps off by so many times what is usual are worth a word: the log itself must say so."""


def _on_stamps(analysis: Analysis) -> list[str]:
    """Say by how much stamps of the reference and of a table are off, which is no gap."""
    motion = analysis.motion
    if motion is None:
        return []
    usual_s, name = motion.model.level_prior.median, analysis.recording.name
    off_s, late_s = motion.levels[STAMP], motion.levels[WHEELS_LATE]
    notes = []
    if analysis.recording.reference is not None and off_s >= _OFF * usual_s[STAMP]:
        notes.append(
            f"{name}: each stamp of the reference is off by about {1e3 * off_s:.1f} ms, early or "
            "late: noise, and no gap."
        )
    if analysis.recording.stamped_by_host and late_s >= _OFF * usual_s[WHEELS_LATE]:
        notes.append(
            f"{name}: what the wheels say in a row was read about {1e3 * late_s:.1f} ms before or "
            "after its time: noise, and no gap."
        )
    return notes


_ALIKE: Final = 3.0
"""Accounts that lack less [nat] are told beside the best one."""


def _is_credible(analysis: Analysis, windows: Sequence[tuple[float, float]]) -> bool:
    """Tell whether what acts in these windows accounts for the log about as well as anything that
    is not listed."""
    best = analysis.alternatives[0].log_evidence
    own = [one.log_evidence for one in analysis.alternatives if one.windows == windows]
    return bool(own) and max(own) > max(best - _ALIKE, 0.0)


def _on_a_while(analysis: Analysis, stage: str) -> list[str]:
    """Say what an unlisted cause that begins and ends does meanwhile."""
    best = next((one for one in analysis.alternatives if one.stage == stage), None)
    if best is None or not best.acts or not _is_credible(analysis, best.windows):
        return []
    ((start_s, stop_s),) = best.windows
    from_s, until_s = (float(one) for one in analysis.recording.t_s[[0, -1]])
    part_s = 0.01 * (until_s - from_s)
    apart = [
        word
        for word, is_so in (
            ("before", start_s > from_s + part_s),
            ("after", stop_s < until_s - part_s),
        )
        if is_so
    ]
    return [
        f"{analysis.recording.name}: from about {start_s - from_s:.0f} s to {stop_s - from_s:.0f} "
        f"s, and not {' or '.join(apart)}, {best.acts}."
    ]


def _on_burst(analysis: Analysis) -> list[str]:
    """Say which wheel loses its hold, how often, and what else there is."""
    burst = analysis.burst
    if burst is None or not _is_credible(analysis, burst.windows):
        return []
    wheel = "Both wheels lose" if burst.side == "both" else f"The {burst.side} wheel loses"
    times = "in one window" if len(burst.windows) == 1 else f"in {len(burst.windows)} windows"
    also = ", and no listed effect explains it" if analysis.has_burst else ""
    return [f"{analysis.recording.name}: {wheel} hold {times}{also}."]


def _on_standstills(analysis: Analysis) -> list[str]:
    """Say whose counts stand, and when."""
    stood = analysis.standstills
    if stood is None or not _is_credible(analysis, stood.windows):
        return []
    from_s = float(analysis.recording.t_s[0])
    told = [
        f"on the {side} from {start_s - from_s:.2f} s to {stop_s - from_s:.2f} s"
        for side, (start_s, stop_s) in zip(stood.sides, stood.windows, strict=True)
    ]
    return [f"{analysis.recording.name}: counts stand while the wheel turns, {', '.join(told)}."]


def _on_pushes(analysis: Analysis) -> list[str]:
    """Say when the body stepped, and how far."""
    pushes = analysis.pushes
    if pushes is None or not _is_credible(analysis, pushes.windows):
        return []
    from_s = float(analysis.recording.t_s[0])
    told = [
        f"at {at_s - from_s:.2f} s by {1e3 * math.hypot(forward_m, left_m):.1f} mm and "
        f"{math.degrees(turned_rad):.2f} degrees"
        for at_s, (turned_rad, forward_m, left_m) in zip(pushes.at_s, pushes.steps, strict=True)
    ]
    name = analysis.recording.name
    return [f"{name}: the body steps {', '.join(told)}, and no wheel turns with it."]


def makes_worse(gap: Gap | None) -> tuple[str, ...]:
    """Return a warning where with what is named the simulation lies farther off than without."""
    if gap is None or gap.after is None or gap.floor is None:
        return ()
    if gap.after < _WORSE * max(gap.before, gap.floor):
        return ()
    return (
        "With what is named the simulation lies farther from the log than without it, on stretches "
        "that the fit never saw: as it stands that is no explanation, however probable.",
    )
