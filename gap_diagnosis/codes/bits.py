"""Stuck bits and missing codes: gaps in a histogram that should be smooth.

Low bits: where codes are densely visited, both halves of each cell of the bit should be; a missing
half is weighed with a generously overdispersed share. High bits: the wheels say which code to
expect, and a stuck bit shows it short or long by exactly the bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln

from gap_diagnosis.code_spells import held_bit
from gap_diagnosis.codes.data import CodeData, stretches

Floats = NDArray[np.float64]

_SHARE: Final = 2.0
"""Of a cell's halves: Beta(2, 2)."""
_ALIKE: Final = 20.0
"""Of two codes next to each other: Beta(20, 20), one is 1.4 times as usual as the other (1 sd)."""
_COARSE: Final = 0.1
"""Prior probability of a sensor that is coarser than its converter."""
_COARSE_ODD: Final = 0.01
_CELL_NATS: Final = 6.0
_EXCURSION_NATS: Final = 6.0
_LEAST_CELLS: Final = 3
_MOST_CELLS: Final = 40
_DENSE: Final = 0.8


@dataclass(frozen=True)
class Stuck:
    """How much better codes are explained by one stuck bit, in these rows alone if any."""

    bit: int
    value: int
    log_ratio: float
    rows: tuple[int, int] | None = None


def stuck_bits(data: CodeData) -> list[Stuck]:
    """Return a log likelihood ratio for each bit and value, all along or in the part of the log in
    which the codes have it; -inf where they contradict it."""
    found = _stuck_bits(data)
    for place, one in enumerate(found):
        rows = held_bit(data.code, one.bit, one.value) if one.log_ratio == -math.inf else None
        if rows is None:
            continue
        within = _stuck_bits(data.rows(*rows))[place].log_ratio - math.log(len(data.code))
        if within > 0.0:
            found[place] = Stuck(one.bit, one.value, within, rows)
    return found


def _stuck_bits(data: CodeData) -> list[Stuck]:
    codes = data.code.astype(np.int64)
    unique, counts = np.unique(codes, return_counts=True)
    coarse = _coarse_bits(unique)
    found = []
    for bit in range(data.bits):
        has = unique >> bit & 1
        for value in (0, 1):
            if not np.all(has == value):
                found.append(Stuck(bit, value, -math.inf))
                continue
            ratio = 0.0
            if bit < coarse:
                # All lower bits stand still as well: a coarse sensor says as much of it.
                told = _cells(unique, counts, bit, value)
                chance = _COARSE if value == 0 else _COARSE_ODD
                ratio = min(told, -math.log(chance)) if bit == 0 else 0.0
            else:
                ratio = max(_cells(unique, counts, bit, value), _excursions(data, bit, value))
            found.append(Stuck(bit, value, ratio))
    return found


def _coarse_bits(unique: NDArray[np.int64]) -> int:
    """Return how many of the lowest bits never change."""
    changed = int(np.bitwise_or.reduce(unique ^ unique[0]))
    return (changed & -changed).bit_length() - 1 if changed else 64


def _cells(unique: NDArray[np.int64], counts: NDArray[np.int64], bit: int, value: int) -> float:
    """Return the evidence of missing halves in cells that lie in a densely visited region."""
    cell, first = np.unique(unique >> (bit + 1), return_index=True)
    told = np.add.reduceat(counts, first)
    visited = np.diff(np.concatenate((first, [len(unique)])))
    dense = visited >= max(1.0, _DENSE * min(2**bit, 16))
    inside = np.zeros(len(cell), dtype=np.bool_)
    inside[1:-1] = (cell[1:-1] - cell[:-2] == 1) & (cell[2:] - cell[1:-1] == 1)
    use = inside & dense & (told >= 4)
    if np.count_nonzero(use) < _LEAST_CELLS:
        return 0.0
    n = told[use].astype(np.float64)
    gains = np.sort(np.minimum(_missed(n, _SHARE), _CELL_NATS))[::-1]
    return float(np.sum(gains[:_MOST_CELLS]))


def _excursions(data: CodeData, bit: int, value: int) -> float:
    """Return the evidence of stretches in which the expected code lacks what the bit adds."""
    size = float(1 << bit)
    if size < 8 * data.spread:
        return 0.0
    margin = min(4 * data.spread, size / 4)
    whole = np.nan_to_num(data.expected, nan=data.zero_code)
    inside = np.mod(whole, 2 * size)
    other = (inside > margin) & (inside < size - margin)
    if value == 0:
        other = (inside > size + margin) & (inside < 2 * size - margin)
    forced = whole + (size if value else -size)
    as_forced = other & (np.abs(data.code - forced) < margin)
    against = other & ~as_forced
    long = [one for one in stretches(as_forced) if one[1] - one[0] >= 5]
    if np.count_nonzero(against) > 0.3 * np.count_nonzero(other):
        return 0.0
    return _EXCURSION_NATS * len(long)


def missing_codes(code: Floats) -> tuple[Floats, Floats]:
    """Return interior codes and the log likelihood ratio of each being missing.

    A missing code is never seen and the next higher one stands for it. Of the n readings of both
    each would have been either, as likely: none is the lower one with a chance of 2^-n, or with
    that of a beta-binomial law where the two are alike only about (Johnson, Kotz and Kemp 1992,
    Univariate discrete distributions, section 6.2.2). A code is not less usual than its neighbours
    on both sides, so n counts as no more than what these had.
    """
    codes = code.astype(np.int64)
    low = int(codes.min())
    if int(codes.max()) - low > 1 << 20:
        return np.zeros(0), np.zeros(0)
    counts = np.bincount(codes - low).astype(np.float64)
    if len(counts) < 8:
        return np.zeros(0), np.zeros(0)
    here, after = counts[2:-2], counts[3:-1]
    about = (counts[:-4] + counts[1:-3] + counts[4:]) / 3
    known = np.minimum(after, 2 * np.minimum(counts[1:-3], counts[4:]))
    ratio = _missed(known, _ALIKE)
    beside = (counts[1:-3] > 0) & (counts[4:] > 0)
    ratio = np.where((here == 0) & (about > 2) & beside, ratio, -np.inf)
    visited = counts[2:-2] > 0
    if np.mean(visited[about > 4]) < 0.97 if np.any(about > 4) else True:
        ratio[:] = -np.inf  # a comb: a coarse sensor or a stuck bit, not one code
    return np.arange(low + 2, low + 2 + len(ratio), dtype=np.float64), ratio


def _missed(readings: Floats, alike: float) -> Floats:
    """Return minus the log of the chance that one of two codes or halves, which Beta(*alike*,
    *alike*) says are alike, has none of so many readings."""
    return np.asarray(betaln(alike, alike) - betaln(alike, alike + readings), dtype=np.float64)
