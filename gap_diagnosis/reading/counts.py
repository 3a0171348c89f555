"""Wheel counters without their wraps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def unwrap_counts(reading: Floats, tick: Ints, period: float, fastest_per_tick: float) -> Floats:
    """Return wrapping readings as a running count, the first valid one being 0; NaN stays NaN.

    The step between two readings is the shortest one. Over a gap in which the fastest wheel could
    come more than half way round, it is the one nearest to what the speeds before and after say.

    Args:
        reading: float64[n], NaN where there is none.
        tick: int64[n], ascending.
        period: at which the readings begin again.
        fastest_per_tick: what the fastest wheel comes in a tick.
    """
    valid = np.flatnonzero(np.isfinite(reading))
    result = np.full(len(reading), np.nan)
    if len(valid) == 0:
        return result
    values, at = reading[valid], tick[valid]
    elapsed = np.diff(at)
    steps = _nearest(np.diff(values), np.zeros(len(elapsed)), period)
    for gap in np.flatnonzero((elapsed > 1) & (elapsed * fastest_per_tick >= period / 2)):
        speeds = [
            steps[near] / elapsed[near]
            for near in (gap - 1, gap + 1)
            if 0 <= near < len(steps) and elapsed[near] * fastest_per_tick < period / 2
        ]
        expected = float(np.mean(speeds)) * elapsed[gap] if speeds else 0.0
        steps[gap] = _nearest(steps[gap], expected, period)
    result[valid] = np.concatenate(([0.0], np.cumsum(steps)))
    return result


def _nearest(step: Floats, expected: Floats | float, period: float) -> Floats:
    """Return the step, up to whole periods, that is nearest to the expected one."""
    away = step - expected
    half = period / 2
    return np.asarray(expected + (away + half) % period - half)
