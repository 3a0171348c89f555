"""The noise levels that suit a log best, by scoring; nothing here knows what they are levels of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.slopes import Weigh, Weighed, leftover_weights, slopes

Floats = NDArray[np.float64]

_ROUNDS: Final = 30
_LITTLE: Final = 0.05
"""No step is tried that promises less [nat]."""
_FARTHEST: Final = 2.0
"""A step changes no level by more than a factor of e^2: the slopes are of here. Where they hold on
it is tried longer."""
_ENOUGH: Final = 0.05
"""A step is kept that gains this share of what its slope promised."""
_BEYOND: Final = 0.3
"""A step that gains less of what its slope promised leads beyond the best along it (half would be
the best itself),"""
_NEAREST: Final = 0.1
"""which is sought no nearer than at this share of it."""
_STEEP: Final = 0.75
"""A step that gains more of what its slope promised is tried twice as long,"""
_FARTHER: Final = 4.0
"""and once more."""
_SETTLED: Final = 0.02
"""Where the best along a step gains less [nat],"""
_SETTLES: Final = 1.0
"""and it promised no more than this, the search ends there: where it promised more, the information
misleads, and a damped step follows the slope."""
_BENT_BELOW: Final = 10.0
"""Where it promises less, the last steps say how slopes change,"""
_SEEN: Final = 2
"""so many of them,"""
_LEAST_BENT: Final = 0.2
"""unless one changed by less than this share of what was to be expected."""
_AT_REST: Final = 30.0
"""A bound holds a level for certain whose slope, squared, is so many times its information."""
_NEWTONS: Final = 0.5
"""A step of Newton's that promised no more, and gained half of that, ends a search too: along a
ridge that hardly rises and then by 200 nats, one that promised 0.9 did so."""
_NOTHING: Final = 0.02
"""At its end no slope promises more, as a parabola through both heights has it [nat]."""
_FIRST_DAMPED: Final = 0.2
_LEAST_DAMPED: Final = 5e-3
_MOST_DAMPED: Final = 1e4
_EASED: Final = 5.0
_RIDGE: Final = 1e-9
_FAR_TOO_LOW: Final = 4.0
"""A mean square of what is left that no levels near these make right."""
EVEN_OVER: Final = 50.0
"""The factor over which a level is even that an effect raises."""


class _Place(NamedTuple):
    """What a search knows of one vector of levels: their logarithms, what the log says at them, and
    with their own density."""

    log_levels: Floats
    seen: Weighed
    height: float


@dataclass(frozen=True)
class LevelPrior:
    """Log-normal priors of the levels: medians and standard deviations of the logarithm, and the
    least and the largest that are believed; float64[levels] each.

    On the *silent* ones nothing in the log depends: their slope is not asked for.
    """

    median: Floats
    spread: Floats
    low: Floats
    high: Floats
    silent: frozenset[int] = frozenset()

    def log_density(self, log_levels: Floats, free: Sequence[int] = ()) -> float:
        """Return the log density; the levels in *free* are even over `EVEN_OVER` instead."""
        score = (log_levels - np.log(self.median)) / self.spread
        terms = -0.5 * score**2 - np.log(self.spread) - 0.5 * math.log(math.tau)
        for index in free:
            terms[index] = -math.log(math.log(EVEN_OVER))
        return float(terms.sum())

    def restraint(self, free: Sequence[int] = ()) -> Floats:
        """Return the inverse variances of the logarithms; none for the levels in *free*."""
        precision = self.spread**-2.0
        precision[list(free)] = 0.0
        return np.asarray(precision)


def best_levels(
    weigh: Weigh,
    prior: LevelPrior,
    start: Floats,
    *,
    free: Sequence[int] = (),
    elsewhere: Sequence[Floats] = (),
) -> Floats:
    """Return the levels that maximise evidence times prior, from *start* (float64[levels]), as
    `better_levels` seeks them."""
    return better_levels(weigh, prior, [start], free=free, elsewhere=elsewhere)[0]


def better_levels(
    weigh: Weigh,
    prior: LevelPrior,
    starts: Sequence[Floats],
    *,
    free: Sequence[int] = (),
    elsewhere: Sequence[Floats] = (),
) -> tuple[Floats, float]:
    """Return the levels that maximise evidence times prior, from the best of *starts*
    (float64[levels] each), and what they gain on it [nat].

    Where that is far too low, from the best of *elsewhere*: a search that climbs for long drags
    along what has no part in it, and takes as long to bring that back.

    Scoring with the information of the innovations (Engle and Watson 1981, JASA 76:774, section 3;
    Harvey 1989, section 3.4), damped as by Levenberg and Marquardt, within bounds: levels differ a
    thousandfold in how sharply a log tells them, so that slopes alone lead nowhere in ten rounds.
    """
    search = _Search(weigh, prior, free)
    begun = [search.at(np.log(np.maximum(one, prior.low))) for one in starts]
    here = max(begun, key=lambda place: place.height)
    begun_at = here.height
    if elsewhere and _surprise(here.seen) > _FAR_TOO_LOW:
        others = [search.at(np.log(np.maximum(one, prior.low))) for one in elsewhere]
        here = max(here, *others, key=lambda place: place.height)
    damping, steps = 0.0, _Steps()
    # Levels that their bounds hold for certain are asked again only where the search would end.
    resting: frozenset[int] = frozenset()
    for _ in range(_ROUNDS):
        slope, information = slopes(weigh, here.log_levels, here.seen, prior.silent | resting)
        slope = slope + search.pull(here.log_levels)
        slope[list(resting)] = 0.0
        information = information + search.restraint
        if not np.isfinite(information).all():
            break  # Levels at which the filter runs out of digits: no slope leads from here.
        is_bound = search.held(here.log_levels, slope)
        is_bound[list(resting)] = True
        is_at_rest = is_bound & (slope**2 > _AT_REST * np.diag(information))
        information = steps.bent(here.log_levels, slope, information)
        best, damping, promised, ends = search.step(here, slope, information, is_bound, damping)
        if ends:
            stays = search.still_held(best, resting)
            if stays == resting:
                return np.exp(best.log_levels), best.height - begun_at
            resting, damping, steps = stays, 0.0, _Steps()
        else:
            steps.add(here.log_levels, slope, promised)
            resting |= frozenset(np.flatnonzero(is_at_rest).tolist())
        here = best
    return np.exp(here.log_levels), here.height - begun_at


class _Search:
    """What every round of a search for levels asks."""

    def __init__(self, weigh: Weigh, prior: LevelPrior, free: Sequence[int]) -> None:
        self._weigh, self._prior, self._free = weigh, prior, free
        self._bounds = np.log(prior.low), np.log(prior.high)
        self.restraint = np.diag(prior.restraint(free))

    def at(self, log_levels: Floats) -> _Place:
        """Return what is known at these levels."""
        seen = self._weigh(np.exp(log_levels))
        height = seen.log_evidence + self._prior.log_density(log_levels, self._free)
        return _Place(log_levels, seen, height)

    def pull(self, log_levels: Floats) -> Floats:
        """Return the slope of the prior."""
        return np.asarray(self.restraint @ (np.log(self._prior.median) - log_levels))

    def held(self, log_levels: Floats, slope: Floats) -> NDArray[np.bool_]:
        """Tell which levels a bound holds."""
        low, high = self._bounds
        return ((log_levels <= low) & (slope < 0)) | ((log_levels >= high) & (slope > 0))

    def still_held(self, place: _Place, levels: frozenset[int]) -> frozenset[int]:
        """Return which of some *levels* at their bounds these hold here."""
        if not levels:
            return levels
        others = set(range(len(place.log_levels))) - levels
        slope, _ = slopes(self._weigh, place.log_levels, place.seen, others)
        is_held = self.held(place.log_levels, slope + self.pull(place.log_levels))
        return levels & set(np.flatnonzero(is_held).tolist())

    def step(
        self,
        here: _Place,
        slope: Floats,
        information: Floats,
        is_bound: NDArray[np.bool_],
        damping: float,
    ) -> tuple[_Place, float, float, bool]:
        """Return where a step leads that is worth it, more damped until one is; the next one's
        damping, what its slope promised [nat], and whether the search ends there."""
        low, high = self._bounds
        while damping <= _MOST_DAMPED:
            reach = low - here.log_levels, high - here.log_levels
            step = _step(slope, information, damping, ~is_bound, reach)
            there = np.clip(here.log_levels + step, low, high)
            promised = float(slope @ (there - here.log_levels))
            if promised < _LITTLE:
                # Cut to size, a step may lead downhill by its slope: a damped one does not.
                damping = max(_EASED * damping, _FIRST_DAMPED)
                continue
            best, share = self._best_along(here, there, promised)
            gained = best.height - here.height
            settles = share < 1.0 and 0.0 <= gained < _SETTLED and promised < _SETTLES
            left = slope - information @ (there - here.log_levels)
            is_newtons = damping == 0.0 and share == 1.0 and promised < _NEWTONS
            leaves_bound = self.held(there, -left).any()
            arrives = is_newtons and not leaves_bound and _promises(promised, gained) < _NOTHING
            if settles or arrives or gained > _ENOUGH * share * promised:
                eased = damping / _EASED if damping > _LEAST_DAMPED else 0.0
                return best, eased, promised, settles or arrives
            damping = max(_EASED * damping, _FIRST_DAMPED)
        return here, 0.0, 0.0, True

    def _best_along(self, here: _Place, there: Floats, promised: float) -> tuple[_Place, float]:
        """Return the best place seen along a step, and at which share of it that is: one where it
        is the end or beyond.

        A log bends more along a step than the mean of all that its levels might have made: steps
        as long as that mean has them lead to and fro across the best. So where the end lies beyond
        that, the top of the parabola through slope and both heights is tried; and where the slope
        has hardly changed, which is so where levels are far too high, as far again.
        """
        end = self.at(there)
        gained = end.height - here.height
        if gained < _BEYOND * promised:
            share = max(0.5 * promised / (promised - gained), _NEAREST)
            nearer = self.at(here.log_levels + share * (there - here.log_levels))
            return (nearer, share) if nearer.height > end.height else (end, 1.0)
        share = 1.0
        while share < _FARTHER and end.height - here.height > _STEEP * share * promised:
            share *= 2.0
            farther = self.at(
                np.clip(here.log_levels + share * (there - here.log_levels), *self._bounds)
            )
            if not farther.height > end.height:
                break
            end = farther
        return end, 1.0


class _Steps:
    """What the last steps of a search showed of how slopes change along them."""

    def __init__(self) -> None:
        self.promised = math.inf
        self._from: tuple[Floats, Floats] | None = None
        self._seen: list[tuple[Floats, Floats]] = []

    def add(self, log_levels: Floats, slope: Floats, promised: float) -> None:
        """Note a step from levels with a slope."""
        self._from, self.promised = (log_levels, slope), promised

    def bent(self, log_levels: Floats, slope: Floats, information: Floats) -> Floats:
        """Return the information with what the last steps to these levels showed (Broyden,
        Fletcher, Goldfarb and Shanno; Nocedal and Wright 2006, equation 6.19).

        It is a mean over all that the levels might have made; of a level that other noise hides
        this log's slope changes several times as fast, and steps go to and fro across its best.
        """
        if self._from is None:
            return information
        step = log_levels - self._from[0]
        # Slopes of levels at their bounds, or at rest there, are not these steps' doing.
        change = np.where(step == 0.0, 0.0, self._from[1] - slope)
        self._seen = [*self._seen, (step, change)][-_SEEN:]
        if self.promised > _BENT_BELOW:
            return information
        for step, change in self._seen:
            along = information @ step
            if change @ step > _LEAST_BENT * (step @ along):
                information = information - np.outer(along, along) / (step @ along)
                information = information + np.outer(change, change) / (change @ step)
        return information


def _promises(promised: float, gained: float) -> float:
    """Return what the slope at a step's end promises along it, where the log is a parabola there.

    A step of Newton's gains half of what its slope promised, and nothing is left; one that gained
    another share ends on a slope, and the way on is as much longer or shorter as that was wrong.
    """
    return (promised - 2.0 * gained) ** 2 / promised


def _step(
    slope: Floats,
    information: Floats,
    damping: float,
    is_free: NDArray[np.bool_],
    reach: tuple[Floats, Floats],
) -> Floats:
    """Return the damped Newton step of the levels that are free to move, within *reach* of each.

    What would go farthest beyond ends there, and the others go as suits that: of two that take each
    other's place, one would else go the wrong way.
    """
    damped = information + np.diag(damping * np.diag(information) + _RIDGE)
    step, moving = np.zeros(len(slope)), is_free.copy()
    while moving.any():
        pull = slope[moving] - damped[np.ix_(moving, ~moving)] @ step[~moving]
        step[moving] = np.linalg.solve(damped[np.ix_(moving, moving)], pull)
        beyond = np.abs(step - np.clip(step, *reach)) * moving
        first = int(np.argmax(beyond))
        if beyond[first] == 0.0:
            break
        step[first] = np.clip(step, *reach)[first]
        moving[first] = False
    return np.clip(step, -_FARTHEST, _FARTHEST)


def along(
    weigh: Weigh,
    prior: LevelPrior,
    levels: Floats,
    place: int,
    *,
    free: Sequence[int] = (),
) -> Floats:
    """Return how the logarithms of the best levels go with that of the one at *place*.

    float64[levels]: one there, and what the information of all makes of the others; none of those
    at a floor.
    """
    here = np.log(np.maximum(levels, prior.low))
    _, information = slopes(weigh, here, weigh(np.exp(here)), prior.silent)
    information = information + np.diag(prior.restraint(free))
    moving = here > np.log(prior.low)
    moving[place] = False
    way = np.zeros(len(here))
    way[place] = 1.0
    inner = information[np.ix_(moving, moving)]
    way[moving] = -np.linalg.lstsq(inner, information[moving, place], rcond=None)[0]
    return way


def _surprise(seen: Weighed) -> float:
    """Return the mean square of what the columns leave over: one where the levels are right."""
    return float(np.mean((seen.white @ leftover_weights(seen)) ** 2))
