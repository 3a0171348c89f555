"""How well a replay explains the recorded odometry: window by window, with honest exits.

In each window the relative motion (forward, left, turn) of the record is held against that of the
replay. Its misfit has one of four densities, mixed with weights that do not depend on the replay:

* *equal*: every tick of the window agrees to the last digit of the record;
* *exact*: the window's misfit is a few digits;
* *practical*: normal about zero with the floor below which no one would speak of a gap;
* *wild*: even in logarithm over many orders of magnitude, for lost frames and the like.

A program that is named must fit nearly all windows in one of the first three ways, and a record
that it gives whole, to the last digit, is proof. The catch-all, "some other arithmetic", has at
least one component (forward, left, turn) that is wild throughout, but may take out a smooth
function of the motion first.

Where the log has all that the ECU had in each tick, there is no excuse: a kernel that ran gives the
record to its last digit, or it is not the one that ran. The catch-all
is then the same kernel with a change that nobody listed: any part of the windows is off by anything
(`exact_scores`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.firmware.inputs import Odometry
from gap_diagnosis.recording import Floats, Ints

WINDOW_S: Final = 2.0
_MOST_WINDOWS: Final = 400

PATH_FLOOR: Final = 1e-4
"""Misfit of path over path, and of turn over turn, that makes no practical difference."""
_LEAST_M: Final = 1e-6
_LEAST_RAD: Final = 1e-5

_EXACT_QUANTA: Final = 3.0
CARRIED_QUANTA: Final = 10.0
_EQUAL_QUANTA: Final = 0.51
_EQUAL_NATS: Final = 20.0
_WHOLE_NATS: Final = 1000.0
_WEIGHT_EQUAL: Final = 0.3
_WEIGHT_EXACT: Final = 0.34
_WEIGHT_PRACTICAL: Final = 0.34
_WEIGHT_WILD: Final = 0.02
_DECADES: Final = 30.0  # e-folds over which a wild misfit is spread
_FREEDOM: Final = (
    4.0  # of Student's density about a digit: no edge, and no room for more than a few
)
_LOG_MOST: Final = math.log(3.0 / 8.0)
"""That density's logarithm where nothing is off."""
LOG_NO_EXCUSE: Final = math.log(1e-6)
"""So rarely a kernel that ran on known inputs gives another record, for a reason of no interest."""
_SHARES: Final = (np.arange(40) + 0.5) / 40.0

COMPONENTS: Final = 3


@dataclass(frozen=True)
class Windows:
    """The record cut into windows, with what each says.

    Attributes:
        rows: int64[r], the recording's rows with odometry.
        first, last: int64[w], a window's ends as places in `rows`.
        motion: float64[w, 3], recorded forward [m], left [m], turn [rad] in each.
        floor: float64[w, 3], misfit that makes no practical difference.
        quantum: float64[3], resolution of the record: of x, y and heading.
        pose: float64[r, 3], the record.
        from_power_on: the replay begins with the ECU. Else the remainders that it carried into the
            log are unknown, and the last digits prove nothing.
        has_all_inputs: the log has, for each tick, what the ECU had in it.
    """

    rows: Ints
    first: Ints
    last: Ints
    motion: Floats
    floor: Floats
    quantum: Floats
    pose: Floats
    from_power_on: bool = True
    has_all_inputs: bool = False

    @property
    def is_exact(self) -> bool:
        """Whether a kernel that ran must give the record."""
        return self.from_power_on and self.has_all_inputs

    @cached_property
    def alike(self) -> Floats:
        """By how much the record and a pose that is equal to its last digit differ, float64[3]."""
        rounded = 4.0 * np.spacing(np.max(np.abs(self.pose), axis=0) + 1.0)
        return np.asarray(_EQUAL_QUANTA * self.quantum + rounded)

    @property
    def count(self) -> int:
        """How many windows there are."""
        return len(self.first)

    def head(self, rows: int) -> Windows:
        """Return the windows that end before this many of the recording's rows."""
        kept = self.rows[self.last] < rows
        end = int(self.last[kept][-1]) + 1 if np.any(kept) else 0
        return Windows(
            self.rows[:end],
            self.first[kept],
            self.last[kept],
            self.motion[kept],
            self.floor[kept],
            self.quantum,
            self.pose[:end],
            self.from_power_on,
            self.has_all_inputs,
        )


