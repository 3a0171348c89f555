"""Every metric of one recording, before and after, on the stretches that no fit has seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.known import by_counts
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.drive_floor import DriveNoise, drive_floor
from gap_diagnosis.gap.floor import DRAWS, Floor, NoiseLevels, noise_floor
from gap_diagnosis.gap.how_far import Compared
from gap_diagnosis.gap.metrics import (
    Path,
    WindowErrors,
    path_errors,
    series_errors,
    stamp_errors,
)
from gap_diagnosis.gap.odometry import (
    as_reported,
    gyro_share,
    gyro_turn_rad,
    odometry_path,
    offset_time_s,
)
from gap_diagnosis.gap.windows import Window, windows_of
from gap_diagnosis.motion.blocks import noise_at_all_times
from gap_diagnosis.motion.whitening import LEVELS, SLIP_S
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, FrameTimes, Recording, Reference
from hil_harness.robot import Robot

_QUANTUM: Final = 1 / 12
"""Variance of rounding to whole counts."""
_LEAST_STAMPS: Final = 8


@dataclass(frozen=True)
class Replayed:
    """Two simulations of one downstream signal, x_m, y_m, heading_rad at the ticks each.

    Attributes:
        before: as described, float64[n, 3].
        after: with the winning effects on; None where there are none.
        noise: of the drive behind them; None where only counting errs.
    """

    before: Floats
    after: Floats | None = None
    noise: DriveNoise | None = None


def levels_of(levels: Floats, robot: Robot, motion: Motion) -> NoiseLevels:
    """Return the motion block's levels, float64[levels], with the description's encoder noise."""
    named = dict(zip(LEVELS, (float(level) for level in levels), strict=True))
    slow_s = named.pop("reference_slow_s")
    for name in ("inexact", "speed_noise_s"):
        named.pop(name)
    if not motion.are_rows_late:
        named["wheels_late_s"] = named["gyro_late_s"] = 0.0
    quantum_rad = _quantum_rad(robot, motion)
    return NoiseLevels(
        **named,
        slow_s=slow_s,
        quantum_rad=quantum_rad,
        slip_s=SLIP_S,
        are_speeds_late=motion.has_speeds,
    )


def _quantum_rad(robot: Robot, motion: Motion) -> float:
    """Return quantisation and noise of one reading of a wheel's angle, standard deviation.

    Next to none where a wheel said its speed: no counts were read.
    """
    counts = math.sqrt(_QUANTUM + robot.plant.encoder.noise_ticks**2)
    return counts * motion.rounding_rad


def windows_on(motion: Motion, held_out: NDArray[np.bool_] | None = None) -> tuple[Window, ...]:
    """Return the windows on the held-out ticks, bool[n] (None: the whole log); none goes on where
    nobody knows which way the robot took."""
    told = motion.lost_m2 == 0.0
    return windows_of(motion.t_s, _way_m(motion), told if held_out is None else told & held_out)


def _way_m(motion: Motion) -> Floats:
    """Return the way of the described wheels until each tick, float64[n]."""
    steps_rad = np.abs(motion.left_step_rad + motion.right_step_rad)
    return np.asarray(np.cumsum(0.5 * motion.radius_m * steps_rad))


def _extents(motion: Motion, windows: Sequence[Window]) -> Floats:
    """Return way [m] and duration [s] of each window, float64[w, 2]."""
    ends_s = np.array([(one.start_s, one.stop_s) for one in windows]).reshape(-1, 2)
    ends_m = np.interp(ends_s, motion.t_s, _way_m(motion))
    return np.column_stack([np.diff(ends_m), np.diff(ends_s)])


def compare_all(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    *,
    effects: Sequence[Setting] = (),
    draws: Sequence[Sequence[Setting]] = (),
    levels: NoiseLevels | None = None,
    drive: Replayed | None = None,
    firmware: Replayed | None = None,
    clock_skew: float | None = None,
) -> dict[str, Compared]:
    """Return each metric that the recording allows window by window, by name.

    Without *effects* there is no ``after``, without *levels* no floor. *draws* are the same effects
    with values drawn from their posterior; they widen the interval. *drive* and *firmware* are
    simulations of the wheels' motion and of the odometry frames. *clock_skew* is the explained part
    of the ECU's clock error; None where no effect acts on the bus.
    """
    compared = compare(
        recording, robot, motion, windows, effects=effects, draws=draws, levels=levels
    )
    explained = bool(effects)
    if drive is not None:
        measured = counted_path(motion, robot)
        quantum_m = motion.radius_m * _quantum_rad(robot, motion)
        compared["drive_position_m"] = _replayed(motion, drive, measured, windows, quantum_m)
    if firmware is not None:
        odometry = recorded_odometry(recording)
        if odometry is not None:
            compared["firmware_position_m"] = _replayed(motion, firmware, odometry, windows)
    if recording.frames:
        known = recording.granted.number("clock_skew.skew")
        compared["timing_s"] = _timing(
            recording.frames,
            windows,
            known,
            known if clock_skew is None else clock_skew,
            explained or clock_skew is not None,
        )
    extents = _extents(motion, windows)
    return {
        name: replace(one, extents=extents[one.before.window]) for name, one in compared.items()
    }


def compare(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    *,
    effects: Sequence[Setting] = (),
    draws: Sequence[Sequence[Setting]] = (),
    levels: NoiseLevels | None = None,
) -> dict[str, Compared]:
    """Return the odometry metrics and the turn difference, window by window."""
    before = _odometry_errors(recording.reference, robot, motion, windows, ())
    after = _odometry_errors(recording.reference, robot, motion, windows, effects)
    drawn = [_odometry_errors(recording.reference, robot, motion, windows, one) for one in draws]
    floor = None
    if levels is not None and windows:
        floor = floor_on(recording, robot, motion, windows, effects, levels)
    compared = {}
    for name, errors in before.items():
        # Whether a window moves far enough to be laid on the reference may depend on the effects.
        every = [errors, after[name], *(one[name] for one in drawn)]
        places = reduce(np.intersect1d, [one.window for one in every])
        own = [one.at(places) for one in every]
        compared[name] = Compared(
            before=own[0],
            after=own[1] if effects else None,
            floor=None if floor is None else _floor_of(floor, name)[:, own[0].window],
            after_draws=np.array([one.mean_square for one in own[2:]]) if drawn else None,
        )
    return compared


def odometry_rms(
    name: str,
    recording: Recording,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    effects: Sequence[Setting],
) -> float:
    """Return one of the odometry metrics with some effects on: what a waterfall is made of."""
    rms = _odometry_errors(recording.reference, robot, motion, windows, effects)[name].rms
    return float("nan") if rms is None else rms


def replayed_rms(
    name: str,
    recording: Recording,
    robot: Robot,
    motion: Motion,
    simulated: Floats,
    windows: Sequence[Window],
) -> float:
    """Return the drive's or the firmware's metric of a simulated path, float64[n, 3]."""
    measured = counted_path(motion, robot)
    if name == "firmware_position_m":
        measured = recorded_odometry(recording) or measured
    rms = path_errors(_path_of(motion, simulated), measured, windows).position.rms
    return float("nan") if rms is None else rms


def timing_rms(recording: Recording, windows: Sequence[Window], clock_skew: float) -> float:
    """Return how far stamps lie from their beat by a clock that is fast by *clock_skew* [s]."""
    rms = _stamps(recording.frames, windows, clock_skew=clock_skew).rms
    return float("nan") if rms is None else rms


def floor_on(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    effects: Sequence[Setting],
    levels: NoiseLevels,
    draws: int = DRAWS,
) -> Floor:
    """Return what noise of these levels leaves on the explained path."""
    prediction, reference = predict(motion, effects), recording.reference
    return noise_floor(
        odometry_path(prediction, robot),
        (np.cumsum(prediction.left_m), np.cumsum(prediction.right_m)),
        motion.radius_m**2 * np.cumsum(_unsure_rad2(motion, levels.speed_noise), axis=1),
        motion.t_s if reference is None else reference.t_s,
        windows,
        levels,
        radius_m=motion.radius_m,
        wheelbase_m=motion.wheelbase_m,
        gyro_share=gyro_share(robot, motion),
        offset_time_s=offset_time_s(motion, robot),
        has_heading=reference is None or reference.heading_rad is not None,
        draws=draws,
    )


def _unsure_rad2(motion: Motion, speed_noise: float) -> Floats:
    """Return how unsure each wheel's turn is in each tick, float64[2, n], where noise of its speeds
    is so many times as loud as told."""
    wheels = (motion.left_step_rad, motion.right_step_rad)
    told = [
        noise_at_all_times(unsure, motion.dt_s, step != 0.0)
        for unsure, step in zip(motion.wheel_unsure_rad2, wheels, strict=True)
    ]
    return motion.wheel_unsure_rad2 + (speed_noise**2 - 1.0) * np.array(told)


def counted_path(motion: Motion, robot: Robot) -> Path:
    """Return where described wheels went by what their drive turned them by."""
    return Path(motion.t_s, *by_counts(motion, robot.plant.wheels.wheelbase_m).path())


def recorded_odometry(recording: Recording) -> Path | None:
    """Return the odometry frames' path, rows without a frame left out; None without frames."""
    x_m, y_m = recording.odometry_x_m, recording.odometry_y_m
    heading = recording.odometry_heading_rad
    if x_m is None or y_m is None or heading is None:
        return None
    good = np.isfinite(x_m) & np.isfinite(y_m) & np.isfinite(heading)
    return Path(recording.t_s[good], x_m[good], y_m[good], heading[good])


