"""How two signals that show the same turns drift apart in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats

TURN_S: Final = 0.35
"""What is smoothed over a tenth of a second has one value in so long."""
BETTER: Final = 1e-3
"""Of a correlation: a shift, or a drift, that adds less is none,"""
_SURE: Final = 5.0
"""nor is one that gains less [nat]: of noise the best of a hundred places gains log 100."""
_RATE: Final = 0.025
"""So fast a clock may run (two and a half times the end of the prior),"""
_MOST_S: Final = 2.5
"""and so far drift away in a log; beyond, no line is sought."""
_PARTS: Final = 24
"""of a log: within one of them no clock drifts by more than a turn lasts,"""
_LEAST_PART_S: Final = 0.5
"""and one must last as long as a turn does."""
_EVERY: Final = 2
"""Of the steps of the grid."""
_NEWTON_STEPS: Final = 3
_LEAST_SEEN: Final = 0.5
"""Of what is seen: of less, all is alike."""


@dataclass(frozen=True)
class Drift:
    """A line of delays over the time of a log.

    Attributes:
        late_s, at_s: how late at which time since the log's start.
        rate: by how much later after each second.
        alike: correlation of the two along it.
    """

    late_s: float = 0.0
    at_s: float = 0.0
    rate: float = 0.0
    alike: float = 0.0

    def delay_s(self, stamps: Floats) -> Floats:
        """Return how late stamps are, float64[s], which count from the log's start."""
        # A stamp is so much later than the time that it speaks of; what is at hand is the stamp.
        return np.asarray((self.late_s + self.rate * (stamps - self.at_s)) / (1.0 + self.rate))


def drift_of(
    ours: Floats, theirs: Floats, search_s: float, step_s: float, seen: NDArray[np.bool_]
) -> Drift:
    """Return by what line *theirs* come later than *ours*, both smooth and every *step_s*, and by
    no more than *search_s* as the log begins; without a rate where one shift does as well.

    Where *theirs* are not *seen*, neither counts: what turned in a hole would lead the line astray.
    """
    most = round(search_s / step_s)
    drifts = _EVERY * round(min(_RATE * len(ours), _MOST_S / step_s) / _EVERY)
    edge = most + drifts
    part = (len(ours) - 2 * edge) // _PARTS
    if part * step_s < _LEAST_PART_S or min(ours.std(), theirs.std()) < 1e-9:
        return Drift()
    ours, weight = ours - ours.mean(), seen.astype(np.float64)
    theirs = (theirs - theirs.mean()) * weight
    shared, own = _inner(ours, theirs, edge, part), _inner(ours**2, weight, edge, part)
    power, known = _sums(theirs**2, edge, part), _sums(weight, edge, part)
    least = _LEAST_SEEN * min(float(weight.sum()), float(_PARTS * part))
    along, each = np.linspace(0.0, 1.0, _PARTS), np.arange(_PARTS)
    begins = np.arange(-most, most + 1)
    best: dict[int, tuple[float, int]] = {}
    for drift in range(-drifts, drifts + 1, _EVERY):
        places = edge + begins[:, np.newaxis] + np.rint(drift * along).astype(np.int64)
        sums, powers, owns, count = (
            one[places, each].sum(axis=1) for one in (shared, power, own, known)
        )
        alike = np.abs(sums) / np.sqrt(np.maximum(powers * owns, 1e-300))
        alike[count < least] = 0.0
        best[drift] = float(alike.max()), int(np.argmax(alike))
    drift = max(best, key=lambda one: best[one])
    alike, place = best[drift]
    # At an end of the search lies no peak: nothing told where one is.
    is_told = abs(drift) < drifts and 0 < place < len(begins) - 1
    if not is_told or not is_better(alike, best[0][0], float(weight.sum()) * step_s):
        return Drift(alike=best[0][0])
    line = np.array([begins[place], drift], dtype=np.float64)
    begin, more = _refined(shared, power, own, along, line)
    at_s = (edge + 0.5 * part) * step_s
    rate = more / ((_PARTS - 1) * part)
    # Along a line of noise the search may end anywhere.
    return Drift(begin * step_s, at_s, rate, alike) if abs(rate) <= _RATE else Drift(alike=alike)


def is_better(alike: float, than: float, seen_s: float, least: float = BETTER) -> bool:
    """Tell whether two signals seen for so long are more *alike* than otherwise, by *least* and
    beyond noise.

    Of n values correlated by r, the best line leaves 1 - r² of the power: by n/2 times its
    logarithm two lines' log likelihoods differ.
    """
    left, left_otherwise = (max(1.0 - one * one, 1e-12) for one in (alike, than))
    gained = 0.5 * seen_s / TURN_S * math.log(left_otherwise / left)
    return alike > than + least and gained > _SURE


def _inner(ours: Floats, theirs: Floats, edge: int, part: int) -> Floats:
    """Return the sum of the two's product over each part of a log, at each shift of *theirs*,
    float64[2 * edge + 1, 24]."""
    length = _PARTS * part
    own = ours[edge : edge + length]
    found = np.empty((2 * edge + 1, _PARTS))
    for shift in range(2 * edge + 1):
        found[shift] = (own * theirs[shift : shift + length]).reshape(_PARTS, part).sum(axis=1)
    return found


def _sums(theirs: Floats, edge: int, part: int) -> Floats:
    """Return the same of theirs alone."""
    until = np.concatenate([[0.0], np.cumsum(theirs)])
    begins = np.arange(2 * edge + 1)[:, np.newaxis] + part * np.arange(_PARTS)
    return np.asarray(until[begins + part] - until[begins])


def _refined(
    shared: Floats, power: Floats, own: Floats, along: Floats, line: Floats
) -> tuple[float, float]:
    """Return the line of shifts along which *theirs* lie closest to *ours*, from one near it: shift
    at the begin, and how much more at the end."""
    ways = np.stack([np.ones(_PARTS), along])
    each, none = np.arange(_PARTS), len(shared) // 2
    for _ in range(_NEWTON_STEPS):
        shifts = line @ ways
        near = np.clip(none + np.rint(shifts).astype(np.int64), 1, 2 * none - 1)
        scale = shared[near, each].sum() / power[near, each].sum()
        closeness = scale * shared - 0.5 * scale**2 * power - 0.5 * own
        before, top, after = (closeness[near + one, each] for one in (-1, 0, 1))
        bends = before - 2.0 * top + after
        slopes = 0.5 * (after - before) + bends * (none + shifts - near)
        line = line - np.linalg.solve((ways * bends) @ ways.T, ways @ slopes)
    return float(line[0]), float(line[1])
