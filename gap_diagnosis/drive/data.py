"""What the drive's residuals are made of: commands and wheel angles in blocks of a few ticks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive.kernels import block_means
from gap_diagnosis.drive.outrun import ACCELERATION, RATE, outrun
from gap_diagnosis.explanations.known import COUNTING, by_counts
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

Floats = NDArray[np.float64]
Spell = tuple[int, int]
"""The first block in which effects act, and the one behind the last."""

_BLOCK_S: Final = 0.04
_RECEPTION_S: Final = 0.004
_ROW: Final = 0.8
"""A command of a table may be in force from its row on or have been since the row before, and rise
from one to the next: so much of a row is the root of the mean square."""
_LEAST_BLOCKS: Final = 50
_FORGOTTEN: Final = 4.0
"""After so many time constants a wheel's rate has forgotten what it was told."""
_SILENT_S: Final = 0.1
"""A silence of the wheels in which a command may be lost: they are sent as often or seldomer."""
_USUAL_TIMES: Final = 5.0
"""A silence is longer than so many times the usual between two counts."""
_TOLD_S: Final = 1.0
"""Commands are told again by then."""
_SETTLED_S: Final = 0.3
"""Three lags of a common drive."""
_REST_BLOCKS: Final = 25
"""A wheel at rest says its angle once a second: the same count again is no new observation."""
_ACTIVITY_S: Final = 0.6
_APART_S: Final = 0.2
"""Over which how far a wheel goes astray is told: its counts are rounded."""
_IDLE: Final = 0.02
"""Share of the largest activity that errors keep while the robot rests."""


