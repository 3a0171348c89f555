"""How well the causes of a case could be told apart by anyone: separations from its own noise.

A first version. Separations follow from the linear and Gaussian model of the motion at the true
parameters and the true noise levels (`MotionModel`'s inner products), tolerances and start being
free in every hypothesis: they are expectations, so no noise is drawn. A window or a threshold is
that of the nearest variant. Counts that an effect leaves to chance, lost now and then, are noise in
every hypothesis: each may take it for a rougher contact. What commands, frames, codes and odometry
show is not modelled here: effects told by them alone are taken to be told apart as soon as they
exceed their tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.evidence import make_gram, score
from gap_diagnosis.motion.levels import FLOORS
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.motion.whitening import LEVELS, SLIP_WANDER, STAMP
from gap_diagnosis.priors import default_prior
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.trials.case import Case, is_news
from gap_diagnosis.trials.sizes import tolerances
from gap_diagnosis.trials.truth import Answer, canonical
from gap_diagnosis.visibility import Sight, sight_of
from hil_harness.effects.model import Value
from hil_harness.robot import Robot

Values = Mapping[str, Value]
Part = tuple[list[int], Floats]
"""Rows of coefficients in the inner products, and their sizes."""

_RARE: Final = frozenset(
    {"frame_duplication", "frame_loss", "frame_reordering", "missed_deadline", "stale_producer"}
)
_EVENTS: Final = 3.0
"""So many are expected where the chance of none is 5 %."""

_BEST: Final = (40, 16, 12)
"""So many effects are tried in pairs, in threes, and in any larger number at once."""


class Oracle:
    """What the motion of one log can tell, at its true noise levels.

    Attributes:
        log_nothing: log likelihood of the log if nothing is at work.
    """

    def __init__(self, recording: Recording, robot: Robot, case: Case) -> None:
        """Prepare; costs about a second."""
        model = MotionModel(recording, robot, default_prior())
        self._robot, self._recording = robot, recording
        course = _by_chance(model, case, robot)
        levels = _levels(model, case)
        self._gram = make_gram(model.columns, course, levels, model.nodes.ticks)
        self._prior = model.prior
        self.log_nothing = self._gram.log_nothing
        self._sight: Sight = sight_of(model.columns, self._gram, model.prior)
        self._place = {key: row for row, key in enumerate(self._sight.keys)}

    def fits(self) -> dict[str, float]:
        """Return the log likelihood of the log if one effect is at work, by effect."""
        return {
            effect: self.log_nothing
            + max(score(self._gram, (term,), self._prior).log_likelihood for term in terms)
            for effect, terms in self._sight.terms.items()
        }

    def over_limit(self, effect: str, values: Values) -> float | None:
        """Return an effect's magnitude over its detection limit; None where it has no magnitude."""
        over = self._over_elsewhere(effect, values)
        part = self._part(effect, values)
        if part is None:
            return over
        separation = self._nothing([(effect, values)], [part])
        seen = math.sqrt(separation / THRESHOLD)
        return seen if over is None else min(over, seen)

    def is_by_chance(self, effect: str) -> bool:
        """Tell whether an effect varies by chance, the more the larger it is."""
        return any(term.variant.scatter is not None for term in self._sight.terms.get(effect, ()))

    def _over_elsewhere(self, effect: str, values: Values) -> float | None:
        """Return a magnitude over its tolerance; rare events must be expected to happen at all."""
        if effect == "adc_missing_code":
            return self._over_scarcity(int(values["code"]))
        over = _over_tolerance(effect, values)
        if over is None or effect not in _RARE:
            return over
        rows = int(self._recording.tick[-1]) + 1
        return min(over, float(values["probability"]) * rows / _EVENTS)

    def _over_scarcity(self, code: int) -> float:
        """Return how far a missing code is over its limit: its n readings come as the next code's,
        whose count alone makes them 2 n log 2 nats likelier there than one half each."""
        codes = self._recording.gyro_code
        n = 0.0 if codes is None else 0.5 * float(np.count_nonzero(codes == code + 1))
        return math.sqrt(2 * 2 * n * math.log(2) / THRESHOLD)

    def group(self, effects: Mapping[str, Values]) -> frozenset[Answer]:
        """Return every answer of at most as many effects that lies within 29 of the truth."""
        news = {name: values for name, values in effects.items() if is_news(name, values)}
        own = canonical(news)
        twins = frozenset(canonical(one) for one in _twins_here(news))
        quiet = {name: values for name, values in news.items() if name not in NOISES}
        return self._imitators(news, own) | twins | {canonical(quiet)}

    def _imitators(self, news: Mapping[str, Values], own: Answer) -> frozenset[Answer]:
        """Return the truth and what the motion cannot tell from it."""
        inside = [(name, self._part(name, values)) for name, values in news.items()]
        moved = [(name, part) for name, part in inside if part is not None]
        still = {name for name, part in inside if part is None}
        if not moved:
            return frozenset({own})
        names = [name for name, _ in moved]
        inner = self._sight.beside(*names)
        rows = [row for _, part in moved for row in part[0]]
        sizes = np.concatenate([part[1] for _, part in moved])
        total = float(sizes @ inner[np.ix_(rows, rows)] @ sizes)
        pull = inner[:, rows] @ sizes
        found = {own}
        if total < THRESHOLD:
            found.add(canonical(still))
        best: dict[str, tuple[float, list[int]]] = {}
        for effect, variant_rows in self._variants():
            left = total - _explained(inner, pull, variant_rows)
            if effect not in best or left < best[effect][0]:
                best[effect] = (left, variant_rows)
        for effect, (left, _) in best.items():
            if left < THRESHOLD:
                found.add(canonical(still | {effect}))
        order = sorted(best, key=lambda effect: best[effect][0])
        for count in range(2, len(moved) + 1):
            for chosen in combinations(order[: _BEST[min(count - 2, len(_BEST) - 1)]], count):
                together = [row for effect in chosen for row in best[effect][1]]
                if total - _explained(inner, pull, together) < THRESHOLD:
                    found.add(canonical(still | set(chosen)))
        return frozenset(found)

    def bounds(self, effects: Mapping[str, Values]) -> dict[str, float]:
        """Return the Cramér-Rao bound of each parameter, by ``effect.parameter``.

        That of the linear model at the true noise levels, tolerances and the other effects being
        free. Only of sizes that are coefficients under their own names.
        """
        rows: list[int] = []
        keys: list[str | None] = []
        for name, values in effects.items():
            told, _ = _told_as(name, values, self._robot)
            part = self._part(name, values)
            if part is None:
                continue
            variant = self._sight.terms[told][0].variant
            plain = told == name and variant.polar is None
            rows += part[0]
            keys += [f"{name}.{one}" if plain else None for one in variant.coefficients]
        if not rows:
            return {}
        inner = self._sight.beside(*(_told_as(n, v, self._robot)[0] for n, v in effects.items()))
        covariance = np.linalg.pinv(inner[np.ix_(rows, rows)])
        sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return {
            key: float(sd) for key, sd in zip(keys, sds, strict=True) if key is not None and sd > 0
        }

    def _nothing(self, settings: Sequence[tuple[str, Values]], parts: Sequence[Part]) -> float:
        """Return the separation from no effect."""
        inner = self._sight.beside(*(_told_as(name, v, self._robot)[0] for name, v in settings))
        rows = [row for part in parts for row in part[0]]
        sizes = np.concatenate([part[1] for part in parts])
        return max(float(sizes @ inner[np.ix_(rows, rows)] @ sizes), 0.0)

    def _variants(self) -> list[tuple[str, list[int]]]:
        return [
            (effect, [self._place[effect, index, c] for c in range(len(term.weights))])
            for effect, terms in self._sight.terms.items()
            for index, term in enumerate(terms)
            if term.weights
        ]

    def _part(self, effect: str, values: Values) -> Part | None:
        """Return an effect as coefficients of its nearest variant; None: not in the motion."""
        name, named = _told_as(effect, values, self._robot)
        terms = self._sight.terms.get(name, ())
        if not terms or not terms[0].variant.coefficients:
            return None
        chosen = _nearest(terms, named)
        if chosen is None:
            return None
        variant = terms[chosen].variant
        if variant.polar is not None:
            size, angle = (float(named[one]) for one in variant.polar)
            pair = variant.polar_turn(size * math.cos(angle), size * math.sin(angle))
            sizes = np.array(pair, dtype=np.float64)
        else:
            sizes = np.array([float(named.get(one, 0.0)) for one in variant.coefficients])
        return [self._place[name, chosen, c] for c in range(len(sizes))], sizes


