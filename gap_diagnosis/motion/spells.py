"""What begins and ends: a stage that errs evenly for a while, and not before or after.

A tyre that loses its air, a load that is taken up, a floor of another kind: a smooth function of
time follows such an edge badly, and two or three listed effects together may pass for it. Each way
in which wheels or a gyro can err is weighed in every window between two ends of a grid. As it is
what it does up to the window's end less what it does up to its start, one whitened column per part
of the log gives all of them. What is strong is weighed again in windows of a finer grid about the
likeliest one: of a slip of 4 %, a second too many costs more than most effects are worth. What a
listed effect does in a window is not weighed again.

What one wheel does otherwise than it counts is told of the wheel: it slips or skids. Of an encoder
that miscounts for a while in proportion to its wheel's way nobody could tell it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.choices import CHANGING, LASTING, LEFT_OUT
from gap_diagnosis.motion.evidence import Gram, gram_of
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.onset import is_a_moment
from gap_diagnosis.motion.unknown import (
    SCALES,
    Alternative,
    column_of,
    free_columns,
    usable,
    usual_sizes,
)
from gap_diagnosis.motion.ways import WAYS, Way
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.motion.windows import has_window
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import best_levels

_PARTS: Final = 24
_FINER: Final = 6
"""So many times finer is the grid about the likeliest window,"""
_TIMES: Final = 3
"""and so often it is made finer: of a log of two minutes to 0.02 s."""
_STRONG: Final = 6.0
"""What is likelier than no effect by so much [nat] gets finer windows and its own noise levels."""

_WAYS: Final = (
    *WAYS["wheel"],
    *(replace(way, stage="wheel") for way in WAYS["encoder"]),
    *WAYS["gyro"],
)


@dataclass(frozen=True)
class Spell:
    """A way of a stage in the window in which it is likeliest.

    Attributes:
        cause: with its evidence, over all windows and all ways of the stage.
        way: which.
    """

    cause: Alternative
    way: Way


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
    t_s = model.nodes.smooth.t_s
    ends_s = np.linspace(t_s[0], t_s[-1], _PARTS + 1)
    return _laid_between(model, usable(model.nodes, _WAYS), ends_s)


def _laid_between(model: MotionModel, ways: list[Way], ends_s: Floats) -> LaidWays:
    columns, nuisances = free_columns(model)
    nominal = residuals(model.nodes, predict(model.nodes.smooth))
    inside = [_inside(model, *window) for window in itertools.pairwise(ends_s)]
    columns += [column_of(model.nodes, nominal, way, one) for way in ways for one in inside]
    admitted = np.array([_admitted(way, ends_s, model) for way in ways])
    values = np.ascontiguousarray(np.stack(columns, axis=-1))
    return LaidWays(values, nuisances, ways, admitted, ends_s)


def _inside(model: MotionModel, start_s: float, stop_s: float) -> Floats:
    """Return one for each tick that ends in a window, none for the others."""
    t_s = model.nodes.smooth.t_s
    begun = (t_s > start_s) | (start_s <= t_s[0])
    return np.asarray(begun & (t_s <= stop_s), dtype=np.float64)


def _admitted(way: Way, ends_s: Floats, model: MotionModel) -> NDArray[np.bool_]:
    """Tell in which windows a way is no listed effect and leaves out enough of the log to be told
    from what acts all the time: bool[e, e]."""
    smooth = model.nodes.smooth
    steps = np.abs(smooth.left_step_rad) + np.abs(smooth.right_step_rad)
    passed = smooth.t_s - smooth.t_s[0] if way.stage == "gyro" else np.cumsum(steps)
    by_end = np.interp(ends_s, smooth.t_s, passed)
    inside = np.subtract.outer(by_end, by_end).T
    found = (inside > 0.0) & (passed[-1] - inside > LEFT_OUT * passed[-1])
    listed = way.for_a_while
    if listed in CHANGING - model.without:
        found[ends_s <= smooth.t_s[0]] = False
        found[:, ends_s >= smooth.t_s[-1]] = False
    windows = [t for t in model.columns.terms if t.variant.effect == listed and has_window(t)]
    is_weighed = any(not is_a_moment(one, smooth) for one in windows)
    if is_weighed and listed not in LASTING:
        return np.zeros_like(found)
    return np.asarray(np.triu(found, 1))


def spells(model: MotionModel, levels: Floats, laid: LaidWays) -> dict[str, Spell]:
    """Return what each stage may have done for a while, at these noise levels."""
    gram, above_noise = _gram_of(model, levels, laid)
    found = {}
    for stage in dict.fromkeys(way.stage for way in laid.ways):
        weighed = {
            way: _weighed(gram, laid, place)
            for place, way in enumerate(laid.ways)
            if way.stage == stage and laid.admitted[place].any()
        }
        weighed = {way: one for way, one in weighed.items() if one.is_seen}
        if not weighed:
            continue
        best = max(weighed, key=lambda way: float(weighed[way].log_evidence.max()))
        sharpest = weighed[best]
        by_way = {
            way: np.array([_log_mean(one.log_evidence), _log_mean(one.log_within)])
            for way, one in weighed.items()
        }
        if by_way[best][0] > _STRONG:
            coarse = sharpest.log_integrals
            fine, sharpest = _sharpened(model, levels, best, sharpest, _TIMES)
            by_way[best] += fine - coarse
        first, last = sharpest.likeliest
        likelihood = float(sharpest.log_likelihood[first, last])
        cause = Alternative(
            stage,
            "time",
            _log_mean([one[0] for one in by_way.values()]),
            likelihood,
            min(2 * likelihood / above_noise, 1.0),
            ((float(sharpest.ends_s[first]), float(sharpest.ends_s[last])),),
            _log_mean([one[1] for one in by_way.values()]),
            best.told(float(sharpest.size[first, last])),
        )
        found[stage] = Spell(cause, best)
    return found


@dataclass(frozen=True)
class _Windows:
    """Of one way in each window, float64[e, e]: log evidence, minus infinity where it is not
    admitted or leaves no trace, that of so little that it is no gap, log likelihood, and size.

    Their ends *ends_s* lie on a grid of *step_s*.
    """

    log_evidence: Floats
    log_within: Floats
    log_likelihood: Floats
    size: Floats
    ends_s: Floats
    step_s: float

    @property
    def is_seen(self) -> bool:
        """Tell whether it leaves a trace in any window."""
        return bool(np.isfinite(self.log_evidence).any())

    @property
    def likeliest(self) -> tuple[int, int]:
        """The ends of the likeliest window, as places of *ends_s*."""
        first, last = np.unravel_index(np.argmax(self.log_evidence), self.log_evidence.shape)
        return int(first), int(last)

    @property
    def log_integrals(self) -> Floats:
        """Of evidence and of that of so little that it is no gap, over when it begins and when it
        ends: float64[2], log of s^2."""
        both = np.array([self.log_evidence.ravel(), self.log_within.ravel()])
        return np.asarray(np.logaddexp.reduce(both, axis=1) + 2 * math.log(self.step_s))

    def without_likeliest(self) -> _Windows:
        """Return the same without the windows whose ends lie within a step of the likeliest's."""
        near = [
            np.abs(self.ends_s - self.ends_s[one]) < 1.01 * self.step_s for one in self.likeliest
        ]
        evidence, within = self.log_evidence.copy(), self.log_within.copy()
        evidence[np.ix_(*near)] = -np.inf
        within[np.ix_(*near)] = -np.inf
        return replace(self, log_evidence=evidence, log_within=within)


