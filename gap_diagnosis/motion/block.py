"""The motion block: fits of sets of effects to wheels, gyro and reference together."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.motion.accounts import Found, dispersed
from gap_diagnosis.motion.bursts import Burst, find_burst
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.edges import EDGES
from gap_diagnosis.motion.evidence import Scored
from gap_diagnosis.motion.gross import looks_gross, put_right
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.noise import NOISES, fit_noise
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.recording import Floats
from gap_diagnosis.setup_mistakes import LEAST_GAIN

_DRAWS: Final = 4000
_SEVERAL: Final = 12
_AS_LIKELY: Final = 5.0
"""Variants that lack less [nat] than that are drawn from too: one draw in 150."""
_REDRAWN: Final = 30
"""So often what is within tolerance is drawn again; what then remains there has no news in it."""
_IMPOSSIBLE: Final = -1e9
_GAINS: Final = 1.0
"""Where a noise and an effect each gain more than this alone [nat], they may gain the same."""
_LEFT: Final = 0.04
"""Share of what an effect gains that a level of noise may take up of what it leaves: a fifth of its
amplitude."""
_ROUGHEST: Final = 5.0
"""Contact this many spreads of its prior above the described one is of no floor: 45 mm after a
metre."""
_CONTACT: Final = LEVELS.index("contact_m_per_sqrt_m")
ALIASED: Final = "radius_scale"
ALIASES: Final = {"ticks_per_rev": ALIASED}
"""Effects that the motion cannot tell from another: t counts too many are a smaller wheel,
1/(1 + t) - 1. Commands may tell them apart."""


LATENCY: Final = "frame_latency"
OFFSET: Final = "reference_time_offset"


def aliased(effects: frozenset[str]) -> frozenset[str]:
    """Return the effects under the names that the motion knows them by."""
    return frozenset(ALIASES.get(effect, effect) for effect in effects)


def beyond(tolerated: float, found: Fit) -> Fit:
    """Return a fit by what it explains beyond what a healthy robot may be off by."""
    more = max(found.log_evidence - tolerated, min(found.log_evidence, 0.0))
    return replace(found, log_evidence=more)


class MotionBlock:
    """Wheels, gyro and reference of one log (a `Block`).

    Attributes:
        tolerated: log evidence of what a healthy robot may be off by, where that explains the log
            better than any listed effect: effects must explain more than that.
    """

    name = "motion"

    def __init__(
        self, model: MotionModel, progress: Callable[[float], None] = lambda share: None
    ) -> None:
        """Search through all single effects and pairs."""
        self.model = model
        self.scan = Scan(model, progress)
        self._nothing = self.scan.found[frozenset()]
        self._noise_fits: dict[tuple[str, str | None], Fit] = {}
        self.tolerated = 0.0

    @cached_property
    def effects(self) -> frozenset[str]:
        """The effects that this log's motion can tell of."""
        aliases = ALIASES.keys() if ALIASED in self.scan.effects else set()
        nodes = self.model.nodes
        noises = {
            name
            for name, noise in NOISES.items()
            if (nodes.has_gyro if noise.stage == "gyro" else nodes.has_reference)
        }
        late = {LATENCY} if OFFSET in self.scan.effects else set()
        return frozenset(self.scan.effects | aliases | noises | late)

    @property
    def several(self) -> list[frozenset[str]]:
        """The best sets of three or more effects of this log's motion, under every name they go by.

        As many of each size.
        """
        ranked = sorted(self.scan.found.values(), key=lambda one: -self.scan.gained(one)[0])
        sets: list[frozenset[str]] = []
        for size in range(3, len(self.model.prior.effects)):
            sets += [one.effects for one in ranked if len(one.effects) == size][:_SEVERAL]
        for alias, name in ALIASES.items():
            sets += [one - {name} | {alias} for one in sets if name in one]
        return sets

    @property
    def levels(self) -> Floats:
        """Noise levels of the best account of all."""
        return max(self.scan.found.values(), key=lambda one: one.log_evidence).levels

    @property
    def explained(self) -> float:
        """Log evidence of the best account of all, less that of no effect."""
        return max(self.scan.gained(one)[0] for one in self.scan.found.values())

    @cached_property
    def burst(self) -> Burst | None:
        """Windows in which wheels lose their hold: evidence less that of no effect."""
        best = max(self.scan.found.values(), key=lambda one: one.log_evidence)
        burst = find_burst(self.model, best, self._nothing)
        if burst is None or burst.log_evidence < self._nothing.log_evidence:
            return None
        return replace(
            burst,
            log_evidence=burst.log_evidence - self._nothing.log_evidence,
            log_likelihood=burst.log_likelihood - self._nothing.log_likelihood,
        )

    def dispersed(self, log_evidence: float, log_likelihood: float) -> tuple[float, float]:
        """Return both as they are worth where the log's surprises scatter too much."""
        return dispersed(log_evidence, log_likelihood, self.scan.dispersion)

    def log_evidence_of_levels(self, levels: Floats) -> float:
        """Return the log evidence of no effect at these noise levels, less that at its own."""
        density = self.model.level_prior.log_density(np.log(levels))
        return self.model.gram(levels).log_nothing + density - self._nothing.log_evidence

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return what the search found of a set of effects, without parameters, beyond what is
        tolerated."""
        return beyond(self.tolerated, self._fit(effects))

    def _fit(self, effects: frozenset[str]) -> Fit:
        """Return what the search found of a set of effects, without parameters."""
        if any(alias in effects and other in effects for alias, other in ALIASES.items()):
            return Fit(tuple(sorted(effects)), _IMPOSSIBLE, _IMPOSSIBLE)
        if LATENCY in effects and LATENCY not in self.scan.effects:
            return self._late(effects)
        found = self.scan.account(aliased(effects - NOISES.keys()))
        if self._accounts_for_nothing(found):
            return Fit(tuple(sorted(effects)), _IMPOSSIBLE, _IMPOSSIBLE)
        if effects & NOISES.keys():
            return self._noisy(effects)
        if self._put_right is not None and tuple(effects) == self._put_right.effects:
            return self._put_right
        return Fit(tuple(sorted(effects)), *self.scan.gained(found))

    @cached_property
    def _put_right(self) -> Fit | None:
        """The likeliest mistake of the set-up, judged by what the log is like without it.

        About so gross an error nothing is linear. None: no mistake is likelier than no effect.
        """
        wrong = [one for one in self._mistakes if not one.effects & self._mend_nothing]
        if not wrong:
            return None
        best = max(wrong, key=lambda one: one.log_evidence)
        if best.log_evidence < self._nothing.log_evidence + LEAST_GAIN:
            return None
        (term,) = best.terms
        effect = term.variant.effect
        right, log_scale = put_right(self.model.recording, effect, term.variant.report)
        model = MotionModel(
            right, self.model.robot, self.model.prior, without=self.model.without | GROSS
        )
        levels = model.no_effect_levels
        density = model.level_prior.log_density(np.log(levels))
        evidence = model.evidence_at((), levels) + density
        evidence += log_scale * float(np.isfinite(model.columns.values[3, :, 0]).sum())
        evidence -= math.log(len(self.scan.by_effect[effect]))
        evidence = max(evidence, best.log_evidence)
        gain = evidence - self._nothing.log_evidence
        likelihood = max(gain, best.log_likelihood - self._nothing.log_likelihood)
        return Fit((effect,), gain, likelihood)

    @property
    def _mistakes(self) -> list[Found]:
        singles = (frozenset({effect}) for effect in sorted(GROSS))
        return [self.scan.found[one] for one in singles if one in self.scan.found]

    @cached_property
    def is_gross(self) -> bool:
        """Something is wrong by a sign or a factor."""
        return looks_gross(self.model.recording, self.model.robot)

    @property
    def nameless(self) -> float:
        """Log evidence, less that of no effect, of the best account that is none.

        It shows that there is something, which explains at least as much and is not listed.
        """
        wrong = [one for one in self.scan.found.values() if self._accounts_for_nothing(one)]
        best = max((one.log_evidence for one in wrong), default=-math.inf)
        return best - self._nothing.log_evidence

    def _accounts_for_nothing(self, found: Found) -> bool:
        """Tell whether a set leaves a gross log as gross as it was.

        A wrong mistake of the set-up, put right, leaves signs or factors between sources; a wrong
        effect leaves a contact that no floor has. Each may win thousands of nats all the same where
        the right one is not listed.
        """
        if not found.effects or not self.is_gross:
            return False
        if found.effects & GROSS:
            return bool(found.effects & self._mend_nothing)
        prior = self.model.level_prior
        return bool(
            np.log(found.levels[_CONTACT] / prior.median[_CONTACT])
            > _ROUGHEST * prior.spread[_CONTACT]
        )

    @cached_property
    def _mend_nothing(self) -> frozenset[str]:
        """Mistakes of the set-up that, put right, leave the log as gross as it was."""
        found = set()
        for one in self._mistakes:
            (term,) = one.terms
            effect, values = term.variant.effect, term.variant.report
            right, _ = put_right(self.model.recording, effect, values)
            if looks_gross(right, self.model.robot):
                found.add(effect)
        return frozenset(found)

    def _late(self, effects: frozenset[str]) -> Fit:
        """Fit a latency: of all sensors it is a reference that is early; of one, unseen here."""
        rest = effects - {LATENCY}
        names = tuple(sorted(effects))
        unseen = self._fit(rest)
        if OFFSET in rest or len(rest) > 1 or rest & NOISES.keys():
            return replace(unseen, effects=names)
        found = self.scan.account(aliased(rest) | {OFFSET})
        late = self._fit(rest | {OFFSET})
        place = next(i for i, t in enumerate(found.terms) if t.variant.effect == OFFSET)
        offset = found.refitted.coefficients[place][0] if found.refitted else self._offset(found)
        if offset > 0:
            return replace(unseen, effects=names, log_evidence=unseen.log_evidence - math.log(2))
        return replace(
            late,
            effects=names,
            log_evidence=float(np.logaddexp(late.log_evidence, unseen.log_evidence)) - math.log(2),
        )

    def _offset(self, found: Found) -> float:
        """Return the reference's time offset as the search found it, about neutral."""
        place = next(i for i, t in enumerate(found.terms) if t.variant.effect == OFFSET)
        before = sum(len(t.weights) for t in found.terms[:place] if not t.is_fixed)
        scored = self.scan.scored(found.terms, found.levels)
        return float(scored.means[int(np.argmax(scored.weights)), before])

    def _noisy(self, effects: frozenset[str]) -> Fit:
        """Fit a set with one level of noise set free; a level within twice the described is none.

        Beside several effects the noise gains no more than beside any one of them, and what an
        explanation that is not quite exact leaves to it is no news. Beside a mistake of the set-up
        no level is told: a factor multiplies the errors of the wheels too.
        """
        noises = frozenset(effects & NOISES.keys())
        quiet = effects - noises
        names = tuple(sorted(effects))
        if len(noises) > 1 or quiet & GROSS:
            return Fit(names, _IMPOSSIBLE, _IMPOSSIBLE)
        (name,) = noises
        if not quiet:
            return self._noise_beside(name, None)
        seen = sorted(
            OFFSET if one == LATENCY and one not in self.scan.effects else one for one in quiet
        )
        told = [self._noise_beside(name, one) for one in seen]
        rest = [self._fit(frozenset({one})) for one in seen]
        together = self._fit(quiet)
        left = _LEFT * max(0.0, *(one.log_evidence for one in rest))
        gains = [a.log_evidence - b.log_evidence - left for a, b in zip(told, rest, strict=True)]
        likelier = [a.log_likelihood - b.log_likelihood for a, b in zip(told, rest, strict=True)]
        least = int(np.argmin(gains))
        return Fit(
            names,
            together.log_evidence + gains[least],
            together.log_likelihood + likelier[least],
            told[least].parameters,
        )

    def _noise_beside(self, name: str, effect: str | None) -> Fit:
        """Fit a noise beside one effect; beside one that gains little it gains what it does alone,
        and where that is little it matters not how much."""
        key = (name, effect)
        if key not in self._noise_fits:
            quiet = frozenset() if effect is None else frozenset({effect})
            beside = self._fit(quiet)
            alone = None if effect is None else self._noise_beside(name, None)
            if alone is None or min(alone.log_evidence, beside.log_evidence) > _GAINS:
                found = self.scan.account(aliased(quiet))
                names = sorted(quiet | {name})
                noisy = fit_noise(self.model, found, self._nothing, name, names)
                evidence, likelihood = self.dispersed(noisy.log_evidence, noisy.log_likelihood)
                fit = replace(noisy, log_evidence=evidence, log_likelihood=likelihood)
            else:
                fit = replace(
                    alone,
                    log_evidence=alone.log_evidence + beside.log_evidence,
                    log_likelihood=alone.log_likelihood + beside.log_likelihood,
                )
            self._noise_fits[key] = fit
        return self._noise_fits[key]

    def detail(self, effects: frozenset[str]) -> Fit:
        """Fit a set once more, with its windows and thresholds off the grid, and draw from it."""
        if not effects:
            return self._fit(effects)
        if LATENCY in effects and LATENCY not in self.scan.effects:
            rest = effects - {LATENCY}
            seen = self._fit(effects).log_evidence > self._fit(rest).log_evidence + 1
            if not seen or OFFSET in rest:
                return replace(self.detail(rest), effects=tuple(sorted(effects)))
            inner = self.detail(rest | {OFFSET})
            parameters = dict(inner.parameters)
            early = parameters.pop(f"{OFFSET}.offset")
            parameters[f"{LATENCY}.delay"] = _estimate("delay", -np.asarray(early.samples))
            return replace(inner, effects=tuple(sorted(effects)), parameters=parameters)
        if effects & NOISES.keys():
            quiet = self.detail(frozenset(effects - NOISES.keys()))
            noisy = self._fit(effects)
            return replace(
                noisy,
                parameters={**quiet.parameters, **noisy.parameters},
                windows=quiet.windows,
            )
        found = self.scan.account(aliased(effects))
        again = found.refitted or self.model.refit(found.terms, found.levels)
        parameters, windows = self._estimates(found, again)
        for alias in effects & ALIASES.keys():
            own = {name.split(".")[1]: name for name in parameters if _is_of(name, ALIASES[alias])}
            for name, known in own.items():
                parameters[f"{alias}.{name}"] = parameters.pop(known)
            samples = 1 / (1 + np.asarray(parameters[f"{alias}.scale"].samples)) - 1
            parameters[f"{alias}.scale"] = _estimate("scale", samples)
        fit = self._fit(effects)
        return replace(fit, parameters=parameters, windows=tuple(windows))

    def settings(self, effects: frozenset[str]) -> list[Setting]:
        """Return variants and best coefficients of what moves, as `predict` takes them."""
        found = self.scan.account(self.moving(effects))
        again = found.refitted or self.model.refit(found.terms, found.levels)
        return [(t.variant, c) for t, c in zip(found.terms, again.coefficients, strict=True)]

    def moving(self, effects: frozenset[str]) -> frozenset[str]:
        """Return the effects that change what is predicted, under the search's own names."""
        own = effects & self.effects
        if LATENCY in own and LATENCY not in self.scan.effects:
            seen = self._fit(own).log_evidence > self._fit(own - {LATENCY}).log_evidence + 1
            own = own - {LATENCY} | ({OFFSET} if seen else frozenset())
        return aliased(frozenset(own - NOISES.keys()))

    def _estimates(
        self, found: Found, again: Refitted
    ) -> tuple[dict[str, Estimate], list[tuple[float, float]]]:
        rng = np.random.default_rng(zlib.crc32("+".join(sorted(found.effects)).encode()))
        draws = self._drawn(found, again, rng)
        parameters: dict[str, Estimate] = {}
        windows: list[tuple[float, float]] = []
        column = 0
        for term in found.terms:
            effect = term.variant.effect
            width = len(term.variant.coefficients)
            named = term.variant.parameters(draws[:, column : column + width]) if width else {}
            column += width
            for name, samples in named.items():
                parameters[f"{effect}.{name}"] = _estimate(name, samples)
            for name in term.variant.report:
                key = f"{effect}.{name}"
                if name in EDGES:
                    samples = self._edge(term, name, found, rng)
                    if name.endswith("_s"):
                        samples = np.clip(samples, *self.model.nodes.motion.t_s[[0, -1]])
                    parameters[key] = _estimate(name, samples)
                else:
                    parameters[key] = self._choice(term, name, found)
            if "start_s" in term.variant.fixed:
                fixed = term.variant.fixed
                windows.append((float(fixed["start_s"]), float(fixed["stop_s"])))
        return parameters, windows

    def _drawn(self, found: Found, again: Refitted, rng: np.random.Generator) -> Floats:
        """Return draws float64[4000, k] of the sizes, of every variant that is about as likely.

        What one side counts too many the other may count too few: the size goes with the side.
        """
        likely = [(found.terms, again)]
        for place, term in enumerate(found.terms):
            if not term.variant.coefficients or any(name in term.variant.fixed for name in EDGES):
                continue
            known = self.scan.evidence(found.terms, found.levels)
            for other in self.scan.by_effect[term.variant.effect]:
                terms = (*found.terms[:place], other, *found.terms[place + 1 :])
                is_rival = other is not term and other.log_weight == 0.0
                if is_rival and self.scan.evidence(terms, found.levels) > known - _AS_LIKELY:
                    fit = self.model.refit(terms, again.levels, free_levels=False)
                    likely.append((terms, fit))
        logs = np.array([fit.log_evidence for _, fit in likely])
        weights = np.exp(logs - logs.max())
        drawn = [
            draw(self._widened(fit.scored), [one for one in terms if not one.is_fixed], rng)
            for terms, fit in likely
        ]
        if len(drawn) == 1:
            return drawn[0]
        picked = rng.choice(len(drawn), size=_DRAWS, p=weights / weights.sum())
        return np.stack(drawn)[picked, np.arange(_DRAWS)]

    def _widened(self, scored: Scored) -> Scored:
        """Return the posterior with as much more variance as the log's likelihood is too sure."""
        return replace(scored, covariances=scored.covariances * self.scan.dispersion)

    def _edge(self, term: Term, name: str, found: Found, rng: np.random.Generator) -> Floats:
        """Return draws float64[4000] of an edge: as the log tells it, or as it was sought."""
        if name in term.variant.told:
            return rng.uniform(*term.variant.told[name], size=_DRAWS)
        sd = self.scan.spans.get(term.variant.effect, {}).get(name)
        if sd is None:
            return self._on_the_grid(term, name, found, rng)
        return float(term.variant.report[name]) + sd * rng.standard_normal(_DRAWS)

    def _on_the_grid(self, term: Term, name: str, found: Found, rng: np.random.Generator) -> Floats:
        """Return draws float64[4000] of an edge that was told too faintly to be sought off its
        grid: from the evidence of every variant, even within a step of the grid."""
        others = [one for one in found.terms if one.variant.effect != term.variant.effect]
        variants = self.scan.by_effect[term.variant.effect]
        known = [one for one in variants if name in one.variant.fixed]
        values = np.array([one.variant.fixed[name] for one in known])
        logs = np.array([self.scan.evidence([*others, one], found.levels) for one in known])
        weights = np.exp(logs - logs.max())
        drawn = rng.choice(values, size=_DRAWS, p=weights / weights.sum())
        grid = np.unique(values)
        step = float(np.diff(grid).mean()) if len(grid) > 1 else 0.0
        return np.maximum(drawn + step * rng.uniform(-0.5, 0.5, _DRAWS), 0.0)

    def _choice(self, term: Term, name: str, found: Found) -> Estimate:
        """Return the probabilities of a choice, from every variant of the effect."""
        others = [one for one in found.terms if one.variant.effect != term.variant.effect]
        scores: dict[str, float] = {}
        for variant in self.scan.by_effect[term.variant.effect]:
            key = str(variant.variant.report[name])
            value = self.scan.evidence([*others, variant], found.levels)
            scores[key] = float(np.logaddexp(scores.get(key, -np.inf), value))
        top = max(scores.values())
        weights = {key: float(np.exp(value - top)) for key, value in scores.items()}
        total = sum(weights.values())
        return Estimate(
            term.variant.report[name],
            probabilities={key: weight / total for key, weight in weights.items()},
        )


