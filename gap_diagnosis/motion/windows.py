"""When a window began and ended: what a log says of every pair of ends, summed over a grid.

The likelihood of an end has plateaus (while a wheel stands, nothing tells when it began to slip)
and peaks as narrow as a tick beside peaks of other manoeuvres: neither a walk uphill nor a
curvature tells where an end may be. But an effect in a window is what it does up to the window's
end less what it does up to its start, so that one whitened column per end gives every window.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.choices import CHANGING, LASTING, LEFT_OUT
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.evidence import scales_of
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import CONTACT, whiten
from gap_diagnosis.recording import Floats

SHORTEST_S: Final = 0.5
"""A window is no shorter."""
_PARTS: Final = 48
_ROUNDS: Final = 6
_QUARTERS: Final = np.array([0.25, 0.5, 0.75])
_PEAKS: Final = 3
_COARSE: Final = 3
"""In so many rounds ends are sought about the highest peaks, however little they stand out."""
_IN_REACH: Final = 8.0
"""Ends that lack more [nat] are not sought more closely, nor those between two that are as likely
to within"""
_ALIKE: Final = 0.5
_AS_WELL: Final = 2.0
"""An end that lacks less [nat] lies within an interval of 95 %."""
_MOST_ENDS: Final = 600
"""Where more ends are about as likely as the best one, finer ones tell nothing."""
_PROMISES: Final = (0.1, 0.25, 0.5)
"""Of what the best window gains, the ends compared so far show this share at least, round by round:
of a window a fifth as long as they are apart a column between two of them holds a fifth."""


@dataclass(frozen=True)
class Windows:
    """What a log says of when one effect began and ended.

    Attributes:
        ends_s: float64[e], ascending, the ends that were compared.
        log_evidence: float64[e, e], of a window from the first end to the second one, and
        areas: float64[e, e], for how many such windows it stands beside the others: before, all
            ends are alike.
        for_good: float64[e, e], how many of those begin or end with the log itself.
        means, variances, log_weights: float64[s, e, e], of the effect's size in each window, by
            component of its prior.
    """

    ends_s: Floats
    log_evidence: Floats
    areas: Floats
    for_good: Floats
    means: Floats
    variances: Floats
    log_weights: Floats

    @property
    def best_s(self) -> tuple[float, float]:
        """The likeliest window. What may as well go on to the log's own end has no other."""
        first, last = self._best
        return float(self.ends_s[first]), float(self.ends_s[last])

    @property
    def log_width(self) -> float:
        """Logarithm of what some window is worth beside the best one: the mean over all there may
        be."""
        share = self.areas * np.exp(self.log_evidence - self.log_evidence[self._best])
        return math.log(float(share.sum() / self.areas.sum()))

    @property
    def _best(self) -> tuple[int, int]:
        goes_on = np.where(self.for_good > 0.0, self.log_evidence, -np.inf)
        may_as_well = goes_on.max() > self.log_evidence.max() - _AS_WELL
        likely = goes_on if may_as_well else self.log_evidence
        first, last = np.unravel_index(np.argmax(likely), likely.shape)
        return int(first), int(last)

    @property
    def spans_s(self) -> dict[str, float]:
        """The standard deviation of either end."""
        share = self._shares(1.0)
        found = {}
        for name, axis in (("start_s", 1), ("stop_s", 0)):
            weight = share.sum(axis=axis)
            away_s = self.ends_s - weight @ self.ends_s
            found[name] = float(np.sqrt(weight @ away_s**2))
        return found

    def _shares(self, dispersion: float) -> Floats:
        """Return the probability of each window, float64[e, e]."""
        share = self.areas * np.exp((self.log_evidence - self.log_evidence.max()) / dispersion)
        return np.asarray(share / share.sum())

    def draw(
        self, count: int, dispersion: float, rng: np.random.Generator
    ) -> tuple[Floats, Floats, Floats]:
        """Return draws float64[count] of start, stop [s] and size, where the log's likelihood is
        *dispersion* times too sure."""
        low, high = cells_of(self.ends_s)
        share = self._shares(dispersion)
        picked = rng.choice(share.size, size=count, p=share.ravel())
        first, last = np.unravel_index(picked, share.shape)
        start, stop = (
            low[one] + (high - low)[one] * rng.uniform(size=count) for one in (first, last)
        )
        weights = np.exp(self.log_weights[:, first, last])
        below = np.cumsum(weights, axis=0) / weights.sum(axis=0)
        part = (rng.uniform(size=count) > below).sum(axis=0)
        sd = np.sqrt(dispersion * self.variances[part, first, last])
        size = self.means[part, first, last] + sd * rng.standard_normal(count)
        # Those that begin or end with the log do so at its end, not in the step beside it.
        for_good = rng.uniform(size=count) * self.areas[first, last] < self.for_good[first, last]
        start = np.where(for_good & (first == 0), self.ends_s[0], start)
        stop = np.where(for_good & (last == len(low) - 1), self.ends_s[-1], stop)
        return start, stop, size


