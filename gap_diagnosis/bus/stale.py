"""What a sender said again though there was news: runs in which a payload stood still."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.bus.events import Message
from gap_diagnosis.lattice import lattice_step
from gap_diagnosis.recording import Recording
from gap_diagnosis.trembling import trembles

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_USUAL_ROWS: Final = 4
_CONTEXT: Final = 40
_CHANGING: Final = 0.8
_LONGEST_STALE_S: Final = 0.3
"""What repeats for longer is frozen: that is the sensor's fault, not its sender's."""
_BY_CHANCE: Final = 0.01
_A_LEAP: Final = 8.0
"""Counts of both wheels: by so many no wheel moves off from one row to the next."""
SURE_LENGTH: Final = 3
_HELD_OFTEN: Final = 3
"""Times, and half of all, that a gyro which is held at a value begins to say that again."""
_NO_CHANGE: Final = 1e-6
_LEAST_STEP: Final = 4.0


@dataclass(frozen=True)
class Staleness:
    """Runs in which a payload stood still while the robot did not.

    Attributes:
        lengths: int64[r], cycles for which the payload was repeated.
        chances: cycles in which a run could have begun.
        windows: (start, stop) of each run.
        ticks: the first repeated tick of each run, and the first with news.
    """

    lengths: Ints
    chances: int
    windows: tuple[tuple[float, float], ...]
    ticks: tuple[tuple[int, int], ...]


def _around(values: NDArray[Any]) -> Floats:
    """Return the sum of each value and its neighbours, of fewer of them at the ends."""
    sums = np.convolve(values, np.ones(2 * _CONTEXT + 1))
    return np.asarray(sums[_CONTEXT : _CONTEXT + len(values)])


def staleness(
    message: Message, recording: Recording, *, has_gyro: bool, has_speeds: bool
) -> Staleness:
    """Find the stale runs of a sensor message.

    A run counts where the payload changes nearly always around it and the wheels turn before and
    after; where the counts themselves stood still, they must leap by what they missed, and where a
    message has the wheels' speeds, these: a steady wheel says the same speed by itself. A gyro that
    trembles at rest as well needs no wheels. One at the end of its range says the same for another
    reason, and one that hardly trembles wherever a turn is steady.
    """
    counts = [recording.left_ticks, recording.right_ticks]
    wheels = counts if has_speeds else [_in_steps(one) for one in counts]
    moved = [_speed_steps(one) for one in counts] if has_speeds else wheels
    good = ~message.doubled & ~message.swapped
    changes, stamp = message.changes[good], message.t_s[good]
    speed = _speed(wheels)
    row = _rows(message, recording)[good]
    tick = message.tick[good] if message.has_counter else recording.tick[row]
    moving = speed[row] > 0.0
    near = _around(changes & moving) / _around(np.ones(len(changes)))
    rolling = moving & (near > _CHANGING / 2)
    trembling = has_gyro & ~rolling & (_around(changes) > _CHANGING * _around(np.ones(len(near))))
    edges = np.flatnonzero(np.diff(np.concatenate(([0], (~changes).astype(np.int8), [0]))))
    repeats = (
        _repeats_itself(recording) if has_gyro else np.zeros(len(recording.tick), dtype=np.bool_)
    )
    longest = _LONGEST_STALE_S / message.cycle_s
    # Of another stale run close by, that it does not change says nothing.
    stale = np.zeros(len(changes), dtype=np.bool_)
    for start, stop in edges.reshape(-1, 2):
        if SURE_LENGTH <= stop - start <= longest and start >= 2 and stop < len(changes) - 1:
            stale[start:stop] = _leaps(moved, row[start - 1], row[stop], int(stop - start))
    found: list[tuple[int, int, int]] = []
    at_rest: list[tuple[int, int, int]] = []
    for start, stop in edges.reshape(-1, 2):
        length = int(stop - start)
        if length > longest or stop >= len(changes) - 1 or start < 2 or repeats[row[start]]:
            continue
        before = _rows_but(stale, max(0, start - _CONTEXT), start)
        after = _rows_but(stale, stop, stop + _CONTEXT)
        around = np.concatenate((changes[before], changes[after]))
        turning = np.concatenate((moving[before], moving[after]))
        if (
            turning.any()
            and np.mean(around[turning]) >= _CHANGING
            and max(np.mean(moving[before]), np.mean(moving[after])) >= 0.5
            and _leaps(moved, row[start - 1], row[stop], length)
        ):
            found.append((length, int(start), int(stop)))
        elif (
            has_gyro
            and not rolling[start]
            and min(np.mean(changes[before]), np.mean(changes[after])) >= _CHANGING
        ):
            at_rest.append((length, int(start), int(stop)))
    kept: list[tuple[int, int, int]] = []
    # A gyro at rest says the same twice more often than one that turns.
    for runs, chances in ((found, rolling), (at_rest, trembling)):
        lengths = [length for length, _, _ in runs]
        if has_gyro:
            # It repeats itself by chance whether or not the wheels are fast enough to leap.
            lengths = [int(stop - start) for start, stop in edges.reshape(-1, 2) if chances[start]]
        least = _beyond_chance(lengths, int(chances.sum()))
        kept += [one for one in runs if one[0] >= least]
    return Staleness(
        np.array([length for length, _, _ in kept], dtype=np.int64),
        max(int(np.count_nonzero(rolling | trembling)), 1),
        tuple((float(stamp[start]), float(stamp[stop])) for _, start, stop in kept),
        tuple((int(tick[start]), int(tick[stop])) for _, start, stop in kept),
    )


def _rows(message: Message, recording: Recording) -> NDArray[np.int64]:
    """Return the row of the recording that each frame is of, int64[f]: the nearest by its stamp
    where no counter says it."""
    last = len(recording.tick) - 1
    if message.has_counter:
        return np.clip(np.searchsorted(recording.tick, message.tick), 0, last)
    between = 0.5 * (recording.t_s[1:] + recording.t_s[:-1])
    return np.searchsorted(between, message.t_s)


def _rows_but(without: Bools, start: int, stop: int) -> NDArray[np.int64]:
    """Return the rows from *start* to before *stop*, int64[k], *without* some, bool[n]."""
    return start + np.flatnonzero(~without[start:stop])


def _repeats_itself(recording: Recording) -> Bools:
    """Mark rows in which the gyro says the same by itself: the highest and the lowest that it ever
    says, what it is held at whenever it is still, and all where it does not tremble.
    """
    code = recording.gyro_code
    if code is None or not np.isfinite(code).any():
        return np.zeros(len(recording.tick), dtype=np.bool_)
    if not trembles(code):
        return np.ones(len(recording.tick), dtype=np.bool_)
    held = code[1:-1][(code[1:-1] == code[2:]) & (code[1:-1] != code[:-2])]
    values, times = np.unique(held, return_counts=True)
    often = values[times >= max(_HELD_OFTEN, 0.5 * len(held))]
    return np.asarray((code == np.nanmax(code)) | (code == np.nanmin(code)) | np.isin(code, often))


def _beyond_chance(lengths: list[int], chances: int) -> int:
    """Return the shortest run that chance does not make, given how often payloads repeat once.

    A payload of a few noisy bits says the same twice now and then.
    """
    singles = lengths.count(1)
    again = min((singles + 1) / max(chances, 1), 0.9)
    if singles <= 1:
        return 1
    return max(1, math.ceil(math.log(_BY_CHANCE / max(chances, 1)) / math.log(again)))


def _in_steps(counts: Floats) -> Floats:
    """Return counts in the steps in which they come: read ten times too large, a slow wheel's would
    leap by ten."""
    step = lattice_step(counts)
    return counts / step if step >= _LEAST_STEP else counts


def _speed(wheels: Sequence[Floats]) -> Floats:
    """Return counts per tick of both wheels, over a few ticks either side; 0 below one."""
    steps = [np.abs(np.nan_to_num(np.diff(counts, prepend=np.nan))) for counts in wheels]
    total = np.sum(steps, axis=0)
    smooth = np.convolve(total, np.ones(9) / 9, mode="same")
    return np.where(smooth >= 2.0, smooth, 0.0)


def _leaps(wheels: Sequence[Floats], last: int, fresh: int, length: int) -> bool:
    """Tell whether the wheels went on during rows last to fresh, standing still or not.

    About as fast as midway between before and after: they may just have begun to turn. Of a message
    that comes oftener than the rows, whose repeats may lie within one, from there to the next.
    """
    fresh = max(fresh, min(last + 1, len(wheels[0]) - 1))
    moved = 0.0
    usual = 0.0
    for wheel in wheels:
        for around in (
            wheel[max(last - _USUAL_ROWS, 0) : last + 1],
            wheel[fresh:][: _USUAL_ROWS + 1],
        ):
            # Another leap close by is no speed.
            usual += 0.5 * float(np.median(np.abs(np.diff(around)))) if len(around) > 1 else 0.0
        moved += float(np.abs(wheel[fresh] - wheel[last]))
    # A slow wheel shows the same count twice by itself, a steady one the same speed; neither leaps.
    sure = length >= SURE_LENGTH
    is_fast = usual >= (2.0 if sure else 8.0) or (sure and moved >= _A_LEAP)
    return bool(is_fast and moved > 0.6 * usual * (fresh - last))


def _speed_steps(counts: Floats) -> Floats:
    """Return speeds that were added up to counts, in steps of their signal."""
    speed = np.diff(counts, append=counts[-1:])
    changes = np.abs(np.diff(speed))
    seen = changes[changes > _NO_CHANGE]
    # Each count is the mean of two speeds.
    return speed / (2.0 * float(seen.min())) if len(seen) else speed