def _is_of(parameter: str, effect: str) -> bool:
    return parameter.partition(".")[0] == effect


def draw(scored: Scored, terms: Sequence[Term], rng: np.random.Generator) -> Floats:
    """Return draws float64[4000, k] of the coefficients from the posterior mixture.

    What lies within its tolerance is no news and is drawn again, as the evidence leaves it out;
    sizes that cannot be negative are never drawn so.
    """
    count = scored.means.shape[1]
    if count == 0:
        return np.zeros((_DRAWS, 0))
    picked = rng.choice(len(scored.weights), size=_DRAWS, p=scored.weights / scored.weights.sum())
    factors = np.linalg.cholesky(
        scored.covariances + 1e-18 * np.eye(count) * np.trace(scored.covariances[0])
    )
    draws = np.zeros((_DRAWS, count))
    again = np.ones(_DRAWS, dtype=np.bool_)
    for _ in range(_REDRAWN):
        which = picked[again]
        normal = rng.standard_normal((len(which), count))
        draws[again] = scored.means[which] + np.einsum("sij,sj->si", factors[which], normal)
        again = ~_is_news(draws, terms)
        if not again.any():
            break
    column = 0
    for term in terms:
        for _ in term.weights:
            if term.variant.is_positive:
                draws[:, column] = np.abs(draws[:, column])
            column += 1
    return draws


def _is_news(draws: Floats, terms: Sequence[Term]) -> NDArray[np.bool_]:
    """Tell of draws float64[s, k] whether each term has a coefficient beyond its tolerance."""
    news = np.ones(len(draws), dtype=np.bool_)
    column = 0
    for term in terms:
        beyond = np.zeros(len(draws), dtype=np.bool_)
        for tolerance in term.tolerances:
            size = draws[:, column] if term.variant.is_positive else np.abs(draws[:, column])
            beyond |= size > tolerance
            column += 1
        news &= beyond
    return news


def _estimate(name: str, samples: Floats) -> Estimate:
    if name in {"phase", "direction"}:
        middle = float(np.angle(np.mean(np.exp(1j * samples))))
        samples = middle + np.angle(np.exp(1j * (samples - middle)))
    return Estimate(float(samples.mean()), float(samples.std()), samples)