def has_window(term: Term) -> bool:
    """Tell whether a term has a window, which is to be sought, and one size."""
    variant = term.variant
    is_window = {"start_s", "stop_s"} <= variant.fixed.keys()
    return is_window and not variant.is_held and len(variant.coefficients) == 1


def at_window(term: Term, start_s: float, stop_s: float) -> Term:
    """Return the term in another window [s, log time]."""
    window = {"start_s": start_s, "stop_s": stop_s}
    variant = term.variant
    report = {**variant.report, **window}
    return replace(term, variant=replace(variant, fixed=window, report=report))


def windows_of(
    model: MotionModel,
    terms: Sequence[Term],
    place: int,
    coefficients: Sequence[tuple[float, ...]],
    levels: Floats,
    *,
    worth: float = -math.inf,
) -> Windows:
    """Return what the log says of the window of ``terms[place]``, about a fit of all terms.

    Where no window promises to gain *worth* [nat], none is sought more closely.
    """
    grid = _Grid(model, terms, place, coefficients, levels)
    windows = grid.compared()
    for done in range(_ROUNDS):
        if windows.log_evidence.max() < worth * _PROMISES[min(done, len(_PROMISES) - 1)]:
            break
        peaks = _PEAKS if done < _COARSE else 0
        between = _between(windows, model.nodes.motion.t_s, peaks)
        if len(between) == 0 or len(grid.ends_s) + len(between) > _MOST_ENDS:
            break
        grid.add(between)
        windows = grid.compared()
    return windows


def nearest_ticks(ends_s: Floats, t_s: Floats) -> Floats:
    """Return the ticks that stand for ends of windows [s], each for those from the middle of its
    own tick to the middle of the next: what they leave in a log is the same."""
    middles = 0.5 * (t_s[1:] + t_s[:-1])
    return np.asarray(t_s[np.searchsorted(middles, ends_s)])


def _between(windows: Windows, t_s: Floats, most: int) -> Floats:
    """Return ends to be compared as well: about so many peaks at most, and wherever it matters."""
    ends_s = windows.ends_s
    wanted = np.zeros(len(ends_s) - 1, dtype=np.bool_)
    for profile in (windows.log_evidence.max(axis=1), windows.log_evidence.max(axis=0)):
        higher = np.maximum(profile[1:], profile[:-1])
        with np.errstate(invalid="ignore"):
            differ = np.abs(np.diff(profile)) > _ALIKE
        wanted |= (higher > profile.max() - _IN_REACH) & differ
        inner = np.concatenate([[-np.inf], profile, [-np.inf]])
        is_peak = (profile >= inner[:-2]) & (profile >= inner[2:]) & np.isfinite(profile)
        peaks = np.flatnonzero(is_peak)
        for peak in peaks[np.argsort(-profile[peaks])][:most]:
            wanted[max(peak - 1, 0) : peak + 1] = True
    at = np.flatnonzero(wanted)
    asked_s = nearest_ticks((ends_s[at, None] + np.diff(ends_s)[at, None] * _QUARTERS).ravel(), t_s)
    return np.setdiff1d(asked_s, ends_s)


