"""The noise levels that suit a log best, by scoring; nothing here knows what they are levels of."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEP: Final = 1e-3
"""Of a level's logarithm, for its slope."""
_ROUNDS: Final = 30
_LITTLE: Final = 0.05
"""No step is tried that promises less [nat]."""
_FARTHEST: Final = 2.0
"""A step changes no level by more than a factor of e^2: the slopes are of here."""
_ENOUGH: Final = 0.05
"""A step is kept that gains this share of what its slope promised."""
_BEYOND: Final = 0.3
"""A step that gains less of what its slope promised leads beyond the best along it (half would be
the best itself),"""
_NEAREST: Final = 0.1
"""which is sought no nearer than at this share of it."""
_SETTLED: Final = 0.02
"""Where the best along a step gains less [nat],"""
_SETTLES: Final = 1.0
"""and it promised no more than this, the search ends there: where it promised more, the information
misleads, and a damped step follows the slope."""
_FIRST_DAMPED: Final = 0.2
_LEAST_DAMPED: Final = 5e-3
_MOST_DAMPED: Final = 1e4
_EASED: Final = 5.0
_RIDGE: Final = 1e-9
_FAR_TOO_LOW: Final = 4.0
"""A mean square of what is left that no levels near these make right."""
EVEN_OVER: Final = 50.0
"""The factor over which a level is even that an effect raises."""


class Weighed(NamedTuple):
    """What a log says at one vector of levels.

    Attributes:
        log_evidence: of what is compared, without the levels' own density.
        white: whitened data and columns, float64[r, 1 + c].
        log_variance: of each row before it was whitened, float64[r].
    """

    log_evidence: float
    white: Floats
    log_variance: Floats


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
    weigh: Callable[[Floats], Weighed],
    prior: LevelPrior,
    start: Floats,
    *,
    free: Sequence[int] = (),
    elsewhere: Sequence[Floats] = (),
) -> Floats:
    """Return the levels that maximise evidence times prior, from *start* (float64[levels]), or
    where these are far too low from the best of *elsewhere*: a search that climbs for long drags
    along what has no part in it, and takes as long to bring that back.

    Scoring with the information of the innovations (Engle and Watson 1981, JASA 76:774, section 3;
    Harvey 1989, section 3.4), damped as by Levenberg and Marquardt, within bounds: levels differ a
    thousandfold in how sharply a log tells them, so that slopes alone lead nowhere in ten rounds.
    """
    low, high = np.log(prior.low), np.log(prior.high)

    def at(log_levels: Floats) -> _Place:
        seen = weigh(np.exp(log_levels))
        return _Place(log_levels, seen, seen.log_evidence + prior.log_density(log_levels, free))

    def held(log_levels: Floats, slope: Floats) -> NDArray[np.bool_]:
        return ((log_levels <= low) & (slope < 0)) | ((log_levels >= high) & (slope > 0))

    here = at(np.log(np.maximum(start, prior.low)))
    if elsewhere and _surprise(here.seen) > _FAR_TOO_LOW:
        others = [at(np.log(np.maximum(one, prior.low))) for one in elsewhere]
        here = max(here, *others, key=lambda place: place.height)
    damping = 0.0
    for _ in range(_ROUNDS):
        slope, information = _slopes(weigh, here.log_levels, here.seen, prior.silent)
        restraint = prior.restraint(free)
        slope -= restraint * (here.log_levels - np.log(prior.median))
        information += np.diag(restraint)
        if not np.isfinite(information).all():
            break  # Levels at which the filter runs out of digits: no slope leads from here.
        is_bound = held(here.log_levels, slope)
        while True:
            reach = low - here.log_levels, high - here.log_levels
            step = _step(slope, information, damping, ~is_bound, reach)
            there = np.clip(here.log_levels + step, low, high)
            promised = float(slope @ (there - here.log_levels))
            if damping > _MOST_DAMPED:
                return np.asarray(np.exp(here.log_levels))
            if promised < _LITTLE:
                # Cut to size, a step may lead downhill by its slope: a damped one does not.
                damping = max(_EASED * damping, _FIRST_DAMPED)
                continue
            best, share = _best_along(at, here, there, promised)
            gained = best.height - here.height
            if share < 1.0 and 0.0 <= gained < _SETTLED and promised < _SETTLES:
                return np.asarray(np.exp(best.log_levels))
            left = slope - information @ (there - here.log_levels)
            is_newtons = damping == 0.0 and share == 1.0 and promised < _SETTLES
            leaves_bound = held(there, -left).any()
            if is_newtons and not leaves_bound and _promises(promised, gained) < _LITTLE:
                return np.asarray(np.exp(best.log_levels))
            if gained > _ENOUGH * share * promised:
                here = best
                damping = damping / _EASED if damping > _LEAST_DAMPED else 0.0
                break
            damping = max(_EASED * damping, _FIRST_DAMPED)
    return np.asarray(np.exp(here.log_levels))


