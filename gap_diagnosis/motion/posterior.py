"""What is told of a fitted set: draws from its posterior, choices, edges of windows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.hypothesis import FORM, Estimate, generator_of
from gap_diagnosis.motion.accounts import Found, says_twice
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.drawing import DRAWS, draw
from gap_diagnosis.motion.edges import EDGES
from gap_diagnosis.motion.evidence import Scored
from gap_diagnosis.motion.importance import MANY, Bends, Drawn
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.thresholds import has_threshold, thresholds_of
from gap_diagnosis.motion.windows import at_window, has_window, windows_of
from gap_diagnosis.recording import Floats

_AS_LIKELY: Final = 5.0
"""Variants that lack less [nat] than that are drawn from too: one draw in 150."""
_WEIGHED: Final = 1000
"""Draws weighed where effects bend: the ends of an interval of 95 % are then a tenth of a standard
deviation unsure."""
_ENDS: Final = ("start_s", "stop_s")
_TOO_SURE: Final = 1.01**2
"""So many times too small a variance is for what the likelihood takes for known. Noise levels at
their best values, not the true ones, make errors over standard deviation 1.02 times as large (220
drives, 24 constants, the same noise in both). Of 10,513 intervals of two measurements at 1.03 too
many held the truth, of all widths; 1.01 is the middle of what lets 50, 80 and 95 % hold within one
of a hundred. It is judged on other drives (docs/reference/accuracy.md)."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """What one log's search says of the sizes, choices and edges of a set that was fitted.

    *closely*: its windows and thresholds are sought off the grid once more.
    """

    model: MotionModel
    scan: Scan
    closely: bool = True

    def estimates(
        self, found: Found, again: Refitted
    ) -> tuple[dict[str, Estimate], list[tuple[float, float]], float | None]:
        """Return the parameters of a set under their full names, its windows [s], and how heavy the
        tail of the weights is that correct its draws; None where none were needed."""
        rng = generator_of(found.effects)
        draws, ends, pareto_k = self._drawn(found, again, rng)
        ends |= self._windows(found, again, draws, rng)
        parameters: dict[str, Estimate] = {}
        windows: list[tuple[float, float]] = []
        column = 0
        for term in found.terms:
            effect = term.variant.effect
            width = len(term.variant.coefficients)
            named = term.variant.parameters(draws[:, column : column + width]) if width else {}
            column += width
            for name, samples in named.items():
                parameters[f"{effect}.{name}"] = estimate(name, samples)
            for name in term.variant.report:
                key = f"{effect}.{name}"
                if key in ends:
                    parameters[key] = estimate(name, ends[key])
                elif name in EDGES:
                    parameters[key] = estimate(name, self._edge(term, name, found, rng))
                else:
                    parameters[key] = self._choice(term, name, found, again)
            if "start_s" in term.variant.fixed:
                fixed = term.variant.fixed
                windows.append((float(fixed["start_s"]), float(fixed["stop_s"])))
        return parameters, windows, pareto_k

    def _drawn(
        self, found: Found, again: Refitted, rng: np.random.Generator
    ) -> tuple[Floats, dict[str, Floats], float | None]:
        """Return draws float64[4000, k] of the sizes, of every variant that is about as likely, and
        float64[4000] of a threshold, and the tail's shape of the best one's weights.

        What one side counts too many the other may count too few: the size goes with the side. Of
        another form it is no such size.
        """
        for place, term in enumerate(found.terms):
            if has_threshold(term) and self.closely:
                return self._along_thresholds(found.terms, place, again, rng)
        likely = [(found.terms, again)]
        for place, term in enumerate(found.terms):
            if not _is_of_either(term):
                continue
            known = self.scan.evidence(found.terms, found.levels)
            for other in self.scan.by_effect[term.variant.effect]:
                terms = (*found.terms[:place], other, *found.terms[place + 1 :])
                is_rival = other is not term and other.is_on_the_grid and not says_twice(terms)
                is_rival &= other.variant.report.get(FORM) == term.variant.report.get(FORM)
                if is_rival and self.scan.evidence(terms, found.levels) > known - _AS_LIKELY:
                    fit = self.model.refit(terms, again.levels, free_levels=False)
                    likely.append((terms, fit))
        logs = np.array([fit.log_evidence for _, fit in likely])
        weights = np.exp(logs - logs.max())
        # Bends of variants that a fit of their own shows to be of little weight shift no interval:
        # those are drawn along the lines. The set's own variant tells the tail's shape.
        light = logs < logs.max() - _AS_LIKELY
        light[0] = False
        each = [
            Drawn(self._along_lines(terms, fit, rng)) if one else self._draws_of(terms, fit, rng)
            for one, (terms, fit) in zip(light, likely, strict=True)
        ]
        drawn = [one.resampled(DRAWS, rng) for one in each]
        if len(drawn) == 1:
            return drawn[0], {}, each[0].pareto_k
        picked = rng.choice(len(drawn), size=DRAWS, p=weights / weights.sum())
        return np.stack(drawn)[picked, np.arange(DRAWS)], {}, each[0].pareto_k

    def _along_thresholds(
        self, terms: Sequence[Term], place: int, fit: Refitted, rng: np.random.Generator
    ) -> tuple[Floats, dict[str, Floats], float | None]:
        """Return the same of a set with a threshold: the sizes go with it."""
        known = thresholds_of(self.model, terms, place, fit.coefficients, fit.levels)
        picked, rates = known.draw(DRAWS, self._too_sure, rng)
        draws: Floats | None = None
        for one in np.unique(picked):
            own = self._along_lines(known.terms[one], known.fits[one], rng)
            draws = np.zeros_like(own) if draws is None else draws
            draws[picked == one] = own[picked == one]
        assert draws is not None
        return draws, {f"{terms[place].variant.effect}.threshold": rates}, None

    def _draws_of(self, terms: Sequence[Term], fit: Refitted, rng: np.random.Generator) -> Drawn:
        """Return draws of a fit's sizes: of three and more weighed as the effects bend, as long as
        those weights can be trusted."""
        shape = None
        if fit.scored.means.shape[1] >= MANY:
            drawn = Bends(self.model, terms, fit, self._too_sure).drawn(_WEIGHED)
            if drawn.is_trusted:
                return drawn
            shape = drawn.pareto_k
        return Drawn(self._along_lines(terms, fit, rng), pareto_k=shape)

    def _along_lines(
        self, terms: Sequence[Term], fit: Refitted, rng: np.random.Generator
    ) -> Floats:
        """Return draws float64[4000, k] of a fit's sizes as if its effects acted along lines."""
        free = [term for term in terms if not term.is_fixed]
        return draw(self._widened(fit.scored), free, rng)

    def _windows(
        self, found: Found, again: Refitted, draws: Floats, rng: np.random.Generator
    ) -> dict[str, Floats]:
        """Return draws float64[4000] of the ends of windows that the log does not tell by itself;
        in *draws* the size goes with the window."""
        ends: dict[str, Floats] = {}
        column = 0
        for place, term in enumerate(found.terms):
            if has_window(term) and self.closely:
                windows = windows_of(
                    self.model,
                    found.terms,
                    place,
                    again.coefficients,
                    again.levels,
                )
                start_s, stop_s, size = windows.draw(DRAWS, self._too_sure, rng)
                effect = term.variant.effect
                ends[f"{effect}.start_s"], ends[f"{effect}.stop_s"] = start_s, stop_s
                draws[:, column] = np.abs(size) if term.variant.is_positive else size
            column += len(term.variant.coefficients)
        return ends

    @property
    def _too_sure(self) -> float:
        """How many times too sure the likelihood is: where no model of the log is right, and by
        what it takes for known."""
        return self.scan.dispersion * _TOO_SURE

    def _widened(self, scored: Scored) -> Scored:
        """Return the posterior with as much more variance as the log's likelihood is too sure."""
        return replace(scored, covariances=scored.covariances * self._too_sure)

    def _edge(self, term: Term, name: str, found: Found, rng: np.random.Generator) -> Floats:
        """Return draws float64[4000] of an edge: as the log tells it, or as it was sought."""
        if name in term.variant.told:
            return rng.uniform(*term.variant.told[name], size=DRAWS)
        sd = self.scan.spans.get(term.variant.effect, {}).get(name)
        if sd is None:
            return self._on_the_grid(term, name, found, rng)
        if name in _ENDS:  # a log tells no moment within a tick
            sd = max(sd, self.model.nodes.motion.tick_s / math.sqrt(12.0))
        return float(term.variant.report[name]) + sd * rng.standard_normal(DRAWS)

    def _on_the_grid(self, term: Term, name: str, found: Found, rng: np.random.Generator) -> Floats:
        """Return draws float64[4000] of an edge that was told too faintly to be sought off its
        grid: from the evidence of every variant, even within a step of the grid."""
        others = [one for one in found.terms if one.variant.effect != term.variant.effect]
        variants = self.scan.by_effect[term.variant.effect]
        known = [one for one in variants if name in one.variant.fixed]
        values = np.array([one.variant.fixed[name] for one in known])
        logs = np.array([self.scan.evidence([*others, one], found.levels) for one in known])
        weights = np.exp(logs - logs.max())
        drawn = rng.choice(values, size=DRAWS, p=weights / weights.sum())
        grid = np.unique(values)
        step = float(np.diff(grid).mean()) if len(grid) > 1 else 0.0
        return np.maximum(drawn + step * rng.uniform(-0.5, 0.5, DRAWS), 0.0)

    def _choice(self, term: Term, name: str, found: Found, again: Refitted) -> Estimate:
        """Return the probabilities of a choice, from every variant of the effect.

        Where straight lines speak for another than was fitted, that one is fitted as it acts: a
        size told of one wheel would stand beside a probability of the other.
        """
        others = [one for one in found.terms if one.variant.effect != term.variant.effect]
        chosen = term.variant.report[name]
        scores: dict[str, float] = {}
        best: dict[str, tuple[float, Term]] = {}
        for variant in self.scan.by_effect[term.variant.effect]:
            if says_twice([*others, variant]):
                continue
            key = str(variant.variant.report[name])
            value = self.scan.evidence([*others, variant], found.levels)
            scores[key] = float(np.logaddexp(scores.get(key, -np.inf), value))
            best[key] = max(best.get(key, (-math.inf, variant)), (value, variant), key=_first)
        own = scores.get(str(chosen), -math.inf)
        for key in [key for key, score in scores.items() if self.closely and score > own]:
            fitted = max(
                self.model.refit(
                    tuple(way if one is term else one for one in found.terms),
                    found.levels,
                    known=(again.levels,),
                ).log_evidence
                for way in self._ways_of(best[key][1], term)
            )
            scores[key] = own + fitted - again.log_evidence
        likeliest = max(scores, key=lambda key: scores[key])
        if _is_of_either(term) and name != FORM:
            chosen = best[likeliest][1].variant.report[name]
        weights = {k: float(np.exp(value - scores[likeliest])) for k, value in scores.items()}
        total = sum(weights.values())
        return Estimate(
            chosen, probabilities={key: weight / total for key, weight in weights.items()}
        )

    @staticmethod
    def _ways_of(rival: Term, term: Term) -> list[Term]:
        """Return a rival of a term as it is on the grid, and in the term's own window, which was
        sought off it: the rival must not lose for an edge."""
        if not (has_window(rival) and has_window(term)):
            return [rival]
        window = (float(term.variant.fixed[name]) for name in ("start_s", "stop_s"))
        return [rival, at_window(rival, *window)]


