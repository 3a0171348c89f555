"""Effects that add to the wheel angles in proportion to their size, and set-up mistakes.

Mistakes of the set-up and errors of the counting are told by the motion too; they stand here so
that a drive is not blamed for what a swapped or slipping counter does to its residuals.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.data import DriveData

Floats = NDArray[np.float64]

LINEAR: Final = ("drive_gain", "extra_ticks", "missed_ticks", "ticks_per_rev")
DISCRETE: Final = ("encoder_dead", "setup_sign", "setup_wheels_swapped")
SHARED: Final = frozenset(("extra_ticks", "missed_ticks", "ticks_per_rev", *DISCRETE))
"""Effects whose parameters the motion tells; this block only weighs them."""

_THRESHOLD_QUANTILES: Final = (0.0, 0.5, 0.8)
_DEAD_S: Final = 1.0


@dataclass(frozen=True)
class Variant:
    """One way in which the discrete part of a set of effects can be.

    Attributes:
        data: the data as they would be without set-up mistakes.
        columns: float64[c, 2, m], what the linear effects other than gain add per unit.
        sizes: the prior of each column.
        frozen: per wheel the block from which its count stands still, or None.
    """

    data: DriveData
    columns: Floats
    sizes: tuple[prior.Size, ...]
    frozen: tuple[int | None, int | None] = field(default=(None, None))

    def freeze(self, angle: Floats) -> Floats:
        """Return predicted angles as a dead encoder shows them."""
        if self.frozen == (None, None):
            return angle
        held = angle.copy()
        for wheel, block in enumerate(self.frozen):
            if block is not None:
                held[wheel, block:] = held[wheel, block]
        return held


def variants(data: DriveData, nominal: Floats, effects: Sequence[str]) -> list[Variant]:
    """Return every variant of a set of effects; *nominal* is what a gain of both
    wheels adds."""
    made = [Variant(data, np.zeros((0, *nominal.shape)), ())]
    for effect in effects:
        if effect in ("ticks_per_rev", "missed_ticks", "extra_ticks"):
            size, columns = _columns(data, nominal, effect)
            made = [
                replace(
                    one,
                    columns=np.concatenate((one.columns, column[np.newaxis])),
                    sizes=(*one.sizes, size),
                )
                for one, column in itertools.product(made, columns)
            ]
        elif effect == "encoder_dead":
            made = [
                replace(one, frozen=frozen)
                for one, frozen in itertools.product(made, _dead_from(data))
            ]
        elif effect in ("setup_sign", "setup_wheels_swapped"):
            made = [
                replace(one, data=changed)
                for one in made
                for changed in _mistakes(one.data, effect)
            ]
    return made


def is_possible(data: DriveData, effect: str) -> bool:
    """Tell whether a discrete effect can be in these data at all."""
    return effect != "encoder_dead" or bool(_dead_from(data))


def _columns(data: DriveData, nominal: Floats, effect: str) -> tuple[prior.Size, list[Floats]]:
    if effect == "ticks_per_rev":
        return prior.TICKS_PER_REV, [nominal]
    if effect == "extra_ticks":
        blocks = np.arange(nominal.shape[1], dtype=np.float64)
        elapsed = blocks * (data.block_s * data.tick_rad)
        return prior.EXTRA_TICKS_PER_S, [_on(wheel, elapsed) for wheel in range(2)]
    made = []
    for wheel in range(2):
        steps = np.diff(nominal[wheel], prepend=nominal[wheel, 0])
        moving = np.abs(steps)[np.abs(steps) > data.tick_rad]
        if len(moving) == 0:
            moving = np.zeros(1)
        for quantile in _THRESHOLD_QUANTILES:
            fast = np.abs(steps) >= (np.quantile(moving, quantile) if quantile else 0.0)
            made.append(
                _on(wheel, np.asarray(-np.cumsum(np.where(fast, steps, 0.0)), dtype=np.float64))
            )
    return prior.MISSED_TICKS, made


def _on(wheel: int, column: Floats) -> Floats:
    both = np.zeros((2, len(column)))
    both[wheel] = column
    return both


def _dead_from(data: DriveData) -> list[tuple[int | None, int | None]]:
    """Return where a count may have died: it stands still to the end while told to move."""
    found: list[tuple[int | None, int | None]] = []
    commanded = np.abs(data.commanded[:, data.start[:-1]])
    for wheel in range(2):
        there = np.flatnonzero(data.count[wheel] > 0)
        away = np.abs(data.angle[wheel] - data.angle[wheel, there[-1]]) > 0.6 * data.tick_rad
        last = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
        driven = np.count_nonzero(commanded[wheel, last:] * data.block_s > 2 * data.tick_rad)
        if driven * data.block_s > _DEAD_S:
            found.append((last, None) if wheel == 0 else (None, last))
    return found


def _mistakes(data: DriveData, effect: str) -> list[DriveData]:
    swapped_commands = replace(data, commanded=np.ascontiguousarray(data.commanded[::-1]))
    if effect == "setup_wheels_swapped":
        return [replace(swapped_commands, activity=_activity_swapped(data))]
    flips = [np.array([[-1.0], [1.0]]), np.array([[1.0], [-1.0]])]
    signs = [
        replace(data, angle=data.angle * flip, rate_0=data.rate_0 * flip[:, 0]) for flip in flips
    ]
    return [*signs, replace(swapped_commands, activity=_activity_swapped(data))]


def _activity_swapped(data: DriveData) -> Floats:
    # activity is the larger of measured and commanded; exchanging commands leaves the measured
    return np.maximum(data.activity, data.activity[::-1])
