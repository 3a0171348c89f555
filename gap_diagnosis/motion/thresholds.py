"""Above which speed a wheel loses counts: what a log says of every threshold, summed over a grid.

Between two speeds at which a log drives for long hardly anything tells one threshold from another,
and at each of them its likelihood jumps: half a nat below the top is no standard deviation. With
the threshold goes the share of counts that are lost, so that both are drawn together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations.encoder import own_speed
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.windows import cells_of
from gap_diagnosis.recording import Floats

_EVEN: Final = 8
_DRIVEN: Final = 20
"""At first so many thresholds are compared evenly, and so many that the wheel is faster than for
1/20, 2/20 … of the log: each speed that it drives at for long lies between two of them."""
_ROUNDS: Final = 9
_IN_REACH: Final = 8.0
"""Thresholds that lack more [nat] are not sought more closely, nor those between two that are as
likely to within"""
_ALIKE: Final = 0.5
_CLOSEST: Final = 5e-4
"""of a nat, or as close as this share of the fastest rate."""

_NONE: Final = 0.5
"""Half of those that lose counts lose them at any speed, as the catalogue has it where nothing is
said: the lowest threshold is none."""
_ONE_BY_ONE: Final = 2.0
"""Counts are lost one by one, each for all to see; their law is told as a normal one, of a few
hundredths of a count on each ramp. That is so many times too sure of where they begin: measured
over 34 drives of known truth, and judged on others (docs/reference/accuracy.md)."""


@dataclass(frozen=True)
class Thresholds:
    """What a log says of one effect's threshold.

    Attributes:
        rates_rad_s: float64[t], ascending, the thresholds that were compared.
        terms, fits: all terms with each of them, and their fit.
    """

    rates_rad_s: Floats
    terms: tuple[tuple[Term, ...], ...]
    fits: tuple[Refitted, ...]

    @property
    def log_evidence(self) -> Floats:
        """Of each threshold, float64[t]."""
        return np.array([fit.log_evidence for fit in self.fits])

    @property
    def best(self) -> tuple[Term, ...]:
        """All terms with the likeliest threshold."""
        return self.terms[int(np.argmax(self.log_evidence))]

    @property
    def log_width(self) -> float:
        """Logarithm of what some threshold is worth beside the likeliest one, at most 0: the mean
        over all that there may be."""
        logs = self.log_evidence
        lowest, cells = self._shares
        worth = np.exp(logs - logs.max())
        return math.log(lowest * float(worth[0]) + float(cells @ worth))

    @property
    def _shares(self) -> tuple[float, Floats]:
        """What is believed beforehand of no threshold, and of the cell about each rate, float64[t]:
        where there is one, all rates up to the fastest are alike."""
        low, high = cells_of(self.rates_rad_s)
        return _NONE, (1.0 - _NONE) * (high - low) / (high[-1] - low[0])

    def draw(
        self, count: int, dispersion: float, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], Floats]:
        """Return draws of which threshold it is, int64[count], and of its rate [rad/s], where the
        log's likelihood is *dispersion* times too sure."""
        low, high = cells_of(self.rates_rad_s)
        logs = self.log_evidence
        worth = np.exp((logs - logs.max()) / (_ONE_BY_ONE * dispersion))
        lowest, cells = self._shares
        share = np.append(lowest * worth[0], cells * worth)
        drawn = rng.choice(len(share), size=count, p=share / share.sum())
        picked = np.maximum(drawn - 1, 0)
        rates = low[picked] + (high - low)[picked] * rng.uniform(size=count)
        return picked, np.where(drawn == 0, low[0], rates)


def has_threshold(term: Term) -> bool:
    """Tell whether a term has a threshold, which is to be sought."""
    return "threshold" in term.variant.fixed and not term.variant.is_held


