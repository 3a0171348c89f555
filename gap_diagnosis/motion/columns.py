"""Every effect as columns: how the residuals would change with each of its coefficients."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np

from gap_diagnosis.explanations import EXPLAINED, predict
from gap_diagnosis.explanations.choices import SLIP_WINDOWS, leaves_out
from gap_diagnosis.explanations.known import Known
from gap_diagnosis.explanations.reference import (
    counts_latency,
    right_later_than_left,
    smoothed_reference,
)
from gap_diagnosis.explanations.registry import explanation_of
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.explanations.wheel import (
    creep_in_turns,
    creep_of_driven_wheels,
    creep_of_the_body,
    creep_under_load,
    lateral_slip,
    longitudinal_slip,
    pressed_outside,
)
from gap_diagnosis.hypothesis import FORM
from gap_diagnosis.motion.nodes import Nodes, residuals, without_jumps
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats
from hil_harness.effects.model import Effect

NEVER_NUISANCE: Final = frozenset(
    {"ticks_per_rev", "adc_inl", "turn_scrub", "supply_ratio", "payload", "frame_latency"}
)
"""Effects whose small amounts another nuisance already stands for, or that come not in bits."""

_ON_EACH_SIDE: Final = frozenset({"encoder_eccentricity"})
"""Effects that either side may have a little of. Of a wheel off centre an encoder's as little is
hardly another."""
_IN_ONE_FORM: Final = frozenset({"lateral_slip", "longitudinal_slip"})
"""Effects of which so little as is no news acts alike in every form."""
_OF_A_ROW: Final = frozenset({"IMU", "ENCODER"})
"""What stands in one row of a table: a rate may be of the moment or a mean since the row before,
and nothing says which."""
GROSS: Final = frozenset({"setup_wheels_swapped", "setup_sign", "setup_unit"})
NEEDS_REFERENCE: Final = frozenset(
    {
        "lateral_slip",
        "reference_yaw",
        "reference_lever_arm",
        "reference_time_offset",
        "reference_clock_skew",
        "reference_scale",
        "cross_slope_drift",
    }
)


@dataclass(frozen=True)
class Term:
    """A variant with the columns of its coefficients.

    Attributes:
        variant: what acts.
        weights: per coefficient (one for a variant without any, whose amplitude is 1), the base
            columns it is made of: pairs of index and weight.
        tolerances: per coefficient, what is no news.
        log_weight: log prior of this variant over the effect's others, beside an even share.
        is_on_the_grid: one of those that share the effect's prior evenly.
    """

    variant: Variant
    weights: tuple[tuple[tuple[int, float], ...], ...]
    tolerances: tuple[float, ...]
    log_weight: float = 0.0
    is_on_the_grid: bool = True

    @property
    def is_fixed(self) -> bool:
        """There or not: no amplitude to fit."""
        return not self.variant.coefficients


@dataclass(frozen=True)
class Columns:
    """The data and all effects at node level.

    Attributes:
        values: float64[4, m, 1 + c]: the residual of the description, then the base columns.
        terms: every variant of every effect.
        nuisances: for each coefficient that is always free within its tolerance: base column and
            standard deviation.
        little: how those act, by base column: variant and which of its coefficients.
    """

    values: Floats
    terms: tuple[Term, ...]
    nuisances: tuple[tuple[int, float], ...]
    little: Mapping[int, tuple[Variant, int]] = field(default_factory=dict)

    @cached_property
    def within_tolerance(self) -> Floats:
        """The data, then the columns of *nuisances* in their order, side by side: every fit reads
        these, and among all columns each lies in a line of memory of its own."""
        return np.take(self.values, [0, *(index + 1 for index, _ in self.nuisances)], axis=-1)


def build_columns(
    nodes: Nodes,
    prior: Prior,
    tolerances: dict[str, float],
    *,
    gross: bool,
    without: frozenset[str] = frozenset(),
    library: Mapping[str, Effect] = MappingProxyType({}),
    speed_cycle_s: float = 0.0,
    granted: Sequence[Known] = (),
) -> Columns:
    """Return the columns of all effects that this log can speak of.

    *tolerances* are those of robot.toml, by ``effect.coefficient``. *gross*: mistakes of the
    set-up too. *without*: effects that are not to be named; what lies within their tolerances stays
    free. *library*: effects of a user's own that say how they act. *speed_cycle_s*: as in
    `Recording`. *granted*: effects known beside the description, and by how much they may be off.
    """
    motion = nodes.motion
    base: list[Floats] = [described_residuals(nodes)]
    # A scale of what a counter jumps where it wraps would hide any other effect.
    recorded, nodes = nodes, replace(nodes, smooth=without_jumps(nodes.smooth))
    nominal = residuals(nodes, predict(nodes.smooth))
    terms: list[Term] = []
    nuisances: list[tuple[int, float]] = []
    little: dict[int, tuple[Variant, int]] = {}
    unsure = {
        (one.ways[0][0].effect, index): sd for one in granted for index, sd in enumerate(one.sds)
    }
    own = {name: explanation_of(effect) for name, effect in library.items()}
    known = {**EXPLAINED, **{name: one for name, one in own.items() if one is not None}}
    for effect, explanation in known.items():
        if effect in GROSS and (effect in without or not gross):
            continue
        if not nodes.has_reference and effect in NEEDS_REFERENCE:
            continue
        if effect == "reference_yaw" and not nodes.has_heading:
            continue
        if effect == "reference_scale" and _reach_m(nodes) < _LEAST_REACH_M:
            continue
        if explanation.stage_rank == 2 and not nodes.has_gyro:
            continue
        variants = list(explanation.variants(motion))
        is_plain = len(variants) == 1 or effect in _ON_EACH_SIDE | _IN_ONE_FORM
        is_nuisance = is_plain and effect not in NEVER_NUISANCE and effect in EXPLAINED
        if effect in without and not is_nuisance:
            continue
        if effect == "one_sided_slip":
            terms += _windows(nodes, variants, nominal, base, prior)
            continue
        if effect == "adc_stuck_bit":
            variants = [one for one in variants if _is_constant(nodes, one)]
        for variant in variants:
            weights: list[tuple[tuple[int, float], ...]] = []
            limits = []
            if not variant.coefficients:
                seen = recorded if effect == "encoder_wrap" else nodes
                change = residuals(seen, predict(seen.smooth))
                change -= residuals(seen, predict(seen.smooth, [(variant, ())]))
                if not _says_something(change):
                    continue
                base.append(change)
                weights.append(((len(base) - 2, 1.0),))
            for index, name in enumerate(variant.coefficients):
                size = prior.of(effect, name)
                limit = tolerances.get(f"{effect}.{name}", size.tolerance)
                if variant.report.get("frame") in _OF_A_ROW:
                    limit = max(limit, motion.tick_s)
                if effect == _OFFSET:
                    limit = max(limit, _OF_A_CYCLE * speed_cycle_s)
                steps = [0.0] * len(variant.coefficients)
                # A step of the effect's usual size: a lag far below a tick changes nothing at all.
                step = math.sqrt(limit * max(size.high, limit))
                if effect in _DELAYS:
                    step = _DELAY_S
                steps[index] = step
                to_both = effect in _DELAYS or effect == _SKEW
                change = _change(nodes, variant, steps, nominal, to_both=to_both) / step
                if not _says_something(change * step):
                    break
                base.append(change)
                weight = [(len(base) - 2, 1.0)]
                limits.append(math.hypot(limit, 2.0 * unsure.get((effect, index), 0.0)))
                if is_nuisance and (variant is variants[0] or effect in _ON_EACH_SIDE):
                    near = _near(nodes, variant, steps, limit, nominal)
                    if np.nanmax(np.abs(near - change), initial=0.0) * limit > _BENT:
                        base.append(near)
                        weight.append((len(base) - 2, 0.0))  # this effect's too: never beside it
                    nuisances.append((len(base) - 2, 0.5 * limit))
                    acts = variant.act if variant.little is None else variant.little
                    little[len(base) - 2] = replace(variant, act=acts, exact=None), index
                weights.append(tuple(weight))
            if effect not in without and len(weights) == max(1, len(variant.coefficients)):
                terms.append(Term(variant, tuple(weights), tuple(limits)))
    for one in granted:
        # Along a smooth line what a known value is off by is not all explained, and the rest speaks
        # for news: of a slip known to 0.004 that was off by 0.007, six nats.
        variant = one.ways[0][0].in_detail
        for index, sd in enumerate(one.sds):
            if sd == 0.0:
                continue
            off = [sd if place == index else 0.0 for place in range(len(one.sds))]
            change = _change_in_detail(nodes, variant, off)
            if _says_something(change):
                base.append(change / sd)
                nuisances.append((len(base) - 2, sd))
    free = {index for index, _ in nuisances}
    delays = {i for one in terms if one.variant.effect == _OFFSET for i, _ in one.weights[0]} & free
    late: set[int] = set()
    healthy: list[tuple[Variant, float, float]] = []
    if speed_cycle_s > 0:
        # A mean since the speed before is that of half a cycle ago; what else was smoothed is late.
        healthy.append((_LATE_COUNTS, _DELAY_S, _OF_A_CYCLE * speed_cycle_s))
    creep = prior.of(_CREEP, "compliance").tolerance
    healthy.append((_CREEP_IN_TURNS, creep, 0.5 * creep))
    if not gross and _speed_in_turns_m_s(motion) > _FAST_M_S:
        healthy.append((_PRESSED, _PRESSED_S2_PER_M, _PRESSED_S2_PER_M))
        healthy.append((_CREEP_UNDER_LOAD, _UNDER_LOAD_S4_PER_M2, _UNDER_LOAD_S4_PER_M2))
        healthy.append((_CREEP_OF_DRIVEN, creep, creep))
        if nodes.has_reference:
            healthy.append((_SLIP_ANGLE, _SLIP_ANGLE_S2_PER_M, _SLIP_ANGLE_S2_PER_M))
    if nodes.has_reference:
        healthy.append((_SMOOTHED, _SMOOTHED_S2, _SMOOTHED_S2))
    if not motion.has_counters:
        # Two controllers are asked one after the other, and nothing says so.
        healthy.append((_ONE_SIDE_LATE, _DELAY_S, min(_APART_ROWS * motion.tick_s, _APART_S)))
    for variant, step, sd in healthy:
        change = _change(nodes, variant, [step], nominal, to_both=True)
        if _says_something(change):
            base.append(change / step)
            nuisances.append((len(base) - 2, sd))
            little[len(base) - 2] = variant, 0
            if variant is _LATE_COUNTS:
                late.add(len(base) - 2)
    lags = {index for index, (variant, _) in little.items() if variant.effect == _LAG}
    values = np.ascontiguousarray(np.stack(base, axis=-1))
    held = {_LATENCY: delays | late, _OFFSET: late}
    slides = {index for index, (variant, _) in little.items() if variant.effect == _LATERAL}
    creeps = {i for i, (variant, _) in little.items() if variant.act is longitudinal_slip}
    alone = _creeps_alone(_slides_alone(_late_alone(terms, held, lags), slides), creeps)
    return Columns(values, tuple(alone), tuple(nuisances), little)


def described_residuals(nodes: Nodes) -> Floats:
    """Return what the description and what is known beside it leave, float64[4, m].

    What is known acts as effects that are fitted do: exact on smooth turns, whatever counts round
    off.
    """
    motion = nodes.motion
    left = residuals(nodes, predict(motion.described))
    if not motion.granted:
        return left
    sharp = nodes.sharp
    change = residuals(nodes, predict(sharp)) - residuals(nodes, predict(sharp.described))
    return left + change


def _late_alone(
    terms: Sequence[Term], delays: Mapping[str, Set[int]], lags: Set[int]
) -> Iterable[Term]:
    """Return the terms; beside an effect none of its *delays* within tolerance is free, beside a
    late gyro none of its *lags*.

    The two are one delay: counts or a reference late by much, and put back by the tolerance's
    straight line, are the way without its bends, and so without the rows' own noise; and a gyro
    that is late by more and put back by a lag below zero is one that smooths.
    """
    for term in terms:
        is_gyro = term.variant.report.get("frame") == "IMU"
        held = lags if is_gyro else delays.get(term.variant.effect, set())
        little = tuple((index, 0.0) for index in sorted(held))
        yield replace(term, weights=tuple((*parts, *little) for parts in term.weights))


def _slides_alone(terms: Iterable[Term], slides: Set[int]) -> Iterable[Term]:
    """Return the terms; beside a slip angle no little one is free, nor a little of another form: it
    is the whole of what tyres yield, and where a log tells it well it was told no better than what
    tyres usually do."""
    little = tuple((index, 0.0) for index in sorted(slides))
    for term in terms:
        is_angle = term.variant.effect == _LATERAL and term.variant.fixed[FORM] > 0
        yield (
            replace(term, weights=tuple((*w, *little) for w in term.weights)) if is_angle else term
        )


def _creeps_alone(terms: Iterable[Term], creeps: Set[int]) -> Iterable[Term]:
    """Return the terms; beside a creep of the body no little one of each wheel is free."""
    little = tuple((index, 0.0) for index in sorted(creeps))
    for term in terms:
        is_of_body = term.variant.act is creep_of_the_body
        weights = tuple((*w, *little) for w in term.weights)
        yield replace(term, weights=weights) if is_of_body else term


def _near(
    nodes: Nodes, variant: Variant, steps: list[float], limit: float, nominal: Floats
) -> Floats:
    """Return what a unit of an effect within its tolerance changes.

    Over a step of the usual size a delay bends: along that chord a good reference would not find
    what is within tolerance explained.
    """
    to_both = not variant.is_positive
    if variant.little is not None:
        # In the detail in which the effect itself is compared: along a smoother line what is within
        # tolerance is not all explained, and the rest speaks for news.
        acts = replace(variant, act=variant.little)
        return _change_in_detail(nodes, acts, steps) / max(steps)
    small = [limit * (one > 0) for one in steps]
    return _change(nodes, variant, small, nominal, to_both=to_both) / limit


def _change_in_detail(nodes: Nodes, variant: Variant, steps: list[float]) -> Floats:
    """Return what *steps* change where turns begin as sharply as they do."""
    sharp = replace(nodes, smooth=nodes.sharp)
    nominal = residuals(sharp, predict(sharp.smooth))
    return _change(sharp, variant, steps, nominal, to_both=not variant.is_positive)


def _change(
    nodes: Nodes, variant: Variant, steps: list[float], nominal: Floats, *, to_both: bool
) -> Floats:
    """Return what *steps* change; the mean of them and their opposites, if *to_both* sides."""
    ahead = residuals(nodes, predict(nodes.smooth, [(variant, steps)]))
    if not to_both:
        return nominal - ahead
    behind = residuals(nodes, predict(nodes.smooth, [(variant, [-one for one in steps])]))
    return 0.5 * (behind - ahead)


def with_variant(
    columns: Columns, nodes: Nodes, variant: Variant, like: Term, step: float | None = None
) -> tuple[Term, Columns]:
    """Return a term for one more variant of *like*'s effect, and columns that hold it.

    They are straight lines from no effect to one of size *step*.
    """
    nominal = residuals(nodes, predict(nodes.smooth))
    base: list[Floats] = []
    weights: list[tuple[tuple[int, float], ...]] = []
    count = columns.values.shape[-1] - 1
    if not variant.coefficients:
        base.append(nominal - residuals(nodes, predict(nodes.smooth, [(variant, ())])))
        weights.append(((count, 1.0),))
    for index, limit in enumerate(like.tolerances):
        steps = [0.0] * len(variant.coefficients)
        steps[index] = 3 * limit if step is None else step
        moved = residuals(nodes, predict(nodes.smooth, [(variant, steps)]))
        base.append((nominal - moved) / steps[index])
        little = tuple((one, share) for one, share in like.weights[index] if share == 0.0)
        weights.append(((count + index, 1.0), *little))
    term = Term(variant, tuple(weights), like.tolerances)
    values = np.ascontiguousarray(np.concatenate([columns.values, np.stack(base, axis=-1)], -1))
    return term, replace(columns, values=values, terms=(*columns.terms, term))


def _speed_in_turns_m_s(motion: Motion) -> float:
    """Return how fast the robot goes where it turns, on average over what it turns."""
    turn_rad = np.abs(motion.turn_rate_rad_s) * motion.dt_s
    total = float(np.sum(turn_rad))
    return float(np.sum(turn_rad * np.abs(motion.speed_m_s))) / total if total > 0 else 0.0


def _reach_m(nodes: Nodes) -> float:
    """Return how far from its start the robot came."""
    motion = nodes.motion
    return float(np.hypot(motion.x_m - motion.x_m[0], motion.y_m - motion.y_m[0]).max())


_LEAST_REACH_M: Final = 0.1
"""On the spot, what scales with the place is the reference's own noise."""
_OFFSET: Final = "reference_time_offset"
_SKEW: Final = "reference_clock_skew"
_LATENCY: Final = "frame_latency"
_LAG: Final = "gyro_lag"
_LATE_COUNTS: Final = Variant(_LATENCY, counts_latency, ("delay",))
_ONE_SIDE_LATE: Final = Variant(_LATENCY, right_later_than_left, ("delay",))
_SMOOTHED: Final = Variant(_OFFSET, smoothed_reference, ("spread",))
_SMOOTHED_S2: Final = 0.01
"""What an estimator makes of positions is smooth: as by a filter of 0.14 s or a mean over 0.5 s."""
_APART_ROWS: Final = 0.5
_APART_S: Final = 0.005
"""By so much of a row, and no more than this, the two wheels of a table are read apart."""
_LATERAL: Final = "lateral_slip"
_SLIP_ANGLE: Final = Variant(_LATERAL, lateral_slip, ("compliance",), {FORM: 1.0})
_SLIP_ANGLE_S2_PER_M: Final = 0.004
"""Rear axles of cars yield by 2 to 4 degrees per g sideways, 0.0036 to 0.007 rad per m/s²
(Bundorf and Leffert 1976, SAE 760713)."""
_PRESSED: Final = Variant("payload", pressed_outside, ("compliance",))
_PRESSED_S2_PER_M: Final = 2e-4
"""A car moves some 250 N per m/s² from one rear wheel to the other, and a radial tyre of 200 N/mm
rolls on a radius smaller by 0.04 to 0.08 of what that presses it in by (the effective radius of
Pacejka 2006, Tyre and Vehicle Dynamics): 0.05 to 0.1 mm of 0.31 m."""
_FAST_M_S: Final = 1.0
"""In slower turns both are no more than what is no news of a lateral slip and of a wheelbase."""
_CREEP: Final = "longitudinal_slip"
_CREEP_IN_TURNS: Final = Variant(_CREEP, creep_in_turns, ("compliance",))
_CREEP_UNDER_LOAD: Final = Variant(_CREEP, creep_under_load, ("compliance",))
_UNDER_LOAD_S4_PER_M2: Final = 5e-4
"""A car's turn moves 5 to 10 % of a rear wheel's load for each m/s², and one driven axle creeps by
0.005 to 0.01 s²/m."""
_CREEP_OF_DRIVEN: Final = Variant(_CREEP, creep_of_driven_wheels, ("compliance",))
_OF_A_CYCLE: Final = 0.5
"""A mean since the speed before is late by so much of a cycle, and nothing says which it is."""
_DELAYS: Final = frozenset({_OFFSET, _LATENCY})
MOVES_IN_TIME: Final = _DELAYS | {_SKEW}
"""Late counts are an early reference: along chords to either side, or of other lengths, the two
would leave the way's bends between them, and in these stands the rows' own noise."""
_DELAY_S: Final = 0.02
_LEAST: Final = 1e-9
"""A change below this [m, rad] is arithmetic, not an effect."""
_BENT: Final = 5e-6
"""So far [m, rad] a chord may lie off an effect within its tolerance: a reference that measures to
0.1 mm does not notice."""


