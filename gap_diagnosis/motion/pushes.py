"""A push now and then: a joint in the floor, a sill, a foot that turns the body in an instant.

Neither a function of anything nor rough contact: the pose steps, no wheel turns. Where what is left
over stands out, a step of the body is put at the tick that suits it best. It must do better there
than a step of the reference's frame: a camera that is pushed turns no gyro.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.components import gains
from gap_diagnosis.motion.evidence import Gram, gram_of
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import best_levels

_STANDS_OUT: Final = 30.0
"""Energy above noise of three blocks [nat]: of a million such sums, one is so large by chance."""
_BLOCKS: Final = 3
_SIZES: Final = np.geomspace(1e-3, 0.1, 4)
"""Usual steps [m, rad]."""
_MOST: Final = 4
_LEAST_RAD: Final = 3e-3
"""A smaller turn is no gap; nor is one of fewer than two counts: how far a wheel rolled on after
its last count, only the gyro saw."""
_AROUND_S: Final = 0.1
_ANY: Final = 1e6
"""An effect may be of any size."""
_CLEAR: Final = 3.0
"""What a push must gain [nat]."""


@dataclass(frozen=True)
class Pushes:
    """Steps of the body that no wheel makes.

    Attributes:
        at_s: when, log time, in order.
        steps: float64[k, 3], turned to the left [rad], moved forward and to the left [m].
        levels: noise levels beside them, float64[levels].
        log_evidence: less that of no effect at the same levels.
        log_likelihood: gain at the best steps.
        share: of the whitened residual's energy above noise that they take.
    """

    at_s: tuple[float, ...]
    steps: Floats
    levels: Floats
    log_evidence: float
    log_likelihood: float
    share: float

    @property
    def windows(self) -> tuple[tuple[float, float], ...]:
        """[start_s, stop_s] about each, log time."""
        return tuple((at_s - _AROUND_S, at_s + _AROUND_S) for at_s in self.at_s)


def find_pushes(model: MotionModel, best: Found, nothing: Found) -> Pushes | None:
    """Return the pushes that a log shows beside no effect; None where it shows none, has no gyro
    to tell them from a reference that was pushed, or nothing stands out beside the *best* account
    either, at whose noise levels they are sought; those beside them from there or *nothing*'s."""
    if not model.nodes.has_gyro or not model.nodes.has_reference:
        return None
    log = _Log(model)
    if not log.stands_out_beside(best):
        return None
    levels, ticks = best.levels, list[int]()
    gained = 0.0
    for _ in range(_MOST):
        found = log.next(ticks, levels)
        if found is None:
            break
        beside = log.levels([*ticks, found], levels, nothing.levels)
        more = log.evidence([*ticks, found], beside) - log.evidence([], beside)
        if more < gained + _CLEAR or not log.are_large([*ticks, found], beside):
            break
        ticks, levels, gained = [*ticks, found], beside, more
    if not ticks:
        return None
    ticks = sorted(ticks)
    steps, likelihood, share = log.explained(ticks, levels)
    at_s = tuple(float(model.nodes.motion.t_s[one]) for one in ticks)
    return Pushes(at_s, steps, levels, gained, likelihood, share)


