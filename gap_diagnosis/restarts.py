"""Counts that leap: a controller that restarts begins to count anew.

In one row counts then change by more than any wheel turns, and go on from there as if nothing had
been. That is no motion: it is put back by its size. But a log in which nothing else is wrong is not
without a gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.motion.counters import jumps_of
from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

_FARTHER: Final = 4.0
"""So many times as far as a wheel can turn, as described, since its count last changed,"""
_LEAST_COUNTS: Final = 256.0
"""and so far, no wheel goes."""
_HELD_S: Final = 1.0
"""A count that was held for longer does not make up for all of it at once."""
_MOST: Final = 5
"""A log with more leaps has another trouble: counts of another unit, or none that can be read."""
_SELDOM: Final = 0.02
"""How likely it is that nothing is wrong with counts that leap."""


@dataclass(frozen=True)
class Restarts:
    """When counts leapt [s], and by how much those of each wheel [counts]: all of one length."""

    t_s: tuple[float, ...] = ()
    left: tuple[float, ...] = ()
    right: tuple[float, ...] = ()

    @property
    def as_ever(self) -> float:
        """How likely it is that these counts are as they always are."""
        return _SELDOM if self.t_s else 1.0


def with_restarts(recording: Recording, robot: Robot) -> tuple[Recording, Restarts]:
    """Return the recording whose counts go on where they leapt, and what the leaps were.

    What a counter narrower than described jumps by is an effect of its own, and stays.
    """
    bits, _ = jumps_of(recording, robot)
    if bits or recording.unsure_ticks2 is not None:
        return recording, Restarts()
    left = _leaps(recording.left_ticks, recording, robot)
    right = _leaps(recording.right_ticks, recording, robot)
    at = np.flatnonzero((left != 0.0) | (right != 0.0))
    if not 0 < len(at) <= _MOST:
        return recording, Restarts()
    mended = replace(
        recording,
        left_ticks=recording.left_ticks - np.cumsum(left),
        right_ticks=recording.right_ticks - np.cumsum(right),
    )
    told = (tuple(float(one) for one in values[at]) for values in (recording.t_s, left, right))
    return mended, Restarts(*told)


def _leaps(counts: Floats, recording: Recording, robot: Robot) -> Floats:
    """Return by how much counts leap in each row beyond what the wheel did in the one before,
    float64[n]."""
    leaps = np.zeros(len(counts))
    known = np.flatnonzero(np.isfinite(counts))
    if len(known) < 3:
        return leaps
    plant = robot.plant
    fastest_per_s = plant.drive.max_wheel_rate_rad_s / math.tau * plant.encoder.ticks_per_rev
    t_s, steps = recording.t_s[known], np.diff(counts[known])
    # A producer that held its counts, or frames that were lost, are made up for in one step.
    changed = np.concatenate(([0], np.where(steps != 0.0, np.arange(1, len(known)), 0)))
    since_s = t_s[1:] - t_s[np.maximum.accumulate(changed)[:-1]]
    lost_s = np.diff(t_s)
    reach = _FARTHER * fastest_per_s * np.maximum(lost_s, np.minimum(since_s, _HELD_S))
    is_leap = np.abs(steps) > reach + _LEAST_COUNTS
    went_on = np.where(is_leap, 0.0, steps)[np.maximum(np.arange(len(steps)) - 1, 0)]
    leaps[known[1:]] = np.where(is_leap, steps - went_on, 0.0)
    return leaps
