"""Integrals over a few parameters: a grid for one, importance sampling for more.

One parameter: grids that close in on where the integrand lies. More: the best point of a coarse
grid, then a Student proposal that follows the tempered integrand until it fits (population Monte
Carlo; O. Cappé et al., J. Comput. Graph. Stat. 13(4), 2004).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaln

from gap_diagnosis.pareto import tail_shape

Floats = NDArray[np.float64]
Values = Callable[[Floats], Floats]

_NATS: Final = 12.0
"""Points less likely than the best by more have no say."""
_POINTS: Final = 25
_FINAL_POINTS: Final = 61
_CLOSINGS: Final = 7
_SHRINKS: Final = 0.6
_COARSE: Final = {2: 7, 3: 5, 4: 4}
_ROUND_DRAWS: Final = 60
_ROUNDS: Final = 6
_DRAWS: Final = 250
_FREEDOM: Final = 5.0


@dataclass(frozen=True)
class Weighted:
    """Points that stand for an integral.

    Attributes:
        point: float64[p, d].
        log_value: float64[p], log of integrand times the volume a point stands for.
        cell: float64[d], width over which a point is smeared; 0 where points are draws.
        pareto_k: shape of the weights' tail; 0 for a grid.
    """

    point: Floats
    log_value: Floats
    cell: Floats
    pareto_k: float = 0.0

    @property
    def log_integral(self) -> float:
        """Return the logarithm of the integral."""
        return float(np.logaddexp.reduce(self.log_value))

    @property
    def best(self) -> Floats:
        """Return the weightiest point."""
        return np.asarray(self.point[int(np.argmax(self.log_value))], dtype=np.float64)


def locate(
    log_density: Values,
    bounds: Sequence[tuple[float, float]],
    alone: Sequence[float | None] = (),
) -> Floats:
    """Return where log_density(points float64[p, d]) is largest in a box.

    *alone*: by coordinate, where it is likeliest without the others, or was before all else moved a
    little, if that is known: a peak may be narrower than the grid's cells.
    """
    box = np.array(bounds, dtype=np.float64).reshape(-1, 2)
    if len(box) == 0:
        return np.zeros(0)
    if len(box) == 1:
        return _top(*_close_in(log_density, box)[1:])
    return _best_of_box(log_density, box, alone)


def integrate(
    log_density: Values, bounds: Sequence[tuple[float, float]], start: Floats | None = None
) -> Weighted:
    """Integrate exp(log_density(points float64[p, d])) over a box of one to four dimensions.

    *start* is near the largest value, where that is known from `locate`.
    """
    box = np.array(bounds, dtype=np.float64).reshape(-1, 2)
    if len(box) == 0:
        point = np.zeros((1, 0))
        return Weighted(point, log_density(point), np.zeros(0))
    if len(box) == 1:
        return _by_grid(log_density, box)
    return _by_sampling(
        log_density, box, _best_of_box(log_density, box) if start is None else start
    )


def _by_grid(log_density: Values, box: Floats) -> Weighted:
    box, _, _ = _close_in(log_density, box)
    points, cell = _middles(box, _FINAL_POINTS)
    return Weighted(points, log_density(points) + float(np.sum(np.log(cell))), cell)


def _close_in(log_density: Values, box: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the part of a box of one dimension in which the integrand lies, the points at which it
    was last weighed, and their log densities."""
    for _ in range(_CLOSINGS):
        points, cell = _middles(box, _POINTS)
        values = log_density(points)
        near = points[values > values.max() - _NATS]
        smaller = np.stack(
            [
                np.maximum(near.min(axis=0) - cell, box[:, 0]),
                np.minimum(near.max(axis=0) + cell, box[:, 1]),
            ],
            axis=1,
        )
        shrink = float((smaller[0, 1] - smaller[0, 0]) / (box[0, 1] - box[0, 0]))
        box = smaller
        if shrink > _SHRINKS:
            break
    return box, points, values