def _twins_here(news: Mapping[str, Values]) -> list[frozenset[str]]:
    """Return answers that leave the same data because of these values.

    What `effects` says of each; a reception stamp's delay and spread are those of a latency and a
    jitter; positions in another unit are those of a reference whose scale is off by as much.
    """
    found = []
    names = frozenset(news)
    for effect, values in news.items():
        others: tuple[frozenset[str], ...] = ()
        match effect:
            case "frame_latency" if values["frame"] == "sensors":
                others = (frozenset({"reference_time_offset"}),)
            case "reference_time_offset" if float(values["offset"]) < 0:
                others = (frozenset({"frame_latency"}),)
            case "reception_stamp":
                others = (frozenset({"frame_jitter"}), frozenset({"frame_jitter", "frame_latency"}))
            case "stale_heading" if values["cycles"] == 1:
                others = (frozenset({"euler_integration"}),)
            case "setup_unit" if values["signal"] == "reference_position":
                others = (frozenset({"reference_scale"}),)
            case "fixed_tick_period":
                others = (frozenset({"firmware_constant"}),)
            case "reference_scale":
                others = (frozenset({"radius_scale", "wheelbase_scale"}),)
            case "firmware_constant" if values["constant"] in ("tick_period", "gyro_sensitivity"):
                others = (frozenset({"fixed_tick_period"}),)
            case "euler_integration" if values["heading"] == "before":
                others = (frozenset({"stale_heading"}),)
        found += [(names - {effect}) | other for other in others]
    return found


