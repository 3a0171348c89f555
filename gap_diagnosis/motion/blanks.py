"""Stretches of a log in which no counts are known: a recorder that stops, a plug that comes loose.

The next counts say how far each wheel has gone meanwhile, and so how far the robot turned, but not
in which order, nor therefore where that led it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.motion.missing import longest_gap_s, silences
from gap_diagnosis.recording import Floats, Recording

_AROUND_S: Final = 1.0
"""So far on either side speeds are taken from."""
_BESIDE_S: Final = 0.15
"""A reference that is late by less may speak of a blank's inside."""
_FASTEST: Final = 95.0
"""Percentile of the turn rates of a log."""
_OF_A_TURN: Final = 6.0
"""A rate w that comes and goes within a time T has a way v T lead aside by about v T · w T / 6."""


def blanks(recording: Recording) -> NDArray[np.bool_]:
    """Mark, bool[n], the ticks whose counts are not known for so long that nothing tells what lies
    between, and the ones that end such a stretch."""
    t_s = recording.t_s
    blank = silences(recording.left_ticks, t_s) | silences(recording.right_ticks, t_s)
    blank[1:] |= blank[:-1]
    steps_s = np.diff(t_s, prepend=t_s[0])
    blank |= steps_s > longest_gap_s(steps_s[1:])
    return blank


def lost_ways_m2(
    blank: NDArray[np.bool_], t_s: Floats, forward_m: Floats, heading_rad: Floats
) -> Floats:
    """Return, float64[n], the variance along either axis of where the ticks of a blank lead: all of
    it in the last one.

    *forward_m* are steps, *heading_rad* what the wheels turned until then, both float64[n].
    """
    found = np.zeros(len(t_s))
    if not blank.any():
        return found
    step_s = np.maximum(np.diff(t_s, prepend=t_s[0]), 1e-9)
    speed = np.abs(forward_m) / step_s
    rate = np.abs(np.diff(heading_rad, prepend=heading_rad[0])) / step_s
    known = ~blank
    if not known.any():
        return found
    fastest_rad_s = float(np.percentile(rate[known], _FASTEST))
    for first, last in stretches(blank):
        lasts_s = float(t_s[last] - t_s[max(first - 1, 0)])
        way_m = float(np.abs(forward_m[first : last + 1]).sum())
        turned_rad = abs(float(heading_rad[last] - heading_rad[max(first - 1, 0)]))
        if way_m == 0.0 and turned_rad == 0.0:
            continue  # it stood: nobody drives out and back to the same two counts
        near = known & (t_s > t_s[first] - _AROUND_S) & (t_s < t_s[last] + _AROUND_S)
        v_m_s = max(
            way_m / max(lasts_s, 1e-9),
            float(speed[near].max(initial=0.0)),
        )
        aside = min(1.0, fastest_rad_s * lasts_s / _OF_A_TURN)
        found[last] = (v_m_s * lasts_s * aside) ** 2
    return found


def stretches(blank: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and the last tick of each blank."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], blank.astype(np.int8), [0]])))
    return [(int(first), int(stop) - 1) for first, stop in edges.reshape(-1, 2)]


def without_blanks(recording: Recording) -> Recording:
    """Return the recording with a reference that says nothing where no counts are known: between
    two of them, nothing tells what it should have seen."""
    reference = recording.reference
    blank = blanks(recording)
    if reference is None or not blank.any():
        return recording
    t_s = recording.t_s
    inside = np.zeros(len(reference.t_s), dtype=np.bool_)
    for first, last in stretches(blank):
        begins_s, ends_s = t_s[max(first - 1, 0)] - _BESIDE_S, t_s[last] + _BESIDE_S
        inside |= (reference.t_s > begins_s) & (reference.t_s < ends_s)
    if not inside.any() or np.count_nonzero(~inside) < 2:
        return recording
    return replace(recording, reference=reference.only(~inside))


def odometry_of_one_part(recording: Recording, restarts_s: Sequence[float] = ()) -> Recording:
    """Return the recording with the odometry of its longest part without a blank or a restart, and
    no other; of a table, which does not tell whether the ECU had what it lacks, without an empty
    cell.

    An ECU that had what the recorder lost went on otherwise than any replay does, and one that
    restarts begins at nought.
    """
    blank = blanks(recording) | np.isin(recording.t_s, restarts_s)
    if not recording.frames:
        for values in (recording.left_ticks, recording.right_ticks, recording.gyro_code):
            blank |= False if values is None else ~np.isfinite(values)
    if not blank.any() or recording.odometry_x_m is None:
        return recording
    parts = stretches(~blank & np.isfinite(recording.odometry_x_m))
    if not parts:
        return recording
    kept = np.zeros(len(blank), dtype=np.bool_)
    first, last = max(parts, key=lambda one: one[1] - one[0])
    kept[first : last + 1] = True

    def of_part(values: Floats | None) -> Floats | None:
        return None if values is None else np.where(kept, values, np.nan)

    return replace(
        recording,
        odometry_x_m=of_part(recording.odometry_x_m),
        odometry_y_m=of_part(recording.odometry_y_m),
        odometry_heading_rad=of_part(recording.odometry_heading_rad),
    )
