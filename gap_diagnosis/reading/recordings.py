"""Several logs or tables, each with its reference, as recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import log_columns, reference_file, table_file
from gap_diagnosis.reading.courses import without_courses
from gap_diagnosis.reading.cut_off import last_line_note
from gap_diagnosis.reading.cycle_times import wire_of_log
from gap_diagnosis.reading.held_poses import without_held_poses
from gap_diagnosis.reading.interpolated import without_interpolated_poses
from gap_diagnosis.reading.log import read_log_recording
from gap_diagnosis.reading.reference_file import (
    read_reference,
    refuse_no_overlap,
    refuse_other_unit,
)
from gap_diagnosis.reading.ros_reference import ros_file
from gap_diagnosis.reading.table import read_table_recording
from gap_diagnosis.reading.table_file import is_table
from gap_diagnosis.reading.unlocked import without_unlocked_ends
from gap_diagnosis.recording import Floats, Recording, Reference
from hil_harness.assembly import Wire
from hil_harness.robot import Robot

SHORTEST_S: Final = 2.0
_MOVED_TICKS: Final = 20
_FASTEST: Final = 1e5
"""A yaw rate [rad/s] or a speed [m/s]: a hundred of either, in thousandths."""
_FARTHEST_M: Final = 1e9
"""The globe's far side in centimetres taken for metres."""
_TIMES_TOO_FAST: Final = 1e4
"""No unit makes a described wheel so much faster."""


def read_recordings(
    logs: Sequence[str | Path],
    *,
    robot: Robot,
    wire: Wire | None = None,
    references: Sequence[str | Path] = (),
    dbc: Path | None = None,
    signals: Path | None = None,
) -> list[Recording]:
    """Read logs and tables, each with its reference.

    Args:
        logs: candump ``.log``, ``.asc``, ``.blf``, ``.mf4``, or tables ``.csv``, ``.parquet``.
        robot: the description.
        wire: DBC and map of the logs, if they are loaded already.
        references: ``.tum`` files, one per log in order, or none at all. A log without one uses its
            own REFERENCE_POSE frames, if it has any.
        dbc, signals: where *wire* is None: the DBC (None: the shipped one) and the ``map.toml`` of
            logs or tables (None: the shipped names).

    Raises DiagnosisError, CanBusError or HarnessError, each in one line for a person.
    """
    if references and len(references) != len(logs):
        count = len(references), len(logs)
        given, wanted = (
            f"{n} {what}{'' if n == 1 else 's'}"
            for n, what in zip(count, ("reference", "log"), strict=True)
        )
        raise DiagnosisError(
            f"{given} for {wanted}: expected one --reference for each log, in order, or none"
        )
    recordings = []
    for place, log in enumerate(logs):
        reference = references[place] if references else None
        recordings.append(
            read_recording(
                log, robot=robot, wire=wire, reference=reference, dbc=dbc, signals=signals
            )
        )
    return recordings


def read_recording(
    log: str | Path,
    *,
    robot: Robot,
    wire: Wire | None = None,
    reference: str | Path | None = None,
    dbc: Path | None = None,
    signals: Path | None = None,
) -> Recording:
    """Read one log or table, as `read_recordings` does."""
    path = Path(log)
    if is_table(path):
        recording, own = read_table_recording(path, robot, signals)
    else:
        recording, own = read_log_recording(
            path, robot, wire or wire_of_log(path, robot, dbc, signals)
        )
    _refuse_useless(recording, path)
    if reference is not None:
        measured = read_reference(reference)
        refuse_other_unit(measured, recording, str(reference))
        refuse_no_overlap(measured, recording, str(reference), robot)
        file, _ = ros_file(Path(reference)) or (Path(reference), None)
        notes = (*recording.notes, *_without_fix(measured, file))
        recording = replace(recording, reference=measured, notes=notes)
    elif own is not None:
        recording = replace(
            recording, reference=own, notes=(*recording.notes, *_without_fix(own, path))
        )
    if recording.reference is not None:
        measured, unlocked = without_unlocked_ends(recording.reference)
        measured, held = without_held_poses(measured)
        measured, between = without_interpolated_poses(measured)
        measured, courses = without_courses(measured)
        notes = (*recording.notes, *unlocked, *held, *between, *courses)
        recording = replace(recording, reference=measured, notes=notes)
    _refuse_unbelievable(recording, path, robot)
    return replace(recording, notes=(*recording.notes, *_cut_off(path, reference)))


