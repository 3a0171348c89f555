"""What the robot was told to do at each tick: one of seven kinds of manoeuvre.

The commands decide where the log has them, otherwise the wheels. All thresholds are ratios: to the
log's own top speed, or of the turn's rim speed |ω|·b/2 to the speed |v|, so a robot of any size is
judged alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

KINDS: Final = ("rest", "straight", "arc", "spin", "accelerate", "brake", "reverse")
REST, STRAIGHT, ARC, SPIN, ACCELERATE, BRAKE, REVERSE = range(7)
Kinds = NDArray[np.int8]

_REST: Final = 0.02  # of the top rim speed
_SPIN: Final = 0.1  # largest |v| over rim speed of a turn on the spot
_ARC: Final = 0.015  # least rim speed over |v| of an arc: a radius of 33 wheelbases
_CHANGE: Final = 0.1  # of the top speed, over _CHANGE_S
_CHANGE_S: Final = 0.4
_SHORTEST_S: Final = 0.3
_SMOOTHING_S: Final = 0.2
_JITTER_TICKS: Final = 3.0


@dataclass(frozen=True)
class Stretch:
    """Consecutive ticks of one kind: rows first to stop − 1."""

    first: int
    stop: int
    kind: int


def kinds_of(recording: Recording, robot: Robot) -> Kinds:
    """Return the kind of manoeuvre of each tick, int8[n], an index into `KINDS`.

    A command of v or ω beyond what the described wheels can do is taken to be in another unit and
    scaled into their range: the kinds do not depend on it.
    """
    t_s, plant = recording.t_s, robot.plant
    half_m, radius_m = 0.5 * plant.wheels.wheelbase_m, plant.wheels.radius_m
    v, w = recording.v_command_m_s, recording.w_command_rad_s
    if v is not None and w is not None and np.isfinite(v).any() and np.isfinite(w).any():
        limit_m_s = radius_m * plant.drive.max_wheel_rate_rad_s
        speed = _in_range(np.nan_to_num(v), limit_m_s)
        rim = _in_range(np.nan_to_num(w) * half_m, limit_m_s)
        return kinds_of_rates(t_s, speed, rim, least_m_s=0.0, is_command=True)
    metres = math.tau * radius_m / plant.encoder.ticks_per_rev
    left, right = (
        _rate(_filled(count, t_s) * metres, t_s)
        for count in (recording.left_ticks, recording.right_ticks)
    )
    jitter_m_s = _JITTER_TICKS * metres / _SMOOTHING_S
    return kinds_of_rates(
        t_s, 0.5 * (left + right), 0.5 * (right - left), least_m_s=jitter_m_s, is_command=False
    )


def kinds_of_rates(
    t_s: Floats, speed_m_s: Floats, rim_m_s: Floats, *, least_m_s: float, is_command: bool
) -> Kinds:
    """Return the kind of each tick from forward speed and rim speed ω·b/2, all float64[n].

    What is slower than *least_m_s* rests. A change of a command shows in the motion a little later,
    so it is sought in the time before each tick; a change of recorded motion, about it.
    """
    size, turning = np.abs(speed_m_s), np.abs(rim_m_s)
    total = size + turning
    moving = total > least_m_s
    if not moving.any():
        return np.zeros(len(t_s), dtype=np.int8)
    top = float(np.quantile(total[moving], 0.95))
    before_s = _CHANGE_S if is_command else 0.5 * _CHANGE_S
    earlier = np.interp(t_s - before_s, t_s, size)
    later = np.interp(t_s + (_CHANGE_S - before_s), t_s, size)
    change = later - earlier
    kinds = np.full(len(t_s), STRAIGHT, dtype=np.int8)
    kinds[turning > _ARC * size] = ARC
    kinds[speed_m_s < 0] = REVERSE
    kinds[total < max(_REST * top, least_m_s)] = REST
    kinds[change > _CHANGE * top] = ACCELERATE
    kinds[change < -_CHANGE * top] = BRAKE
    kinds[(size < _SPIN * turning) & (turning >= max(_REST * top, least_m_s))] = SPIN
    return _without_flicker(t_s, kinds)


def stretches_of(kinds: Kinds) -> tuple[Stretch, ...]:
    """Return the runs of equal kind, in order; together they cover every tick."""
    if not len(kinds):
        return ()
    edges = np.flatnonzero(np.diff(kinds)) + 1
    firsts = [0, *edges.tolist()]
    stops = [*edges.tolist(), len(kinds)]
    return tuple(
        Stretch(first, stop, int(kinds[first])) for first, stop in zip(firsts, stops, strict=True)
    )


def _in_range(rates: Floats, limit: float) -> Floats:
    moving = np.abs(rates[rates != 0])
    top = float(np.quantile(moving, 0.95)) if len(moving) else 0.0
    return rates * (0.5 * limit / top) if top > 1.5 * limit else rates


def _filled(values: Floats, t_s: Floats) -> Floats:
    known = np.isfinite(values)
    return np.interp(t_s, t_s[known], values[known]) if known.any() else np.zeros(len(t_s))


def _rate(travel: Floats, t_s: Floats) -> Floats:
    """Return the mean rate over `_SMOOTHING_S` about each tick."""
    start = np.maximum(t_s - 0.5 * _SMOOTHING_S, t_s[0])
    stop = np.minimum(t_s + 0.5 * _SMOOTHING_S, t_s[-1])
    return np.asarray(
        (np.interp(stop, t_s, travel) - np.interp(start, t_s, travel))
        / np.maximum(stop - start, 1e-9)
    )


def _without_flicker(t_s: Floats, kinds: Kinds) -> Kinds:
    """Give runs shorter than `_SHORTEST_S` the kind of the last longer run before them."""
    runs = stretches_of(kinds)
    step_s = (t_s[-1] - t_s[0]) / max(len(t_s) - 1, 1)
    lengths = np.array([t_s[run.stop - 1] - t_s[run.first] + step_s for run in runs])
    kept = np.flatnonzero(lengths >= _SHORTEST_S)
    if not len(kept):
        return kinds
    place = np.searchsorted(kept, np.arange(len(runs)), side="right") - 1
    source = kept[np.maximum(place, 0)]
    values = np.array([runs[index].kind for index in source], dtype=np.int8)
    return np.repeat(values, [run.stop - run.first for run in runs])
