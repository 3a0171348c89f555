"""Odometry as another program would compute it: floats, its own rule, its own offset.

A described kernel may be a default that says nothing about the program that a real robot runs.
These programs stand beside it as nuisances, so that what they explain is never taken for an effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np

from firmware_model import FRESH
from gap_diagnosis.firmware.comparison import Windows
from gap_diagnosis.firmware.inputs import ReplayInputs
from gap_diagnosis.recording import Floats, Ints

_OUTLYING: Final = 9.0
"""A step counts for no more than so many times the usual square of what another lag is off by."""
_RULES: Final[Mapping[str, float]] = {"before": 0.0, "midpoint": 0.5, "after": 1.0}


@dataclass(frozen=True)
class Foreign:
    """One float program.

    Attributes:
        source: what turns the heading: gyro or wheel.
        rule: which heading of a tick the step is taken along, in parts of the tick's turn.
        holds: the heading is held while neither wheel moves.
    """

    source: str
    rule: float
    holds: bool


FOREIGN: Final = (
    *(Foreign("gyro", rule, holds) for rule, holds in product(_RULES.values(), (False, True))),
    *(Foreign("wheel", rule, False) for rule in _RULES.values()),
)
"""Every float program that is known."""

_SCALES: Final[Mapping[str, tuple[str, bool]]] = {
    "wheel_radius": ("wheel", True),
    "ticks_per_rev": ("wheel", True),
    "wheelbase": ("wheel", False),
    "gyro_sensitivity": ("gyro", False),
    "tick_period": ("gyro", False),
}
"""By constant: whose turn it scales, and whether it scales the path."""


@dataclass(frozen=True)
class Steps:
    """What a float program reads: per tick, the path [m] and both turns [rad]."""

    path_m: Floats
    gyro_rad: Floats
    wheel_rad: Floats
    period_s: float
    moves: Floats


def float_steps(inputs: ReplayInputs) -> Steps:
    """Return path and turns of each tick by the described constants; 0 where a frame is missing.

    Counts that come after a gap bring its whole path.
    """
    known = inputs.config.constants
    tick_m = 2.0 * np.pi * known.wheel_radius_m / known.ticks_per_rev
    fresh = inputs.encoder_validity == FRESH
    at = np.flatnonzero(fresh)
    left, right = np.zeros(inputs.ticks), np.zeros(inputs.ticks)
    left[at[1:]] = np.diff(inputs.left_count[at])
    right[at[1:]] = np.diff(inputs.right_count[at])
    code = np.where(
        inputs.gyro_validity == FRESH, inputs.gyro_code - known.gyro_zero_rate_code, 0.0
    )
    return Steps(
        path_m=0.5 * tick_m * (left + right),
        gyro_rad=code * known.gyro_sensitivity_rad_s_per_lsb * known.tick_period_s,
        wheel_rad=(right - left) * tick_m / known.wheelbase_m,
        period_s=known.tick_period_s,
        moves=((left != 0) | (right != 0)).astype(np.float64),
    )


def foreign_replay(
    program: Foreign,
    steps: Steps,
    windows: Windows,
    places: Ints,
    *,
    scaled: str | None = None,
    changes: Mapping[str, Any] | None = None,
) -> tuple[Floats, float]:
    """Return the pose on the recording's rows, fitted to the record, and the fitted scale.

    A constant offset of the gyro is free. *scaled* names a constant whose scale is free (used over
    described − 1); without it the scale is 0. *changes* are stale_heading_cycles, auto_zero_rad_s.
    """
    wanted = changes or {}
    turn = steps.gyro_rad if program.source == "gyro" else steps.wheel_rad
    active = steps.moves if program.holds else np.ones_like(turn)
    turn = turn * active
    threshold = wanted.get("auto_zero_rad_s", 0.0)
    rows = places[windows.rows]
    recorded = windows.pose
    scales_turn = scaled is not None and _SCALES[scaled][0] == program.source
    scales_path = scaled is not None and _SCALES[scaled][1]

    turn_ratio, offset = 1.0, 0.0
    heading = recorded[:, 2] - recorded[0, 2]
    if threshold == 0.0:
        columns = []
        total = np.cumsum(turn)[rows]
        total = total - total[0]
        if program.source == "gyro":
            drift = np.cumsum(active)[rows]
            columns.append(drift - drift[0])
        if scales_turn:
            columns.append(total)
        if columns:
            A = np.column_stack(columns)
            norm = np.sqrt(np.sum(A**2, axis=0)) + 1e-300
            found = np.linalg.lstsq(A / norm, heading - total, rcond=1e-12)[0] / norm
            if program.source == "gyro":
                offset = float(found[0])
            if scales_turn:
                turn_ratio = 1.0 + float(found[-1])
    else:
        turn = np.where(np.abs(turn) < threshold * steps.period_s, 0.0, turn)
    turn = turn * turn_ratio + offset * active
    path_ratio = 1.0
    if scales_path:
        ours, theirs = _path(steps.path_m, rows), recorded_path(recorded)
        path_ratio = float(ours @ theirs / (ours @ ours + 1e-300))
    heading_after = np.cumsum(turn)
    along = heading_after - (1.0 - program.rule) * turn
    cycles = int(wanted.get("stale_heading_cycles", 0))
    if cycles:
        along = np.concatenate([np.full(cycles, along[0]), along[:-cycles]])
    along = along + recorded[0, 2] - heading_after[rows[0]]
    step = steps.path_m * path_ratio
    pose = np.column_stack(
        [
            np.cumsum(step * np.cos(along)),
            np.cumsum(step * np.sin(along)),
            heading_after + recorded[0, 2] - heading_after[rows[0]],
        ]
    )
    pose[:, :2] += recorded[0, :2] - pose[rows[0], :2]
    return pose[places], _scale(scaled, path_ratio, turn_ratio)


def _scale(scaled: str | None, path_ratio: float, turn_ratio: float) -> float:
    match scaled:
        case None:
            return 0.0
        case "wheel_radius":
            return path_ratio - 1.0
        case "ticks_per_rev":
            return 1.0 / path_ratio - 1.0 if path_ratio > 0.0 else 0.0
        case "tick_period":
            return turn_ratio - 1.0
        case _:
            return 1.0 / turn_ratio - 1.0 if turn_ratio > 0.0 else 0.0


def _path(path_m: Floats, rows: Ints) -> Floats:
    total = np.cumsum(path_m)[rows]
    return np.asarray(total - total[0])


def recorded_path(pose: Floats) -> Floats:
    """Return the signed path from the first row: float64[r]; back along the heading is negative."""
    step = np.diff(pose, axis=0, prepend=pose[:1])
    # Linear in the steps, so that coarse digits do not add up to a longer path.
    along = pose[:, 2] - 0.5 * step[:, 2]
    return np.asarray(np.cumsum(np.cos(along) * step[:, 0] + np.sin(along) * step[:, 1]))


def best_lag(steps: Steps, windows: Windows, at_row: Ints, most: int = 3) -> int:
    """Return by how many ticks the recorded odometry lags the counts, −most … most.

    A lag other than 0 needs a clear improvement, and not of a few steps: counts that stand and leap
    are used a tick later by a firmware that asks for a leap to be confirmed.
    """
    rows = windows.rows
    theirs = recorded_path(windows.pose)
    total = np.cumsum(steps.path_m)
    turned = np.cumsum(steps.wheel_rad)
    off = {}
    for lag in range(-most, most + 1):
        at = np.clip(at_row[rows] - lag, 0, len(total) - 1)
        ours, turns = np.diff(total[at]), np.diff(turned[at])
        off[lag] = (ours - np.diff(theirs)) ** 2
        off[lag] += 0.01 * (turns - np.diff(windows.pose[:, 2])) ** 2
    counted = _OUTLYING * max(float(np.median(one)) for one in off.values())
    costs = {lag: float(np.minimum(one, counted).sum()) for lag, one in off.items()}
    best = min(costs, key=lambda lag: (costs[lag], abs(lag)))
    return best if costs[best] < 0.8 * costs[0] else 0
