"""A reference whose clock was never set by the log's: its stamps are moved before all else.

A delay of a measurement is a matter of milliseconds and an effect like any other. Seconds are two
computers that do not know of each other, and say nothing of the robot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.signal import correlate

from gap_diagnosis.explanations.standstill import told_until_s
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.offset import SEARCH_S, turns_of
from gap_diagnosis.motion.seen import is_seen
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats, Recording, Reference
from hil_harness.robot import Robot

_STEP_S: Final = 0.02
_SMOOTHED_S: Final = 0.2
_REACH_S: Final = 3.0 * _SMOOTHED_S
_LEAST_S: Final = 20.0
"""So long the two must run together, and half of the shorter one."""
_ALIKE: Final = 0.8
"""Two records of one drive agree so well at the right shift,"""
_BETTER: Final = 0.1
"""and so much better than at any that is an effect's."""
UNSET_S: Final = 0.05
"""Beside a large effect the shift is found to so much; below, nothing is said of delays."""
UNTOLD: Final = frozenset({"reference_time_offset"})
"""What no log tells of a reference whose clock was never set."""
_AS_GOOD: Final = 0.02
"""Rounds of a track look alike: of shifts as good as the best the smallest is taken."""


def with_clock_set(recording: Recording, robot: Robot) -> tuple[Recording, float]:
    """Return the recording with its reference on the log's clock, and by how much it was late [s].

    0 where it is no later, or earlier, than a reference may be that shares a clock, or where no
    shift makes the two alike.
    """
    reference = recording.reference
    if reference is None or len(reference.t_s) < 20:
        return recording, 0.0
    late_s = _late_s(estimate_motion(replace(recording, reference=None), robot), reference)
    if late_s == 0.0:
        return recording, 0.0
    late_s += _left_s(_moved(recording, reference, late_s), robot)
    return _moved(recording, reference, late_s), late_s


def _late_s(motion: Motion, reference: Reference) -> float:
    """Return by how much the stamps are late, to a hundredth of a second, if by more than an
    effect: what wheels or gyro turn (or go, where there is no orientation) is laid over the
    reference.
    """
    # One wheel alone turns like another round of the track.
    ours_t_s = np.arange(motion.t_s[0], told_until_s(motion), _STEP_S)
    theirs_t_s = np.arange(reference.t_s[0], reference.t_s[-1], _STEP_S)
    if min(len(ours_t_s), len(theirs_t_s)) * _STEP_S < _LEAST_S:
        return 0.0
    if reference.heading_rad is not None:
        sources = [_turns(ours_t_s, motion.t_s, turn) for turn in turns_of(motion)]
        theirs = _turns(theirs_t_s, reference.t_s, reference.heading_rad)
    else:
        sources = [_ways(ours_t_s, motion.t_s, motion.x_m, motion.y_m)]
        theirs = _ways(theirs_t_s, reference.t_s, reference.x_m, reference.y_m)
    seen = is_seen(theirs_t_s, reference.t_s, _REACH_S)
    theirs = np.where(seen, theirs - theirs[seen].mean(), 0.0) if seen.any() else theirs
    alike = max((_alike(ours, theirs, seen) for ours in sources), key=lambda one: float(one.max()))
    first = theirs_t_s[0] - ours_t_s[0]
    late_s = first + _STEP_S * (np.arange(len(alike)) - (len(sources[0]) - 1))
    best = float(alike.max())
    near = float(alike[np.abs(late_s) <= SEARCH_S].max(initial=0.0))
    if best < max(_ALIKE, near + _BETTER):
        return 0.0
    tops = alike == maximum_filter1d(alike, round(SEARCH_S / _STEP_S))
    as_good = np.flatnonzero(tops & (alike >= best - _AS_GOOD))
    return float(late_s[as_good[np.argmin(np.abs(late_s[as_good]))]])


def _turns(grid_s: Floats, t_s: Floats, heading_rad: Floats) -> Floats:
    """Return smooth turns along a grid, less their mean."""
    steps = _smooth_steps(grid_s, t_s, heading_rad)
    return np.asarray(steps - steps.mean())


def _ways(grid_s: Floats, t_s: Floats, x_m: Floats, y_m: Floats) -> Floats:
    """Return smooth ways along a grid, less their mean."""
    steps = np.hypot(_smooth_steps(grid_s, t_s, x_m), _smooth_steps(grid_s, t_s, y_m))
    return np.asarray(steps - steps.mean())


def _smooth_steps(grid_s: Floats, t_s: Floats, values: Floats) -> Floats:
    smooth = gaussian_filter1d(np.interp(grid_s, t_s, values), _SMOOTHED_S / _STEP_S)
    return np.asarray(np.diff(smooth))


def _alike(ours: Floats, theirs: Floats, seen: NDArray[np.bool_]) -> Floats:
    """Return the size of the correlation at every shift, float64[n + m - 1], of what is *seen*; 0
    where too little of them runs together."""
    ones, others = np.ones(len(ours)), seen.astype(np.float64)
    together = correlate(others, ones, method="fft")
    product = np.abs(correlate(theirs, ours, method="fft"))
    power = correlate(others, ours**2, method="fft") * correlate(theirs**2, ones, method="fft")
    least = max(_LEAST_S / _STEP_S, 0.5 * min(len(ours), int(np.count_nonzero(seen))))
    floor = 1e-12 * float(np.sum(ours**2) * np.sum(theirs**2)) + 1e-300
    return np.where(together >= least, product / np.sqrt(np.maximum(power, floor)), 0.0)


def _left_s(recording: Recording, robot: Robot) -> float:
    """Return how late the stamps still are, fitted with all that is free beside it."""
    model = MotionModel(recording, robot, default_prior())
    terms = [t for t in model.columns.terms if t.variant.effect == "reference_time_offset"]
    if not terms:
        return 0.0
    fitted = model.refit(terms, model.level_prior.median, free_levels=False)
    return fitted.coefficients[0][0]


def _moved(recording: Recording, reference: Reference, late_s: float) -> Recording:
    return replace(recording, reference=replace(reference, t_s=reference.t_s - late_s))
