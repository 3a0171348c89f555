"""What goes with the leftover of a drive that answers otherwise than any listed effect has it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.columns import Variant
from gap_diagnosis.drive.likelihood import fitted_levels, linear_sizes, setting_of
from gap_diagnosis.drive.linear import explained_by
from gap_diagnosis.drive.noise import Levels, whitened
from gap_diagnosis.drive.shapes import Shapes
from gap_diagnosis.drive.unlisted import (
    STANDS,
    Foreign,
    Null,
    as_told,
    foreign,
    poles_of,
)
from hil_harness.robot import Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Dependence:
    """A variable with which a drive's leftover goes.

    Attributes:
        variable: which.
        log_evidence: of the likeliest of its ways, less that of no effect.
        share: of the leftover's whitened energy above noise that goes with it.
        columns: float64[c, 2, m], what that way of it adds to the angles which fits best of those
            that speak for themselves.
    """

    variable: str
    log_evidence: float
    share: float
    columns: Floats


@dataclass(frozen=True)
class StandIn:
    """A drive that answers otherwise, fitted on a part of a log.

    Attributes:
        angle: float64[2, n], what it adds to the described wheels' angles, from the row of the
            first command on.
        levels: noise levels beside it.
    """

    angle: Floats
    levels: Levels


def stand_in(null: Null, robot: Robot, one: Dependence, kept: NDArray[np.bool_]) -> StandIn:
    """Return what *one* adds all along the log, by what its blocks *kept*, bool[m], say."""
    data = null.data
    fitted = replace(data, seen=data.seen & kept)
    variant = Variant(fitted, one.columns, (prior.FOREIGN,) * len(one.columns))
    setting = setting_of(variant, robot, frozenset())
    logs, _ = fitted_levels(setting, {}, null.levels)
    blocks = np.tensordot(linear_sizes(setting, logs), one.columns, axes=1)
    middle = 0.5 * (data.start[:-1] + data.start[1:] - 1)
    rows = np.arange(data.commanded.shape[1])
    angle = np.zeros(data.commanded.shape)
    for wheel, there in enumerate(data.seen):
        if there.any():
            angle[wheel] = np.interp(rows, middle[there], blocks[wheel, there])
    return StandIn(angle, Levels.of(logs, data.tick_rad))


def depends_on(null: Null, robot: Robot) -> list[Dependence]:
    """Return what the leftover goes with, the likeliest first.

    The ways are those by which an unlisted drive is weighed, each by itself: late answers differ
    only while the commanded speed changes, so that they go with the acceleration.
    """
    found: dict[str, list[Foreign]] = {}
    for variable, ways in _ways(null, robot).items():
        telling = [one for one in ways if one.evidence > 0]
        if telling:
            found[variable] = telling
    if not found:
        return []
    evidences = {name: max(one.evidence for one in ways) for name, ways in found.items()}
    best = {name: max(ways, key=lambda one: one.likelihood) for name, ways in found.items()}
    # At the levels of no effect noise has taken what is to be shared out.
    levels = max(best.values(), key=lambda one: one.likelihood).levels
    ordered = sorted(found, key=lambda name: -evidences[name])
    shares = _shares(null, levels, [best[name].columns for name in ordered])
    return [
        Dependence(name, evidences[name], share, best[name].columns)
        for name, share in zip(ordered, shares, strict=True)
    ]


def _ways(null: Null, robot: Robot) -> dict[str, list[Foreign]]:
    """Return, by variable, what may answer otherwise, as far as it would be taken for a cause."""
    shapes = Shapes(null.data, robot)
    does_as_told = as_told(null.data, robot)
    found: dict[str, list[Foreign]] = {}
    if not does_as_told:
        lags_and_bend, late, gains, bent, by_command = shapes.foreign()
        lags, bend = lags_and_bend[:-1], lags_and_bend[-1:]
        found["acceleration"] = [foreign(null, robot, one) for one in (lags, late)]
        found["speed"] = [foreign(null, robot, one) for one in (gains, bend, bent, by_command[:1])]
        found["turn_rate"] = [foreign(null, robot, by_command[1:])]
    slow = shapes.slow()
    if len(slow):
        answers = foreign(null, robot, slow)
        if not does_as_told or answers.sizes.min() < STANDS:
            found["command"] = [answers]
    waves = shapes.waves()
    for wheel, side in enumerate(("left", "right")):
        own = slice(2 * wheel, 2 * wheel + 2)
        poles = poles_of(null, robot, [one[own] for one in waves])
        if poles is not None:
            found[f"wheel_angle_{side}"] = [poles]
    return found


def _shares(null: Null, logs: Floats, ways: list[Floats]) -> list[float]:
    """Return which share of the residual's energy above noise the columns of each way take."""
    setting, tick_rad = null.setting, null.data.tick_rad
    residual = setting.columns({})[:1]
    stacked = np.concatenate((residual, setting.nuisances, *ways))
    white, _ = whitened(null.data, stacked, Levels.of(logs, tick_rad))
    first = 1 + len(setting.nuisances)
    within, sd = white[1:first], setting.nuisance_sd
    left = float(white[0] @ white[0]) - explained_by(within, white[0], sd)
    above_noise = max(left - np.count_nonzero(null.data.seen), 1.0)
    shares = []
    for way in ways:
        own, first = white[first : first + len(way)], first + len(way)
        sds = np.concatenate((sd, np.full(len(own), np.inf)))
        both = explained_by(np.concatenate((within, own)), white[0], sds)
        taken = both - explained_by(within, white[0], sd)
        shares.append(float(np.clip(taken / above_noise, 0.0, 1.0)))
    return shares