def thresholds_of(
    model: MotionModel,
    terms: Sequence[Term],
    place: int,
    coefficients: Sequence[tuple[float, ...]],
    levels: Floats,
) -> Thresholds:
    """Return what the log says of the threshold of ``terms[place]``, about a fit of all terms."""
    found = _Compared(model, terms, place, coefficients, levels)
    found.add(found.coarse)
    for _ in range(_ROUNDS):
        between = found.between()
        if len(between) == 0:
            break
        found.add(between)
    return found.thresholds


def coarse_thresholds(
    model: MotionModel,
    terms: Sequence[Term],
    place: int,
    coefficients: Sequence[tuple[float, ...]],
    levels: Floats,
) -> Thresholds:
    """Return the same on a coarse grid, far from a fit.

    How much is lost by chance goes with how much is lost, which a first step of two brings. Every
    second one of the grid is compared, then those beside the best.
    """
    found = _Compared(model, terms, place, coefficients, levels, steps=2)
    grid = found.coarse
    now = int(np.searchsorted(grid, float(terms[place].variant.fixed["threshold"])))
    found.add(np.union1d(grid[0], grid[now % 2 :: 2]))
    best = float(found.thresholds.best[place].variant.fixed["threshold"])
    at = int(np.searchsorted(grid, best))
    found.add(np.setdiff1d(grid[max(at - 1, 0) : at + 2], best))
    return found.thresholds


class _Compared:
    """Fits of one effect's thresholds, all from one start: as far from it all are as far from
    their ends."""

    def __init__(
        self,
        model: MotionModel,
        terms: Sequence[Term],
        place: int,
        coefficients: Sequence[tuple[float, ...]],
        levels: Floats,
        *,
        steps: int = 1,
    ) -> None:
        self._model, self._terms, self._place = model, tuple(terms), place
        self._start, self._levels = coefficients, levels
        self._steps = steps
        self._fastest_rad_s = model.nodes.motion.fastest_rad_s
        self._found: dict[float, tuple[tuple[Term, ...], Refitted]] = {}

    @property
    def coarse(self) -> Floats:
        """The thresholds that are compared at first, the present one among them."""
        term = self._terms[self._place]
        now = float(term.variant.fixed["threshold"])
        probability = self._start[self._place][0]
        side = str(term.variant.report["side"])
        speed = own_speed(self._model.nodes.motion, side, probability, now).rad_s
        driven = np.quantile(speed, np.arange(1, _DRIVEN) / _DRIVEN)
        even = np.linspace(0.0, self._fastest_rad_s, _EVEN + 1)
        return np.union1d(np.union1d(even, driven[driven < even[-1]]), now)

    def add(self, rates_rad_s: Floats) -> None:
        """Compare these as well."""
        place = self._place
        for rate in map(float, rates_rad_s):
            moved = at_threshold(self._terms[place], rate)
            trial = (*self._terms[:place], moved, *self._terms[place + 1 :])
            fit = self._model.refit(
                trial,
                self._levels,
                free_levels=False,
                steps=self._steps,
                start=self._start,
                is_compared=True,
            )
            self._found[rate] = trial, fit

    def between(self) -> Floats:
        """Return those between two that are likely and differ."""
        rates = np.array(sorted(self._found))
        logs = self.thresholds.log_evidence
        differ = np.abs(np.diff(logs)) > _ALIKE
        near = np.maximum(logs[1:], logs[:-1]) > logs.max() - _IN_REACH
        apart = np.diff(rates) > _CLOSEST * self._fastest_rad_s
        return np.asarray(0.5 * (rates[1:] + rates[:-1])[differ & near & apart])

    @property
    def thresholds(self) -> Thresholds:
        """All that were compared."""
        each = [self._found[rate] for rate in sorted(self._found)]
        return Thresholds(
            np.array(sorted(self._found)),
            tuple(one for one, _ in each),
            tuple(fit for _, fit in each),
        )


def at_threshold(term: Term, rate_rad_s: float) -> Term:
    """Return the term with its threshold elsewhere [rad/s]."""
    variant = term.variant
    fixed = {**variant.fixed, "threshold": rate_rad_s}
    report = {**variant.report, "threshold": rate_rad_s}
    return replace(term, variant=replace(variant, fixed=fixed, report=report))
