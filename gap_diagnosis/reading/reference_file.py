"""Reference trajectories: ``.tum`` files, one row ``t x y z qx qy qz qw`` each, and others.

The format is that of the TUM RGB-D benchmark: stamps in seconds, metres, unit quaternions; lines
that begin with ``#`` are comments.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Final, TextIO

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.clock_setting import with_clock_set
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.reading.cut_off import unfinished_line
from gap_diagnosis.reading.quaternions import (
    NORM_TOLERANCE,
    heading_of,
    is_no_unit,
    says_no_heading,
)
from gap_diagnosis.reading.reference_table import read_reference_table
from gap_diagnosis.reading.ros_reference import RosPoses, read_ros_poses, ros_file
from gap_diagnosis.reading.table_file import is_cut_off as is_table_cut_off
from gap_diagnosis.reading.table_file import is_table
from gap_diagnosis.recording import Recording, Reference
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

MAX_ROWS: Final = 20_000_000
_MAX_LINE: Final = 1000
_CHUNK: Final = 50_000
_FORM: Final = "t x y z qx qy qz qw, eight numbers"
_LEAST_OVERLAP_S: Final = 2.0


def read_reference(path: str | Path) -> Reference:
    """Read a ``.tum`` file, or the poses of a ROS recording: ``FILE.mcap`` or ``FILE.mcap:/topic``.

    A rosbag2 folder, its ``.db3`` or a ``.bag`` will do as well, and a table whose columns have the
    names of poses: see `read_reference_table`.

    The heading is left out where every row has the same quaternion although the path bends: such a
    file has positions only, as the fixes of a GPS receiver (sensor_msgs/NavSatFix) have.

    A last line that was cut off while it was written is left out.

    Raises DiagnosisError naming file and line: what is no number, NaN, a quaternion that is none,
    stamps that do not ascend, fewer than two rows.
    """
    path = Path(path)
    if is_table(path):
        return read_reference_table(path)
    recording = ros_file(path)
    if recording is None:
        read, lines = _read(path)
        poses = RosPoses(read, has_headings=True, without_fix=0)
    else:
        poses = read_ros_poses(*recording, MAX_ROWS)
        lines = np.arange(1, len(poses.rows) + 1)
    rows = poses.rows
    _refuse_without_fixes(path, poses)
    if len(rows) < 2:
        raise DiagnosisError(f"{path}: {len(rows)} rows: expected at least two, each {_FORM}")
    broken = np.asarray(~np.isfinite(rows).all(axis=1), dtype=np.bool_)
    _refuse(path, lines, broken, "not a number (NaN or infinity)", _FORM)
    t_s = rows[:, 0]
    _refuse(
        path,
        lines,
        np.concatenate(([False], np.diff(t_s) <= 0)),
        "the stamp does not come after the one before",
        "ascending stamps (sort -n orders a file)",
    )
    _refuse(path, lines, is_no_unit(rows[:, 4:]), "the quaternion is not of length 1", _FORM)
    heading = unwrapped(heading_of(rows[:, 4:]))
    x_m, y_m = rows[:, 1].copy(), rows[:, 2].copy()
    has_headings = poses.has_headings and not says_no_heading(heading, x_m, y_m)
    heading_rad = heading if has_headings else None
    return Reference(t_s.copy(), x_m, y_m, heading_rad, without_fix=poses.without_fix)


def _refuse_without_fixes(path: Path, poses: RosPoses) -> None:
    if poses.without_fix and len(poses.rows) < 2:
        raise DiagnosisError(
            f"{path}: {poses.without_fix} messages have no fix, {len(poses.rows)} have one: "
            "expected at least two with one"
        )


_OTHER_UNITS: Final = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_ABOUT: Final = 0.7


def refuse_other_unit(reference: Reference, recording: Recording, name: str) -> None:
    """Raise DiagnosisError for a reference that lasts as long as it would in another unit."""
    longer = float(np.ptp(reference.t_s)) / max(float(np.ptp(recording.t_s)), _LEAST_OVERLAP_S)
    for unit, per_s in _OTHER_UNITS.items():
        if _ABOUT * per_s < longer < per_s / _ABOUT:
            raise DiagnosisError(
                f"{name} lasts from {_span(reference.t_s)}, {recording.name} from "
                f"{_span(recording.t_s)}: expected stamps in seconds, not in {unit}"
            )


def refuse_no_overlap(reference: Reference, recording: Recording, name: str, robot: Robot) -> None:
    """Raise DiagnosisError for a reference that does not overlap the recording in time, unless the
    drive itself tells by how much its clock is off."""
    start = max(reference.t_s[0], recording.t_s[0])
    stop = min(reference.t_s[-1], recording.t_s[-1])
    if stop - start >= _LEAST_OVERLAP_S:
        return
    _, late_s = with_clock_set(replace(recording, reference=reference), robot)
    if late_s == 0.0:
        raise DiagnosisError(
            f"{name} lasts from {_span(reference.t_s)}, {recording.name} from "
            f"{_span(recording.t_s)}: expected "
            f"stamps of one clock that overlap by {_LEAST_OVERLAP_S:g} s or more, or a drive that "
            "tells how far the clocks are apart"
        )


def _span(t_s: Floats) -> str:
    first_s, last_s = (round(float(t), 3) + 0.0 for t in (t_s[0], t_s[-1]))  # a zero has no sign
    return f"{first_s:.3f} to {last_s:.3f} s"


def _read(path: Path) -> tuple[Floats, NDArray[np.int64]]:
    chunks: list[Floats] = []
    numbers: list[NDArray[np.int64]] = []
    total = line_number = 0
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            while lines := list(islice(_bounded(file), _CHUNK)):
                kept = [
                    (number, text)
                    for number, line in enumerate(lines, line_number + 1)
                    if (text := line.strip()) and not text.startswith("#")
                ]
                line_number += len(lines)
                if kept and is_cut_pose(lines[-1]):
                    kept.pop()
                total += len(kept)
                if total > MAX_ROWS:
                    raise DiagnosisError(f"{path}: more than {MAX_ROWS} rows: expected fewer")
                chunks.append(_parse(path, kept))
                numbers.append(np.array([number for number, _ in kept], dtype=np.int64))
    except OSError as error:
        raise DiagnosisError(f"{path}: cannot read this reference: {error.strerror}") from None
    if not chunks:
        return np.empty((0, 8)), np.empty(0, dtype=np.int64)
    return np.concatenate(chunks), np.concatenate(numbers)


def is_cut_off(path: Path) -> bool:
    """Tell a file whose last line was cut off and is left out by `read_reference`."""
    if is_table(path):
        return is_table_cut_off(path)
    last = unfinished_line(path) if ros_file(path) is None and path.is_file() else None
    return last is not None and is_cut_pose(last)


def is_cut_pose(line: str) -> bool:
    """Tell a line, with its end, that breaks off within a pose."""
    if line.endswith("\n") or not line.strip() or line.lstrip().startswith("#"):
        return False
    words = line.replace(",", " ").split()
    if len(words) != 8 or not all(map(_is_number, words)):
        return True
    return abs(math.hypot(*map(float, words[4:])) - 1) > NORM_TOLERANCE


def _bounded(file: TextIO) -> Iterator[str]:
    while line := file.readline(_MAX_LINE):
        yield line


def _parse(path: Path, kept: list[tuple[int, str]]) -> Floats:
    if not kept:
        return np.empty((0, 8))
    words = [text.replace(",", " ").split() for _, text in kept]
    try:
        table = np.array(words, dtype=np.float64)
        if table.shape[1:] == (8,):
            return table
    except ValueError:
        pass
    for (number, text), row in zip(kept, words, strict=True):
        if len(row) != 8 or not all(map(_is_number, row)):
            raise DiagnosisError(f"{path}:{number}: {text[:60]!r}: expected {_FORM}")
    return np.array([[float(word) for word in row] for row in words])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _refuse(
    path: Path, lines: NDArray[np.int64], bad: NDArray[np.bool_], what: str, expected: str
) -> None:
    if bad.any():
        raise DiagnosisError(f"{path}:{lines[int(np.argmax(bad))]}: {what}: expected {expected}")