def _is_of_either(term: Term) -> bool:
    """Tell whether sizes are drawn of every variant of a term that is about as likely: where none
    has a window or a threshold of its own."""
    return bool(term.variant.coefficients) and not any(name in term.variant.fixed for name in EDGES)


def _first(scored: tuple[float, Term]) -> float:
    return scored[0]


def estimate(name: str, samples: Floats) -> Estimate:
    """Return what samples float64[n] of a parameter say; those of an angle are laid about it."""
    if name in {"phase", "direction"}:
        middle = float(np.angle(np.mean(np.exp(1j * samples))))
        samples = middle + np.angle(np.exp(1j * (samples - middle)))
    return Estimate(float(samples.mean()), float(samples.std()), samples)


def of_moment_or_mean(
    parameters: Mapping[str, Estimate], row_s: float, *, has_reference: bool
) -> dict[str, Estimate]:
    """Return how late a gyro is whose rows do not say whether a rate is of the row's own moment or
    the mean since the row before.

    Either is as likely, and a fit takes it for the mean, which shows half a row less; of wheels
    that are late beside the gyro half a row more, where no reference says how late these are.
    """
    frame = parameters.get("frame_latency.frame")
    late = None if frame is None else frame.value
    name, later_s = "gyro_lag.time_constant", 0.5 * row_s
    if late == "IMU":
        name = "frame_latency.delay"
    elif late == "ENCODER" and not has_reference:
        name, later_s = "frame_latency.delay", -0.5 * row_s
    if name not in parameters:
        return {}
    samples = np.asarray(parameters[name].samples)
    of_the_moment = np.arange(len(samples)) % 2 == 1
    either = estimate(name, np.maximum(samples + later_s * of_the_moment, 0.0))
    return {name: replace(either, news=parameters[name].news, is_either=True)}
