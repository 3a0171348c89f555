"""Wheels that lose their hold now and then: contact that is rough in some windows only.

Ice that is trodden several times, a wheel that lifts, a sill: no listed effect has so many windows,
and two or three made-up ones together may pass for it. Here the contact of one wheel or of both
wanders in a few windows much more than anywhere else, as far as it will. What lies outside of them
is told at its usual noise, so this is far likelier than one large noise all the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.evidence import Gram, make_gram, score
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.motion.whitening import IS_OF_ROBOT, LEVELS, SLIP_WANDER, whiten
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import LevelPrior, best_levels

_CELL_S: Final = 0.5
_HOT: Final = 12.0
"""Times the usual energy of what is left over: a window begins."""
_WARM: Final = 4.0
"""As far as this it reaches."""
_REACH: Final = 4
_MOST: Final = 0.4
"""What happens in more than this share of the log is how it is, and no burst."""
_FACTORS: Final = (10.0, 30.0, 100.0, 300.0)
_WORSE: Final = (2.0, 4.0, 8.0, 16.0)
"""So many times as far a reference may be off that a camera or a satellite fewer sees."""
_ROUNDS: Final = 3
_LEAST_M: Final = 0.01
"""Contact of less than this [m per root metre] is no slip: three times what floors have."""
_BESIDE: Final = 3
_CLEARLY: Final = 50.0
"""A listed effect beside it must add this much [nat]: what slides is not described so well."""
_LARGE: Final = 100.0
"""So many tolerances is what acts all along, as far as windows go."""
SIDES: Final = ("left", "right", "both")

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Burst:
    """Windows in which wheels lose their hold.

    Attributes:
        side: left, right or both.
        windows: [start_s, stop_s] each, log time.
        contact_m_per_sqrt_m: how far contact wanders inside,
        times_rougher: so many times as far as elsewhere.
        beside: listed effects that act at all times as well.
        log_evidence, log_likelihood: comparable with those of the search.
        share: of the energy that no effect leaves over, what lies in the windows.
    """

    side: str
    windows: tuple[tuple[float, float], ...]
    contact_m_per_sqrt_m: float
    times_rougher: float
    beside: tuple[str, ...]
    log_evidence: float
    log_likelihood: float
    share: float


def find_burst(model: MotionModel, best: Found, nothing: Found) -> Burst | None:
    """Return rough windows of the contact where *best*, the best account, leaves any.

    *nothing* is the account of no effect. Windows grow while what is left outside of them stands
    out; their choice costs what two ends each may be anywhere cost.
    """
    if not _Log(model).hot_beside(best).any():
        return None
    found, terms = None, list[Term]()
    tried = set[frozenset[str]]()
    while (names := frozenset(term.variant.effect for term in terms)) not in tried:
        # What an effect does all along is in no window: those found without it hide it.
        tried.add(names)
        there = _windows_beside(model, terms, best, nothing)
        if there is None or (found is not None and there[0].log_evidence < found.log_evidence):
            break
        found, terms = there
    return found


def _windows_beside(
    model: MotionModel, terms: Sequence[Term], best: Found, nothing: Found
) -> tuple[Burst, list[Term]] | None:
    """Return rough windows of what *terms* leave over, and what acts at all times as well."""
    log = _Log(model, terms)
    course = model.course
    levels = log.levels(course, nothing.levels) if log.wanders(nothing.levels) else nothing.levels
    inside = np.zeros(log.cells, dtype=np.bool_)
    found: tuple[str, float] | None = None
    for _ in range(_ROUNDS):
        grown = inside | log.hot(course, levels)
        if not grown.any() or grown.sum() > _MOST * log.cells:
            return None
        if found is None:
            levels = np.minimum(levels, _quiet(model.level_prior.median, best.levels))
            found = log.best(grown, levels)
        levels = log.levels(log.rough(grown, *found), levels)
        found = log.best(grown, levels)
        kept = log.needed(grown, found, levels)
        settled = np.array_equal(kept, inside)
        inside, course = kept, log.rough(kept, *found)
        if settled:
            break
    if not inside.any():
        return None
    assert found is not None  # the first round has set it
    side, factor = found
    if factor * levels[0] < _LEAST_M or log.measures_worse(inside, found, levels):
        return None
    windows = log.windows(inside)
    cost = log.cost_of_window * len(windows) + math.log(len(SIDES) * len(_FACTORS))
    gram = make_gram(model.columns, course, levels, model.nodes.ticks)
    chosen, gained = _beside(model, gram)
    cost += _cost_beside(model, len(chosen))
    density = model.level_prior.log_density(np.log(levels))
    likelihood = gram.log_nothing + density + gained
    burst = Burst(
        side=side,
        windows=windows,
        contact_m_per_sqrt_m=float(factor * levels[0]),
        times_rougher=factor,
        beside=tuple(sorted(term.variant.effect for term in chosen)),
        log_evidence=likelihood - cost,
        log_likelihood=likelihood,
        share=log.share(inside, nothing.levels),
    )
    return burst, chosen


def beside_burst(model: MotionModel, burst: Burst) -> MotionModel:
    """Return the model with the contact as rough in the windows of a burst as it found it.

    What happens there and not elsewhere is the burst's: no effect in a window of its own is sought
    beside it.
    """
    t_s = model.nodes.mean(model.nodes.motion.t_s)
    inside = np.any([(start <= t_s) & (t_s < stop) for start, stop in burst.windows], axis=0)
    rough = copy(model)
    rough.course = _roughened(model.course, inside, burst.side, burst.times_rougher)
    rough.columns = replace(model.columns, terms=tuple(t for t in model.columns.terms if _lasts(t)))
    rough.level_prior = _calm(model.level_prior)
    vars(rough).pop("no_effect_levels", None)  # those of an even floor
    return rough


def _lasts(term: Term) -> bool:
    """Tell whether an effect acts at all times."""
    return "start_s" not in term.variant.fixed


def _calm(prior: LevelPrior) -> LevelPrior:
    """Return the prior of noise levels beside rough windows: wheels slip no more than usual there.

    A slip that wanders all along grows with these until nothing stands out.
    """
    is_slip = np.arange(len(LEVELS)) == SLIP_WANDER
    return replace(prior, high=np.where(is_slip, prior.median, prior.high))


def _roughened(course: Course, inside: Mask, side: str, factor: float) -> Course:
    """Return a course with contact *factor* times as rough in the blocks *inside*, bool[m]."""
    more = np.where(inside, factor**2, 1.0)
    left = course.left_path_m * (more if side != "right" else 1.0)
    right = course.right_path_m * (more if side != "left" else 1.0)
    return replace(course, left_path_m=left, right_path_m=right)


def _quiet(described: Floats, suiting: Floats) -> Floats:
    """Return the described levels of the robot, beside those of the reference and of the log's rows
    that suit the log."""
    return np.where(IS_OF_ROBOT, described, suiting)


def _beside(model: MotionModel, gram: Gram) -> tuple[list[Term], float]:
    """Return listed effects that act at all times as well, one by one, and what they add."""
    chosen: list[Term] = []
    gained = 0.0
    for _ in range(_BESIDE):
        taken = {term.variant.effect for term in chosen} | GROSS
        rest = [
            term
            for term in model.columns.terms
            if term.variant.effect not in taken and _lasts(term)
        ]
        scored = [score(gram, [*chosen, term], model.prior) for term in rest]
        if not scored:
            break
        best = max(scored, key=lambda one: one.log_evidence)
        if best.log_evidence < gained + _CLEARLY:
            break
        chosen, gained = list(best.terms), best.log_evidence
    return chosen, gained


def _cost_beside(model: MotionModel, count: int) -> float:
    """Return what it costs [nat] that so many listed effects act as well, and that they are these:
    as much as it costs their set without a burst."""
    among = len({term.variant.effect for term in model.columns.terms})
    chance = math.factorial(count) * model.prior.chance_of(count) / model.prior.chance_of(0)
    return count * math.log(max(among, 1)) - math.log(chance)


class _Log:
    """One log's residuals, with tolerances free and the sizes of terms, at whatever contact."""

    def __init__(self, model: MotionModel, terms: Sequence[Term] = ()) -> None:
        self._model = model
        self._level_prior = _calm(model.level_prior)
        nodes = model.nodes
        t_s = nodes.mean(nodes.motion.t_s)
        self._start_s = float(t_s[0])
        self._cell = ((t_s - t_s[0]) / _CELL_S).astype(np.int64)
        self.cells = int(self._cell[-1]) + 1
        self._row_node, self._row_channel = np.nonzero(~np.isnan(model.columns.values[..., 0]).T)
        sizes = dict(model.columns.nuisances)
        for term in terms:
            for weight, small in zip(term.weights, term.tolerances, strict=False):
                sizes |= dict.fromkeys((index for index, _ in weight), _LARGE * small)
        self._nuisances = list(enumerate(sizes.values()))
        self._free = list(sizes)
        self._values = self._chosen(self._free)

    def _chosen(self, indices: Sequence[int]) -> Floats:
        values = self._model.columns.values
        return np.take(values, [0, *(index + 1 for index in indices)], axis=-1)

    def rough(self, inside: Mask, side: str, factor: float) -> Course:
        """Return the course with contact *factor* times as rough in the cells *inside*."""
        return _roughened(self._model.course, inside[self._cell], side, factor)

    def evidence(self, course: Course, levels: Floats) -> float:
        """Return the log evidence of no effect on this course."""
        return self._weighing(course)(levels).log_evidence

    def _weighing(self, course: Course) -> Weighing:
        return Weighing(self._values, self._nuisances, course, self._model.nodes.ticks)

    def measures_worse(self, inside: Mask, found: tuple[str, float], levels: Floats) -> bool:
        """Tell whether a reference that measures worse in the cells *inside* explains them
        better than wheels do: what these slip stays when they hold again, what it errs does not."""
        course, there = self._model.course, inside[self._cell]
        rough = self.evidence(self.rough(inside, *found), levels)
        return any(
            self.evidence(
                replace(course, samples=np.where(there, course.samples / times**2, course.samples)),
                levels,
            )
            > rough
            for times in _WORSE
        )

    def best(self, inside: Mask, levels: Floats) -> tuple[str, float]:
        """Return the side and the factor that suit these cells best."""
        choices = [(side, factor) for side in SIDES for factor in _FACTORS]
        return max(choices, key=lambda one: self.evidence(self.rough(inside, *one), levels))

    def needed(self, inside: Mask, found: tuple[str, float], levels: Floats) -> Mask:
        """Return the cells without the windows that are not worth what they cost."""
        kept = inside.copy()
        reached = self.evidence(self.rough(kept, *found), levels)
        for start_s, stop_s in self.windows(inside):
            first, last = (round((at - self._start_s) / _CELL_S) for at in (start_s, stop_s))
            fewer = kept.copy()
            fewer[first:last] = False
            without = self.evidence(self.rough(fewer, *found), levels)
            if without > reached - self.cost_of_window:
                kept, reached = fewer, without
        return kept

    @property
    def cost_of_window(self) -> float:
        """Two ends that may be anywhere [nat]."""
        return 2 * math.log(self.cells)

    def levels(self, course: Course, start: Floats) -> Floats:
        """Return the noise levels that suit this course."""
        start = np.minimum(start, self._level_prior.high)
        weigh = self._weighing(course)
        return best_levels(weigh, self._level_prior, start)

    def hot_beside(self, best: Found) -> Mask:
        """Return the cells in which what an account leaves over stands out."""
        levels = np.minimum(best.levels, self._level_prior.high)
        if best.refitted is not None:
            fit = replace(best.refitted, levels=levels)
            return self._hot(self._model.left_by(best.terms, fit))
        return self._hot(self._left(best.terms, self._model.course, levels))

    def wanders(self, levels: Floats) -> bool:
        """Tell whether wheels slip more than usual, all along."""
        return bool(levels[SLIP_WANDER] > self._level_prior.high[SLIP_WANDER])

    def hot(self, course: Course, levels: Floats) -> Mask:
        """Return the cells in which what no effect leaves over stands out."""
        return self._hot(self._left((), course, levels))

    def _hot(self, left: Floats) -> Mask:
        ratio = self._energy(left)
        hot = ratio > _HOT
        for _ in range(_REACH):
            near = np.concatenate([hot[1:], [False]]) | np.concatenate([[False], hot[:-1]])
            hot |= near & (ratio > _WARM)
        return np.asarray(hot)

    def share(self, inside: Mask, levels: Floats) -> float:
        """Return how much of the energy that no effect leaves over lies in the cells *inside*."""
        energy = self._left((), self._model.course, levels) ** 2
        return float(energy[inside[self._cell[self._row_node]]].sum() / energy.sum())

    def _left(self, terms: Sequence[Term], course: Course, levels: Floats) -> Floats:
        """Return what *terms* and tolerances leave over, whitened: float64[rows]."""
        own = sorted({index for term in terms for weight in term.weights for index, _ in weight})
        values = self._chosen([*self._free, *own]) if own else self._values
        white, _ = whiten(values, course, levels, self._model.nodes.ticks)
        data, columns = white[:, 0], white[:, 1:]
        sizes = [1 / sd for _, sd in self._nuisances] + [1e-6] * len(own)
        damped = np.vstack([columns, np.diag(sizes)])
        padded = np.concatenate([data, np.zeros(len(sizes))])
        return np.asarray(data - columns @ np.linalg.lstsq(damped, padded, rcond=None)[0])

    def _energy(self, left: Floats) -> Floats:
        """Return of each cell the largest energy of a channel beside that channel's usual one.

        The largest value of a cell is left out: one reading far off (a count that flips as a wheel
        begins to move) is no burst.
        """
        cell = self._cell[self._row_node]
        largest = np.zeros(self.cells)
        for channel in np.unique(self._row_channel):
            own = self._row_channel == channel
            count = np.bincount(cell[own], minlength=self.cells)
            most = np.zeros(self.cells)
            np.maximum.at(most, cell[own], left[own] ** 2)
            rest = np.bincount(cell[own], left[own] ** 2, self.cells) - most
            energy = rest / np.maximum(count - 1, 1)
            usual = float(np.median(energy[count > 0]))
            largest = np.maximum(largest, energy / max(usual, 1e-12))
        return largest

    def windows(self, inside: Mask) -> tuple[tuple[float, float], ...]:
        """Return runs of cells as [start_s, stop_s]; a gap of one cell is none."""
        at = np.flatnonzero(inside)
        breaks = np.flatnonzero(np.diff(at) > 2)
        firsts, lasts = at[np.append(0, breaks + 1)], at[np.append(breaks, len(at) - 1)]
        return tuple(
            (self._start_s + _CELL_S * float(first), self._start_s + _CELL_S * float(last + 1))
            for first, last in zip(firsts, lasts, strict=True)
        )
