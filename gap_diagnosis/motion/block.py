"""The motion block: fits of sets of effects to wheels, gyro and reference together."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.motion.accounts import Found, dispersed, of_one_quotient
from gap_diagnosis.motion.bursts import Burst, find_burst
from gap_diagnosis.motion.columns import GROSS
from gap_diagnosis.motion.gross import looks_gross
from gap_diagnosis.motion.mending import Mending
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.neighbours import DEAD
from gap_diagnosis.motion.noise import NOISES, fit_noise
from gap_diagnosis.motion.posterior import Posterior, estimate, of_moment_or_mean
from gap_diagnosis.motion.pushes import Pushes, find_pushes
from gap_diagnosis.motion.scan import Scan, search
from gap_diagnosis.motion.standstill import Standstills, find_standstills
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import EVEN_OVER
from hil_harness.effects import catalogue

_SEVERAL: Final = 12
_IMPOSSIBLE: Final = -1e9
_GAINS: Final = 1.0
"""Where a noise and an effect each gain more than this alone [nat], they may gain the same."""
_GAINS_FAR: Final = 3.0
"""Or more than this, where both together lack"""
_OUT_OF_REACH: Final = 20.0
"""so much of what the best account explains."""
_LEFT: Final = 0.04
"""Share of what an effect gains that a level of noise may take up of what it leaves: a fifth of its
amplitude."""
_ROUGHEST: Final = 5.0
"""Contact this many spreads of its prior above the described one is of no floor: 45 mm after a
metre."""
_CONTACT: Final = LEVELS.index("contact_m_per_sqrt_m")
_WALK: Final = LEVELS.index("gyro_bias_walk_rad_s_per_sqrt_s")
_SLOW_POSITION: Final = LEVELS.index("reference_slow_position_m")
_SLOW_S: Final = LEVELS.index("reference_slow_s")
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


class _Drawn(NamedTuple):
    """What is told of the fit of a set, as `_estimates` returns it."""

    found: Found
    parameters: dict[str, Estimate]
    windows: list[tuple[float, float]]
    pareto_k: float | None


class MotionBlock:
    """Wheels, gyro and reference of one log (a `Block`).

    Attributes:
        tolerated: log evidence of what a healthy robot may be off by, where that explains the log
            better than any listed effect: effects must explain more than that.
    """

    name = "motion"

    def __init__(
        self,
        model: MotionModel,
        progress: Callable[[float], None] = lambda share: None,
        scan: Scan | None = None,
    ) -> None:
        """Search through all single effects and pairs, unless *scan* has."""
        self.model = model
        self.scan = scan or search(model, progress)
        self._nothing = self.scan.found[frozenset()]
        self._told: dict[frozenset[str], tuple[Found, Fit]] = {}
        self._noise_fits: dict[tuple[str, str | None], Fit] = {}
        self._drawn: dict[tuple[frozenset[str], bool, float], _Drawn] = {}
        self.tolerated = 0.0
        self._mending = Mending(model, self.scan)

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
    def levels_of_nothing(self) -> Floats:
        """Noise levels of no effect."""
        return self._nothing.levels

    @property
    def explained(self) -> float:
        """Log evidence of the best account of all, less that of no effect."""
        return max(self.scan.gained(one)[0] for one in self.scan.found.values())

    @cached_property
    def burst(self) -> Burst | None:
        """Windows in which wheels lose their hold: evidence less that of no effect."""
        burst = find_burst(self.model, self.scan.best_steady, self._nothing)
        if burst is None or burst.log_evidence < self._nothing.log_evidence:
            return None
        return replace(
            burst,
            log_evidence=burst.log_evidence - self._nothing.log_evidence,
            log_likelihood=burst.log_likelihood - self._nothing.log_likelihood,
        )

    @cached_property
    def pushes(self) -> Pushes | None:
        """Steps of the body that no wheel makes."""
        return find_pushes(self.model, self.scan.best_steady, self._nothing)

    @cached_property
    def standstills(self) -> Standstills | None:
        """Stretches in which counts stand while their wheels turn."""
        return find_standstills(self.model, self._nothing)

    def dispersed(self, log_evidence: float, log_likelihood: float) -> tuple[float, float]:
        """Return both as they are worth where the log's surprises scatter too much."""
        return dispersed(log_evidence, log_likelihood, self.scan.dispersion)

    def log_evidence_of_levels(self, levels: Floats) -> float:
        """Return the log evidence of no effect at these noise levels, less that at its own."""
        density = self.model.level_prior.log_density(np.log(levels))
        return self.model.evidence_at((), levels) + density - self._nothing.log_evidence

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
        quotient = of_one_quotient(aliased(effects), self.model.nodes)
        if len(quotient) > 1:
            parts = [self._fit(aliased(effects) - quotient | {one}) for one in sorted(quotient)]
            best = max(parts, key=lambda one: one.log_evidence)
            return replace(best, effects=tuple(sorted(effects)))
        found = self.scan.account(aliased(effects - NOISES.keys()))
        if self._accounts_for_nothing(found):
            return Fit(tuple(sorted(effects)), _IMPOSSIBLE, _IMPOSSIBLE)
        if effects & NOISES.keys():
            return self._noisy(effects)
        if (right := self._mending.put_right.get(effects)) is not None:
            return right.fit
        known = self._told.get(effects)
        if known is None or known[0] is not found:
            counting = {
                alias: 1 / (1 + self._size(found, name)) - 1
                for alias, name in ALIASES.items()
                if alias in effects
            }
            told = Fit(tuple(sorted(effects)), *self.scan.gained(found), counting=counting)
            known = self._told[effects] = found, told
        return known[1]

    def beside_mistake(self, effects: frozenset[str]) -> frozenset[str]:
        """Return what is likeliest besides, where a set is a mistake of the set-up: the log is put
        right first."""
        right = self._mending.put_right.get(effects & GROSS)
        return frozenset() if right is None else right.beside

    def levels_beside(self, effects: frozenset[str]) -> Floats:
        """Return noise levels beside a set: those of the best account of all, or of a log in which
        the set's mistake of the set-up is put right."""
        right = self._mending.put_right.get(effects & GROSS)
        return self.levels if right is None else right.levels

    @cached_property
    def is_gross(self) -> bool:
        """Something is wrong by a sign or a factor."""
        return looks_gross(self.model.recording, self.model.robot)

    @cached_property
    def _where_it_turns(self) -> MotionBlock | None:
        """The log in which the wheel of a dead encoder turns again."""
        there = self.scan.where_it_turns
        return None if there is None else MotionBlock(there.model, scan=there)

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
        effect leaves a contact that no floor has, a bias that no gyro has, or a reference that
        wanders faster than the wheels can go. Each may win thousands of nats all the same where the
        right one is not listed.
        """
        if not found.effects or not self.is_gross:
            return False
        if found.effects & GROSS:
            return bool(found.effects & self._mending.in_vain)
        prior = self.model.level_prior
        louder = np.log(found.levels / prior.median)
        roughest = _ROUGHEST * prior.spread[_CONTACT]
        wanders_m_s = found.levels[_SLOW_POSITION] / found.levels[_SLOW_S]
        plant = self.model.robot.plant
        fastest_m_s = plant.drive.max_wheel_rate_rad_s * plant.wheels.radius_m
        return bool(
            louder[_CONTACT] > roughest
            or louder[_WALK] > math.log(EVEN_OVER)
            or wanders_m_s > fastest_m_s
        )

    def _late(self, effects: frozenset[str]) -> Fit:
        """Fit a latency: of all sensors it is a reference that is early; of one, unseen here."""
        rest = effects - {LATENCY}
        names = tuple(sorted(effects))
        unseen = self._fit(rest)
        if OFFSET in rest or len(rest) > 1 or rest & NOISES.keys():
            return replace(unseen, effects=names)
        found = self.scan.account(aliased(rest) | {OFFSET})
        late = self._fit(rest | {OFFSET})
        if self._size(found, OFFSET) > 0:
            return replace(unseen, effects=names, log_evidence=unseen.log_evidence - math.log(2))
        return replace(
            late,
            effects=names,
            log_evidence=float(np.logaddexp(late.log_evidence, unseen.log_evidence)) - math.log(2),
        )

    def _size(self, found: Found, effect: str) -> float:
        """Return the size of an effect of one coefficient as it was fitted, or as the search found
        it, about neutral."""
        place = next(i for i, t in enumerate(found.terms) if t.variant.effect == effect)
        if found.refitted is not None:
            return found.refitted.coefficients[place][0]
        before = sum(len(t.weights) for t in found.terms[:place] if not t.is_fixed)
        scored = self.scan.scored(found.terms, found.levels)
        return float(scored.means[int(np.argmax(scored.weights)), before])

    def _noisy(self, effects: frozenset[str]) -> Fit:
        """Fit a set with one level of noise set free; a level within twice the described is none.

        Beside several effects the noise gains no more than beside any one of them, and what an
        explanation that is not quite exact may leave to it is no news: some of what it gains; less
        where it acts elsewhere and its leftover could not be so loud. Beside a mistake of the
        set-up no level is told: a factor multiplies the errors of the wheels too.
        """
        noises = frozenset(effects & NOISES.keys())
        quiet = effects - noises
        names = tuple(sorted(effects))
        if len(noises) > 1 or quiet & GROSS:
            return Fit(names, _IMPOSSIBLE, _IMPOSSIBLE)
        turning = self._where_it_turns
        if turning is not None and quiet >= DEAD and quiet - DEAD <= turning.effects:
            dead, there = self._fit(DEAD), turning._fit(effects - DEAD)
            return replace(
                there,
                effects=names,
                log_evidence=dead.log_evidence + there.log_evidence,
                log_likelihood=dead.log_likelihood + there.log_likelihood,
            )
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
        stage, known = NOISES[name].stage, catalogue()
        if all(one in known and known[one].stage != stage for one in seen):
            left = 0.0 if all(self._is_beyond(one, 2 * left) for one in told) else left
        gains = [a.log_evidence - b.log_evidence - left for a, b in zip(told, rest, strict=True)]
        likelier = [a.log_likelihood - b.log_likelihood for a, b in zip(told, rest, strict=True)]
        least = int(np.argmin(gains))
        return Fit(
            names,
            together.log_evidence + gains[least],
            together.log_likelihood + likelier[least],
            told[least].parameters,
            counting=together.counting,
        )

    def _is_beyond(self, noisy: Fit, energy: float) -> bool:
        """Tell whether a level of noise is beyond twice the described one without what leftovers of
        so much whitened *energy* may add to it.

        A level that a log tells to a standard deviation of its logarithm s stands in 1/(2 s²) rows.
        """
        for name, noise in NOISES.items():
            for parameter, level in noise.parameters:
                told = noisy.parameters.get(f"{name}.{parameter}")
                if told is None or told.sd <= 0.0:
                    continue
                density = float(told.value)
                rows = 0.5 * (density / told.sd) ** 2
                own = density * math.sqrt(max(1.0 - energy / rows, 0.0))
                if own > 2 * self.model.level_prior.median[LEVELS.index(level)]:
                    return True
        return False

    def _is_worth(self, noise: float, effect: float) -> bool:
        """Tell whether a noise is to be fitted beside an effect, each of which gains so much alone
        [nat]: together they hardly gain more than both."""
        lacks = self.explained - (noise + effect)
        return min(noise, effect) > (_GAINS if lacks < _OUT_OF_REACH else _GAINS_FAR)

    def _noise_beside(self, name: str, effect: str | None) -> Fit:
        """Fit a noise beside one effect; beside one that gains little it gains what it does alone,
        and where that is little it matters not how much."""
        key = (name, effect)
        if key not in self._noise_fits:
            quiet = frozenset() if effect is None else frozenset({effect})
            beside = self._fit(quiet)
            alone = None if effect is None else self._noise_beside(name, None)
            if alone is None or self._is_worth(alone.log_evidence, beside.log_evidence):
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

    def detail(self, effects: frozenset[str], *, closely: bool = True) -> Fit:
        """Fit a set once more and draw from it; *closely*: windows and thresholds off the grid."""
        if not effects:
            return self._fit(effects)
        if LATENCY in effects and LATENCY not in self.scan.effects:
            rest = effects - {LATENCY}
            seen = self._fit(effects).log_evidence > self._fit(rest).log_evidence + 1
            if not seen or OFFSET in rest:
                return replace(self.detail(rest, closely=closely), effects=tuple(sorted(effects)))
            inner = self.detail(rest | {OFFSET}, closely=closely)
            parameters = dict(inner.parameters)
            early = parameters.pop(f"{OFFSET}.offset")
            parameters[f"{LATENCY}.delay"] = estimate("delay", -np.asarray(early.samples))
            return replace(inner, effects=tuple(sorted(effects)), parameters=parameters)
        if effects & NOISES.keys():
            quiet = self.detail(frozenset(effects - NOISES.keys()), closely=closely)
            noisy = self._fit(effects)
            return replace(
                noisy,
                parameters={**quiet.parameters, **noisy.parameters},
                windows=quiet.windows,
            )
        drawn = self._drawn_of(aliased(effects), closely)
        parameters = dict(drawn.parameters)
        for effect in effects & self._mending.choices.keys():
            parameters |= self._mending.told_of(effect)
        for alias in effects & ALIASES.keys():
            own = {name.split(".")[1]: name for name in parameters if _is_of(name, ALIASES[alias])}
            for name, known in own.items():
                parameters[f"{alias}.{name}"] = parameters.pop(known)
            samples = 1 / (1 + np.asarray(parameters[f"{alias}.scale"].samples)) - 1
            parameters[f"{alias}.scale"] = estimate("scale", samples)
        nodes = self.model.nodes
        if not nodes.motion.has_counters:
            parameters |= of_moment_or_mean(
                parameters, nodes.motion.tick_s, has_reference=nodes.has_reference
            )
        fit = self._fit(effects)
        return replace(
            fit,
            parameters=parameters,
            windows=tuple(drawn.windows),
            pareto_k=drawn.pareto_k,
        )

    def _drawn_of(self, effects: frozenset[str], closely: bool) -> _Drawn:
        """Draw from a set, once for all the names that it goes by."""
        key, found = (effects, closely, self.scan.dispersion), self.scan.account(effects)
        if key not in self._drawn or self._drawn[key].found is not found:
            self._drawn[key] = _Drawn(found, *_estimates(self.scan, effects, closely))
        return self._drawn[key]

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
    scan: Scan, effects: frozenset[str], closely: bool
) -> tuple[dict[str, Estimate], list[tuple[float, float]], float | None]:
    """Return parameters, windows and the shape of the heaviest tail of a set's weights, those of
    its evidence or its draws; beside a dead encoder those of the log in which its wheel turns
    again."""
    there = scan.turning_with(effects)
    if there is not None:
        dead, died, _ = _estimates(scan, DEAD, closely)
        rest, windows, pareto_k = _estimates(there, effects - DEAD, closely)
        return dead | rest, died + windows, pareto_k
    found = scan.account(effects)
    again = found.refitted or scan.model.refit(found.terms, found.levels)
    posterior = Posterior(scan.model, scan, closely=closely)
    parameters, windows, drawn_k = posterior.estimates(found, again)
    shapes = [one for one in (drawn_k, found.pareto_k) if one is not None]
    return parameters, windows, max(shapes, default=None)


def _is_of(parameter: str, effect: str) -> bool:
    return parameter.partition(".")[0] == effect