def _best_along(
    at: Callable[[Floats], _Place], here: _Place, there: Floats, promised: float
) -> tuple[_Place, float]:
    """Return the better of a step's end and, where that lies beyond the best along it, the top of
    the parabola through slope and both heights; and at which share of the step it is.

    A log bends more along a step than the mean of all that its levels might have made: steps as
    long as that mean has them lead to and fro across the best.
    """
    end = at(there)
    gained = end.height - here.height
    if not gained < _BEYOND * promised:
        return end, 1.0
    share = max(0.5 * promised / (promised - gained), _NEAREST)
    nearer = at(here.log_levels + share * (there - here.log_levels))
    return (nearer, share) if nearer.height > end.height else (end, 1.0)


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
    weigh: Callable[[Floats], Weighed],
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
    _, information = _slopes(weigh, here, weigh(np.exp(here)), prior.silent)
    information = information + np.diag(prior.restraint(free))
    moving = here > np.log(prior.low)
    moving[place] = False
    way = np.zeros(len(here))
    way[place] = 1.0
    inner = information[np.ix_(moving, moving)]
    way[moving] = -np.linalg.lstsq(inner, information[moving, place], rcond=None)[0]
    return way


def _slopes(
    weigh: Callable[[Floats], Weighed], here: Floats, seen: Weighed, silent: Set[int]
) -> tuple[Floats, Floats]:
    """Return slope float64[levels] and information float64[levels, levels] of log evidence by the
    logarithms of levels; nothing of the *silent* ones.

    With whitened innovations w of log variance v, the information of levels i and j is the sum over
    rows of v_i v_j / 2 + (w_i + w v_i / 2) (w_j + w v_j / 2), indices for derivatives.
    """
    weights = _leftover_weights(seen.white)
    left = seen.white @ weights
    slope = np.zeros(len(here))
    rows = np.zeros((2, len(left), len(here)))
    for place in sorted(set(range(len(here))) - silent):
        moved = here.copy()
        moved[place] += _STEP
        there = weigh(np.exp(moved))
        slope[place] = (there.log_evidence - seen.log_evidence) / _STEP
        wider = (there.log_variance - seen.log_variance) / _STEP
        rows[0, :, place] = wider / math.sqrt(2.0)
        rows[1, :, place] = (there.white @ weights - left) / _STEP + 0.5 * left * wider
    flat = rows.reshape(-1, len(here))
    return slope, np.asarray(flat.T @ flat)


def _surprise(seen: Weighed) -> float:
    """Return the mean square of what the columns leave over: one where the levels are right."""
    return float(np.mean((seen.white @ _leftover_weights(seen.white)) ** 2))


def _leftover_weights(white: Floats) -> Floats:
    """Return what to multiply data and columns by for what the columns leave over, float64[1 + c].

    By least squares; columns that are nearly the others' sums are held at little.
    """
    whole = white.T @ white
    size = np.sqrt(np.maximum(np.diag(whole)[1:], np.finfo(np.float64).tiny))
    inner = whole[1:, 1:] / np.outer(size, size) + _RIDGE * np.eye(len(size))
    return np.append(1.0, -np.linalg.solve(inner, whole[1:, 0] / size) / size)