def cut_windows(odometry: Odometry, t_s: Floats) -> Windows:
    """Return windows of two seconds, or as many longer ones as are worth looking at."""
    rows = np.flatnonzero(np.isfinite(odometry.pose[:, 0]))
    time_s = t_s[rows] - t_s[rows[0]]
    window_s = max(WINDOW_S, float(time_s[-1]) / _MOST_WINDOWS)
    starts = np.unique(np.searchsorted(time_s, np.arange(0.0, float(time_s[-1]), window_s)))
    first = starts
    last = np.append(starts[1:], len(rows) - 1)
    keep = last > first
    first, last = first[keep], last[keep]
    pose = odometry.pose[rows]
    motion = relative_motion(pose, first, last)
    steps = np.abs(np.diff(pose, axis=0, prepend=pose[:1]))
    path_m = np.add.reduceat(np.hypot(steps[:, 0], steps[:, 1]), first)
    turn_rad = np.add.reduceat(steps[:, 2], first)
    quantum_m, quantum_rad = odometry.quantum_m, odometry.quantum_rad
    turn_floor = PATH_FLOOR * turn_rad + _LEAST_RAD + 2.0 * quantum_rad
    step_floor = PATH_FLOOR * path_m + _LEAST_M + 2.0 * quantum_m
    floor = np.column_stack([step_floor, step_floor + path_m * turn_floor, turn_floor])
    quantum = np.array([quantum_m, quantum_m, quantum_rad])
    return Windows(rows, first, last, motion, floor, quantum, pose)


def relative_motion(pose: Floats, first: Ints, last: Ints) -> Floats:
    """Return forward, left and turn from *first* to *last*, seen from the pose at *first*."""
    step = pose[last] - pose[first]
    cosine, sine = np.cos(pose[first, 2]), np.sin(pose[first, 2])
    return np.column_stack(
        [
            cosine * step[:, 0] + sine * step[:, 1],
            cosine * step[:, 1] - sine * step[:, 0],
            step[:, 2],
        ]
    )


def misfit(windows: Windows, replayed: Floats) -> Floats:
    """Return recorded minus replayed motion of each window: float64[w, 3]; *replayed* by row."""
    return windows.motion - relative_motion(replayed[windows.rows], windows.first, windows.last)


def equal_windows(windows: Windows, replayed: Floats) -> NDArray[np.bool_]:
    """Tell for each window whether all of its ticks agree to the last digit: bool[w, 3]."""
    difference = windows.pose - replayed[windows.rows]
    starts = windows.first
    high = np.maximum.reduceat(difference, starts, axis=0)
    low = np.minimum.reduceat(difference, starts, axis=0)
    ends = difference[windows.last]
    high, low = np.maximum(high, ends), np.minimum(low, ends)
    return np.asarray((high - low <= windows.alike) & ~np.isnan(high))


def is_equal(windows: Windows, replayed: Floats) -> bool:
    """Tell whether the whole record agrees with the replay to its last digit."""
    difference = np.abs(windows.pose - replayed[windows.rows])
    return bool(np.all(difference <= windows.alike))


def score(windows: Windows, replayed: Floats) -> float:
    """Return the log likelihood of a named program's replay."""
    whole = _WHOLE_NATS if windows.from_power_on and is_equal(windows, replayed) else 0.0
    return float(np.sum(component_scores(windows, replayed))) + whole


