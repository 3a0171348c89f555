"""Wheel speeds added up to counts, and how sure each step of them is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from gap_diagnosis.lattice import step_of_values

Floats = NDArray[np.float64]

_BENT_ROWS: Final = 2.0
_JUMP: Final = 5.0
"""A wheel that always starts with so many times what it gains in the next row is not told before:
no wheel leaps."""
_LEAST_SPEEDS: Final = 3.0
"""A wheel that is told at so many times the least speed does not creep from there to its stop."""
_STEADY_ROWS: Final = 3.0
_SPREAD: Final = 2.5
"""Of the signal's step: what spreads over more of them is rounded otherwise in each row."""
_SLOPE_S: Final = 0.3
_LONGEST_S: Final = 1.0
_UNSURE: Final = 0.5
_SETTLES_S: Final = 1.0
"""The slowest loop of a wheel that many tune: a judgement;"""
_SETTLED: Final = 4.0
"""after so many times that it stands."""
_SPEAKS_ROWS: Final = 8
"""So near to a speed that is told a 0 is one, and has as much noise: of noise that a step rounds
off to 0 most of the time so many in a row are rare."""
_GAP_ROWS: Final = 1.5
"""Between rows that are further apart than so many usual ones one was lost."""
_EVEN_S: Final = 0.7
"""A small robot seldom goes as fast for longer."""
_FEWEST_ROWS: Final = 16
_MOST_ROWS: Final = 64
_CLOSE_S: Final = 0.03
"""Of a wheel's speeds: closer to one another they bend by little."""
_WHOLE: Final = 0.02
_NEARLY_ALL: Final = 0.98
_SEVERAL: Final = (2, 3, 5, 7)
"""Counts that come in so many at a time, always, are of a part of a row."""
_LEAST_WHOLE: Final = 50
"""Of so many steps hardly any would be as near to whole ticks by chance: one in 25 is."""
_ROUNDED: Final = 0.2
"""Ticks: by less are whole steps off that were rounded once more, and their changes by less than
twice that;"""
_LEAST_CHANGES: Final = 100
"""of so many, all but two are so near to whole ones by one chance in ten million."""


@dataclass(frozen=True)
class AddedUp:
    """A wheel's way from its speeds.

    Attributes:
        ticks: float64[n], running count; NaN where there is no speed.
        unsure_ticks2: float64[n], variance of the step that ends at each row.
        half_row_ticks: float64[n], what the count has more where speeds are means since the row
            before.
        is_counted: the speeds are differences of counts, which `ticks` then are.
    """

    ticks: Floats
    unsure_ticks2: Floats
    half_row_ticks: Floats
    is_counted: bool = False


def integrated_speed(
    speed: Floats, time_s: Floats, *, scale: float, other: Floats | None = None
) -> AddedUp:
    """Return the running count that wheel speeds, float64[n], add up to (a gap is bridged).

    While the *other* wheel turns, this one may turn by less than a step of its signal and say 0;
    where that says 0 as well the robot stands.

    Trapezoids. What they do not know: where a speed bends within a row (nothing says whether it is
    of the moment), what a step of the signal rounds off for as long as it says the same, how far a
    wheel crept that is too slow for its sensor, and what the noise of speeds adds up to.
    """
    valid = np.flatnonzero(np.isfinite(speed))
    ticks, unsure, half = np.full(len(speed), np.nan), np.zeros(len(speed)), np.zeros(len(speed))
    if len(valid) < 3:
        ticks[valid] = 0.0
        return AddedUp(ticks, unsure, half)
    told, t_s = speed[valid], time_s[valid]
    apart_s = np.diff(t_s, prepend=t_s[0])
    counted = _counts(told * scale, apart_s)
    if counted is not None:
        ticks[valid] = counted
        return AddedUp(ticks, unsure, half, is_counted=True)
    crept = _crept(told, t_s)
    every = told + crept
    usual_s = float(np.median(apart_s[1:]))
    speaks = maximum_filter1d(told != 0.0, 2 * _SPEAKS_ROWS + 1)
    noise2 = np.where(speaks, _noise2(told, usual_s), 0.0)
    is_led = told != 0.0 if other is None else (told != 0.0) | (np.nan_to_num(other[valid]) != 0.0)
    rounded2 = np.where(is_led, _rounded2(told, is_led), _unsettled2(is_led, told, t_s))
    variance = (_bends2(every) + np.maximum(rounded2, noise2)) * apart_s**2
    # What crept in one go is off together.
    for first, stop in _runs(crept != 0.0):
        way = float(np.sum((crept * apart_s)[first:stop]))
        variance[first:stop] += (_UNSURE * way) ** 2 / (stop - first)
    steps = 0.5 * (every + np.append(every[0], every[:-1])) * apart_s
    ticks[valid] = np.cumsum(steps) * scale
    unsure[valid] = variance * scale**2
    # A mean after a gap goes back no further than elsewhere.
    over_s = np.where(apart_s > _GAP_ROWS * usual_s, usual_s, apart_s)
    half[valid] = np.cumsum(0.5 * np.diff(every, prepend=every[0]) * over_s) * scale
    return AddedUp(ticks, unsure, half)