@dataclass(frozen=True)
class DriveData:
    """Commands and wheels of one recording.

    Attributes:
        dt_s: time from row to row.
        commanded: float64[2, n], wheel rates in force from each row on [rad/s].
        rate_0: float64[2], wheel rates at the first row.
        row_used: bool[2, n], rows whose count is there.
        start: int64[m + 1], first row of each block.
        block_s: time from block to block.
        angle: float64[2, m], mean measured wheel angle of each block [rad].
        seen: bool[2, m], blocks that count as an observation.
        count: float64[2, m], rows averaged, or as many as it is worth.
        turning: float64[2, m], how fast the wheel turns by its counts [rad/s].
        activity: float64[2, m], how fast the wheel turns or ought to [rad/s].
        astray: float64[2, m], how far the wheel's rate is from that of the described drive [rad/s].
        lost: bool[m], after a gap of which nothing is known.
        scatter: float64[2, m], variance of the counts that were lost or came by chance since the
            block before [rad²].
        time_s: float64[m], log time of each block.
        tick_rad: wheel angle of one count.
        delay_sd_s: how far off any delay is between a command's row and a wheel's: by the offset
            between a command's reception by log and by drive, and where rows of a table were put
            together, or wheels say mean speeds, by a part of a row.
        limits: what of table [drive] the wheels outrun, as they have it, by key.
        manner: float64[c, 2, m], what a drive that does as it is told adds in its own manner; every
            hypothesis has it.
        acting: in which blocks a drive does otherwise; None: in all.
        miscounting: in which blocks counts are wrong; None: in all.
    """

    dt_s: float
    commanded: Floats
    rate_0: Floats
    row_used: NDArray[np.bool_]
    start: NDArray[np.int64]
    block_s: float
    angle: Floats
    seen: NDArray[np.bool_]
    count: Floats
    turning: Floats
    activity: Floats
    astray: Floats
    lost: NDArray[np.bool_]
    scatter: Floats
    time_s: Floats
    tick_rad: float
    delay_sd_s: float
    limits: Mapping[str, float] = field(default_factory=dict)
    manner: Floats | None = None
    acting: Spell | None = None
    miscounting: Spell | None = None

    def limits_beside(self, robot: Robot) -> tuple[float, float]:
        """Return the largest wheel rate [rad/s] and acceleration [rad/s²] of the described drive,
        as far as its wheels keep to them."""
        drive = robot.plant.drive
        rate = self.limits.get(RATE, drive.max_wheel_rate_rad_s)
        return rate, self.limits.get(ACCELERATION, drive.max_wheel_acceleration_rad_s2)

    def told(self, commanded: Floats) -> DriveData:
        """Return the data as they would be had the drive been told these wheel rates."""
        there = commanded[:, self.start[:-1]]
        return replace(
            self,
            commanded=np.ascontiguousarray(commanded),
            activity=_activity(there, self.turning, self.block_s),
            astray=np.zeros(self.angle.shape),
        )

    def beside(self, described: Floats) -> DriveData:
        """Return the data beside the described drive's angles float64[2, m], from which its wheels
        go astray."""
        return replace(self, astray=self._astray(described))

    def _astray(self, described: Floats) -> Floats:
        """Return how far rates are from described ones, less what the rounding of counts does."""
        apart = max(1, round(_APART_S / self.block_s))
        gone = np.where(self.seen, self.angle - described, np.nan)
        for one in gone:
            there = np.flatnonzero(np.isfinite(one))
            one[:] = np.interp(np.arange(len(one)), there, one[there]) if len(there) else 0.0
        way = np.zeros(gone.shape)
        way[:, apart // 2 : apart // 2 - apart] = gone[:, apart:] - gone[:, :-apart]
        square = np.maximum(way**2 - 2.0 * self.tick_rad**2 / 12.0, 0.0)
        smooth = np.stack([_smooth(one, self.block_s) for one in square])
        return np.asarray(np.sqrt(smooth) / (apart * self.block_s), dtype=np.float64)

    def blocks(self, angles: Floats) -> Floats:
        """Return the block means of angles float64[2, n]; 0 where a block is not observed."""
        means: Any = block_means(angles, self.row_used, self.start)
        return np.where(self.seen, means, 0.0)


def drive_data(recording: Recording, robot: Robot) -> DriveData | None:
    """Return the data, or None where the log has no commands, no motion or too few rows."""
    v, w = recording.v_command_m_s, recording.w_command_rad_s
    if v is None or w is None:
        return None
    known = np.isfinite(v) & np.isfinite(w)
    if not known.any():
        return None
    first = int(np.argmax(known))
    rows = slice(first, None)
    wheels = robot.plant.wheels
    turn = 0.5 * np.nan_to_num(w[rows]) * wheels.wheelbase_m
    speed = np.nan_to_num(v[rows])
    commanded = np.stack([speed - turn, speed + turn]) / wheels.radius_m
    commanded = np.ascontiguousarray(recording.granted.turning(commanded))
    tick_rad = math.tau / robot.plant.encoder.ticks_per_rev
    angle = _turned_rad(recording, robot)[:, rows]
    used = np.isfinite(angle)
    dt_s = recording.tick_s
    if used.sum(axis=1).min() < _LEAST_BLOCKS:
        return None
    silenced = np.zeros(used.shape[1], dtype=np.bool_)
    if recording.frames:
        silenced = _silenced(used, commanded, dt_s)
    used[:, silenced] = False
    every = max(1, round(_BLOCK_S / dt_s))
    n = angle.shape[1]
    start = np.arange(0, n + 1, every, dtype=np.int64)
    if len(start) - 1 < _LEAST_BLOCKS or used.sum(axis=1).min() < _LEAST_BLOCKS:
        return None
    if not np.any(np.abs(commanded) > 0):
        return None
    means = block_means(np.nan_to_num(angle), used, start)
    count = np.add.reduceat(used, start[:-1], axis=1)[:, : len(start) - 1].astype(np.float64)
    block_s = every * dt_s
    turning = _turning(means, block_s)
    jumped = np.concatenate(([False], np.diff(recording.tick[rows]) > 1))
    if recording.frames:
        jumped[1:] |= silenced[:-1] & ~silenced[1:]
    else:
        # A row of a table that was lost took its command along.
        memory_s = _FORGOTTEN * robot.plant.drive.time_constant_s
        untold = _untold(commanded, ~(used[0] | used[1]), math.ceil(memory_s / dt_s))
        jumped = np.logical_or(jumped, untold)
    lost = np.logical_or.reduceat(jumped, start[:-1])
    data = DriveData(
        dt_s=dt_s,
        commanded=commanded,
        rate_0=_first_rates(angle, dt_s),
        row_used=used,
        start=start,
        block_s=block_s,
        angle=np.nan_to_num(means),
        seen=np.isfinite(means) & ~_repeats_at_rest(means, commanded[:, start[:-1]], tick_rad),
        count=np.maximum(count, 1.0),
        turning=turning,
        activity=_activity(commanded[:, start[:-1]], turning, block_s),
        astray=np.zeros(means.shape),
        lost=lost,
        scatter=np.zeros(means.shape),
        time_s=recording.t_s[rows][start[:-1]],
        tick_rad=tick_rad,
        delay_sd_s=math.hypot(
            _RECEPTION_S, 0.5 * recording.speed_cycle_s if recording.frames else _ROW * dt_s
        ),
    )
    return replace(data, limits=outrun(data, robot))


def _turned_rad(recording: Recording, robot: Robot) -> Floats:
    """Return what the wheels turned by their counts with those errors that are known, float64[2, n]
    from the first count on; NaN where none came."""
    counted = np.stack([recording.left_ticks, recording.right_ticks])
    tick_rad = math.tau / robot.plant.encoder.ticks_per_rev
    few = np.isfinite(counted).sum(axis=1).min() < _LEAST_BLOCKS
    if few or COUNTING.isdisjoint(recording.granted.values):
        return counted * tick_rad
    motion = estimate_motion(replace(recording, reference=None), robot)
    turned = by_counts(motion, motion.wheelbase_m)
    known = np.cumsum(np.stack([turned.left_rad, turned.right_rad]), axis=1)
    return np.where(np.isfinite(counted), known, np.nan)


def _untold(commanded: Floats, missing: NDArray[np.bool_], memory_ticks: int) -> NDArray[np.bool_]:
    """Mark the ticks at which a wheel may be anywhere: in a row that is missing it may have been
    told what comes next already, and its rate remembers that for a while."""
    untold = np.zeros(len(missing), dtype=np.bool_)
    for end in np.flatnonzero(missing[:-1] & ~missing[1:]) + 1:
        if (commanded[:, end] != commanded[:, end - 1]).any():
            untold[end : end + memory_ticks + 1] = True
    return untold


def _silenced(used: NDArray[np.bool_], commanded: Floats, dt_s: float) -> NDArray[np.bool_]:
    """Mark rows, bool[n], in which nobody knows what the drive was told.

    While no count comes a command may be lost as well: it is not known again before another one,
    and the drive goes on as it was told until it has settled. Where commands came meanwhile, it was
    the counts alone that were lost.
    """
    rows = used.shape[1]
    fresh = np.any(np.diff(commanded, axis=1, prepend=commanded[:, :1]) != 0, axis=0)
    silent = np.concatenate(([False], ~used.any(axis=0), [False]))
    edges = np.flatnonzero(np.diff(silent.astype(np.int8))).reshape(-1, 2)
    silenced = np.zeros(rows, dtype=np.bool_)
    usual_s = float(np.median(np.diff(np.flatnonzero(used.any(axis=0))))) * dt_s
    least_s = max(_SILENT_S, _USUAL_TIMES * usual_s)
    for start, stop in edges:
        if (stop - start) * dt_s < least_s or fresh[start + 1 : stop].any():
            continue
        told = np.flatnonzero(fresh[stop : stop + round(_TOLD_S / dt_s)])
        until = stop + (int(told[0]) if len(told) else round(_TOLD_S / dt_s))
        silenced[start : until + round(_SETTLED_S / dt_s)] = True
    return silenced


def _first_rates(angle: Floats, dt_s: float) -> Floats:
    """Return the wheel rates over the first ticks: a log may begin in motion."""
    rates = np.zeros(2)
    for wheel in range(2):
        rows = np.flatnonzero(np.isfinite(angle[wheel]))[:8]
        if len(rows) > 2:
            rates[wheel] = np.polyfit(rows * dt_s, angle[wheel][rows], 1)[0]
    return rates


def _turning(angle: Floats, block_s: float) -> Floats:
    filled = angle.copy()
    for wheel in range(2):
        there = np.flatnonzero(np.isfinite(filled[wheel]))
        filled[wheel] = np.interp(np.arange(filled.shape[1]), there, filled[wheel][there])
    return np.asarray(np.abs(np.gradient(filled, block_s, axis=1)), dtype=np.float64)


def _activity(commanded: Floats, turning: Floats, block_s: float) -> Floats:
    size = np.maximum(turning, np.abs(commanded))
    square = np.stack([_smooth(one**2, block_s) for one in size])
    typical = float(np.quantile(size, 0.9)) or float(size.max()) or 1.0
    return np.asarray(np.sqrt(square + (_IDLE * typical) ** 2), dtype=np.float64)


def _smooth(values: Floats, block_s: float) -> Floats:
    width = max(1, round(_ACTIVITY_S / block_s))
    return np.convolve(values, np.ones(width) / width, mode="same")


def _repeats_at_rest(angle: Floats, commanded: Floats, tick_rad: float) -> NDArray[np.bool_]:
    """Mark blocks in which a wheel that is told to rest still shows what it showed before."""
    repeated = np.zeros(angle.shape, dtype=np.bool_)
    for wheel in range(2):
        rests = 0
        for i in range(1, angle.shape[1]):
            still = abs(angle[wheel, i] - angle[wheel, i - 1]) < 0.6 * tick_rad
            idle = commanded[wheel, i] == 0.0 and commanded[wheel, i - 1] == 0.0
            rests = rests + 1 if still and idle else 0
            repeated[wheel, i] = rests > 0 and rests % _REST_BLOCKS != 0
    return repeated
