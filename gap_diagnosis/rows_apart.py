"""Residuals of the stages that the motion does not show: commands, replay, stamps.

Each holds a recorded signal against the simulation of its stage from the recorded signal before it
(docs/design.md, section 5): wheels against the drive that is fed the commands, odometry frames
against the replay, stamps against the beat of the ECU's clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gap_diagnosis.gap.metrics import Path, lateness
from gap_diagnosis.gap.on_recording import Replayed, counted_path, recorded_odometry
from gap_diagnosis.pictures import ResidualSeries
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, FrameTimes, Recording
from gap_diagnosis.touching import (
    FRAMES_MISSING,
    ODOMETRY_AGAINST_REPLAY,
    STAMPS_AGAINST_BEAT,
    WHEELS_AGAINST_COMMANDS,
)
from hil_harness.robot import Robot

_LEAST_STAMPS: Final = 20
_DRIVE: Final = (
    (f"{WHEELS_AGAINST_COMMANDS}, way", "m"),
    (f"{WHEELS_AGAINST_COMMANDS}, heading", "rad"),
)
_REPLAY: Final = (
    (f"{ODOMETRY_AGAINST_REPLAY}, along x", "m"),
    (f"{ODOMETRY_AGAINST_REPLAY}, along y", "m"),
    (f"{ODOMETRY_AGAINST_REPLAY}, heading", "rad"),
)


def rows_apart(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    drive: Replayed | None,
    firmware: Replayed | None,
    clock_skew: float | None,
) -> tuple[list[ResidualSeries], list[str]]:
    """Return these residuals, and which of them this recording has no data for.

    *drive* and *firmware* are simulations of the wheels' motion and of the odometry frames;
    *clock_skew* is the explained part of the clock's error, None where none is.
    """
    found: list[ResidualSeries] = []
    missing: list[str] = []
    if drive is None:
        missing.append(f"{WHEELS_AGAINST_COMMANDS}: no commands, or no motion")
    else:
        wheels = counted_path(motion, robot)
        explained = None if drive.after is None else _behind(wheels, drive.after)
        found += _series("actuation", _DRIVE, motion.t_s, _behind(wheels, drive.before), explained)
    odometry = recorded_odometry(recording)
    if odometry is None:
        missing.append(f"{ODOMETRY_AGAINST_REPLAY}: no odometry frames")
    elif firmware is None:
        missing.append(f"{ODOMETRY_AGAINST_REPLAY}: no gyro, by which the firmware turns")
    else:
        before = _off(odometry, motion.t_s, firmware.before)
        after = None if firmware.after is None else _off(odometry, motion.t_s, firmware.after)
        found += _series("firmware", _REPLAY, odometry.t_s, before, after)
    stamps = _stamps(recording.frames, clock_skew)
    if not stamps:
        missing.append(f"{STAMPS_AGAINST_BEAT}: no stamped frames")
    return [*found, *stamps], missing


def _series(
    stage: str,
    rows: Sequence[tuple[str, str]],
    t_s: Floats,
    before: Sequence[Floats],
    after: Sequence[Floats] | None,
) -> list[ResidualSeries]:
    return [
        ResidualSeries(stage, name, unit, t_s, before[k], None if after is None else after[k])
        for k, (name, unit) in enumerate(rows)
    ]


def _behind(wheels: Path, simulated: Floats) -> tuple[Floats, Floats]:
    """Return by how much the wheels went farther [m] and turned more [rad] than *simulated*,
    float64[n, 3], since it begins."""
    x_m, y_m, heading = simulated.T
    told = _way(x_m, y_m, heading)
    if wheels.heading_rad is None:
        raise ValueError("the wheels' path has headings")
    went = _way(wheels.x_m, wheels.y_m, wheels.heading_rad)
    return _since(went - told), _since(wheels.heading_rad - heading)


def _way(x_m: Floats, y_m: Floats, heading: Floats) -> Floats:
    """Return the way forward until each row; NaN before the path begins."""
    known = np.isfinite(heading)
    x, y, turn = x_m[known], y_m[known], heading[known]
    middle = turn - 0.5 * np.diff(turn, prepend=turn[:1])
    steps = np.diff(x, prepend=x[:1]) * np.cos(middle) + np.diff(y, prepend=y[:1]) * np.sin(middle)
    way = np.full(len(heading), np.nan)
    way[known] = np.cumsum(steps)
    return way


def _off(odometry: Path, t_s: Floats, replayed: Floats) -> tuple[Floats, ...]:
    """Return how far the frames' odometry lies from a replay, float64[n, 3], at its own rows."""
    at = np.searchsorted(t_s, odometry.t_s)
    if odometry.heading_rad is None:
        raise ValueError("the odometry has headings")
    told = (odometry.x_m, odometry.y_m, odometry.heading_rad)
    x_m, y_m, heading = (one - replayed[at, k] for k, one in enumerate(told))
    return x_m, y_m, np.asarray(np.angle(np.exp(1j * heading)))


def _since(values: Floats) -> Floats:
    """Return values since the first that is known."""
    known = np.flatnonzero(np.isfinite(values))
    return np.asarray(values - values[known[0]]) if len(known) else values


def _stamps(frames: Mapping[str, FrameTimes], clock_skew: float | None) -> list[ResidualSeries]:
    """Return how late the stamps are of the message that keeps its beat worst, and how many frames
    are missing of all."""
    able = {
        name: one
        for name, one in frames.items()
        if one.cycle_s > 0 and len(one.t_s) >= _LEAST_STAMPS
    }
    if not able:
        return []
    late = {name: lateness(one) for name, one in able.items()}
    worst = max(sorted(able), key=lambda name: float(np.mean(np.diff(late[name][1]) ** 2)))
    explained = None
    if clock_skew is not None:
        explained = _since(lateness(able[worst], clock_skew=clock_skew)[1])
    t_s, late_s = late[worst]
    found = [
        ResidualSeries(
            "bus",
            f"{STAMPS_AGAINST_BEAT}, {worst}",
            "s",
            t_s,
            _since(late_s),
            explained,
            is_sum=False,
        )
    ]
    lost = [_missing(one) for one in able.values() if one.modulo and (one.counter >= 0).all()]
    if lost:
        at_s, count = np.concatenate(lost, axis=1)
        order = np.argsort(at_s, kind="stable")
        found.append(
            ResidualSeries("bus", FRAMES_MISSING, "1", at_s[order], np.cumsum(count[order]))
        )
    return found


def _missing(one: FrameTimes) -> Floats:
    """Return the stamps of a message and how many of its frames are missing before each,
    float64[2, f]."""
    counter = np.sort(one.counter)
    steps = np.diff(counter, prepend=counter[:1])
    cycle = max(float(np.median(steps[1:])), 1.0)
    return np.array([np.sort(one.t_s), np.maximum(np.round(steps / cycle) - 1.0, 0.0)])