def _says_something(change: Floats) -> bool:
    return bool(np.nanmax(np.abs(change), initial=0.0) > _LEAST)


_ALL_ALONG: Final = (("start_s", -math.inf), ("stop_s", math.inf))


def _is_constant(nodes: Nodes, variant: Variant) -> bool:
    """Tell whether every recorded code of the variant's window has this bit at this value."""
    codes, t_s = nodes.motion.gyro_code, nodes.motion.t_s
    if codes is None:
        return False
    start_s, stop_s = (variant.fixed.get(end, inf) for end, inf in _ALL_ALONG)
    codes = codes[~nodes.motion.gyro_is_filled & (t_s >= start_s) & (t_s <= stop_s)]
    whole = np.rint(codes[codes == np.rint(codes)]).astype(np.int64)
    bit, value = int(variant.fixed["bit"]), int(variant.fixed["value"])
    return len(whole) > 0 and bool(np.all((whole >> bit) & 1 == value))


def _windows(
    nodes: Nodes,
    variants: Sequence[Variant],
    nominal: Floats,
    base: list[Floats],
    prior: Prior,
) -> Iterable[Term]:
    """Return windowed slips as differences of slips from the start on: one column per border.

    Not where a wheel stands, nor over all of its way.
    """
    limit = prior.of("one_sided_slip", "ratio").tolerance
    starts: dict[tuple[str, float], int] = {}
    for variant in variants[:: len(variants) // 2]:
        side = str(variant.report["side"])
        begin = variant.fixed["start_s"]
        edges = sorted({one.fixed["stop_s"] for one in variants})
        for edge in edges:
            window = Variant(
                variant.effect,
                variant.act,
                variant.coefficients,
                {"start_s": begin, "stop_s": edge},
            )
            moved = residuals(nodes, predict(nodes.smooth, [(window, (limit,))]))
            base.append((nominal - moved) / limit)
            starts[side, edge] = len(base) - 2
        assert len(edges) == SLIP_WINDOWS
    for variant in variants:
        side = str(variant.report["side"])
        if _hardly_turns(nodes.smooth, side, variant) or not leaves_out(nodes.smooth, variant):
            continue
        weights = [(starts[side, variant.fixed["stop_s"]], 1.0)]
        before = starts.get((side, variant.fixed["start_s"]))
        if before is not None:
            weights.append((before, -1.0))
        yield Term(variant, (tuple(weights),), (limit,))


_PACE: Final = 0.02
"""Of a wheel's mean pace in the log: a slower one stands, and its counter trembles."""


def _hardly_turns(motion: Motion, side: str, window: Variant) -> bool:
    """Tell whether a wheel turns so little in a window, beside its pace in the log, that what its
    counts do there is their own noise: a slip of as much would take that away."""
    steps = np.abs(motion.left_step_rad if side == "left" else motion.right_step_rad)
    inside = (motion.t_s > window.fixed["start_s"]) & (motion.t_s <= window.fixed["stop_s"])
    return bool(steps[inside].mean() < _PACE * steps.mean()) if inside.any() else True
