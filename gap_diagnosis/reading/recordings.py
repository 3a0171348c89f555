"""Several logs or tables, each with its reference, as recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.cycle_times import wire_of_log
from gap_diagnosis.reading.log import read_log_recording
from gap_diagnosis.reading.reference_file import read_reference, refuse_no_overlap
from gap_diagnosis.reading.table import read_table_recording
from gap_diagnosis.reading.table_file import is_table
from gap_diagnosis.recording import Recording
from hil_harness.assembly import Wire
from hil_harness.robot import Robot

SHORTEST_S: Final = 2.0
_MOVED_TICKS: Final = 20


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
        raise DiagnosisError(
            f"{len(references)} references for {len(logs)} logs: expected one --reference for each "
            "log, in order, or none"
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
        recording, own = read_log_recording(path, robot, wire or wire_of_log(path, dbc, signals))
    _refuse_useless(recording, path)
    if reference is not None:
        measured = read_reference(reference)
        refuse_no_overlap(measured, recording, str(reference))
    elif own is not None:
        measured = own
    else:
        return recording
    return replace(recording, reference=measured)


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
