"""What a log lacks: what can be put in its place, how surely, and where nothing can."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.recording import Floats

_SILENCE_S: Final = 0.1
_USUAL_TIMES: Final = 5.0
"""What is missing for longer than this, and so many times the usual, cannot be interpolated."""
_BENDS_S: Final = 0.5
_BENT_ROWS: Final = 2.0


def filled(values: Floats, t_s: Floats) -> Floats:
    """Return values with what is missing interpolated (counts and codes of lost frames)."""
    known = np.isfinite(values)
    if known.all():
        return np.asarray(values, dtype=np.float64)
    if not known.any():
        return np.zeros(len(values))
    return np.interp(t_s, t_s[known], values[known])


def unheld(values: Floats, t_s: Floats) -> Floats:
    """Return what a slow sensor measures between its frames: a held reading is late.

    Straight from the last row of a reading that was held to the next reading, over no more than
    the time between two of them.
    """
    known = filled(values, t_s)
    changes = np.flatnonzero(np.diff(known)) + 1
    if len(changes) < 2:
        return known
    held = int(np.diff(changes).min())
    before = np.maximum(changes - held, 0)
    rows = np.concatenate([[0], before, changes, [len(known) - 1]])
    readings = np.concatenate([known[:1], known[changes - 1], known[changes], known[-1:]])
    order = np.lexsort((np.arange(len(rows)), rows))
    rows, readings = rows[order], readings[order]
    last = np.append(np.diff(rows) > 0, True)
    return np.asarray(np.interp(t_s, t_s[rows[last]], readings[last]))


def between(counts: Floats, t_s: Floats) -> Floats:
    """Return counts with those of lost rows where a wheel that changes its speed was."""
    known = np.isfinite(counts)
    if known.all() or known.sum() < 2:
        return filled(counts, t_s)
    inside = np.clip(t_s, *t_s[known][[0, -1]])
    return np.where(known, counts, PchipInterpolator(t_s[known], counts[known])(inside))


def silences(values: Floats, t_s: Floats) -> NDArray[np.bool_]:
    """Mark, bool[n], what is missing for so long that it cannot be interpolated."""
    missing = ~np.isfinite(values)
    usual_s = np.diff(t_s[~missing])
    if not missing.any() or len(usual_s) == 0:
        return np.zeros(len(values), dtype=np.bool_)
    longest_s = longest_gap_s(usual_s)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
    silent = np.zeros(len(values), dtype=np.bool_)
    for first, stop in edges.reshape(-1, 2):
        last = min(stop, len(t_s) - 1)
        silent[first:stop] = t_s[last] - t_s[max(first - 1, 0)] > longest_s
    return silent


def longest_gap_s(steps_s: Floats) -> float:
    """Return how long nothing may be missing, where samples come at these steps [s], for what lies
    between to be interpolated."""
    return max(_SILENCE_S, _USUAL_TIMES * float(np.median(steps_s)))


def variance_of_filled(rate: Floats | None, t_s: Floats) -> Floats:
    """Return the variance [rad²/s²], float64[n], of rates that were interpolated; 0 where known.

    The rates around say how well a straight line over so many ticks tells those between.
    """
    found = np.zeros(len(t_s))
    if rate is None:
        return found
    missing = ~np.isfinite(rate)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
    firsts, counts = edges[::2], np.diff(edges)[::2]
    for count in np.unique(counts):
        half = int(count) // 2 + 1
        if 2 * half >= len(rate):
            continue
        bend = np.full(len(rate), np.nan)
        bend[half:-half] = rate[half:-half] - 0.5 * (rate[: -2 * half] + rate[2 * half :])
        told = np.isfinite(bend)
        width = _BENDS_S / float(np.median(np.diff(t_s)))
        square = gaussian_filter1d(np.where(told, bend, 0.0) ** 2, width)
        share = gaussian_filter1d(told.astype(np.float64), width)
        local = square / np.maximum(share, 1e-3)
        for first in firsts[counts == count]:
            # They are off together: of *count* rates the sum is off by so many times one.
            found[first : first + count] = count * local[first : first + count]
    return found


def variance_of_moments(rate: Floats, t_s: Floats, noise2: float) -> Floats:
    """Return the variance [rad²/s²], float64[n], of a tick's mean rate if samples are of a moment.

    A row of a table does not say. Where the rate bends within a tick (beyond its noise of variance
    *noise2*), the mean is off the straight line between samples by up to a quarter of the bend.
    """
    known = filled(rate, t_s)
    bend = np.zeros(len(rate))
    bend[1:-1] = known[1:-1] - 0.5 * (known[:-2] + known[2:])
    around = gaussian_filter1d(bend**2, _BENT_ROWS) - 1.5 * noise2
    return np.asarray(np.maximum(around, 0.0) / 16.0)