def _top(points: Floats, values: Floats) -> Floats:
    """Return where the parabola through the largest of evenly spaced values and its neighbours has
    its top; the largest itself, where that is the first or the last."""
    best = int(np.argmax(values))
    if not 0 < best < len(values) - 1:
        return np.asarray(points[best])
    before, here, after = values[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    share = 0.5 * (before - after) / bend if np.isfinite(bend) and bend < 0.0 else 0.0
    return np.asarray(points[best] + share * (points[best + 1] - points[best]))


def _inside(log_density: Values, box: Floats, candidates: Floats) -> Floats:
    """Return the log density of candidates, -inf outside the box."""
    there = np.all((candidates > box[:, 0]) & (candidates < box[:, 1]), axis=1)
    logs = np.full(len(candidates), -np.inf)
    if there.any():
        logs[there] = log_density(candidates[there])
    return logs


def _best_of_box(log_density: Values, box: Floats, alone: Sequence[float | None] = ()) -> Floats:
    """Return the best point of a coarse grid, of its lines through what is known of single
    coordinates and of the point that all of those make, improved by a simplex."""
    size = len(box)
    points, cell = _middles(box, _COARSE[size])
    lines, known = [points], points
    for place, value in enumerate(alone):
        if value is not None:
            line = points.copy()
            known = known.copy()
            line[:, place] = known[:, place] = np.clip(value, box[place, 0], box[place, 1])
            lines.append(np.unique(line, axis=0))
    points = np.concatenate([*lines, np.unique(known, axis=0)])
    start = points[int(np.argmax(log_density(points)))]
    found = minimize(
        lambda point: -max(float(_inside(log_density, box, point[np.newaxis])[0]), -1e300),
        start,
        method="Nelder-Mead",
        options={
            "maxfev": 60 * size,
            "initial_simplex": np.vstack([start, start + 0.45 * np.diag(cell)]),
            "fatol": 0.05,
            "xatol": 1e-7,
        },
    )
    return np.asarray(found.x, dtype=np.float64)


def _by_sampling(log_density: Values, box: Floats, start: Floats) -> Weighted:
    size = len(box)
    cell = (box[:, 1] - box[:, 0]) / _COARSE[size]
    mean = start
    covariance = np.diag((0.5 * cell) ** 2)
    random = np.random.default_rng(1)
    temper = 0.0
    for _ in range(4 * _ROUNDS):
        draws, log_proposal = _student(mean, covariance, _ROUND_DRAWS, random)
        values = _inside(log_density, box, draws)
        ratio = values - log_proposal
        temper = _temperature(values, ratio)
        weight = _tempered(values, ratio, temper)
        mean = weight @ draws
        away = draws - mean
        covariance = (weight[:, np.newaxis] * away).T @ away + 1e-9 * covariance
        if temper == 1.0 and float(1 / np.sum(weight**2)) > 0.35 * _ROUND_DRAWS:
            break
    draws, log_proposal = _student(mean, 1.3 * covariance, _DRAWS, random)
    log_value = _inside(log_density, box, draws) - log_proposal - np.log(_DRAWS)
    return Weighted(draws, log_value, np.zeros(size), tail_shape(log_value))


def _temperature(values: Floats, ratio: Floats) -> float:
    """Return the largest power of the integrand that a quarter of the draws still carries."""
    for temper in (1.0, 0.5, 0.25, 0.1, 0.03, 0.01, 0.003, 0.001, 1e-4, 1e-5):
        weight = _tempered(values, ratio, temper)
        if float(1 / np.sum(weight**2)) > 0.2 * len(values):
            return temper
    return 1e-5


def _tempered(values: Floats, ratio: Floats, temper: float) -> Floats:
    logs = np.where(np.isfinite(values), temper * np.where(np.isfinite(ratio), ratio, 0.0), -np.inf)
    weight = np.exp(logs - logs.max())
    return np.asarray(weight / weight.sum(), dtype=np.float64)


def _student(
    mean: Floats, covariance: Floats, count: int, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return draws from a Student distribution and their log densities."""
    size = len(mean)
    factor = np.linalg.cholesky(covariance + 1e-300 * np.eye(size))
    normal = random.standard_normal((count, size))
    stretch = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, count))[:, np.newaxis]
    square = np.sum((normal * stretch) ** 2, axis=1)
    log_density = (
        gammaln((_FREEDOM + size) / 2)
        - gammaln(_FREEDOM / 2)
        - 0.5 * size * np.log(_FREEDOM * np.pi)
        - float(np.sum(np.log(np.diag(factor))))
        - 0.5 * (_FREEDOM + size) * np.log1p(square / _FREEDOM)
    )
    return mean + (normal * stretch) @ factor.T, np.asarray(log_density)


def _middles(box: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the middles of *count* equal cells along each side, and the cells' widths."""
    cell = (box[:, 1] - box[:, 0]) / count
    axes = [box[i, 0] + cell[i] * (np.arange(count) + 0.5) for i in range(len(box))]
    return np.array(list(itertools.product(*axes)), dtype=np.float64), cell
