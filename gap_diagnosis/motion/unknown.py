"""What no listed effect explains: a stage's residual plus a smooth function of a variable.

Each alternative adds a few columns: a function of one variable (hats over its range, or two
harmonics of an angle) on every way in which a stage can err, or on one of them, or the simplest
such function there: proportional, one harmonic. These are weighed with equal odds, so that
a plain cause does not pay for the bends that it could have had. The evidence is compared with the
library's on equal terms; what wins says on what the leftover depends, without naming a cause.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.bases import Basis, basis
from gap_diagnosis.motion.components import gains
from gap_diagnosis.motion.evidence import Gram, gram_of
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import Nodes, residuals
from gap_diagnosis.motion.ways import OWN_WAYS, WAYS, Way
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import best_levels

SCALES: Final = 4
"""Orders of magnitude of a usual size, weighed with equal odds."""
_WORTH_LEVELS: Final = 6.0
"""What gains so much more [nat] than its many columns gain from noise gets levels of its own."""
_LIKELY: Final = 1.0
"""So does what is likelier than no effect by more than this [nat], however few its columns."""
CODE: Final = ("adc_code", "turn_rate")
"""Which code there should be, the wheels' turn rate says: a function of the codes that there are
would explain their noise with itself."""


@dataclass(frozen=True)
class Alternative:
    """A stage whose residual depends smoothly on a variable, or that errs evenly in windows.

    Attributes:
        stage, variable: which.
        log_evidence: less that of no effect, at the same noise levels.
        log_likelihood: gain at the best coefficients.
        share: of the whitened residual's energy above noise that it takes.
        windows: [start_s, stop_s] where it does not act at all times.
        within: log evidence, likewise, of so little of it that it is no gap.
        acts: what it does in its windows, in words; nothing where only its variable tells.
    """

    stage: str
    variable: str
    log_evidence: float
    log_likelihood: float
    share: float
    windows: tuple[tuple[float, float], ...] = ()
    within: float = 0.0
    acts: str = ""


_VARIABLES: Final[Mapping[str, tuple[str, ...]]] = {
    "wheel": (
        "speed",
        "acceleration",
        "turn_rate",
        "lateral_acceleration",
        "direction",
        "reversal",
        "heading",
        "distance",
        "time",
    ),
    "encoder": ("wheel_angle_left", "wheel_angle_right", "speed", "reversal", "time"),
    "gyro": (
        "turn_rate",
        "speed",
        "acceleration",
        "lateral_acceleration",
        "temperature",
        "supply",
        "time",
    ),
    # With time only its delay: every reference wanders about slowly, and that is noise.
    "reference": ("heading", "place", "time"),
}


class Shape(NamedTuple):
    """A combination of columns that is weighed.

    Attributes:
        mix: float64[k, s], what to multiply the columns by.
        sizes: float64[SCALES + 1, s], usual sizes from small to large, last those that are no gap.
    """

    mix: Floats
    sizes: Floats


@dataclass(frozen=True)
class Plan:
    """Where the columns of one stage and variable stand, and how they may act.

    Attributes:
        stage, variable: of the alternative.
        columns: int64[k], where all of its columns stand.
        shapes: combinations of the columns that are weighed.
        ways, functions: of every way in turn, all functions: what the columns stand for.
    """

    stage: str
    variable: str
    columns: NDArray[np.int64]
    shapes: list[Shape]
    ways: Sequence[Way]
    functions: list[Floats]

    def act(self, prediction: Prediction, sizes: Floats) -> None:
        """Change *prediction* by so much of each column, float64[k]."""
        for way, own in zip(self.ways, np.split(sizes, len(self.ways)), strict=True):
            way.act(prediction, np.tensordot(own, np.array(self.functions), axes=1))


@dataclass(frozen=True)
class Laid:
    """Data, nuisances and columns of alternatives: float64[4, m, 1 + c] and where they stand.

    They are the same at all noise levels, and each takes a prediction of the whole log.
    """

    values: Floats
    nuisances: list[tuple[int, float]]
    plans: list[Plan]

    def only(self, stage: str, variable: str) -> Laid:
        """Return what there is of one stage and variable."""
        plans = [one for one in self.plans if (one.stage, one.variable) == (stage, variable)]
        first = 1 + len(self.nuisances)
        columns = [1 + place for one in plans for place in one.columns]
        kept = np.take(self.values, [*range(first), *columns], axis=-1)
        moved = [
            replace(one, columns=np.arange(first - 1, first - 1 + len(one.columns)))
            for one in plans
        ]
        return Laid(kept, self.nuisances, moved)


@dataclass(frozen=True)
class Fitted:
    """Sizes of an alternative's columns: log evidence, mean float64[k] and covariance."""

    log_evidence: float
    mean: Floats
    covariance: Floats


