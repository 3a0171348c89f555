"""Drives that answer their commands in some way that no effect of the list has."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.columns import Variant
from gap_diagnosis.drive.data import DriveData, Spell
from gap_diagnosis.drive.likelihood import (
    Setting,
    evidence,
    fitted_levels,
    linear_sizes,
    setting_of,
)
from gap_diagnosis.drive.noise import Levels, whitened
from gap_diagnosis.drive.shapes import FEWEST_POLES, WAVE, Shapes, masked
from gap_diagnosis.drive.told import GIVES_WAY, is_as_described, off
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

AS_TOLD: Final = 0.3 * prior.GAIN.tolerance
"""A drive that is off by less of its rates does as it is told: on a slope every loop gives way."""
_WAVES_TOLD: Final = 0.5 * prior.GAIN.tolerance
"""Poles by which a wheel's rate goes up and down by less are none of its faults,"""
_ROUNDING: Final = 0.1
"""nor those by which its angle does by less of a count."""
STANDS: Final = -0.5
"""Of its rate a drive that does as it is told gives way by less, however slow that is: one that
gives way by more stands."""

_A_MANNER: Final = 5.0
"""What gains less [nat] needs no manner."""
_LEFT: Final = 0.04
"""Share of what a manner gains that it may leave over: a fifth of its amplitude."""


@dataclass(frozen=True)
class Null:
    """What the log says of no effect.

    Attributes:
        setting: of the data as they are.
        levels: logarithms of its noise levels.
        likelihood, evidence: their logarithms.
    """

    setting: Setting
    levels: Floats
    likelihood: float
    evidence: float

    @property
    def data(self) -> DriveData:
        """Commands and wheels."""
        return self.setting.variant.data


@dataclass(frozen=True)
class Foreign:
    """What a drive explains that answers in some way of its own.

    Attributes:
        evidence, likelihood: their logarithms, less those of no effect.
        columns: float64[c, 2, m], what it may add to the angles.
        sizes: of its columns, the best ones.
        levels: logarithms of the noise levels beside it.
    """

    evidence: float
    likelihood: float
    columns: Floats
    sizes: Floats
    levels: Floats


@dataclass(frozen=True)
class Manner:
    """How a drive that does as it is told answers otherwise than a first-order lag.

    Attributes:
        columns: float64[c, 2, m], what that may add to the angles.
        gained: log evidence of it.
    """

    columns: Floats
    gained: float

    @property
    def leaves(self) -> float:
        """What of it, not being exact, it may leave to what is sought beside it [nat]."""
        return _LEFT * self.gained


def unlisted(
    null: Null, robot: Robot, without: frozenset[str], spell: Spell | None = None
) -> tuple[float, float]:
    """Return logarithms of evidence and best likelihood of a drive without a name, less those of
    no effect.

    Linear dynamics of other time constants with a speed that bends with the command, answers
    that come late, or a gain of each wheel, some function of its speed, or of driving and of
    turning, all of unknown size: what is left to a motor, a velocity loop or an engine not in the
    library. Or one that answers slow commands in a way of their own, or whose poles show in its
    rate. A steady gain is a listed effect, unless the library is *without* it. Any of the first may
    be all along or in a *spell*.
    """
    shapes = Shapes(null.data, robot)
    does_as_told = as_told(null.data, robot)
    found = []
    log_spell = prior.log_of_spell(null.data.angle.shape[1])
    for columns in shapes.foreign(has_gains="drive_gain" in without):
        ways = [foreign(null, robot, columns)]
        if spell is not None:
            one = foreign(null, robot, masked(columns, spell))
            ways.append(replace(one, evidence=one.evidence + log_spell))
        found += [
            replace(one, evidence=min(one.evidence, 0.0)) if does_as_told else one for one in ways
        ]
    slow = shapes.slow()
    if len(slow):
        one = foreign(null, robot, slow)
        if not does_as_told or one.sizes.min() < STANDS:
            found.append(one)
    poles = poles_of(null, robot, shapes.waves())
    if poles is not None:
        found.append(poles)
    total = float(np.logaddexp.reduce([one.evidence for one in found])) - math.log(len(found))
    return total, max(one.likelihood for one in found)


