"""Where a reference lost the robot: poses that stand still while it drives, holes, and leaps.

A motion capture that loses its markers says nothing for a while or repeats the last pose; one that
finds other markers, or a receiver that fixes another integer, goes on somewhere else. None of it
says anything of the robot: frozen poses are left out, what follows a leap is put back by its size.
But a log in which nothing else is wrong is not without a gap: its reference has one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from gap_diagnosis.motion.course import dead_reckoned
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.offset import coarse_delay_s
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, Recording, Reference
from hil_harness.robot import Robot

_FROZEN: Final = 5
"""So many equal poses in a row are no chance, if the robot drove on by its wheels,"""
_DRIVEN_M: Final = 0.03
_DRIVEN_STEPS: Final = 3.0
"""so far and by so many of the steps in which the reference counts,"""
_AT_REST: Final = 0.5
"""and if fewer than this share of the poses at rest repeat: a reference without noise may show a
robot whose wheels spin."""
_HOLE_S: Final = 0.9
"""Every motion capture blinks: no samples for about a second, while the robot drives on,"""
_FILLED_S: Final = 1.0
"""What writes a reference on the log's rows holds its pose for so long before the first and after
the last one that was measured: there it only ends."""
_HOLE_STEPS: Final = 10.0
"""and for so many of the usual steps, is a loss."""
_AROUND: Final = 5
"""Samples on each side of a leap whose median says where it led."""
_FAR: Final = 15.0
"""In robust standard deviations."""
_SD_OF_MEDIAN: Final = 1.4826
_FASTEST_M_S: Final = 3.0
"""No floor throws a robot so fast between two samples."""
_SELDOM: Final = 0.02
"""How likely it is that nothing is wrong with a reference that says what is not so,"""
_OFTEN: Final = 0.6
"""and with one that says nothing for a while: cameras and receivers lose a robot in many a room."""
_MOST: Final = 20
"""With more leaps than this, or more holes, that is how the reference measures."""

Window = tuple[float, float]
"""From and to [s]."""


@dataclass(frozen=True)
class Leap:
    """A leap of the reference: the time of the first sample after it, and how far it leads."""

    t_s: float
    x_m: float
    y_m: float
    heading_rad: float


@dataclass(frozen=True)
class Lost:
    """What was mended, and when the reference knew nothing of the robot.

    Attributes:
        frozen: samples left out.
        leaps: put back.
        stopped: windows of the frozen samples, but for what was filled up at the ends.
        holes: windows without samples.
    """

    frozen: int = 0
    leaps: tuple[Leap, ...] = ()
    stopped: tuple[Window, ...] = ()
    holes: tuple[Window, ...] = ()

    @property
    def windows(self) -> tuple[Window, ...]:
        """All of them in the order of time; a leap takes none."""
        return tuple(sorted((*self.stopped, *self.holes, *((one.t_s,) * 2 for one in self.leaps))))

    @property
    def as_ever(self) -> float:
        """How likely it is that this reference is as it always is."""
        if self.stopped or self.leaps:
            return _SELDOM
        return _OFTEN if self.holes else 1.0


def with_tracking(recording: Recording, robot: Robot) -> tuple[Recording, Lost]:
    """Return the recording without frozen poses and leaps of its reference, and what they were."""
    reference = recording.reference
    if reference is None or len(reference.t_s) < 4 * _AROUND:
        return recording, Lost()
    delay_s = coarse_delay_s(recording, robot)
    motion = estimate_motion(recording, robot, reference_delay_s=delay_s)
    left, right = motion.left_steady_rad, motion.right_steady_rad
    way_m = _way_m(reference, motion, delay_s, np.abs(left + right))
    rolled_m = _way_m(reference, motion, delay_s, np.abs(left) + np.abs(right))
    stopped, t_s = _stopped(reference, way_m), reference.t_s
    frozen = np.zeros(len(way_m), dtype=np.bool_)
    for first, stop in stopped:
        # Before it was measured the first pose is no better at the first stamp than later.
        is_before = first == 1 and _is_filled(t_s, first, stop)
        frozen[0 if is_before else first : stop] = True
    kept = reference.only(~frozen) if stopped else reference
    leaps = _leaps(kept, motion, delay_s[~frozen])
    lost = Lost(
        int(frozen.sum()),
        tuple(leaps),
        tuple(
            (float(t_s[first]), float(t_s[stop - 1]))
            for first, stop in stopped
            if not _is_filled(t_s, first, stop)
        ),
        _holes(t_s, rolled_m),
    )
    if not stopped and not leaps:
        return recording, lost
    for leap in leaps:
        kept = _put_back(kept, leap)
    return replace(recording, reference=kept), lost


def _is_filled(t_s: Floats, first: int, stop: int) -> bool:
    is_at_an_end = first == 1 or stop == len(t_s)
    return is_at_an_end and float(t_s[stop - 1] - t_s[first - 1]) < _FILLED_S


def _way_m(reference: Reference, motion: Motion, delay_s: Floats, steps_rad: Floats) -> Floats:
    """Return, float64[s], how far steps of both wheels together, float64[n], have gone by each
    sample; a counter that trembles at an edge goes no way."""
    way_m = np.cumsum(0.5 * motion.radius_m * steps_rad)
    return np.asarray(np.interp(reference.t_s - delay_s, motion.t_s, way_m))


def _holes(t_s: Floats, rolled_m: Floats) -> tuple[Window, ...]:
    """Return the windows without samples in which wheels rolled on, be it in a turn on the spot."""
    steps_s = np.diff(t_s)
    long_s = max(_HOLE_S, _HOLE_STEPS * float(np.median(steps_s)))
    places = np.flatnonzero((steps_s > long_s) & (np.diff(rolled_m) > _DRIVEN_M))
    if len(places) > _MOST:
        return ()
    return tuple((float(t_s[k]), float(t_s[k + 1])) for k in places)


def _stopped(reference: Reference, at: Floats) -> list[tuple[int, int]]:
    """Return the first samples, and those after the last, of runs that repeat an older pose though
    the robot drove on; *at* is how far it has gone."""
    repeats = reference.said_again()
    stands = np.concatenate(([False], np.diff(at) == 0))
    if stands.sum() > _FROZEN and repeats[stands].mean() > _AT_REST:
        return []
    steps_m = np.abs(np.concatenate((np.diff(reference.x_m), np.diff(reference.y_m))))
    least_m = float(np.min(steps_m, where=steps_m > 0, initial=np.inf))
    far_m = max(_DRIVEN_M, _DRIVEN_STEPS * least_m)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], repeats.astype(np.int8), [0]))))
    return [
        (int(first), int(stop))
        for first, stop in edges.reshape(-1, 2)
        if stop - first >= _FROZEN and at[stop - 1] - at[first - 1] > far_m
    ]


def _leaps(reference: Reference, motion: Motion, delay_s: Floats) -> list[Leap]:
    """Return the leaps: steps off dead reckoning that nothing on wheels could make."""
    stamps = reference.t_s - delay_s
    way = dead_reckoned(_forward_m(motion), motion.heading_rad)
    path_x_m, path_y_m = (np.interp(stamps, motion.t_s, path) for path in way)
    x_m, y_m = reference.x_m - path_x_m, reference.y_m - path_y_m
    step = np.hypot(_step(x_m), _step(y_m))
    sudden = np.hypot(np.diff(x_m, prepend=x_m[0]), np.diff(y_m, prepend=y_m[0]))
    elapsed_s = np.diff(reference.t_s, prepend=reference.t_s[0] - 1.0)
    speed_m_s = np.hypot(_rate(path_x_m, stamps), _rate(path_y_m, stamps))
    top = sudden == maximum_filter1d(sudden, 2 * _AROUND + 1)
    is_far = step > _FAR * _usual_size(step, speed_m_s)
    # Samples a fifth of a second apart drift off in five by as much as a receiver leaps in one.
    is_sudden = (sudden > _FAR * _usual_size(sudden, speed_m_s)) & (step > 0.5 * sudden)
    is_leap = top & (is_far | is_sudden) & (sudden > 0.5 * step)
    places = np.flatnonzero(is_leap & (step > _FASTEST_M_S * elapsed_s))
    if len(places) > _MOST:
        return []
    turn = _turned(reference, motion, stamps)
    return [
        Leap(
            float(reference.t_s[k]),
            float(_step(x_m)[k]),
            float(_step(y_m)[k]),
            0.0 if turn is None else float(turn[k]),
        )
        for k in places
    ]


def _rate(path: Floats, t_s: Floats) -> Floats:
    """Return how fast a path is left at each time, over the samples around it, float64[s]."""
    place = np.arange(len(t_s))
    first, last = np.maximum(place - _AROUND, 0), np.minimum(place + _AROUND, len(t_s) - 1)
    return np.asarray((path[last] - path[first]) / (t_s[last] - t_s[first]))


def _usual_size(size: Floats, speed: Floats) -> Floats:
    """Return the usual size of errors, standard deviations float64[s], at these speeds: part of it
    is the same at any, and part grows in proportion, as the slower and the faster half tell."""
    fast = speed > float(np.median(speed))
    if not fast.any():
        return np.full(len(size), _SD_OF_MEDIAN * float(np.median(size)))
    at_slow, at_fast = (_SD_OF_MEDIAN * float(np.median(size[half])) for half in (~fast, fast))
    slower, faster = (float(np.median(speed[half])) for half in (~fast, fast))
    per_speed2 = max(at_fast**2 - at_slow**2, 0.0) / (faster**2 - slower**2)
    return np.sqrt(at_slow**2 + per_speed2 * np.maximum(speed**2 - slower**2, 0.0))


def _turned(reference: Reference, motion: Motion, stamps: Floats) -> Floats | None:
    """Return how far the heading steps off the gyro's turn, or off the estimate without one."""
    if reference.heading_rad is None:
        return None
    turned = motion.heading_rad if motion.gyro_turn_rad is None else motion.gyro_turn_rad
    return _step(reference.heading_rad - np.interp(stamps, motion.t_s, turned))


def _step(values: Floats) -> Floats:
    """Return, float64[s], the median of the samples from each one on less that of those before."""
    padded = np.pad(values, _AROUND, mode="edge")
    windows = np.median(np.lib.stride_tricks.sliding_window_view(padded, _AROUND), axis=-1)
    return np.asarray(windows[_AROUND : _AROUND + len(values)] - windows[: len(values)])


def _put_back(reference: Reference, leap: Leap) -> Reference:
    after = reference.t_s >= leap.t_s
    heading = reference.heading_rad
    return replace(
        reference,
        x_m=reference.x_m - leap.x_m * after,
        y_m=reference.y_m - leap.y_m * after,
        heading_rad=None if heading is None else heading - leap.heading_rad * after,
    )


def _forward_m(motion: Motion) -> Floats:
    """Return the described wheels' way in each tick, float64[n]."""
    return np.asarray(0.5 * motion.radius_m * (motion.left_step_rad + motion.right_step_rad))
