"""How a trial's reference errs: as the likelihood assumes, and in ways that it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from gap_diagnosis.motion.levels import FLOORS
from gap_diagnosis.motion.whitening import LEVELS, OF_ROWS
from gap_diagnosis.scoring import LevelPrior

Floats = NDArray[np.float64]
Draw = np.random.Generator

FAMILIAR: Final = ("white",)
FRESH: Final = ("occlusions", "shaking")
"""Nothing but a trial has these, as `drives.FRESH`."""
NEW: Final = ("heavy_tails", "correlated", "steps_in_level", *FRESH)
"""Not used while the diagnosis was developed: scored apart."""

_FREEDOM: Final = 3.0
_OCCLUDED: Final = 0.05
"""Of its samples a reference takes so many with fewer cameras, and is off by"""
_TIMES_WORSE: Final = 4.0
"""times as much there, for"""
_OCCLUDED_S: Final = 0.5
"""at a time, on average."""
_SHAKES_HZ: Final = (3.0, 9.0)
"""A marker on a mast swings between these rates."""
_AS_BELIEVED: Final = frozenset(
    {"inexact", "slip_wander", "speed_noise", "speed_noise_s", *OF_ROWS}
)
"""Not drawn: a trial's effects are exact, its wheels slip at random, it has no speeds, and its rows
have a clock of their own."""
_RATES_HZ: Final = (50.0, 100.0, 120.0)


@dataclass(frozen=True)
class ReferenceLevels:
    """How well the reference of a case measures.

    Attributes:
        kind: of `FAMILIAR` or `NEW`.
        position_m, heading_rad: standard deviations of one sample.
        slow_position_m, slow_heading_rad: of a slow error on top (first-order Gauss-Markov).
        correlation_s: of the slow error; for "correlated" of the whole.
        rate_hz: samples a second.
        stamp_s: by which a sample's stamp is off, standard deviation.
    """

    kind: str
    position_m: float
    heading_rad: float
    slow_position_m: float
    slow_heading_rad: float
    correlation_s: float
    rate_hz: float
    stamp_s: float = 0.0


def draw_levels(kind: str, draw: Draw) -> ReferenceLevels:
    """Return the levels of a good motion capture room, none of them news to the diagnosis."""
    return ReferenceLevels(
        kind=kind,
        position_m=float(np.exp(draw.uniform(math.log(2e-4), math.log(1e-3)))),
        heading_rad=float(np.exp(draw.uniform(math.log(2e-4), math.log(1e-3)))),
        slow_position_m=float(draw.uniform(1e-4, 5e-4)),
        slow_heading_rad=float(draw.uniform(1e-4, 5e-4)),
        correlation_s=float(draw.uniform(0.5, 2.0)),
        rate_hz=float(draw.choice(_RATES_HZ)),
        stamp_s=float(np.exp(draw.uniform(math.log(3e-5), math.log(3e-3)))),
    )


def believed_levels(kind: str, believed: LevelPrior, draw: Draw) -> ReferenceLevels:
    """Return levels as the diagnosis believes them to be beforehand: log-normal about its medians.

    In stratum *prior* its probabilities are held to account, and a reference that is noisy for want
    of a better one is what speaks against a noise that is news.
    """
    varies = np.array([name not in _AS_BELIEVED for name in LEVELS])
    scores = np.zeros(len(LEVELS))
    scores[varies] = draw.standard_normal(int(varies.sum()))
    logs = np.log(believed.median) + believed.spread * scores
    level = dict(zip(LEVELS, np.maximum(np.exp(logs), FLOORS), strict=True))
    return ReferenceLevels(
        kind=kind,
        position_m=float(level["reference_position_m"]),
        heading_rad=float(level["reference_heading_rad"]),
        slow_position_m=float(level["reference_slow_position_m"]),
        slow_heading_rad=float(level["reference_slow_heading_rad"]),
        correlation_s=float(level["reference_slow_s"]),
        rate_hz=float(draw.choice(_RATES_HZ)),
        stamp_s=float(level["reference_stamp_s"]),
    )


def reference_errors(
    time_s: Floats, levels: ReferenceLevels, draw: Draw, *, position: bool, heading: bool
) -> Floats:
    """Return float64[n, 3] to be added to the true poses at times.

    Without *position* or *heading* these columns are zero: an effect states their noise.
    """
    found = np.zeros((len(time_s), 3))
    columns = (
        (levels.position_m, levels.slow_position_m, position),
        (levels.position_m, levels.slow_position_m, position),
        (levels.heading_rad, levels.slow_heading_rad, heading),
    )
    change = int(len(time_s) * draw.uniform(0.3, 0.7))
    factor = float(draw.uniform(2.0, 4.0))
    for column, (white, slow, wanted) in enumerate(columns):
        fast = _fast(len(time_s), levels, draw)
        if levels.kind == "steps_in_level":
            fast[change:] *= factor
            fast /= math.sqrt((1 + factor**2) / 2)
        wandering = _wandering(len(time_s), levels, draw)
        if wanted:
            found[:, column] = white * fast + slow * wandering
    return found


def _fast(count: int, levels: ReferenceLevels, draw: Draw) -> Floats:
    """Return errors of unit variance."""
    if levels.kind == "heavy_tails":
        scale = math.sqrt((_FREEDOM - 2) / _FREEDOM)
        return np.asarray(draw.standard_t(_FREEDOM, count) * scale)
    if levels.kind == "correlated":
        return _wandering(count, levels, draw, share=0.1)
    if levels.kind == "occlusions":
        worse = np.where(_occluded(count, levels.rate_hz, draw), _TIMES_WORSE, 1.0)
        return np.asarray(draw.standard_normal(count) * worse / math.sqrt(np.mean(worse**2)))
    if levels.kind == "shaking":
        turns = np.arange(count) / levels.rate_hz * draw.uniform(*_SHAKES_HZ) + draw.random()
        return np.asarray(np.sin(math.tau * turns) + draw.standard_normal(count) / math.sqrt(2))
    return draw.standard_normal(count)


def _occluded(count: int, rate_hz: float, draw: Draw) -> NDArray[np.bool_]:
    """Return which samples were taken with fewer cameras: a chain of two states."""
    ends = 1.0 / max(_OCCLUDED_S * rate_hz, 1.0)
    begins = ends * _OCCLUDED / (1.0 - _OCCLUDED)
    chance = draw.random(count)
    occluded = np.zeros(count, dtype=np.bool_)
    now = False
    for place in range(count):
        now = bool(chance[place] >= ends) if now else bool(chance[place] < begins)
        occluded[place] = now
    return occluded


def _wandering(count: int, levels: ReferenceLevels, draw: Draw, share: float = 1.0) -> Floats:
    """Return a first-order Gauss-Markov process of unit variance."""
    kept = math.exp(-1.0 / (levels.rate_hz * levels.correlation_s * share))
    normals = draw.standard_normal(count)
    normals[1:] *= math.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], normals), dtype=np.float64)
