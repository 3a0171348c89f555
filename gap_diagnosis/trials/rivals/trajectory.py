"""Dead-reckoned trajectories against the reference, and least squares on what is left.

The start pose and a time offset within its tolerance are refitted under every hypothesis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.explanations import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Setting, Variant
from gap_diagnosis.gap.metrics import Path
from gap_diagnosis.gap.odometry import as_reported, gyro_turn_rad
from gap_diagnosis.motion.columns import GROSS
from gap_diagnosis.motion.gross import looks_gross
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.trials.rivals.door import Job

_APART_S: Final = 0.1
"""Samples of the reference this far apart are compared: more of them say nothing new."""
_START: Final = 3
_STEPS: Final = 3
_LEAST: Final = 1e-9


@dataclass(frozen=True)
class Fitted:
    """A hypothesis fitted to the trajectories.

    Attributes:
        effect: its name; empty for none.
        setting: variant and coefficients; None for no effect.
        sds: standard deviations of the coefficients, for white residuals.
        squares: sum of the squared residuals that are left.
        count: of residuals.
        free: number of parameters fitted, the start pose and the offset among them.
        is_news: whether a coefficient is beyond its tolerance (an effect without one always is).
    """

    effect: str
    setting: Setting | None
    sds: tuple[float, ...]
    squares: float
    count: int
    free: int
    is_news: bool

    @property
    def bic(self) -> float:
        """Schwarz's criterion for independent normal residuals of unknown variance."""
        return self.count * math.log(self.squares / self.count) + self.free * math.log(self.count)