def alternatives(model: MotionModel, levels: Floats, laid: Laid | None = None) -> list[Alternative]:
    """Return every stage and variable with its evidence, best first."""
    laid, smooth = laid or lay_out(model), model.nodes.smooth
    white, log_variance = whiten(laid.values, model.course, levels, model.nodes.ticks)
    gram = gram_of(white, log_variance, laid.nuisances, levels)
    above_noise = max(gram.left_over - len(white), 1.0)
    found = []
    plans = [*laid.plans]
    if smooth.gyro_code is not None:
        # What is proportional to the code is a scale, and said of the turn rate already.
        turns = [one for one in plans if (one.stage, one.variable) == ("gyro", CODE[1])]
        plans += [replace(one, variable=CODE[0], shapes=one.shapes[:1]) for one in turns]
    for plan in plans:
        evidence, likelihood, within = _gain(gram, plan)
        share = min(2 * likelihood / above_noise, 1)
        found.append(
            Alternative(plan.stage, plan.variable, evidence, likelihood, share, within=within)
        )
    return sorted(found, key=lambda one: -one.log_evidence)


def beyond_tolerance(found: Sequence[Alternative]) -> list[Alternative]:
    """Return the same by what speaks for more of them than a description may be off by.

    Where nothing that is listed explains a log, a healthy robot competes with them: no gap means
    nothing beyond tolerance, whether it has a name or not.
    """
    within = max(within_tolerance(found), 0.0)
    return [replace(one, log_evidence=one.log_evidence - within) for one in found]


def within_tolerance(found: Sequence[Alternative]) -> float:
    """Return the log evidence of any of them, so little of it that it is no gap."""
    if not found:
        return 0.0
    return float(np.logaddexp.reduce([one.within for one in found])) - math.log(len(found))


def levels_beside(
    model: MotionModel,
    one: Alternative,
    start: Floats,
    laid: Laid | None = None,
    *,
    elsewhere: Sequence[Floats] = (),
) -> Floats | None:
    """Return the noise levels that suit an alternative best, sought from *start*, or where these
    are far too low from the model's other starts and *elsewhere*; None where it gains no more than
    columns gain from noise.

    At the levels of no effect, noise has taken what the alternative explains.
    """
    variable = CODE[1] if one.variable == CODE[0] else one.variable
    own = (laid or lay_out(model, only=(one.stage, variable))).only(one.stage, variable)
    is_likely = one.log_evidence > _LIKELY
    if own.plans and not is_likely:
        is_likely = one.log_likelihood > 0.5 * len(own.plans[0].columns) + _WORTH_LEVELS
    if not is_likely:
        return None

    # Along the shape that explains most: all columns of all ways would only cost more.
    shaped = _shaped(own, model, start)

    def gain(gram: Gram) -> float:
        return _gain(gram, shaped.plans[0])[0]

    weigh = Weighing(shaped.values, shaped.nuisances, model.course, model.nodes.ticks, gain)
    others = [*model.elsewhere, *elsewhere]
    return best_levels(weigh, model.level_prior, start, elsewhere=others)


def _shaped(laid: Laid, model: MotionModel, levels: Floats) -> Laid:
    """Return one stage and variable with only the shape that explains most at these levels."""
    (plan,) = laid.plans
    white, log_variance = whiten(laid.values, model.course, levels, model.nodes.ticks)
    gram = gram_of(white, log_variance, laid.nuisances, levels)
    best = max(
        plan.shapes,
        key=lambda one: gains(*seen_by(gram, plan, one.mix), one.sizes)[0][:SCALES].max(),
    )
    first = 1 + len(laid.nuisances)
    columns = laid.values[..., 1 + plan.columns] @ best.mix
    values = np.concatenate([laid.values[..., :first], columns], axis=-1)
    count = best.mix.shape[1]
    own = replace(
        plan,
        columns=np.arange(first - 1, first - 1 + count),
        shapes=[Shape(np.eye(count), best.sizes)],
    )
    return Laid(np.ascontiguousarray(values), laid.nuisances, [own])


def lay_out(model: MotionModel, only: tuple[str, str] | None = None) -> Laid:
    """Return the columns of all alternatives, or of one stage and variable."""
    nodes = model.nodes
    smooth = nodes.smooth
    columns, nuisances = free_columns(model)
    nominal = residuals(nodes, predict(smooth))
    lead_s = 0.5 * model.tolerances["gyro_lag.time_constant"]  # half of a tolerance is no gap
    plans: list[Plan] = []
    for stage, ways in WAYS.items():
        for variable in _VARIABLES[stage]:
            if only is not None and (stage, variable) != only:
                continue
            base = basis(smooth, stage, variable)
            own = usable(nodes, OWN_WAYS.get((stage, variable), ways))
            if not own or not base.functions:
                continue
            first = len(columns) - 1
            columns += [
                column_of(nodes, nominal, way, function)
                for way in own
                for function in base.functions
            ]
            plans.append(_planned(stage, variable, first, own, base, lead_s, model.without))
    return Laid(np.ascontiguousarray(np.stack(columns, axis=-1)), nuisances, plans)