def as_told(data: DriveData, robot: Robot) -> bool:
    """Tell whether what a drive does otherwise than it is told is no news, in whatever way that
    goes with its speed or its commands."""
    return off(data, robot) < AS_TOLD or is_as_described(data, robot)


def manner(null: Null, robot: Robot, listed: Callable[[], float]) -> Manner | None:
    """Return the drive's own manner of answering, if it has one that is likelier than any listed
    effect, whose best log evidence *listed* returns.

    No first-order lag is what a motor, its loop and its load do together. Where that moves the
    wheels by no more than a description may be off, it is none of the drive's faults.
    """
    if not is_as_described(null.data, robot):
        return None
    own = own_manner(null, robot)
    return own if own is not None and own.gained > listed() else None


def own_manner(null: Null, robot: Robot) -> Manner | None:
    """Return in which manner a drive answers other than a first-order lag; None where it hardly
    does."""
    columns = np.concatenate(Shapes(null.data, robot).foreign()[:2])
    if 0.5 * _explained(null, [columns])[0] < _A_MANNER:
        return None
    gained = foreign(null, robot, columns).evidence
    return Manner(columns, gained) if gained > _A_MANNER else None


def foreign(null: Null, robot: Robot, columns: Floats) -> Foreign:
    """Return what columns of unknown size explain."""
    variant = Variant(null.data, columns, (prior.FOREIGN,) * len(columns))
    setting = setting_of(variant, robot, frozenset())
    levels, free = fitted_levels(setting, {}, null.levels)
    # A load, a caster that swings round: a loop gives way by a little that no noise level has.
    before = evidence(null.setting, _giving_way(null.levels), rough=True)[0]
    yielding = evidence(setting, _giving_way(levels), rough=True)[0] - before
    # Effects of the list are weighed without that allowance: it must not favour what is not.
    strict = evidence(setting, levels, rough=True)[0] - null.evidence
    return Foreign(
        min(yielding, strict),
        max(free - null.likelihood, 0.0),
        columns,
        linear_sizes(setting, levels),
        levels,
    )


def poles_of(null: Null, robot: Robot, waves: Sequence[Floats]) -> Foreign | None:
    """Return what the likeliest number of poles explains, as if any were as likely; None where a
    wheel's rate or its count hardly feels them.

    *waves* are those of two poles, of three and so on.
    """
    gains = _explained(null, waves)
    likeliest = int(np.argmax(gains))
    best = foreign(null, robot, waves[likeliest])
    share = WAVE * float(np.hypot(best.sizes[::2], best.sizes[1::2]).max())
    # Where a wheel stands is known by its counts: what goes round with them may be their rounding.
    counts = share / (FEWEST_POLES + likeliest) / null.data.tick_rad
    if share < _WAVES_TOLD or counts < _ROUNDING:
        return None
    return replace(best, evidence=best.evidence - math.log(len(waves)))


def _explained(null: Null, ways: Sequence[Floats]) -> list[float]:
    """Return by how much each way's columns, of whatever size, lessen the residual's square."""
    stacked = np.concatenate((null.setting.columns({})[:1], *ways))
    white, _ = whitened(null.data, stacked, Levels.of(null.levels, null.data.tick_rad))
    gains, first = [], 1
    for way in ways:
        one, first = white[first : first + len(way)], first + len(way)
        pull = one @ white[0]
        gains.append(float(pull @ np.linalg.lstsq(one @ one.T, pull)[0]))
    return gains


def _giving_way(logs: Floats) -> Floats:
    """Return log levels with a rate error of at least what any velocity loop has under load."""
    return np.asarray(np.maximum(logs, np.log([1e-9, 1e-9, GIVES_WAY, 1e-9, 1e-9])))
