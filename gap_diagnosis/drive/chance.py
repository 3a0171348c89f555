"""Counts that are lost, or come, one by one and by chance: by how much they scatter.

That is noise, whatever else a drive does: what it alone shows speaks neither for these effects nor
for others beside them, which took it up where it was no noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive.columns import Variant
from gap_diagnosis.drive.noise import IDEAL, Levels, Whitening, exact, marginal
from gap_diagnosis.drive.unlisted import Null

Floats = NDArray[np.float64]

BY_CHANCE: Final = frozenset({"extra_ticks", "missed_ticks"})
_SIZES: Final = 12
"""Of an effect so many are tried, even in the logarithm."""


def likeliest_scatter(null: Null, effects: Mapping[str, Sequence[Variant]]) -> Floats:
    """Return the variance of counts that effects add to each block's, float64[2, m], at the
    likeliest of their sizes and ways: zeros where counts that are as expected are likelier.

    One after the other: the next scatters by no more than what those before it leave.
    """
    scatter, moved = np.zeros(null.data.angle.shape), np.zeros(null.data.angle.shape)
    residual, nuisances = null.setting.columns({})[:1], null.setting.nuisances
    sd = null.setting.nuisance_sd[np.newaxis]
    every = [exact(null.levels), IDEAL]

    def likelihood(scattered: Floats, added: Floats) -> float:
        data = replace(null.data, scatter=scattered)
        columns = np.concatenate((residual - added, nuisances))
        found = []
        for logs in every:
            whitening = Whitening(data, Levels.of(logs, data.tick_rad))
            white = whitening.of(columns)
            gram = white @ white.T
            (met,) = marginal(gram[1:, 1:], gram[1:, 0], gram[0, 0], sd)
            found.append(float(met) - 0.5 * whitening.log_determinant)
        return max(found)

    most = likelihood(scatter, moved)
    for effect, ways in effects.items():
        best = scatter, moved
        for more, added in _tried(effect, ways):
            beside = scatter + more, moved + added
            likely = likelihood(*beside)
            if likely > most:
                best, most = beside, likely
        scatter, moved = best
    return scatter


def _tried(effect: str, ways: Sequence[Variant]) -> Iterator[tuple[Floats, Floats]]:
    """Yield what sizes of an effect add to the variance and to the angle of each block."""
    for way in ways:
        steps = _steps(way)
        (size,) = way.sizes
        for value in np.geomspace(size.tolerance, size.high, _SIZES).tolist():
            kept = 1.0 - value if effect == "missed_ticks" else 1.0
            for sign in (1.0,) if effect == "missed_ticks" else (-1.0, 1.0):
                yield (value * kept * way.data.tick_rad) * steps, sign * value * way.acting[0]


def _steps(way: Variant) -> Floats:
    """Return how far a unit of an effect moves each angle since the block seen before it:
    float64[2, m]."""
    steps = np.zeros(way.data.angle.shape)
    for wheel, seen in enumerate(way.data.seen):
        there = np.flatnonzero(seen)
        steps[wheel, there[1:]] = np.abs(np.diff(way.acting[0, wheel, there]))
    return steps
