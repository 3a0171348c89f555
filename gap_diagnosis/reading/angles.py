"""Angles without their jumps."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Floats = NDArray[np.float64]

_SAFE: Final = 45.0
"""Student's noise of three degrees of freedom makes a step of so many standard deviations three
times in a million."""
_AVERAGED: Final = ((5.0, 7, 7), (0.0, 15, 45))
"""Of how many standard deviations a step of half a turn is at least; how many samples are then
averaged before turns are counted, as fewer blur a turning robot less; and over how many it is told
how fast that turns."""
_FEW_SAMPLES: Final = 15
"""Fewer do not tell their noise."""
_FASTEST: Final = 95.0
"""Percentile of the turns in a window: whole turns counted too many are fewer."""
_SD_PER_MEDIAN: Final = 1.4826


def unwrapped(angle_rad: Floats) -> Floats:
    """Return angles without jumps of a turn; NaN stays NaN.

    From sample to sample, as long as noise alone, with heavy tails too, cannot make a step of half
    a turn; noisier ones about the direction of their neighbours' mean (Mardia and Jupp, Directional
    Statistics, 2.2), where they do not turn by half a turn themselves.
    """
    result = angle_rad.copy()
    known = np.isfinite(result)
    values = result[known]
    half_turn_sd = math.pi / math.sqrt(2.0) / max(_noise_rad(values), 1e-9)
    if half_turn_sd > _SAFE:
        result[known] = np.unwrap(values)
        return result
    samples, over = next(one for least, *one in _AVERAGED if half_turn_sd > least)
    if samples * _fastest_step_rad(values, over) > math.pi:
        result[known] = np.unwrap(values)
        return result
    cosine, sine = (uniform_filter1d(one, samples) for one in (np.cos(values), np.sin(values)))
    middle = np.unwrap(np.arctan2(sine, cosine))
    result[known] = middle + within_half_a_turn(values - middle)
    return result


def _noise_rad(angle_rad: Floats) -> float:
    """Return the standard deviation of angles about a smooth course, by their second differences;
    nearly half a turn for angles that have none."""
    if len(angle_rad) < _FEW_SAMPLES:
        return 0.0
    bends = np.abs(within_half_a_turn(np.diff(angle_rad, 2)))
    return _SD_PER_MEDIAN * float(np.median(bends)) / math.sqrt(6.0)


def _fastest_step_rad(angle_rad: Floats, over: int) -> float:
    """Return by how much angles turn from sample to sample, over so many, where they turn
    fastest."""
    steps = within_half_a_turn(np.diff(angle_rad))
    return float(np.percentile(np.abs(uniform_filter1d(steps, over)), _FASTEST))


def within_half_a_turn(angle_rad: Floats) -> Floats:
    """Return angles from -pi on and below pi."""
    return np.asarray((angle_rad + math.pi) % math.tau - math.pi, dtype=np.float64)
