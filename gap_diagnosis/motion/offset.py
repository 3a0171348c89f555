"""First guesses of how late the reference, or the gyro, is stamped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.explanations.known import LONG_S
from gap_diagnosis.explanations.standstill import told_until_s
from gap_diagnosis.motion.drift import BETTER, TURN_S, drift_of, is_better
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.seen import is_seen
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

Mask = NDArray[np.bool_]

SEARCH_S: Final = 0.5
"""No gyro is later, and few references that share a clock with the log are, or earlier:"""
_FAR_S: Final = 2.0
"""some are by so much, where a log is long enough and turns tell it, or speeds beyond doubt:
at a constant speed one moment is as good as another."""
_LONG: Final = 10
"""So many times as long."""
_STEP_S: Final = 0.02
_REACH_S: Final = 0.3
"""Samples so near reach into what is smoothed."""
_BY_CHANCE: Final = 4.0
"""Standard deviations of a correlation of noise that none of all shifts has by chance: of a robot
of 0.25 m/s fixes that were off by 0.5 m once a second were 0.44 s late."""
_BETTER_OF_SPEEDS: Final = 1e-4
"""Of a correlation: a car's are alike to 0.9993 as they are, and to 0.9996 a tenth of a second
later. Turns that are more alike by as little are late by what a fit finds from there."""
_ALIKE: Final = 0.8
"""A gyro that shows the wheels' turns at all agrees with them so well at the right shift, and a
reference along the right line."""


def coarse_delay_s(recording: Recording, robot: Robot) -> Floats:
    """Return reference stamp - log time of each sample, roughly, float64[s]: one for all unless the
    clock drifts; 0 where it is small or cannot be told.

    The turn of the reference over a fifth of a second is laid over the wheels' and the gyro's (or
    the speeds, where there is no orientation); the shift with the best correlation wins, or the
    line of shifts. The fit itself is never made on differentiated signals: this only chooses where
    it starts. It is asked once of a log and a robot: what prepares a log asks it, and what models
    it.
    """
    asked_of, delay_s = recording.told.get(coarse_delay_s, (None, None))
    if asked_of is not robot:
        delay_s = _coarse_delay_s(recording, robot)
        recording.told[coarse_delay_s] = robot, delay_s
    return np.asarray(delay_s)


def _coarse_delay_s(recording: Recording, robot: Robot) -> Floats:
    reference = recording.reference
    if reference is None:
        return np.zeros(0)
    timely = np.zeros(len(reference.t_s))
    if len(timely) < 20:
        return timely
    motion = estimate_motion(replace(recording, reference=None), robot)
    first_s = max(motion.t_s[0], reference.t_s[0])
    grid = np.arange(first_s, min(told_until_s(motion), reference.t_s[-1]), _STEP_S)
    if len(grid) < 100:
        return timely
    if reference.heading_rad is None:
        path = np.hypot(np.diff(reference.x_m), np.diff(reference.y_m))
        theirs = _smooth_steps(np.interp(grid, reference.t_s[1:], np.cumsum(path)))
        way = np.cumsum(np.abs(motion.speed_m_s * motion.dt_s))
        ours = [_smooth_steps(np.interp(grid, motion.t_s, way))]
    else:
        theirs = _smooth_steps(np.interp(grid, reference.t_s, reference.heading_rad))
        ours = [_smooth_steps(np.interp(grid, motion.t_s, turn)) for turn in turns_of(motion)]
    better = BETTER if reference.heading_rad is not None else _BETTER_OF_SPEEDS
    seen = is_seen(grid, reference.t_s, _REACH_S)
    if not seen.any():
        return timely
    # Where the reference sees nothing it is no more like the wheels one moment than another.
    theirs = np.where(seen, theirs - theirs[seen].mean(), 0.0)
    drifts = (drift_of(one, theirs, SEARCH_S, _STEP_S, seen) for one in ours)
    drift = max(drifts, key=lambda it: it.alike)
    # Along a line through noise something is always a little more alike.
    if drift.rate != 0.0 and drift.alike > _ALIKE:
        return drift.delay_s(reference.t_s - grid[0])
    samples = np.count_nonzero((reference.t_s >= grid[0]) & (reference.t_s <= grid[-1]))
    by_chance = _BY_CHANCE / math.sqrt(min(samples, np.count_nonzero(seen) * _STEP_S / TURN_S))
    if len(grid) * _STEP_S > _LONG * _FAR_S:
        far_s, alike = _likeliest(ours, theirs, _FAR_S, seen, better)
        least = by_chance if reference.heading_rad is not None else max(by_chance, _ALIKE)
        if alike > least:
            return timely + far_s
    near_s, alike = _likeliest(ours, theirs, SEARCH_S, seen, better)
    return timely + near_s if alike > by_chance else timely


def turns_of(motion: Motion) -> list[Floats]:
    """Return the headings that wheels and gyro give, each by itself: one of them may be broken."""
    wheels = motion.radius_m * (motion.right_angle_rad - motion.left_angle_rad) / motion.wheelbase_m
    return [wheels] if motion.gyro_turn_rad is None else [wheels, motion.gyro_turn_rad]


def coarse_gyro_delay_s(motion: Motion) -> float:
    """Return how late the gyro shows what the wheels do, roughly; 0 where it is small or unclear.

    Where a gyro is late by several ticks, a straight line from no delay at all misleads.
    """
    if motion.gyro_turn_rad is None:
        return 0.0
    grid = np.arange(motion.t_s[0], motion.t_s[-1], _STEP_S)
    if len(grid) < 100:
        return 0.0
    wheels, gyro = (_smooth_steps(np.interp(grid, motion.t_s, turn)) for turn in turns_of(motion))
    late_s, alike = _shift(wheels, gyro, SEARCH_S, np.ones(len(gyro), dtype=np.bool_))
    return late_s if alike > _ALIKE else 0.0


def _likeliest(
    ours: Sequence[Floats], theirs: Floats, most_s: float, seen: Mask, better: float
) -> tuple[float, float]:
    """Return the shift by which *theirs* is most like one of *ours*, and how alike they are then;
    see `_shift`."""
    return max(
        (_shift(one, theirs, most_s, seen, better) for one in ours), key=lambda shift: shift[1]
    )


def _smooth_steps(values: Floats) -> Floats:
    """Return how values on a grid of _STEP_S change, smoothed over turns."""
    return np.asarray(gaussian_filter1d(np.diff(values), 0.1 / _STEP_S))


def _shift(
    ours: Floats, theirs: Floats, most_s: float, seen: Mask, better: float = BETTER
) -> tuple[float, float]:
    """Return by how much *theirs*, smooth steps on a grid of _STEP_S, come later than *ours*, up to
    *most_s* (0 where it is small or not *better* than none by so much), and how alike they are
    then, where they are *seen*."""
    most = round(most_s / _STEP_S)
    is_short = len(ours) <= 2 * (2 * most + 1) + 1
    if is_short or ours.std() < 1e-9 or theirs.std() < 1e-9:
        return 0.0, 0.0
    scores = _correlations(ours, theirs, most, seen)
    peak = int(np.argmax(scores))
    best = (peak - most + _between(scores, peak)) * _STEP_S
    # At an end of the search lies no peak: nothing told where one is.
    seen_s = float(np.count_nonzero(seen)) * _STEP_S
    is_told = 0 < peak < len(scores) - 1 and is_better(scores[peak], scores[most], seen_s, better)
    return best if abs(best) >= LONG_S and is_told else 0.0, float(scores[peak])


def _correlations(ours: Floats, theirs: Floats, most: int, seen: Mask) -> Floats:
    """Return how alike *ours* and *theirs* are, moved back by -*most* to *most* steps.

    float64[2 most + 1]: correlations but for a sign, of what is inside at every shift and *seen*; 0
    where that is less than half of what it might be: of little, all is alike.
    """
    edge = 2 * most + 1
    around = slice(edge - most, len(theirs) - edge + most)
    weight = seen[around].astype(np.float64)
    theirs = (theirs - theirs.mean())[around] * weight
    ours = ours[edge:-edge] - ours[edge:-edge].mean()

    def sums(of_theirs: Floats, of_ours: Floats) -> Floats:
        return np.correlate(of_theirs, of_ours, mode="valid")

    ones = np.ones(len(ours))
    together = sums(weight, ones)
    count = np.maximum(together, 1.0)
    first, second = sums(weight, ours), sums(theirs, ones)
    shared = sums(theirs, ours) - first * second / count
    power = (sums(weight, ours**2) - first**2 / count) * (sums(theirs**2, ones) - second**2 / count)
    floor = 1e-12 * float(np.sum(ours**2) * np.sum(theirs**2)) + np.finfo(np.float64).tiny
    alike = np.abs(shared) / np.sqrt(np.maximum(power, floor))
    return np.where(together >= 0.5 * min(len(ours), int(np.count_nonzero(seen))), alike, 0.0)


def _between(scores: Floats, peak: int) -> float:
    """Return how many steps from *peak* the parabola through it and its neighbours has its top."""
    if not 0 < peak < len(scores) - 1:
        return 0.0
    before, top, after = scores[peak - 1 : peak + 2]
    bend = 2 * top - before - after
    return float(0.5 * (after - before) / bend) if bend > 0 else 0.0