def _odometry_errors(
    reference: Reference | None,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    effects: Sequence[Setting],
) -> dict[str, WindowErrors]:
    prediction = predict(motion, effects)
    errors: dict[str, WindowErrors] = {}
    if reference is not None:
        reported = as_reported(prediction, odometry_path(prediction, robot))
        measured = Path(reference.t_s, reference.x_m, reference.y_m, reference.heading_rad)
        found = path_errors(reported, measured, windows)
        errors["odometry_position_m"] = found.position
        if found.heading is not None:
            errors["odometry_heading_rad"] = found.heading
    if motion.gyro_turn_rad is not None:
        difference = np.cumsum(prediction.turn_rad) - gyro_turn_rad(prediction)
        errors["turn_difference_rad"] = series_errors(motion.t_s, difference, windows)
    return errors


def _floor_of(floor: Floor, name: str) -> Floats:
    if name == "odometry_position_m":
        return floor.position
    return floor.heading if name == "odometry_heading_rad" else floor.turn_difference


def _replayed(
    motion: Motion,
    replayed: Replayed,
    measured: Path,
    windows: Sequence[Window],
    quantum_m: float = 0.0,
) -> Compared:
    """Compare simulations with a measured path, whose wheels are read with this noise."""

    before = path_errors(_path_of(motion, replayed.before), measured, windows).position
    after = best = None
    if replayed.after is not None:
        best = _path_of(motion, replayed.after)
        after = path_errors(best, measured, windows).position
    floor = np.full((1, len(before.mean_square)), quantum_m**2)
    if replayed.noise is not None:
        floor = drive_floor(
            best or _path_of(motion, replayed.before),
            replayed.noise,
            [windows[place] for place in before.window],
            radius_m=motion.radius_m,
            wheelbase_m=motion.wheelbase_m,
        )
    return Compared(before, after, floor)