class Trajectories:
    """The paths by the wheels' heading and by the gyro's, held against the reference."""

    def __init__(self, job: Job) -> None:
        """Choose the samples that a fit may use."""
        self._job = job
        reference = job.recording.reference
        assert reference is not None  # every case of a trial has one
        t_s, motion = reference.t_s, job.motion
        inside = (t_s > motion.t_s[0] + 0.1) & (t_s < motion.t_s[-1] - 0.1)
        nearest = np.clip(np.searchsorted(motion.t_s, t_s), 0, len(motion.t_s) - 1)
        inside &= job.sides.fit[nearest]
        rows = np.flatnonzero(inside)
        every = max(1, round(_APART_S / float(np.median(np.diff(t_s)))))
        rows = rows[::every]
        heading = np.zeros(len(rows))
        if reference.heading_rad is not None:
            heading = reference.heading_rad[rows]
        self._t_s = t_s[rows]
        self._measured = np.array([reference.x_m[rows], reference.y_m[rows], heading])
        self._offset_limit_s = job.robot.tolerance.time_offset_s
        self._nothing = self._paths(predict(motion))
        late = self._paths(predict(motion), 1e-3)
        self._by_offset = (late - self._nothing) / 1e-3
        first = self._measured[:, 0] - self._nothing[0, :, 0]
        self._turn_rad = float(first[2])

    def best(self) -> list[Fitted]:
        """Return no effect and the best variant of every effect of the motion, fitted."""
        found = [self.fit(None)]
        for variants in self._variants().values():
            quick = [one for v in variants if (one := self._quick(v)) is not None]
            if quick:
                found.append(self.fit(min(quick, key=lambda one: one[0])[1]))
        return found

    def _variants(self) -> dict[str, list[Variant]]:
        gross = looks_gross(self._job.recording, self._job.robot)
        return {
            effect: list(known.variants(self._job.motion))
            for effect, known in EXPLAINED.items()
            if effect not in self._job.without and (gross or effect not in GROSS)
        }

    def _quick(self, variant: Variant) -> tuple[float, Variant] | None:
        """Return what one linear step leaves; None for a variant that changes nothing."""
        start = tuple(0.0 for _ in variant.coefficients)
        columns = self._columns(variant, start, self._nothing)
        if variant.coefficients:
            if any(np.abs(one).max() < _LEAST for one in columns):
                return None
            return self._solved(self._nothing, columns, variant)[0], variant
        moved = self._paths(predict(self._job.motion, [(variant, ())]))
        if np.abs(moved - self._nothing).max() < _LEAST:
            return None
        return self._solved(moved, [], variant)[0], variant

    def fit(self, variant: Variant | None) -> Fitted:
        """Fit by Gauss and Newton: start pose, offset, coefficients."""
        coefficients = () if variant is None else tuple(0.0 for _ in variant.coefficients)
        for _ in range(_STEPS if coefficients else 1):
            settings = [] if variant is None else [(variant, coefficients)]
            paths = self._paths(predict(self._job.motion, settings))
            columns = [] if variant is None else self._columns(variant, coefficients, paths)
            squares, steps, sds = self._solved(paths, columns, variant)
            coefficients = tuple(
                _within(variant, one + step) for one, step in zip(coefficients, steps, strict=True)
            )
        if coefficients:
            assert variant is not None
            paths = self._paths(predict(self._job.motion, [(variant, coefficients)]))
            squares = self._solved(paths, [], variant)[0]
        return Fitted(
            effect="" if variant is None else variant.effect,
            setting=None if variant is None else (variant, coefficients),
            sds=sds,
            squares=max(squares, 1e-12),
            count=2 * self._measured.size,
            free=_START + 1 + len(coefficients),
            is_news=variant is not None and self._is_news(variant, coefficients),
        )

    def _is_news(self, variant: Variant, coefficients: Sequence[float]) -> bool:
        known = default_prior()
        if not coefficients:
            return True
        limits = [known.of(variant.effect, name).tolerance for name in variant.coefficients]
        if variant.polar is not None:
            return math.hypot(*coefficients) > limits[0]
        return any(abs(c) > limit for c, limit in zip(coefficients, limits, strict=True))

    def _columns(
        self, variant: Variant, coefficients: Sequence[float], paths: Floats
    ) -> list[Floats]:
        """Return how the paths move with each coefficient."""
        known = default_prior()
        columns = []
        for index, name in enumerate(variant.coefficients):
            step = known.of(variant.effect, name).tolerance
            near = list(coefficients)
            near[index] += step
            moved = self._paths(predict(self._job.motion, [(variant, near)]))
            columns.append((moved - paths) / step)
        return columns

    def _paths(self, prediction: Prediction, late_s: float = 0.0) -> Floats:
        """Return both paths as the reference should report them, float64[2, 3, m]."""
        turns = [np.cumsum(prediction.turn_rad), gyro_turn_rad(prediction)]
        found = []
        for turn in turns:
            path = Path(self._job.motion.t_s, *prediction.path(turn))
            said = as_reported(prediction, path)
            assert said.heading_rad is not None  # dead reckoning has one
            at_s = self._t_s - late_s
            order = np.asarray(said.t_s, dtype=np.float64)
            found.append(
                [np.interp(at_s, order, v) for v in (said.x_m, said.y_m, said.heading_rad)]
            )
        return np.array(found)

    def _solved(
        self, paths: Floats, columns: Sequence[Floats], variant: Variant | None
    ) -> tuple[float, Floats, tuple[float, ...]]:
        """Return sum of squares, steps of the coefficients and their standard deviations.

        Paths are turned and moved onto the reference; the start's own turn is refitted twice.
        """
        turn = self._turn_rad
        for _ in range(2):
            placed = _turned(paths, turn)
            left = (self._measured - placed).ravel()
            ones = np.zeros((_START, *paths.shape))
            ones[0, :, 0], ones[1, :, 1], ones[2, :, 2] = 1.0, 1.0, 1.0
            ones[2, :, 0], ones[2, :, 1] = -placed[:, 1], placed[:, 0]
            free = [one.ravel() for one in ones]
            own = [_turned(one, turn, is_step=True).ravel() for one in columns]
            offset = _turned(self._by_offset, turn, is_step=True).ravel()
            is_offset = variant is not None and variant.effect == "reference_time_offset"
            matrix = np.array([*free, *([] if is_offset else [offset]), *own])
            solved = np.linalg.lstsq(matrix.T, left, rcond=None)[0]
            if not is_offset and abs(solved[_START]) > self._offset_limit_s:
                held = math.copysign(self._offset_limit_s, solved[_START])
                rest = np.delete(matrix, _START, axis=0)
                some = np.linalg.lstsq(rest.T, left - held * offset, rcond=None)[0]
                solved = np.insert(some, _START, held)
            turn += float(solved[2])
        last = left - solved @ matrix
        squares = float(last @ last)
        count = len(columns)
        if count == 0:
            return squares, np.zeros(0), ()
        covariance = np.linalg.pinv(matrix @ matrix.T) * squares / len(left)
        sds = np.sqrt(np.maximum(np.diag(covariance)[-count:], 0.0))
        return squares, solved[-count:], tuple(sds.tolist())


def _turned(paths: Floats, turn_rad: float, *, is_step: bool = False) -> Floats:
    """Turn paths float64[2, 3, m] about the origin; a *step* has no heading to be added to."""
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    x, y, heading = paths[:, 0], paths[:, 1], paths[:, 2]
    turned = heading if is_step else heading + turn_rad
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, turned], axis=1)


def _within(variant: Variant | None, value: float) -> float:
    """Keep a size that cannot be negative from being so."""
    return max(value, 0.0) if variant is not None and variant.is_positive else value