def _nearest(terms: Sequence[Term], named: Values) -> int | None:
    """Return which of an effect's variants acts as these values say; None: on no such side."""
    sides = [
        i for i, t in enumerate(terms) if t.variant.report.get("side") in (None, side_of(named))
    ]

    def away(index: int) -> float:
        fixed = terms[index].variant.fixed
        return sum(abs(fixed[key] - float(named[key])) for key in fixed if key in named)

    return min(sides, key=away, default=None)


def _by_chance(model: MotionModel, case: Case, robot: Robot) -> Course:
    """Return the course whose counts vary as much as the true effects make them vary."""
    course, columns = model.course, model.columns
    for effect, values in case.effects.items():
        name, named = _told_as(effect, values, robot)
        terms = [term for term in columns.terms if term.variant.effect == name]
        chosen = _nearest(terms, named)
        variant = None if chosen is None else terms[chosen].variant
        if variant is not None and variant.scatter is not None:
            size = float(named[variant.coefficients[0]])
            variances = variant.scatter(model.nodes.motion, size, **variant.fixed)
            course = course.scattered(model.nodes, *variances)
    return course


def side_of(values: Values) -> Value | None:
    """Return the side of a setting, if it has one."""
    return values.get("side")


def _explained(inner: Floats, pull: Floats, rows: list[int]) -> float:
    stiff = inner[np.ix_(rows, rows)]
    scale = np.sqrt(np.maximum(np.diag(stiff), 1e-300))
    solved = np.linalg.lstsq(stiff / np.outer(scale, scale), pull[rows] / scale, rcond=1e-10)[0]
    return float(pull[rows] / scale @ solved)


def _over_tolerance(effect: str, values: Values) -> float | None:
    sizes = tolerances(effect)
    if not sizes:
        return None
    return max(abs(float(values.get(name, 0.0))) / limit for name, limit in sizes.items())


def _told_as(effect: str, values: Values, robot: Robot) -> tuple[str, Values]:
    """Return the effect of the motion by which a twin is told, with its values."""
    number = {name: float(v) for name, v in values.items() if isinstance(v, int | float)}
    match effect:
        case "ticks_per_rev":
            return "radius_scale", {"scale": 1 / (1 + number["scale"]) - 1}
        case "adc_offset":
            per_rad_s = robot.plant.gyro.sensitivity_lsb_per_rad_s
            return "gyro_bias", {"bias": number["offset"] / per_rad_s}
        case "adc_gain":
            return "gyro_scale", {"scale": number["gain"]}
        case "gyro_tilt":
            tilt = math.cos(number.get("roll", 0.0)) * math.cos(number.get("pitch", 0.0))
            return "gyro_scale", {"scale": tilt - 1}
        case "wheel_toe":
            return "reference_yaw", {"angle": -number["angle"]}
    return effect, values


def _levels(model: MotionModel, case: Case) -> Floats:
    """Return the true noise levels in the order of `LEVELS`; what is not drawn is as described."""
    noise = case.noise
    slip = case.surroundings["micro_slip"]
    known = {
        "contact_m_per_sqrt_m": (float(slip["left"]) + float(slip["right"])) / 2,
        "lateral_m_per_sqrt_m": 1e-4,
        "slip_wander": max(float(slip.get("wander_left", 0.0)), FLOORS[SLIP_WANDER]),
        "reference_position_m": noise.position_m,
        "reference_heading_rad": noise.heading_rad,
        "reference_stamp_s": max(noise.stamp_s, FLOORS[STAMP]),
        "reference_slow_position_m": noise.slow_position_m,
        "reference_slow_heading_rad": noise.slow_heading_rad,
        "reference_slow_s": noise.correlation_s,
    }
    median = model.level_prior.median
    return np.array([known.get(name, float(median[place])) for place, name in enumerate(LEVELS)])