def _counts(ticks_per_s: Floats, apart_s: Floats) -> Floats | None:
    """Return the counts, float64[n], of which speeds are the differences; None where they are not.

    From row to row, backwards or forwards: a row more or less is a delay, which nothing tells. Or
    of the row before and the row after, with those of one side at the ends.
    """
    usual_s = float(np.median(apart_s[1:]))
    for steps in (ticks_per_s * np.where(apart_s > 0.0, apart_s, usual_s), ticks_per_s * usual_s):
        if (_are_whole(steps) or _are_rounded(steps)) and _are_single(steps):
            return np.asarray(np.cumsum(np.round(steps)))
        across_two = _are_whole(2.0 * steps) and _are_whole(steps[[0, -1]], least=0)
        if across_two and _are_single(2.0 * steps):
            counts = np.zeros(len(steps))
            counts[1] = np.round(steps[0])
            across = np.round(2.0 * steps[1:-1])
            for first in (0, 1):
                chain = np.concatenate([[counts[first]], across[first::2]])
                counts[first::2] = np.cumsum(chain)[: len(counts[first::2])]
            return counts
    return None


def _are_whole(steps: Floats, least: int = _LEAST_WHOLE) -> bool:
    """Tell whether steps, of which *least* are none, are whole numbers."""
    moved = steps[np.abs(steps) > 0.5]
    off = np.abs(moved - np.round(moved))
    return len(moved) >= least and bool(np.mean(off < _WHOLE) >= _NEARLY_ALL if len(off) else True)


def _are_single(steps: Floats) -> bool:
    """Tell whether whole steps differ by single counts: what comes in twos, threes or fives was
    counted over a shorter time than a row, and says nothing of the rest of it."""
    moved = np.round(steps[np.abs(steps) > 0.5])
    return all(np.mean(moved % several == 0) < _NEARLY_ALL for several in _SEVERAL)


def _are_rounded(steps: Floats) -> bool:
    """Tell whether steps are whole numbers but for what their signal rounds off.

    A steady wheel's steps may happen to lie near one whole number, but counts go from one to
    another all the time.
    """
    moved = steps[np.abs(steps) > 0.5]
    changes = np.diff(steps)
    changes = changes[np.abs(changes) > 0.5]
    if len(changes) < _LEAST_CHANGES:
        return False
    off = float(np.quantile(np.abs(moved - np.round(moved)), _NEARLY_ALL))
    apart = float(np.quantile(np.abs(changes - np.round(changes)), _NEARLY_ALL))
    return max(off, 0.5 * apart) < _ROUNDED


def _crept(told: Floats, t_s: Floats) -> Floats:
    """Return the speeds that a sensor with a least speed does not tell, float64[n].

    A wheel slows down to its stop as it slowed down before, and starts likewise.
    """
    moves = told != 0.0
    crept = np.zeros(len(told))
    starts = np.flatnonzero(~moves[:-1] & moves[1:]) + 1
    stops = np.flatnonzero(moves[:-1] & ~moves[1:])
    ends = [(at, 1) for at in starts] + [(at, -1) for at in stops]
    if not ends:
        return crept
    rows = max(1, round(_SLOPE_S / float(np.median(np.diff(t_s)))))
    inside = [(at, way) for at, way in ends if 0 <= at + way * rows < len(told)]
    gains = [abs(told[at + way] - told[at]) for at, way in inside]
    first = float(np.median([abs(told[at]) for at, _ in ends]))
    if not gains or first < _JUMP * float(np.median(gains)):
        return crept
    for at, way in inside:
        if abs(told[at]) > _LEAST_SPEEDS * first:
            continue  # so fast a wheel was told: it says nothing for another reason
        away = way * rows
        slope = (abs(told[at + away]) - abs(told[at])) / abs(t_s[at + away] - t_s[at])
        lasts_s = min(abs(told[at]) / max(slope, 1e-9), _LONGEST_S)
        row = at - way
        while 0 <= row < len(told) and not moves[row] and crept[row] == 0.0:
            left = 1.0 - abs(t_s[row] - t_s[at]) / lasts_s
            if left <= 0.0:
                break
            crept[row] = left * told[at]
            row -= way
    return crept