def _sharpened(
    model: MotionModel, levels: Floats, way: Way, windows: _Windows, times: int
) -> tuple[Floats, _Windows]:
    """Return the logarithms of the integrals [s^2] with the windows about the likeliest one weighed
    on finer grids, and those of the finest.

    An end of the grid stands for the step about it; finer ends fill the steps of three of them.
    """
    if times == 0:
        return windows.log_integrals, windows
    step_s = windows.step_s / _FINER
    reach = 3 * _FINER // 2
    steps_s = step_s * np.arange(-reach, reach + 1)
    t_s = model.nodes.smooth.t_s
    starts_s, stops_s = (
        np.clip(windows.ends_s[place] + steps_s, t_s[0], t_s[-1]) for place in windows.likeliest
    )
    ends_s = np.unique(np.concatenate((starts_s, stops_s)))
    laid = _laid_between(model, [way], ends_s)
    laid.admitted[:] &= np.isin(ends_s, starts_s)[:, None] & np.isin(ends_s, stops_s)
    finer = _weighed(_gram_of(model, levels, laid)[0], laid, 0, step_s)
    if not finer.is_seen:
        return windows.log_integrals, windows
    inside, finest = _sharpened(model, levels, way, finer, times - 1)
    return np.logaddexp(windows.without_likeliest().log_integrals, inside), finest


