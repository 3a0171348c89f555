"""A gyro that is told in steps wider than its noise: what they round off does not average out."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter

from gap_diagnosis.recording import Floats

_AROUND_S: Final = 1.0
_BENDS_ROWS: Final = 9
_MANY: Final = 200
"""Samples of a robot that turns, which show how much noise there is."""
_SAME_PART: Final = 0.25
"""Of a step: a robot that turns alike to this leaves its gyro the same remainder."""
_HARMONICS: Final = np.arange(1, 50)
_NOISE: Final = np.linspace(0.0, 1.5, 301)
"""Standard deviations of a sample, in steps."""


def variance_of_steps(
    rate_rad_s: Floats, step_rad_s: float, turn_rate_rad_s: Floats, tick_s: float
) -> Floats:
    """Return the variance [rad²/s²], float64[n], of each tick's rate by the steps it is told in, so
    that a sum over ticks is as unsure as it is.

    At one rate the remainder is the same each time: of all ticks that say the same while the robot
    turns alike, each takes its share. Noise that spreads a rate over several steps makes
    their mean right (non-subtractive dither; Widrow & Kollár 2008, *Quantization Noise*, ch. 19).

    *rate_rad_s* has no gaps, *turn_rate_rad_s* is about how fast the robot turns, float64[n] each;
    without a step, 0, there is no such variance.
    """
    if step_rad_s == 0.0:
        return np.zeros(len(rate_rad_s))
    code = np.rint((rate_rad_s - rate_rad_s[0]) / step_rad_s).astype(np.int64)
    turns = np.abs(turn_rate_rad_s) > step_rad_s
    left_over = _left_over(np.diff(code).astype(np.float64), turns, _AROUND_S / tick_s)
    visit = np.cumsum(np.diff(code, prepend=code[0]) != 0)
    turned = np.bincount(visit, turn_rate_rad_s) / np.bincount(visit)
    part = np.rint(turned[visit] / (_SAME_PART * step_rad_s)).astype(np.int64)
    part -= part.min()
    same = code * (part.max() + 1) + part
    _, kind, alike = np.unique(same, return_inverse=True, return_counts=True)
    return np.asarray(left_over * alike[kind] * step_rad_s**2)


def _left_over(changes: Floats, turns: NDArray[np.bool_], around: float) -> Floats:
    """Return the variance of a mean of codes, float64[n], in steps squared, that noise does not
    take away, from the changes between them, float64[n - 1].

    A noisy sample takes back what the one before took; a rate that rises or falls does not. How
    often, depends on where between two codes a rate lies: all of a robot that *turns*, bool[n],
    together tell, and no place is taken to have more noise than it shows itself.
    """
    own = changes - median_filter(changes, _BENDS_ROWS, mode="nearest")
    taken_back = np.concatenate(([0.0], -own[:-1] * own[1:], [0.0]))
    many = np.count_nonzero(turns) >= _MANY
    usual2 = float(np.mean(taken_back[turns])) if many else np.inf
    seen2 = np.minimum(gaussian_filter1d(taken_back, around, mode="nearest"), usual2)
    remainder2 = _remainder2(_NOISE)
    # A code is the rate, its noise and a remainder; of the remainder noise averages out a part.
    scatter2 = _NOISE**2 + remainder2[0] - remainder2
    return np.asarray(np.interp(seen2, scatter2, remainder2))


def _remainder2(noise: Floats) -> Floats:
    """Return the variance, float64[k], over all rates, of the mean of what rounding adds, in steps
    squared, of Gaussian noise [steps]: 1/12 without any."""
    order = _HARMONICS[:, np.newaxis]
    return np.asarray(
        np.sum(np.exp(-((2.0 * np.pi * order * noise) ** 2)) / (2.0 * (np.pi * order) ** 2), axis=0)
    )
