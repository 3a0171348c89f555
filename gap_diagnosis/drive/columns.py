"""Effects that add to the wheel angles in proportion to their size, and what is there or not.

Errors of the counting are told by the motion too; they stand here so that a drive is not blamed for
what a slipping or dead counter does to its residuals.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.data import DriveData
from gap_diagnosis.drive.mistakes import SETUP, Mistake, mistakes
from gap_diagnosis.drive.shapes import masked
from gap_diagnosis.explanations.known import COUNTING

Floats = NDArray[np.float64]

TICKS: Final = "ticks_per_rev"
LINEAR: Final = ("drive_gain", *sorted(COUNTING))
SHARED: Final = COUNTING | {"encoder_dead"}
"""Effects whose parameters the motion tells; this block only weighs them."""

_THRESHOLD_QUANTILES: Final = (0.0, 0.5, 0.8)
_DEAD_S: Final = 1.0
_STILL_TICKS: Final = 0.5
"""How closely a count that stands still is foretold."""


@dataclass(frozen=True)
class Variant:
    """One way in which the discrete part of a set of effects can be.

    Attributes:
        data: the data as they would be without set-up mistakes, and without what a dead encoder
            says.
        columns: float64[c, 2, m], what the linear effects other than gain add per unit, all along.
        sizes: the prior of each column.
        log_constant: log density of what was taken out of the data, or of their change of scale.
        values: of the mistake, by name.
    """

    data: DriveData
    columns: Floats
    sizes: tuple[prior.Size, ...]
    log_constant: float = 0.0
    values: Mapping[str, str | float] = field(default_factory=dict)

    @property
    def acting(self) -> Floats:
        """The columns where counts are wrong: float64[c, 2, m]."""
        spell = self.data.miscounting
        return self.columns if spell is None else masked(self.columns, spell)


def variants(
    data: DriveData,
    nominal: Floats,
    effects: Sequence[str],
    doubted: frozenset[str] = frozenset(),
) -> list[Variant]:
    """Return every variant of a set of effects; *nominal* are the described wheel angles,
    *doubted* the signals of which a mistake of the set-up may be."""
    made = [Variant(data, np.zeros((0, *nominal.shape)), ())]
    for effect in effects:
        if effect in COUNTING:
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
                _without_dead(one, *dead) for one, dead in itertools.product(made, _dead_from(data))
            ]
        elif effect in SETUP:
            made = [
                _mistaken(one, wrong)
                for one in made
                for wrong in mistakes(one.data, effect, doubted)
            ]
    return made


def _mistaken(one: Variant, wrong: Mistake) -> Variant:
    return replace(
        one,
        data=wrong.data,
        log_constant=one.log_constant + wrong.log_scale,
        values={**one.values, **wrong.values},
    )


def may_be_dead(data: DriveData) -> bool:
    """Tell whether an encoder can be dead in these data at all."""
    return bool(_dead_from(data))


def _columns(data: DriveData, nominal: Floats, effect: str) -> tuple[prior.Size, list[Floats]]:
    if effect == TICKS:
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


def _dead_from(data: DriveData) -> list[tuple[int, int]]:
    """Return (wheel, block) where a count may have died: it stands still to the end while told to
    move."""
    found: list[tuple[int, int]] = []
    commanded = np.abs(data.commanded[:, data.start[:-1]])
    for wheel in range(2):
        there = np.flatnonzero(data.count[wheel] > 0)
        away = np.abs(data.angle[wheel] - data.angle[wheel, there[-1]]) > 0.6 * data.tick_rad
        last = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
        driven = np.count_nonzero(commanded[wheel, last:] * data.block_s > 2 * data.tick_rad)
        if driven * data.block_s > _DEAD_S:
            found.append((wheel, last))
    return found


def _without_dead(one: Variant, wheel: int, block: int) -> Variant:
    """Leave a dead encoder out: it stands still, which is foretold to the count.

    The block in which it died tells of a part of the motion only.
    """
    data = one.data
    dead = np.zeros(data.seen.shape, dtype=np.bool_)
    dead[wheel, max(block - 1, 0) :] = True
    dead &= data.seen
    variance = (_STILL_TICKS * data.tick_rad) ** 2 / data.count[dead]
    return replace(
        one,
        data=replace(data, seen=data.seen & ~dead),
        log_constant=one.log_constant - 0.5 * float(np.sum(np.log(variance))),
    )