def _without_fix(reference: Reference, path: Path) -> tuple[str, ...]:
    """Say how often a receiver had no fix."""
    if not reference.without_fix:
        return ()
    of = reference.without_fix + len(reference.t_s)
    return (f"{path.name}: {reference.without_fix} of {of} messages have no fix and are left out.",)


def _cut_off(path: Path, reference: str | Path | None) -> tuple[str, ...]:
    """Say of which files the last line was left out."""
    is_cut = table_file.is_cut_off(path) if is_table(path) else log_columns.is_cut_off(path)
    notes = [last_line_note()] if is_cut else []
    if reference is not None and reference_file.is_cut_off(Path(reference)):
        notes.append(last_line_note(Path(reference).name))
    return tuple(notes)


def _refuse_useless(recording: Recording, path: Path) -> None:
    if recording.duration_s < SHORTEST_S:
        raise DiagnosisError(
            f"{path}: {recording.duration_s:.2f} s long: expected at least {SHORTEST_S:g} s, "
            "better a minute or more"
        )
    moved = []
    for side, ticks in (("left", recording.left_ticks), ("right", recording.right_ticks)):
        if not np.isfinite(ticks).any():
            raise DiagnosisError(f"{path}: no valid {side} wheel count: expected a log with both")
        moved.append(float(np.nanmax(ticks) - np.nanmin(ticks)))
    if max(moved) < _MOVED_TICKS:
        raise DiagnosisError(
            f"{path}: the robot never moves ({max(moved):.0f} encoder ticks in "
            f"{recording.duration_s:.0f} s): expected a log of a drive"
        )


def _refuse_unbelievable(recording: Recording, path: Path, robot: Robot) -> None:
    """Raise DiagnosisError for sizes that no unit's mistake explains: sums would overflow."""
    sizes: list[tuple[str, Floats | None, float, str]] = [
        ("yaw rate", recording.gyro_rate_rad_s, _FASTEST, "rad/s"),
        ("commanded speed", recording.v_command_m_s, _FASTEST, "m/s"),
        ("commanded turn rate", recording.w_command_rad_s, _FASTEST, "rad/s"),
        ("odometry x", recording.odometry_x_m, _FARTHEST_M, "m"),
        ("odometry y", recording.odometry_y_m, _FARTHEST_M, "m"),
    ]
    if recording.reference is not None:
        reference = recording.reference
        sizes.append(("reference x", reference.x_m, _FARTHEST_M, "m"))
        sizes.append(("reference y", reference.y_m, _FARTHEST_M, "m"))
    per_rad = robot.plant.encoder.ticks_per_rev / math.tau
    for side, ticks in (("left", recording.left_ticks), ("right", recording.right_ticks)):
        way_rad = (ticks - np.nanmin(ticks)) / per_rad
        most_rad = _TIMES_TOO_FAST * robot.plant.drive.max_wheel_rate_rad_s * recording.duration_s
        sizes.append((f"way of the {side} wheel", way_rad, most_rad, "rad"))
    for name, values, most, unit in sizes:
        if values is None or not np.isfinite(values).any():
            continue
        largest = float(np.nanmax(np.abs(values)))
        if largest > most:
            raise DiagnosisError(
                f"{path}: {name} reaches {largest:.3g} {unit}: expected at most {most:.3g} "
                f"{unit}; look at its unit"
            )
