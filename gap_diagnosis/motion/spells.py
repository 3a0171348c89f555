"""What begins and ends: a stage that errs evenly for a while, and not before or after.

A tyre that loses its air, a load that is taken up, a floor of another kind: a smooth function of
time follows such an edge badly, and two or three listed effects together may pass for it. Each way
in which wheels, counts or a gyro can err is weighed in every window between two ends of a grid. As
it is what it does up to the window's end less what it does up to its start, one whitened column per
part of the log gives all of them. What a listed effect does in a window is not weighed again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.choices import LASTING, LEFT_OUT
from gap_diagnosis.motion.evidence import Gram, gram_of
from gap_diagnosis.motion.levels import Weighed, best_levels
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.unknown import (
    SCALES,
    Alternative,
    column_of,
    free_columns,
    usable,
    usual_sizes,
)
from gap_diagnosis.motion.ways import WAYS, Way
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats

_PARTS: Final = 24
_WORTH_LEVELS: Final = 6.0
"""What is likelier than no effect by so much [nat] gets noise levels of its own."""


@dataclass(frozen=True)
class Spell:
    """A way of a stage in the window in which it is likeliest.

    Attributes:
        cause: with its evidence, over all windows and all ways of the stage.
        way: which, of those laid out.
        first, last: parts of the log in which it acts; *last* is not among them.
    """

    cause: Alternative
    way: int
    first: int
    last: int


@dataclass(frozen=True)
class LaidWays:
    """Data, nuisances and a column of each way in each part: float64[4, m, 1 + n + w * parts].

    Attributes:
        values: as said.
        nuisances: columns and standard deviations of what is free beside.
        ways: in the order of their columns.
        admitted: bool[w, parts + 1, parts + 1], from which end to which end they may act.
        ends_s: float64[parts + 1], log time.
    """

    values: Floats
    nuisances: list[tuple[int, float]]
    ways: list[Way]
    admitted: NDArray[np.bool_]
    ends_s: Floats


def lay_out_ways(model: MotionModel) -> LaidWays:
    """Return the columns of everything that may act for a while."""
    nodes = model.nodes
    smooth = nodes.smooth
    columns, nuisances = free_columns(model)
    nominal = residuals(nodes, predict(smooth))
    ends_s = np.linspace(smooth.t_s[0], smooth.t_s[-1], _PARTS + 1)
    part = np.clip(np.searchsorted(ends_s, smooth.t_s, side="left") - 1, 0, _PARTS - 1)
    ways = [way for stage in ("wheel", "encoder", "gyro") for way in usable(nodes, WAYS[stage])]
    inside = [np.asarray(part == place, dtype=np.float64) for place in range(_PARTS)]
    columns += [column_of(nodes, nominal, way, one) for way in ways for one in inside]
    steps = np.abs(smooth.left_step_rad) + np.abs(smooth.right_step_rad)
    driven = np.append(0.0, np.cumsum(np.bincount(part, steps, _PARTS)))
    passed = np.linspace(0.0, 1.0, _PARTS + 1)
    admitted = [_admitted(way, passed if way.stage == "gyro" else driven, model) for way in ways]
    values = np.ascontiguousarray(np.stack(columns, axis=-1))
    return LaidWays(values, nuisances, ways, np.array(admitted), ends_s)


def _admitted(way: Way, passed: Floats, model: MotionModel) -> NDArray[np.bool_]:
    """Tell in which windows a way is no listed effect and leaves out enough of the log to be told
    from what acts all the time: bool[e, e]. *passed* is what has passed up to each end."""
    inside = np.subtract.outer(passed, passed).T
    found = (inside > 0.0) & (passed[-1] - inside > LEFT_OUT * passed[-1])
    listed = way.for_a_while
    if listed and listed not in model.without:
        if listed not in LASTING:
            return np.zeros_like(found)
        found[0], found[:, -1] = False, False
    return np.asarray(np.triu(found, 1))


def spells(model: MotionModel, levels: Floats, laid: LaidWays) -> dict[str, Spell]:
    """Return what each stage may have done for a while, at these noise levels."""
    white, log_variance = whiten(laid.values, model.course, levels, model.nodes.ticks)
    gram = gram_of(white, log_variance, laid.nuisances, levels)
    above_noise = max(gram.left_over - len(white), 1.0)
    by_stage: dict[str, list[int]] = {}
    for place, way in enumerate(laid.ways):
        if laid.admitted[place].any():
            by_stage.setdefault(way.stage, []).append(place)
    found = {}
    for stage, places in by_stage.items():
        weighed = {place: _weighed(gram, laid, place) for place in places}
        weighed = {place: one for place, one in weighed.items() if one.is_seen}
        if not weighed:
            continue
        best = max(weighed, key=lambda place: float(weighed[place].log_evidence.max()))
        own = weighed[best].log_evidence
        first, last = (int(end) for end in np.unravel_index(np.argmax(own), own.shape))
        likelihood = float(weighed[best].log_likelihood[first, last])
        cause = Alternative(
            stage,
            "time",
            _log_mean([_log_mean(one.log_evidence) for one in weighed.values()]),
            likelihood,
            min(2 * likelihood / above_noise, 1.0),
            ((float(laid.ends_s[first]), float(laid.ends_s[last])),),
            _log_mean([_log_mean(one.log_within) for one in weighed.values()]),
            laid.ways[best].told(float(weighed[best].size[first, last])),
        )
        found[stage] = Spell(cause, best, first, last)
    return found


@dataclass(frozen=True)
class _Windows:
    """Of one way in each window, float64[e, e]: log evidence, minus infinity where it is not
    admitted or leaves no trace, that of so little that it is no gap, log likelihood, and size."""

    log_evidence: Floats
    log_within: Floats
    log_likelihood: Floats
    size: Floats

    @property
    def is_seen(self) -> bool:
        """Tell whether it leaves a trace in any window."""
        return bool(np.isfinite(self.log_evidence).any())


def _weighed(gram: Gram, laid: LaidWays, place: int) -> _Windows:
    own = len(laid.nuisances) + place * _PARTS + np.arange(_PARTS)
    data = np.append(0.0, np.cumsum(gram.data[own]))
    inner = np.zeros((_PARTS + 1, _PARTS + 1))
    inner[1:, 1:] = np.cumsum(np.cumsum(gram.inner[np.ix_(own, own)], axis=0), axis=1)
    pull = np.subtract.outer(data, data).T
    power = np.diag(inner)[:, None] + np.diag(inner)[None, :] - inner - inner.T
    way = laid.ways[place]
    # What leaves no trace at its largest is not asked for.
    seen = laid.admitted[place] & (way.high**2 * power > 1.0)
    power = np.where(seen, power, 1.0)
    usual = usual_sizes(way.low, way.high)
    parts = np.stack([_gain(power, pull, size) for size in usual])
    logs = np.logaddexp.reduce(parts, axis=0)
    shares = np.exp(parts - logs)
    shrunk = np.stack([size**2 * pull / (1.0 + size**2 * power) for size in usual])
    return _Windows(
        np.where(seen, logs - math.log(SCALES), -np.inf),
        np.where(seen, _gain(power, pull, way.within), -np.inf),
        np.where(seen, 0.5 * pull**2 / power, 0.0),
        np.sum(shares * shrunk, axis=0),
    )


def _gain(power: Floats, pull: Floats, size: float | Floats) -> Floats:
    """Return the log evidence of one coefficient of this usual size."""
    more = 1.0 + size**2 * power
    return np.asarray(0.5 * (size**2 * pull**2 / more - np.log(more)))


def _log_mean(logs: Floats | Sequence[float]) -> float:
    """Return the logarithm of the mean over all that there may be: each way is as likely
    beforehand, and so is each of its windows."""
    known = np.asarray(logs)[np.isfinite(logs)]
    return float(np.logaddexp.reduce(known)) - math.log(len(known))


def levels_of_spell(
    model: MotionModel, found: Mapping[str, Spell], start: Floats, laid: LaidWays
) -> Floats | None:
    """Return the noise levels that suit the likeliest of all best, sought from *start*; None where
    none is clearly likelier than no effect."""
    best = max(found.values(), key=lambda one: one.cause.log_evidence)
    if best.cause.log_evidence < _WORTH_LEVELS:
        return None
    first = 1 + len(laid.nuisances)
    parts = first + best.way * _PARTS + np.arange(best.first, best.last)
    column = laid.values[..., parts].sum(axis=-1, keepdims=True)
    values = np.ascontiguousarray(np.concatenate([laid.values[..., :first], column], axis=-1))
    usual = np.array(usual_sizes(laid.ways[best.way].low, laid.ways[best.way].high))

    def weigh(levels: Floats) -> Weighed:
        white, log_variance = whiten(values, model.course, levels, model.nodes.ticks)
        gram = gram_of(white, log_variance, laid.nuisances, levels)
        gained = _gain(gram.inner[-1:, -1:], gram.data[-1:], usual)
        gain = float(np.logaddexp.reduce(gained.ravel())) - math.log(SCALES)
        return Weighed(gram.log_nothing + gain, white, log_variance)

    return best_levels(weigh, model.level_prior, start)