def cells_of(ends_s: Floats) -> tuple[Floats, Floats]:
    """Return from where to where each of these, ascending, stands for those about it, float64[e]
    each."""
    middles = 0.5 * (ends_s[1:] + ends_s[:-1])
    return np.append(ends_s[0], middles), np.append(middles, ends_s[-1])


class _Grid:
    """Whitened columns of one effect up to each of some ends, beside those of a fit."""

    def __init__(
        self,
        model: MotionModel,
        terms: Sequence[Term],
        place: int,
        coefficients: Sequence[tuple[float, ...]],
        levels: Floats,
    ) -> None:
        self._model, self._levels = model, levels
        self._variant = terms[place].variant
        least = 1e-3 * terms[place].tolerances[0]
        size = coefficients[place][0]
        self._size = size if abs(size) > least else least
        self._scales = scales_of(model.prior, terms[place])[:, 0]
        self._others = [
            (term.variant, sizes)
            for term, sizes in zip(terms, coefficients, strict=True)
            if term is not terms[place]
        ]
        self._course = model.scattered(terms, coefficients, levels)
        values, nuisances, tangent = model.linearised(terms, coefficients, levels)
        free, slope = list(nuisances), 0
        for term in tangent:
            if term.variant is self._variant:
                (((slope, _),),) = term.weights
            else:
                sds = scales_of(model.prior, term)[-1]
                free += [(one[0][0], float(sd)) for one, sd in zip(term.weights, sds, strict=True)]
        white = self._whitened(values)
        # Sizes are told along chords here: what the fit added along the tangent is taken off.
        self._data = white[:, 0] - size * white[:, 1 + slope]
        self._free = white[:, [1 + index for index, _ in free]] * np.array([sd for _, sd in free])
        loaded = np.eye(self._free.shape[1]) + self._free.T @ self._free
        self._lower = np.linalg.cholesky(loaded)
        # Columns in the order in which they came, their products with what is free and, less that,
        # with each other; by ascending ends, where each smooth column and each detail stands.
        self._columns: list[Floats] = []
        self._held = np.zeros((len(loaded), 0))
        self._products = np.zeros((0, 0))
        self._smooth = self._details = np.zeros(0, dtype=np.int64)
        self.ends_s = np.zeros(0)
        t_s = model.nodes.motion.t_s
        now = nearest_ticks(
            np.array([self._variant.fixed[one] for one in ("start_s", "stop_s")]), t_s
        )
        self.add(np.union1d(nearest_ticks(np.linspace(t_s[0], t_s[-1], _PARTS + 1), t_s), now))
        first, last = np.searchsorted(self.ends_s, now)
        (columns,) = self._columns
        smooth, inside = (
            columns[:, places[last]] - columns[:, places[first]]
            for places in (self._smooth, self._details)
        )
        self._data = self._data + self._size * (smooth - inside)

    def _whitened(self, values: Floats) -> Floats:
        nodes = self._model.nodes
        return whiten(np.ascontiguousarray(values), self._course, self._levels, nodes.ticks)[0]

    def add(self, ends_s: Floats) -> None:
        """Compare these ends [s] as well.

        Beside the smooth column of a size stands what the effect does in every detail: the data are
        compared exactly, along columns that are free of their noise (as in a fit).
        """
        nodes = self._model.nodes
        columns = []
        contact = float(self._levels[CONTACT])
        exactly = [(variant.in_noise(contact), sizes) for variant, sizes in self._others]
        for motion, others, own in (
            (nodes.smooth, self._others, self._variant),
            (nodes.sharp, exactly, self._variant.in_detail),
        ):
            without = residuals(nodes, predict(motion, others))
            for end_s in ends_s:
                window = {"start_s": float(nodes.motion.t_s[0]), "stop_s": float(end_s)}
                acting = [*others, (replace(own, fixed=window), (self._size,))]
                columns.append((without - residuals(nodes, predict(motion, acting))) / self._size)
        white, count = self._whitened(np.stack(columns, axis=-1)), len(ends_s)
        new = np.hstack([white[:, :count], white[:, :count] - white[:, count:]])
        held = self._held_by(new)
        among = new.T @ new - held.T @ held
        known = len(self._products)
        across = np.zeros((known, 2 * count))
        if known:
            across = np.vstack([one.T @ new for one in self._columns]) - self._held.T @ held
        self._products = np.block([[self._products, across], [across.T, among]])
        self._columns.append(new)
        self._held = np.hstack([self._held, held])
        ends = np.concatenate([self.ends_s, ends_s])
        order = np.argsort(ends)
        at = known + np.arange(count)
        self.ends_s = ends[order]
        self._smooth = np.concatenate([self._smooth, at])[order]
        self._details = np.concatenate([self._details, at + count])[order]

    def _held_by(self, columns: Floats) -> Floats:
        """Return of columns what is free may take up, so that products of it are to be taken off
        theirs."""
        return np.asarray(np.linalg.solve(self._lower, self._free.T @ columns))

    def compared(self) -> Windows:
        """Return what the log says of every window between two of the ends."""
        smooth, details = self._smooth, self._details
        with_data = np.concatenate([one.T @ self._data for one in self._columns])
        with_data -= self._held.T @ self._held_by(self._data)

        def between(products: Floats) -> Floats:
            own = np.diag(products)
            return np.asarray(own[:, None] + own - products - products.T)

        def along(products: Floats) -> Floats:
            return np.asarray(products - products[:, None])

        power = np.maximum(between(self._products[np.ix_(smooth, smooth)]), 0.0)
        data = along(with_data[smooth])
        data = data + self._size * between(self._products[np.ix_(smooth, details)])
        misfit = 2.0 * self._size * along(with_data[details])
        misfit = misfit + self._size**2 * between(self._products[np.ix_(details, details)])
        scales = self._scales[:, None, None] ** 2
        variances = scales / (1.0 + scales * power)
        means = variances * data
        log_parts = 0.5 * (means * data - np.log1p(scales * power))
        top = log_parts.max(axis=0)
        log_evidence = top + np.log(np.exp(log_parts - top).mean(axis=0)) - 0.5 * misfit
        admitted = self._admitted()
        log_evidence = np.where(admitted, log_evidence, -np.inf)
        areas, for_good = self._areas(admitted)
        return Windows(
            self.ends_s, log_evidence, areas, for_good, means, variances, log_parts - top
        )

    def _areas(self, admitted: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Return for how many windows each one stands, and how many of those begin or end with the
        log itself, float64[e, e] each: none of those that are not *admitted*, bool[e, e].

        What may change on the way does so for good or for a while, either as likely.
        """
        low, high = cells_of(self.ends_s)
        width = high - low
        of_both = np.where(admitted, np.outer(width, width), 0.0)
        if self._variant.effect not in CHANGING:
            return of_both, np.zeros_like(of_both)
        begins = self.ends_s == self.ends_s[0]
        lasts = admitted & self._at_an_end
        of_one = np.where(lasts, np.where(begins[:, None], width, width[:, None]), 0.0)
        if self._variant.effect in LASTING:
            return of_one, of_one
        for_good = of_one / of_one.sum()
        return for_good + of_both / of_both.sum(), for_good

    @property
    def _at_an_end(self) -> NDArray[np.bool_]:
        """Of which windows an end is that of the log, bool[e, e]."""
        is_end = (self.ends_s == self.ends_s[0]) | (self.ends_s == self.ends_s[-1])
        return np.asarray(np.logical_or.outer(is_end, is_end))

    def _admitted(self) -> NDArray[np.bool_]:
        """Tell which windows there may be, bool[e, e]."""
        motion = self._model.nodes.smooth
        long = np.subtract.outer(self.ends_s, self.ends_s).T >= SHORTEST_S
        if self._variant.effect in LASTING:
            return np.asarray(long & self._at_an_end)
        if self._variant.effect != "one_sided_slip":
            return np.asarray(long)
        is_left = self._variant.report["side"] == "left"
        steps = np.abs(motion.left_step_rad if is_left else motion.right_step_rad)
        way = np.append(0.0, np.cumsum(steps))
        until = way[np.searchsorted(motion.t_s, self.ends_s, side="right")]
        inside = np.subtract.outer(until, until).T
        return np.asarray(long & (way[-1] - inside > LEFT_OUT * way[-1]))
