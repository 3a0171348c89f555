"""Angles without their jumps."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Floats = NDArray[np.float64]

_SAFE: Final = 45.0
"""Student's noise of three degrees of freedom makes a step of so many standard deviations about
once in 10^5 samples."""
_SAMPLES: Final = ((5.0, 7), (0.0, 15))
"""How many standard deviations a step of half a turn has at least, and how many samples are then
averaged before turns are counted: fewer blur a turning robot less."""
_LEAST: Final = 15
_SD_PER_MEDIAN: Final = 1.4826


def unwrapped(angle_rad: Floats) -> Floats:
    """Return angles without jumps of a turn; NaN stays NaN.

    From sample to sample, as long as noise alone, with heavy tails too, cannot make a step of half
    a turn; noisier ones about the direction of their neighbours' mean (Mardia and Jupp, Directional
    Statistics, 2.2).
    """
    result = angle_rad.copy()
    known = np.isfinite(result)
    values = result[known]
    half_turn_sd = math.pi / math.sqrt(2.0) / max(_noise_rad(values), 1e-9)
    if half_turn_sd > _SAFE:
        result[known] = np.unwrap(values)
        return result
    samples = next(count for least, count in _SAMPLES if half_turn_sd > least)
    cosine, sine = (uniform_filter1d(one, samples) for one in (np.cos(values), np.sin(values)))
    middle = np.unwrap(np.arctan2(sine, cosine))
    result[known] = middle + _within_half_a_turn(values - middle)
    return result


def _noise_rad(angle_rad: Floats) -> float:
    """Return the standard deviation of angles about a smooth course, by their second differences;
    nearly half a turn for angles that have none."""
    if len(angle_rad) < _LEAST:
        return 0.0
    bends = np.abs(_within_half_a_turn(np.diff(angle_rad, 2)))
    return _SD_PER_MEDIAN * float(np.median(bends)) / math.sqrt(6.0)


def _within_half_a_turn(angle_rad: Floats) -> Floats:
    return np.asarray((angle_rad + math.pi) % math.tau - math.pi, dtype=np.float64)
