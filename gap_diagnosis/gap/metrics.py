"""Errors of a predicted path (or angle, or stamp) over windows, and their RMS.

The prediction is known at the ticks and interpolated to the stamps of what it is held against,
never the other way round. In each window only the start pose is estimated, from the first second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.gap.windows import Window
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.recording import Floats, FrameTimes

Complexes = NDArray[np.complex128]

_LEAST_STAMPS: Final = 20
_ALIGN_M: Final = 0.5  # without orientation: the way that tells the start heading


@dataclass(frozen=True)
class Path:
    """A trajectory: float64[n] each, ascending stamps, heading unwrapped or None."""

    t_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats | None


@dataclass(frozen=True)
class WindowErrors:
    """Errors window by window; windows without data are left out.

    Attributes:
        window: int64[w], each window's place in the sequence that was asked for.
        mean_square: float64[w], mean squared error of the samples after the alignment.
        end: float64[w, c], error at the window's end: predicted − measured.
    """

    window: Floats
    mean_square: Floats
    end: Floats

    @property
    def rms(self) -> float | None:
        """Root of the mean over windows; None without any."""
        if not len(self.mean_square):
            return None
        return math.sqrt(float(self.mean_square.mean()))

    def at(self, places: Floats) -> WindowErrors:
        """Return the errors of these windows only."""
        kept = np.isin(self.window, places)
        return WindowErrors(self.window[kept], self.mean_square[kept], self.end[kept])


@dataclass(frozen=True)
class PathErrors:
    """Position errors [m] (ends: forward, left of the window's start) and heading errors [rad]."""

    position: WindowErrors
    heading: WindowErrors | None


def path_errors(path: Path, measured: Path, windows: Sequence[Window]) -> PathErrors:
    """Return the errors of *path* (with headings) against *measured*.

    Turning and moving the whole of *measured* changes nothing. Where it has no orientation, the
    start heading comes from the positions of the first second, or of as much more as it takes to
    travel half a metre, half the window at most; a window that does not move a quarter of a metre
    until then is left out.
    """
    if path.heading_rad is None:
        raise ValueError("a predicted path has headings")
    position: list[tuple[int, float, Floats]] = []
    heading: list[tuple[int, float, Floats]] = []
    for place, window in enumerate(windows):
        first, stop = _samples(measured.t_s, window)
        if stop - first < 4:
            continue
        at_s = measured.t_s[first:stop]
        inside = slice(*np.searchsorted(path.t_s, [at_s[0], at_s[-1]]) + np.array([-1, 1]))
        inside = slice(max(inside.start, 0), inside.stop)
        x_m, y_m, predicted_rad = (
            np.interp(at_s, path.t_s[inside], values[inside])
            for values in (path.x_m, path.y_m, path.heading_rad)
        )
        known = int(np.searchsorted(at_s, window.align_s, side="right"))
        mine = x_m + 1j * y_m
        theirs = measured.x_m[first:stop] + 1j * measured.y_m[first:stop]
        if measured.heading_rad is None:
            known = known_by_way(mine, known)
            if np.abs(np.diff(mine[:known])).sum() < 0.5 * _ALIGN_M:
                continue
            turn = _procrustes(mine[:known], theirs[:known])
        else:
            turned = np.exp(1j * (measured.heading_rad[first:stop] - predicted_rad))
            turn = float(np.angle(turned[:known].sum()))
        if not 0 < known < len(at_s):
            continue
        # The measured path, turned and moved onto the predicted one, seen from its start.
        theirs = theirs * np.exp(-1j * turn)
        theirs = theirs + (mine[:known] - theirs[:known]).mean()
        off = (mine - theirs) * np.exp(-1j * predicted_rad[0])
        mean_square = float((np.abs(off[known:]) ** 2).mean())
        position.append((place, mean_square, np.array([off[-1].real, off[-1].imag])))
        if measured.heading_rad is not None:
            angle = unwrapped(np.angle(np.exp(1j * turn) / turned))
            heading.append((place, float((angle[known:] ** 2).mean()), angle[-1:]))
    return PathErrors(
        _errors(position, 2), None if measured.heading_rad is None else _errors(heading, 1)
    )


def series_errors(t_s: Floats, difference: Floats, windows: Sequence[Window]) -> WindowErrors:
    """Return the errors of a difference of two cumulated signals, float64[n], as of two angles.

    Its mean over each window's first second is taken off; samples that are not finite are left out.
    """
    good = np.isfinite(difference)
    t_s, difference = t_s[good], difference[good]
    found: list[tuple[int, float, Floats]] = []
    for place, window in enumerate(windows):
        first, stop = _samples(t_s, window)
        known = int(np.searchsorted(t_s[first:stop], window.align_s, side="right"))
        if not 0 < known < stop - first:
            continue
        values = difference[first:stop] - difference[first : first + known].mean()
        found.append((place, float((values[known:] ** 2).mean()), values[-1:]))
    return _errors(found, 1)


def stamp_errors(
    frames: FrameTimes,
    windows: Sequence[Window],
    *,
    clock_skew: float = 0.0,
    free_rate: bool = False,
) -> WindowErrors:
    """Return how far a message's stamps lie from its beat in each window [s].

    The beat is the tick counter (where it runs) or the order of arrival, in the described cycle
    times of a clock that is fast by *clock_skew*. Its start is the mean of the window's first
    second; with *free_rate* its rate is the log's own.
    """
    t_s, late_s = lateness(frames, clock_skew=clock_skew)
    if free_rate:
        number = _beats(frames)[np.argsort(frames.t_s, kind="stable")]
        late_s = late_s - np.polyval(np.polyfit(number, late_s, 1), number)
    return series_errors(t_s, late_s, windows)


def lateness(frames: FrameTimes, *, clock_skew: float = 0.0) -> tuple[Floats, Floats]:
    """Return a message's stamps in order, float64[f], and how late each is on its beat [s]."""
    order = np.argsort(frames.t_s, kind="stable")
    late_s = frames.t_s - _beats(frames) * frames.cycle_s / (1 + clock_skew)
    return frames.t_s[order], np.asarray(late_s[order])


def clock_skew_of(frames: Mapping[str, FrameTimes], t_s: Floats, kept: NDArray[np.bool_]) -> float:
    """Return by how much the sender's clock is fast, from the stamps in ticks that are *kept*.

    Args:
        frames: stamps by message.
        t_s: float64[n], ends of the ticks.
        kept: bool[n]; the median over the messages that have enough of them, 0 if none has.
    """
    skews = []
    for one in frames.values():
        place = np.clip(np.searchsorted(t_s, one.t_s), 0, len(t_s) - 1)
        seen = kept[place]
        if one.cycle_s > 0 and np.count_nonzero(seen) >= _LEAST_STAMPS:
            per_beat_s = float(np.polyfit(_beats(one)[seen], one.t_s[seen], 1)[0])
            skews.append(one.cycle_s / per_beat_s - 1)
    return float(np.median(skews)) if skews else 0.0


def drifting_share(frames: Mapping[str, FrameTimes]) -> float:
    """Return which share of the energy of how late all messages' stamps are goes away where the
    sender's clock has a rate of its own: 0 to 1, 0 if there are too few."""
    before = after = 0.0
    for one in frames.values():
        if one.cycle_s > 0 and len(one.t_s) >= _LEAST_STAMPS:
            t_s, late_s = lateness(one)
            before += float(np.sum((late_s - late_s.mean()) ** 2))
            after += float(np.sum((late_s - np.polyval(np.polyfit(t_s, late_s, 1), t_s)) ** 2))
    return 1.0 - after / before if before > 0.0 else 0.0


def _beats(frames: FrameTimes) -> Floats:
    """Return each stamp's number: by the tick counter where it runs, else by order of arrival."""
    counter = frames.counter
    if frames.modulo and (counter >= 0).all():
        ticks_per_cycle = max(float(np.median(np.diff(np.sort(counter)))), 1.0)
        return np.asarray((counter - counter.min()) / ticks_per_cycle)
    return np.arange(len(frames.t_s), dtype=np.float64)


def known_by_way(points: Complexes, known: int) -> int:
    """Return of how many of the first points (complex positions) the start heading is estimated.

    At least *known*; as many as it takes to travel half a metre, half of all points at most; two,
    as one point has no direction: of a car's fixes once a second each is the first of its second.
    """
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
    by_way = int(np.searchsorted(way, _ALIGN_M))
    return max(known, min(by_way, len(points) // 2), 2)


def _samples(t_s: Floats, window: Window) -> tuple[int, int]:
    return (
        int(np.searchsorted(t_s, window.start_s, side="left")),
        int(np.searchsorted(t_s, window.stop_s, side="right")),
    )


def _procrustes(mine: Complexes, theirs: Complexes) -> float:
    """Return the turn that takes *mine* to *theirs* (complex positions) with least squares."""
    cross = np.sum(np.conj(mine - mine.mean()) * (theirs - theirs.mean()))
    return float(np.angle(cross))


def _errors(rows: list[tuple[int, float, Floats]], width: int) -> WindowErrors:
    return WindowErrors(
        np.array([place for place, _, _ in rows], dtype=np.int64),
        np.array([mean_square for _, mean_square, _ in rows]),
        np.array([end for _, _, end in rows]).reshape(-1, width),
    )