def free_columns(model: MotionModel) -> tuple[list[Floats], list[tuple[int, float]]]:
    """Return data and columns of what is free beside every cause, and where those stand with their
    standard deviations."""
    taken = [0, *(index + 1 for index, _ in model.columns.nuisances)]
    columns = [np.asarray(model.columns.values[..., place]) for place in taken]
    return columns, [(place, sd) for place, (_, sd) in enumerate(model.columns.nuisances)]


def column_of(nodes: Nodes, nominal: Floats, way: Way, function: Floats) -> Floats:
    """Return what a unit of a function changes of *nominal* residuals in one way, float64[4, m]."""
    prediction = predict(nodes.smooth)
    way.act(prediction, way.step * function)
    return np.asarray((nominal - residuals(nodes, prediction)) / way.step)


def usual_sizes(low: Floats | float, high: Floats | float) -> list[Floats | float]:
    """Return usual sizes, evenly over the orders of magnitude between two ends."""
    return [low * (high / low) ** (step / (SCALES - 1)) for step in range(SCALES)]


def _planned(
    stage: str,
    variable: str,
    first: int,
    ways: Sequence[Way],
    base: Basis,
    lead_s: float,
    without: Set[str],
) -> Plan:
    """Return a plan: all ways together, each by itself, and the simplest shapes of each that are no
    listed effect: an arm straight ahead would be likelier than one that may lie aside as well."""
    count = len(base.functions)
    whole = np.eye(count * len(ways))
    mixes = [whole]
    even = [np.ptp(function) == 0.0 for function in base.functions]
    for place, way in enumerate(ways):
        own = whole[:, place * count : (place + 1) * count]
        mixes += [own] if len(ways) > 1 else []
        is_listed = way.evenly not in {"", *without}
        listed = {place for place, effect in base.listed.items() if effect not in without}
        simple = [one for place, one in enumerate(base.simple) if place not in listed]
        mixes += [own @ one for one in simple if not (is_listed and one[even].any())]
    scales = np.repeat([(way.low, way.high, way.within) for way in ways], count, axis=0)
    if base.within_per_s:
        within = lead_s * np.tile(base.within_per_s, len(ways))
        scales[:, 2] = np.maximum(scales[:, 2], within)
    shapes = []
    for mix in mixes:
        low, high, least = scales[np.argmax(mix != 0, axis=0)].T
        shapes.append(Shape(mix, np.array([*usual_sizes(low, high), least])))
    columns = np.arange(first, first + len(whole))
    return Plan(stage, variable, columns, shapes, ways, base.functions)


def _gain(gram: Gram, plan: Plan) -> tuple[float, float, float]:
    """Return log evidence and log likelihood of an alternative, and the log evidence of so little
    of it that it is no gap, less those of none."""
    found = [gains(*seen_by(gram, plan, mix), sizes) for mix, sizes in plan.shapes]
    evidences = np.array([one for one, _ in found])
    likelihood = max(0.0, *(float(one[:SCALES].max()) for _, one in found))
    count = math.log(len(found))
    evidence = float(np.logaddexp.reduce(evidences[:, :SCALES].ravel())) - math.log(SCALES)
    return evidence - count, likelihood, float(np.logaddexp.reduce(evidences[:, SCALES])) - count


def fit_of(gram: Gram, plan: Plan) -> Fitted:
    """Return the likeliest shape and usual size of an alternative with its sizes."""
    best: Fitted | None = None
    for mix, sizes in plan.shapes:
        inner, data = seen_by(gram, plan, mix)
        usual = sizes[:SCALES]
        for scale, evidence in zip(usual, gains(inner, data, usual)[0], strict=True):
            if best is None or evidence > best.log_evidence:
                spread = np.linalg.inv(inner + np.diag(scale**-2.0))
                best = Fitted(float(evidence), mix @ spread @ data, mix @ spread @ mix.T)
    if best is None:
        raise ValueError(f"{plan.stage}, {plan.variable}: expected at least one shape")
    return best


def seen_by(gram: Gram, plan: Plan, mix: Floats) -> tuple[Floats, Floats]:
    """Return the inner products of a shape's columns with each other and with the data."""
    place = np.ix_(plan.columns, plan.columns)
    return mix.T @ gram.inner[place] @ mix, mix.T @ gram.data[plan.columns]


def usable(nodes: Nodes, ways: Sequence[Way]) -> list[Way]:
    """Return those ways of a stage that this log can show."""
    return [
        way
        for way in ways
        if (nodes.has_reference or not way.needs_reference)
        and (nodes.has_gyro or not way.needs_gyro)
    ]
