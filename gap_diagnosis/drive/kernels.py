"""Means over blocks of rows, and the whitening of the drive's residuals, compiled."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numba import njit

_TOGETHER: Final = 16
"""Variances multiplied before a logarithm is taken: it is dear, and so few do not underflow."""


@njit(cache=True, error_model="numpy")
def block_means(values: Any, used: Any, start: Any) -> Any:
    """Return the means of *values* float64[2, n] over the used rows of blocks: float64[2, m].

    Block i is rows start[i] to start[i + 1]; one without a used row is NaN.
    """
    blocks = start.size - 1
    means = np.full((2, blocks), np.nan)
    for wheel in range(2):
        for i in range(blocks):
            total, count = 0.0, 0
            for k in range(start[i], start[i + 1]):
                if used[wheel, k]:
                    total += values[wheel, k]
                    count += 1
            if count > 0:
                means[wheel, i] = total / count
    return means


@njit(cache=True, error_model="numpy")
def gains(
    seen: Any,
    count: Any,
    activity: Any,
    lost: Any,
    scatter: Any,
    dt_s: float,
    white: float,
    walk: float,
    spread: float,
    memory_s: float,
) -> Any:
    """Return what a filter that whitens cumulative signals does to every column alike.

    The error of a wheel's angle is white noise (standard deviation white/sqrt(count)) plus a random
    walk (*walk* per sqrt of a second, times activity) plus the integral of an Ornstein-Uhlenbeck
    rate error (standard deviation *spread* times activity, time constant *memory_s*), plus what
    counts *scatter* by chance.

    Args:
        seen: bool[2, m], which are observed. The first of each wheel sets the unknown start angle.
        count: float64[2, m], rows averaged in each.
        activity: float64[2, m], rate scale of the errors [rad/s].
        lost: bool[m], the angle is unknown again from this block on.
        scatter: float64[2, m], variance by chance since the block before.
        dt_s: time from block to block.
        white, walk, spread, memory_s: the levels.

    Returns float64[2, m] each: how a rate error moves the angle and how it fades until this block,
    how an innovation corrects both, and its scale (0: no innovation); then the log determinant.
    """
    blocks = seen.shape[1]
    flow, fade = np.zeros((2, blocks)), np.ones((2, blocks))
    angle_gain, rate_gain = np.zeros((2, blocks)), np.zeros((2, blocks))
    scale = np.zeros((2, blocks))
    keep = math.exp(-dt_s / memory_s)
    fresh = spread * spread * (1.0 - keep * keep)
    log_determinant = 0.0
    started = np.zeros(2, dtype=np.bool_)
    of_angle, of_both, of_rate = np.zeros(2), np.zeros(2), np.full(2, spread * spread)
    product, together = 1.0, 0
    for i in range(blocks):
        for wheel in range(2):  # both in one step: neither waits for the other
            g = activity[wheel, i]
            paa, pau, puu = of_angle[wheel], of_both[wheel], of_rate[wheel]
            if started[wheel]:
                f = g * memory_s * (1.0 - keep)
                flow[wheel, i], fade[wheel, i] = f, keep
                paa += 2.0 * f * pau + f * f * puu
                pau = keep * (pau + f * puu)
                puu = keep * keep * puu + fresh
                step = walk * g
                # what the rate error gains within the block also moves the angle
                within = spread * g * dt_s
                paa += step * step * dt_s + within * within * (1.0 - keep) * 0.667
                paa += scatter[wheel, i]
                if lost[i]:
                    started[wheel] = False
            if seen[wheel, i]:
                noise = white * white / count[wheel, i]
                if started[wheel]:
                    variance = paa + noise
                    product *= variance
                    together += 1
                    if together == _TOGETHER:
                        log_determinant += math.log(product)
                        product, together = 1.0, 0
                    scale[wheel, i] = 1.0 / math.sqrt(variance)
                    inverse = 1.0 / variance
                    ka, ku = paa * inverse, pau * inverse
                    angle_gain[wheel, i], rate_gain[wheel, i] = ka, ku
                    puu -= ku * pau
                    pau -= ka * pau
                    paa -= ka * paa
                else:
                    started[wheel] = True
                    paa, pau = noise, 0.0
                    angle_gain[wheel, i] = 1.0
            of_angle[wheel], of_both[wheel], of_rate[wheel] = paa, pau, puu
    log_determinant += math.log(product)
    return flow, fade, angle_gain, rate_gain, scale, log_determinant


@njit(cache=True, error_model="numpy")
def innovations(
    columns: Any, flow: Any, fade: Any, angle_gain: Any, rate_gain: Any, scale: Any
) -> Any:
    """Return the whitened columns float64[c, 2, m] of a filter with these `gains`."""
    kinds = columns.shape[0]
    blocks = columns.shape[2]
    out = np.empty((kinds, 2, blocks))
    for c in range(kinds):
        angle, error, angle_2, error_2 = 0.0, 0.0, 0.0, 0.0
        for i in range(blocks):  # both wheels in one step: neither waits for the other
            angle += flow[0, i] * error
            angle_2 += flow[1, i] * error_2
            innovation = columns[c, 0, i] - angle
            innovation_2 = columns[c, 1, i] - angle_2
            out[c, 0, i] = innovation * scale[0, i]
            out[c, 1, i] = innovation_2 * scale[1, i]
            angle += angle_gain[0, i] * innovation
            angle_2 += angle_gain[1, i] * innovation_2
            error = fade[0, i] * error + rate_gain[0, i] * innovation
            error_2 = fade[1, i] * error_2 + rate_gain[1, i] * innovation_2
    return out


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract"})
def products(rows: Any) -> Any:
    """Return the inner products of a few long rows, float64[c, n] with each other."""
    count, length = rows.shape
    made = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for k in range(length):
                total += rows[i, k] * rows[j, k]
            made[i, j] = made[j, i] = total
    return made
