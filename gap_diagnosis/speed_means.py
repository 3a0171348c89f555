"""Speeds of wheels that are means since the row before, where a reference shows that they are.

Nothing in a table says whether a speed is one of the moment. Added up along trapezoids, means are
half a row late, which is no news; but that row's detail is then told along smooth lines, and where
speeds are noisy it is not all in these.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

_OVER_S: Final = 0.5
_SELDOM_S: Final = 0.25
"""Poses that are rarer tell the way between them no closer than a row of speeds is long."""
_FEWEST: Final = 20
_SURELY: Final = 0.25
"""Rows: standard deviation of where between the two kinds a log's speeds stand."""
_CREEP_S2_PER_M: Final = 0.005
"""What tyres slip by for each m/s² of speeding up, one standard deviation; as they go faster that
looks like speeds that are late."""
_MEANS: Final = (
    "The wheels' speeds are taken for means since the row before, as the reference has the way."
)
_MOST: Final = 2.0
"""A reference that is off by more of such half rows has a delay of its own."""


def with_means_added_up(recording: Recording, robot: Robot) -> Recording:
    """Return the recording with speeds added up as means since the row before, where its reference
    is nearer to that than to speeds of the moment."""
    half = recording.half_row_ticks
    if half is None:
        return recording
    recording = replace(recording, half_row_ticks=None)
    if not _are_means(recording, half, robot):
        return recording
    left, right = half
    return replace(
        recording,
        left_ticks=recording.left_ticks + left,
        right_ticks=recording.right_ticks + right,
        notes=(*recording.notes, _MEANS),
    )


def _are_means(recording: Recording, half_row_ticks: Floats, robot: Robot) -> bool:
    """Tell whether ways are those of means: half a row's way more where a wheel has sped up."""
    reference, known = recording.reference, np.isfinite(recording.left_ticks)
    if reference is None or not np.any(known & np.isfinite(recording.right_ticks)):
        return False
    known &= np.isfinite(recording.right_ticks)
    t_s = recording.t_s[known]
    first_s, last_s = max(t_s[0], reference.t_s[0]), min(t_s[-1], reference.t_s[-1])
    at_s = np.arange(first_s, last_s, _OVER_S)
    if len(at_s) < _FEWEST or float(np.median(np.diff(reference.t_s))) > _SELDOM_S:
        return False
    wheels = robot.plant.wheels
    per_tick_m = math.tau * wheels.radius_m / robot.plant.encoder.ticks_per_rev
    way_m, more_m = (
        np.interp(at_s, t_s, 0.5 * per_tick_m * (left + right)[known])
        for left, right in ((recording.left_ticks, recording.right_ticks), half_row_ticks)
    )
    x_m, y_m = (
        np.diff(np.interp(at_s, reference.t_s, one)) for one in (reference.x_m, reference.y_m)
    )
    steps_m = np.diff(way_m)
    off_m = np.sign(steps_m) * np.hypot(x_m, y_m) - steps_m
    # Wheels that creep as they speed up go less far, the more the faster they are.
    columns = np.diff(np.column_stack([more_m, more_m * np.abs(more_m)]), axis=0)
    best = np.linalg.lstsq(columns, off_m)[0]
    variance_m2 = float(np.mean((off_m - columns @ best) ** 2))
    creeps = 2.0 * _CREEP_S2_PER_M / recording.speed_cycle_s**2
    inner = columns.T @ columns + np.diag([0.0, variance_m2 / creeps**2])
    if not np.linalg.det(inner) > 0.0:
        return False
    share = float(np.linalg.solve(inner, columns.T @ off_m)[0])
    sd = math.sqrt(variance_m2 * float(np.linalg.inv(inner)[0, 0]))
    return sd < _SURELY and 0.5 < share < _MOST