def _gram_of(model: MotionModel, levels: Floats, laid: LaidWays) -> tuple[Gram, float]:
    """Return inner products, and the whitened data's energy above noise."""
    white, log_variance = whiten(laid.values, model.course, levels, model.nodes.ticks)
    gram = gram_of(white, log_variance, laid.nuisances, levels)
    return gram, max(gram.left_over - len(white), 1.0)


def _weighed(gram: Gram, laid: LaidWays, place: int, step_s: float | None = None) -> _Windows:
    """Return what speaks for one way in each window between the ends, of a grid of *step_s* or else
    of that which they make."""
    parts = len(laid.ends_s) - 1
    own = len(laid.nuisances) + place * parts + np.arange(parts)
    data = np.append(0.0, np.cumsum(gram.data[own]))
    inner = np.zeros((parts + 1, parts + 1))
    inner[1:, 1:] = np.cumsum(np.cumsum(gram.inner[np.ix_(own, own)], axis=0), axis=1)
    pull = np.subtract.outer(data, data).T
    power = np.diag(inner)[:, None] + np.diag(inner)[None, :] - inner - inner.T
    way = laid.ways[place]
    # What leaves no trace at its largest is not asked for.
    seen = laid.admitted[place] & (way.high**2 * power > 1.0)
    power = np.where(seen, power, 1.0)
    usual = usual_sizes(way.low, way.high)
    gained = np.stack([_gain(power, pull, size) for size in usual])
    logs = np.logaddexp.reduce(gained, axis=0)
    shares = np.exp(gained - logs)
    shrunk = np.stack([size**2 * pull / (1.0 + size**2 * power) for size in usual])
    return _Windows(
        np.where(seen, logs - math.log(SCALES), -np.inf),
        np.where(seen, _gain(power, pull, way.within), -np.inf),
        np.where(seen, 0.5 * pull**2 / power, 0.0),
        np.sum(shares * shrunk, axis=0),
        laid.ends_s,
        float(laid.ends_s[1] - laid.ends_s[0]) if step_s is None else step_s,
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
    model: MotionModel, found: Mapping[str, Spell], start: Floats, elsewhere: Sequence[Floats] = ()
) -> Floats | None:
    """Return the noise levels that suit the likeliest of all best, sought from *start*, or where
    these are far too low from *elsewhere*; None where none is clearly likelier than no effect."""
    best = max(found.values(), key=lambda one: one.cause.log_evidence)
    if best.cause.log_evidence < _STRONG:
        return None
    (window,) = best.cause.windows
    laid = _laid_between(model, [best.way], np.array(window))
    usual = np.array(usual_sizes(best.way.low, best.way.high))

    def gain(gram: Gram) -> float:
        gained = _gain(gram.inner[-1:, -1:], gram.data[-1:], usual)
        return float(np.logaddexp.reduce(gained.ravel())) - math.log(SCALES)

    weigh = Weighing(laid.values, laid.nuisances, model.course, model.nodes.ticks, gain)
    return best_levels(weigh, model.level_prior, start, elsewhere=elsewhere)