def exact_scores(windows: Windows, replayed: Floats) -> tuple[float, float]:
    """Return the log likelihoods of a kernel that ran on inputs which are all known, and of the
    same kernel with a change that nobody listed.

    The record is its output, or else something is wrong that nobody knows. With a change, of each
    component any share of the windows is as replayed, and the others are off by anything: all
    shares are as likely, and all sizes from a digit on, in logarithm.
    """
    off, same = _to_digits(windows, replayed)
    size = np.maximum(np.abs(off), windows.quantum) / windows.floor
    other = -math.log(2.0 * _DECADES) - np.log(size)
    shares = _SHARES[:, None, None]
    most = np.maximum(same, other)
    mixed = shares * np.exp(same - most) + (1.0 - shares) * np.exp(other - most)
    logs = np.sum(most + np.log(mixed), axis=1)
    changed = float(np.sum(np.logaddexp.reduce(logs, axis=0) - math.log(len(_SHARES))))
    if not is_equal(windows, replayed):
        return LOG_NO_EXCUSE + changed, changed
    return float(np.sum(same)) + _WHOLE_NATS, changed


def _to_digits(windows: Windows, replayed: Floats) -> tuple[Floats, Floats]:
    """Return the misfits, and their log density where they are digits: float64[w, 3] each."""
    off = misfit(windows, replayed)
    off = np.where(np.isfinite(off), off, 1e30)
    digits = _EXACT_QUANTA * windows.quantum
    few = _LOG_MOST - 0.5 * (_FREEDOM + 1.0) * np.log1p((off / digits) ** 2 / _FREEDOM)
    few += np.log(windows.floor / digits)
    none = np.where(
        equal_windows(windows, replayed),
        np.log(windows.floor / (2.0 * digits)) + _EQUAL_NATS,
        -np.inf,
    )
    return off, np.asarray(np.logaddexp(few, none) - math.log(2.0))


def component_scores(windows: Windows, replayed: Floats) -> Floats:
    """Return the log likelihood of forward, left and turn, each over all windows: float64[3]."""
    off = misfit(windows, replayed)
    return np.asarray(np.sum(_window_scores(windows, off, equal_windows(windows, replayed)), 0))


def turn_score(windows: Windows, replayed: Floats) -> float:
    """Return the log likelihood of the turns alone."""
    return float(component_scores(windows, replayed)[2])


def _window_scores(windows: Windows, off: Floats, equal: NDArray[np.bool_]) -> Floats:
    off = np.where(np.isfinite(off), off, 1e30)
    z = np.abs(off) / windows.floor
    digits = (_EXACT_QUANTA if windows.from_power_on else CARRIED_QUANTA) * windows.quantum
    equal = equal & windows.from_power_on
    per_digit = np.log(windows.floor / (2.0 * digits))
    log_wild = math.log(_WEIGHT_WILD) + _log_wild(z)
    log_practical = math.log(_WEIGHT_PRACTICAL) - 0.5 * z**2 - 0.5 * math.log(2.0 * math.pi)
    # Cauchy's density has no edge that the chance of a last digit could cross.
    log_exact = math.log(_WEIGHT_EXACT) + np.log(windows.floor / (math.pi * digits))
    log_exact = log_exact - np.log1p((off / digits) ** 2)
    log_equal = np.where(equal, math.log(_WEIGHT_EQUAL) + per_digit + _EQUAL_NATS, -np.inf)
    total = np.logaddexp(np.logaddexp(log_wild, log_practical), np.logaddexp(log_exact, log_equal))
    return np.asarray(total)


def _log_wild(z: Floats) -> Floats:
    return -math.log(2.0 * _DECADES) - np.log(np.maximum(z, 1.0))


def catch_all_scores(windows: Windows, off: Floats) -> Floats:
    """Return the log likelihood of "some other arithmetic" whose misfit is *off*: float64[3]."""
    return np.asarray(np.sum(_log_wild(np.abs(off) / windows.floor), axis=0))