def _bends2(speed: Floats) -> Floats:
    """Return the variance of a row's mean speed where its speed bends, float64[n].

    It is off the straight line between two readings of a moment by up to a quarter of the bend.
    """
    bend = np.zeros(len(speed))
    bend[1:-1] = speed[1:-1] - 0.5 * (speed[:-2] + speed[2:])
    return np.asarray(gaussian_filter1d(bend**2, _BENT_ROWS) / 16.0)


def _noise2(speed: Floats, row_s: float) -> float:
    """Return the variance of that noise of a speed which adds up.

    What counts are rounded by does not: of their differences each takes back what the one before
    took. White noise of variance s² and differences of white noise of variance q² give second
    differences of variance 6 s² + 20 q², and from one to the next -4 s² - 15 q².
    """
    many = min(max(round(_EVEN_S / row_s), _FEWEST_ROWS), _MOST_ROWS)
    rows = speed[: len(speed) // many * many].reshape(-1, many)
    rows = rows[np.all(rows != 0.0, axis=1)]
    if len(rows) == 0:
        return 0.0
    is_seldom = row_s > _CLOSE_S
    if is_seldom:
        # Where a robot speeds up or slows down, what bends is its way.
        first, second = rows[:, : many // 2], rows[:, many // 2 :]
        changes = np.abs(second.mean(axis=1) - first.mean(axis=1))
        rows = rows[changes <= np.median(changes)]
    bends = np.diff(rows, 2, axis=1)
    shared = np.mean(bends[:, 1:] * bends[:, :-1], axis=1)
    found = 1.5 * np.mean(bends**2, axis=1) + 2.0 * shared
    # From one row to the next that is close a way bends by less than counts are rounded by: of that
    # all rows are needed to tell noise, and a start among them is left out by the median.
    return max(float(np.mean(found) if is_seldom else np.median(found)), 0.0)


def _rounded2(told: Floats, is_led: NDArray[np.bool_]) -> Floats:
    """Return the variance of a row's speed by the signal's step, float64[n], where the robot *is
    led* anywhere.

    While a wheel turns as fast, to a step of its signal, it is off by the same: of so many rows
    each takes its share. That a value between two steps is told now as the one and now as the
    other does not make up for it, unless noise spreads it over several.
    """
    changes = np.abs(np.diff(told))
    moving = changes[changes > 0.0]
    if len(moving) == 0:
        return np.zeros(len(told))
    step = float(np.quantile(moving, 0.01))
    same = np.cumsum(np.concatenate(([True], (changes > 0.0) | np.diff(is_led)))) - 1
    lengths = np.bincount(same)[same]
    smooth = gaussian_filter1d(told, _STEADY_ROWS, mode="nearest")
    first = 0
    for stop in range(1, len(told) + 1):
        if stop < len(told) and abs(smooth[stop] - smooth[first]) < step:
            continue
        if np.ptp(told[first:stop]) < _SPREAD * step:
            lengths[first:stop] = np.maximum(lengths[first:stop], stop - first)
        first = stop
    return np.asarray(lengths * step**2 / 12.0)


def _unsettled2(is_led: NDArray[np.bool_], told: Floats, t_s: Floats) -> Floats:
    """Return the variance of a row's speed, float64[n], after the robot came to rest.

    A loop with an integral lets it creep to its place, by less than half a step of its signal and
    ever less, all in one direction: a row takes its share of as many as that lasts.
    """
    led_s = np.maximum.accumulate(np.where(is_led, t_s, -np.inf))
    since_s = t_s - led_s
    most = np.where(since_s < _SETTLED * _SETTLES_S, np.exp(-since_s / _SETTLES_S), 0.0)
    lasts_rows = _SETTLES_S / float(np.median(np.diff(t_s)))
    return np.asarray((0.5 * step_of_values(told) * most) ** 2 * lasts_rows)


def _runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return first and past-the-last index of each run of true: int64[r, 2]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return edges.reshape(-1, 2)
