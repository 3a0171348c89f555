"""A table as a reference: a receiver's fixes, or positions in a unit of length."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.reading.clock_names import reference_time_unit
from gap_diagnosis.reading.evidence import Guess
from gap_diagnosis.reading.fixes import reference_of
from gap_diagnosis.reading.propose import propose_reference
from gap_diagnosis.reading.quaternions import (
    heading_of,
    is_no_unit,
    quaternion_columns,
    says_no_heading,
)
from gap_diagnosis.reading.signals_found import clock_of_table, signals_of_table
from gap_diagnosis.reading.table_file import read_columns
from gap_diagnosis.recording import Reference
from hil_harness.signal_roles import Unit, unit_of

Floats = NDArray[np.float64]


def read_reference_table(path: Path) -> Reference:
    """Read the reference that a table's columns are by their names.

    A clock; a latitude and a longitude, or positions x and y; a heading where there is one, or a
    quaternion. Rows without a number in one of them are left out.

    Raises DiagnosisError for a table that cannot be read, has no clock or no positions, two columns
    that could be the same, a position without a unit, stamps that do not ascend, and fewer than two
    whole rows.
    """
    found = signals_of_table(path)
    clock = clock_of_table(path, {name: signal.value for name, signal in found.items()})
    try:
        guesses = propose_reference(found)
    except DiagnosisError as error:
        raise DiagnosisError(f"{path}: {error}") from None
    if "reference_x" not in guesses or "reference_y" not in guesses:
        raise DiagnosisError(
            f"{path}: no positions among the columns {', '.join(found)}: expected latitude and "
            "longitude, or x and y with their unit, as in x_m and y_m"
        )
    units = {role: _unit(path, guess) for role, guess in guesses.items()}
    turned = () if "reference_heading" in guesses else quaternion_columns(found)
    poses = [guess.signal.path for guess in guesses.values()]
    columns = read_columns(path, [clock, *poses, *turned])
    t_s = columns[clock] * reference_time_unit(columns[clock], clock)
    back = np.flatnonzero(np.diff(t_s) <= 0)
    if len(back) > 0:
        raise DiagnosisError(
            f"{path}: {clock} says the same in row {back[0] + 1} and in the next: expected "
            "ascending stamps"
        )
    value = {
        role: columns[guess.signal.path] * units[role].factor for role, guess in guesses.items()
    }
    heading = value.get("reference_heading")
    if turned:
        heading = _heading(path, np.stack([columns[name] for name in turned], axis=1))
    reference = reference_of(
        t_s,
        (value["reference_x"], units["reference_x"].quantity),
        (value["reference_y"], units["reference_y"].quantity),
        None if heading is None else unwrapped(heading),
        str(path),
    )
    if reference is None:
        raise DiagnosisError(f"{path}: fewer than two whole rows: expected a pose in each")
    told = reference.heading_rad
    if turned and told is not None and says_no_heading(told, reference.x_m, reference.y_m):
        return replace(reference, heading_rad=None)
    return reference


def _heading(path: Path, quaternions: Floats) -> Floats:
    """Return headings, NaN where a tracker has not found its robot yet: its quaternion is 0."""
    quaternions = np.where(np.any(quaternions, axis=1, keepdims=True), quaternions, np.nan)
    wrong = np.flatnonzero(is_no_unit(quaternions))
    if len(wrong) > 0:
        raise DiagnosisError(
            f"{path}: row {wrong[0] + 1}: the quaternion is not of length 1: expected its parts in "
            "columns that end in x, y, z and w"
        )
    return heading_of(quaternions)


def _unit(path: Path, guess: Guess) -> Unit:
    unit = unit_of(guess.unit or "")
    if unit is None:
        name = guess.signal.path
        like = f"{name}_deg" if guess.role == "reference_heading" else f"{name}_m"
        raise DiagnosisError(
            f"{path}: {name} says no unit: expected it in the column's name, as in {like}"
        )
    return unit