class _Log:
    """One log's residuals, with tolerances and pushes free."""

    def __init__(self, model: MotionModel) -> None:
        self._model, self._nodes = model, model.nodes
        free = [index for index, _ in model.columns.nuisances]
        self._base = np.take(model.columns.values, [0, *(index + 1 for index in free)], axis=-1)
        self._tolerated = [(place, sd) for place, (_, sd) in enumerate(model.columns.nuisances)]
        self._row_node = np.nonzero(~np.isnan(self._base[..., 0]).T)[0]
        self._nominal = residuals(self._nodes, predict(self._nodes.smooth))
        self._known: dict[tuple[int, bool], Floats] = {}

    def stands_out_beside(self, best: Found) -> bool:
        """Tell whether an account leaves anything that stands out."""
        if best.refitted is not None:
            return self._loudest(self._model.left_by(best.terms, best.refitted)) is not None
        own = sorted({at for term in best.terms for weight in term.weights for at, _ in weight})
        columns = np.take(self._model.columns.values, [index + 1 for index in own], axis=-1)
        values = np.concatenate([self._base, columns], axis=-1)
        first = len(self._tolerated)
        free = [(first + place, _ANY) for place in range(len(own))]
        left = self._left(values, [*self._tolerated, *free], best.levels)
        return self._loudest(left) is not None

    def levels(self, ticks: list[int], *starts: Floats) -> Floats:
        """Return the noise levels that suit pushes at these ticks, from the best of *starts*."""

        def gain(gram: Gram) -> float:
            return self._gain(gram, len(ticks))

        values = self._values(ticks)
        course = self._model.course
        weigh = Weighing(values, self._tolerated, course, self._nodes.ticks, gain)
        start = max(starts, key=lambda levels: weigh(levels).log_evidence)
        return best_levels(weigh, self._model.level_prior, start)

    def evidence(self, ticks: list[int], levels: Floats) -> float:
        """Return the log evidence of pushes at these ticks, sought anywhere."""
        gram = self._gram(self._values(ticks), levels)
        cost = len(ticks) * math.log(len(self._nodes.motion.t_s))
        return gram.log_nothing + self._gain(gram, len(ticks)) - cost

    def are_large(self, ticks: list[int], levels: Floats) -> bool:
        """Tell whether every step turns the body by more than is no gap."""
        motion = self._nodes.motion
        count_rad = motion.radius_m * motion.rounding_rad / motion.wheelbase_m
        turned_rad = np.abs(self.explained(ticks, levels)[0][:, 0])
        return bool((turned_rad > max(_LEAST_RAD, 2 * count_rad)).all())

    def explained(self, ticks: list[int], levels: Floats) -> tuple[Floats, float, float]:
        """Return the best steps, float64[k, 3], the log likelihood that they gain, and their share
        of what is above noise."""
        gram = self._gram(self._values(ticks), levels)
        own = self._own(len(ticks))
        steps = np.linalg.lstsq(gram.inner[np.ix_(own, own)], gram.data[own], rcond=None)[0]
        likelihood = 0.5 * float(gram.data[own] @ steps)
        above_noise = max(gram.left_over - len(self._row_node), 1.0)
        return np.asarray(steps).reshape(-1, 3), likelihood, min(2 * likelihood / above_noise, 1.0)

    def next(self, ticks: list[int], levels: Floats) -> int | None:
        """Return the tick at which one push more explains most; None where nothing stands out that
        the reference's frame does not explain as well."""
        known = self._values(ticks)
        held = [*self._tolerated, *self._held(len(ticks))]
        block = self._loudest(self._left(known, held, levels))
        if block is None:
            return None
        starts = self._nodes.starts
        first = int(starts[max(block - 1, 1)])
        last = int(starts[min(block + 2, len(starts) - 1)])
        around = np.unique(np.linspace(first, last, 16).astype(np.int64)).tolist()
        steps = [self._step(one) for one in around]
        jumps = [self._step(one, of_frame=True) for one in around]
        values = np.concatenate([known, *steps, *jumps], axis=-1)
        gram = gram_of(*self._white(values, levels), held, levels)
        places = known.shape[-1] - 1 + 3 * np.arange(2 * len(around))
        gain = [_gain_of(gram, np.arange(one, one + 3)) for one in places]
        pushed, jumped = gain[: len(around)], gain[len(around) :]
        best = int(np.argmax(pushed))
        return None if pushed[best] < max(jumped) + _CLEAR else around[best]

    def _loudest(self, left: Floats) -> int | None:
        rows = np.bincount(self._row_node, minlength=self._nodes.count)
        energy = np.bincount(self._row_node, left**2, self._nodes.count) - rows
        summed = np.convolve(energy, np.ones(_BLOCKS), mode="valid")
        block = int(np.argmax(summed))
        return block if summed[block] > 2 * _STANDS_OUT else None

    def _left(self, values: Floats, held: list[tuple[int, float]], levels: Floats) -> Floats:
        """Return what columns of a usual size each leave of the data, whitened: float64[rows]."""
        white, _ = self._white(values, levels)
        damped = np.vstack([white[:, 1:], np.diag([1 / sd for _, sd in held])])
        padded = np.concatenate([white[:, 0], np.zeros(len(held))])
        return np.asarray(
            white[:, 0] - white[:, 1:] @ np.linalg.lstsq(damped, padded, rcond=None)[0]
        )

    def _held(self, count: int) -> list[tuple[int, float]]:
        return [(place, float(_SIZES[-1])) for place in self._own(count).tolist()]

    def _values(self, ticks: list[int]) -> Floats:
        steps = [self._step(one) for one in ticks]
        return np.ascontiguousarray(np.concatenate([self._base, *steps], axis=-1))

    def _step(self, tick: int, *, of_frame: bool = False) -> Floats:
        """Return what a step of one does: turned, forward and to the left, float64[4, m, 3]."""
        known = self._known.get((tick, of_frame))
        if known is not None:
            return known
        columns = []
        small = 1e-3
        for way in range(3):
            prediction = predict(self._nodes.smooth)
            added = np.zeros(len(self._nodes.motion.t_s))
            added[tick] = small
            if way == 0 and of_frame:
                prediction.reference_heading_rad = np.cumsum(added)
            elif way == 0:
                prediction.yaw_rad = prediction.yaw_rad + added
            elif way == 1:
                prediction.left_m = prediction.left_m + added
                prediction.right_m = prediction.right_m + added
            else:
                prediction.lateral_m = prediction.lateral_m + added
            columns.append((self._nominal - residuals(self._nodes, prediction)) / small)
        found = np.stack(columns, axis=-1)
        self._known[tick, of_frame] = found
        return found

    def _white(self, values: Floats, levels: Floats) -> tuple[Floats, Floats]:
        return whiten(np.ascontiguousarray(values), self._model.course, levels, self._nodes.ticks)

    def _gram(self, values: Floats, levels: Floats) -> Gram:
        return gram_of(*self._white(values, levels), self._tolerated, levels)

    def _gain(self, gram: Gram, count: int) -> float:
        return _gain_of(gram, self._own(count)) if count else 0.0

    def _own(self, count: int) -> NDArray[np.int64]:
        """Return where the columns of so many pushes stand."""
        first = len(self._tolerated)
        return np.arange(first, first + 3 * count)


def _gain_of(gram: Gram, own: NDArray[np.int64]) -> float:
    """Return the log evidence of steps of a usual size, less that of none."""
    scales = np.repeat(_SIZES[:, np.newaxis], len(own), axis=1)
    evidences, _ = gains(gram.inner[np.ix_(own, own)], gram.data[own], scales)
    return float(np.logaddexp.reduce(evidences)) - math.log(len(_SIZES))