def _path_of(motion: Motion, columns: Floats) -> Path:
    """Return x, y and heading at the ticks, float64[n, 3], without the rows that have none."""
    good = np.isfinite(columns).all(1)
    return Path(motion.t_s[good], *columns[good].T)


def _timing(
    frames: Mapping[str, FrameTimes],
    windows: Sequence[Window],
    known_skew: float,
    clock_skew: float,
    explained: bool,
) -> Compared:
    """Compare all messages' stamps with their beat; the floor is their spread about a line."""
    return Compared(
        _stamps(frames, windows, clock_skew=known_skew),
        _stamps(frames, windows, clock_skew=clock_skew) if explained else None,
        _stamps(frames, windows, free_rate=True).mean_square[np.newaxis],
    )


def _stamps(
    frames: Mapping[str, FrameTimes],
    windows: Sequence[Window],
    *,
    clock_skew: float = 0.0,
    free_rate: bool = False,
) -> WindowErrors:
    """Return how far all messages' stamps lie from their beats, as `stamp_errors` has it."""
    return _joined(
        [
            stamp_errors(one, windows, clock_skew=clock_skew, free_rate=free_rate)
            for _, one in sorted(frames.items())
            if one.cycle_s > 0 and len(one.t_s) >= _LEAST_STAMPS
        ]
    )


def _joined(parts: Sequence[WindowErrors]) -> WindowErrors:
    """Return one row per window: the mean over messages of their mean squares."""
    if not parts:
        return WindowErrors(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 1)))
    window = np.concatenate([part.window for part in parts])
    places, row = np.unique(window, return_inverse=True)
    counts = np.bincount(row)
    square = np.bincount(row, np.concatenate([part.mean_square for part in parts])) / counts
    end = np.bincount(row, np.concatenate([part.end[:, 0] for part in parts])) / counts
    return WindowErrors(places, square, end[:, np.newaxis])
