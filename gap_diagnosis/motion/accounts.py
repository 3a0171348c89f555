"""Sets of effects and what each says of one log's motion, compared on Gram matrices."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from typing import Final

import numpy as np

from can_bus import SENSORS
from gap_diagnosis.hypothesis import NEVER
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.evidence import Gram, Scored, log_sum, score
from gap_diagnosis.motion.importance import Bends
from gap_diagnosis.motion.model import MotionModel, Refitted, along_lines, is_far
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.motion.onset import is_a_moment
from gap_diagnosis.priors import WHEELS
from gap_diagnosis.recording import Floats
from hil_harness.effects import catalogue

Effects = frozenset[str]

_LEADERS: Final = 6
"""Single terms that are combined with every other term."""
_VARIANTS_KEPT: Final = 10
_NARROWER: Final = 0.9
"""Wheels stand nearer to each other than described by no more than this share."""
_OF_A_TURN: Final = frozenset({"radius_scale", "wheelbase_scale", "gyro_scale"})
"""Of a turn by wheels and gyro alone only what these make of it together is measured."""
NEAR: Final = 12.0
"""Sets this many nats below the best are not fitted again."""
_FALLS: Final = 3
"""Once so many fits beside an effect, its own among them, fell short of what straight lines
promised, no set with it is expected to keep its promise."""
_SURELY: Final = 3.0
"""So many standard deviations within its tolerance a size is sure to be no news."""
_DELAYS: Final = frozenset({"frame_latency", "reference_time_offset"})


@dataclass(frozen=True)
class Found:
    """The best account that a set of effects gives of the motion.

    Attributes:
        effects: their names.
        terms: the best variant of each.
        log_evidence, log_likelihood: with the levels' density, variants averaged in the evidence;
            comparable between sets of one log.
        levels: at which noise levels.
        refitted: the non-linear fit, for the best sets only.
        fell: by how much the fit lies below what straight lines promised [nat].
        pareto_k: how heavy the tail is of the weights that correct the evidence; None where none
            were needed.
    """

    effects: Effects
    terms: tuple[Term, ...]
    log_evidence: float
    log_likelihood: float
    levels: Floats
    refitted: Refitted | None = None
    fell: float = 0.0
    pareto_k: float | None = None


def dispersed(log_evidence: float, log_likelihood: float, times: float) -> tuple[float, float]:
    """Return both with the likelihood so many times smaller; what a prior costs stays."""
    less = (1 - 1 / times) * log_likelihood
    return log_evidence - less, log_likelihood - less


class Accounts:
    """What sets of effects say of one log's motion.

    Attributes:
        model: the log.
        by_effect: the terms of each effect.
        spans: how far edges can move, by effect.
        found: the best account of every set of at most two effects that was scored, and of the
            larger sets that were worth it; no effect is the empty set.
        dispersion: how many times too large the log's likelihoods are.
    """

    dispersion = 1.0

    def __init__(self, model: MotionModel) -> None:
        """Begin without any."""
        self.model = model
        self.by_effect: dict[str, list[Term]] = defaultdict(list)
        for term in model.columns.terms:
            self.by_effect[term.variant.effect].append(term)
        self.found: dict[Effects, Found] = {}
        self.spans: dict[str, dict[str, float]] = {}
        self._grams: list[Gram] = []
        self._kept: list[dict[str, list[Term]]] = []
        self._led_astray: set[str] = set()

    @property
    def effects(self) -> Effects:
        """The effects that this log's motion can tell of."""
        return frozenset(self.by_effect)

    def account(self, effects: Effects) -> Found:
        """Return the best account of a set; of a set that was not worth it, an approximate one."""
        if effects not in self.found:
            terms = tuple(self.found[frozenset({effect})].terms[0] for effect in sorted(effects))
            place = max(range(len(self._grams)), key=lambda at: self._compared(at, [terms])[1])
            self._offer(self._compared(place, [terms])[0])
        return self.found[effects]

    def _compared(self, place: int, choices: Sequence[tuple[Term, ...]]) -> tuple[Found, float]:
        """Return the account of variants of one set at the levels of one Gram matrix."""
        gram = self._grams[place]
        offset = gram.log_nothing + self.model.level_prior.log_density(np.log(gram.levels))
        found = self._one(gram, choices, offset)[0]
        return found, found.log_evidence

    def evidence(self, terms: Sequence[Term], levels: Floats) -> float:
        """Return the log evidence of terms at levels that were tried, or the nearest of them."""
        return self.scored(terms, levels).log_evidence

    def scored(self, terms: Sequence[Term], levels: Floats) -> Scored:
        """Return the linear fit of terms at levels that were tried, or the nearest of them."""
        return score(self._gram_at(levels), terms, self.model.prior)

    def _gram_at(self, levels: Floats) -> Gram:
        """Return what was multiplied at levels that were tried, or the nearest of them."""
        return min(self._grams, key=lambda one: float(np.sum(np.log(one.levels / levels) ** 2)))

    def _hold_back_the_unfitted(self) -> None:
        """Let no set win on straight lines alone: where those of one bent effect mislead, they do
        so beside every other effect, and no more fits are spent on them."""
        best = max(self._belief(one) for one in self._fitted())
        singles = [one for one in self._fitted() if len(one.effects) == 1]
        misled = {next(iter(one.effects)): one.fell for one in singles}
        for effects, one in self.found.items():
            if one.refitted is not None or not effects:
                continue
            less = max(misled.get(effect, 0.0) for effect in effects)
            if self._belief(one) - less / self.dispersion > best:
                less = (self._belief(one) - (best - NEAR)) * self.dispersion
            if less > 0.0:
                self.found[effects] = replace(
                    one,
                    log_evidence=one.log_evidence - less,
                    log_likelihood=one.log_likelihood - less,
                )

    def _take_in_bends(self) -> None:
        """Let the fitted sets that may win be worth what they explain as their effects act: all
        alike, so that none wins by a straight line that leads astray, nor by the bends of what is
        tolerated."""
        done: set[Effects] = {frozenset()}
        while True:
            least = max(self._belief(one) for one in self._fitted()) - NEAR
            near = [one for one in self._fitted() if self._belief(one) > least]
            left = [one for one in near if one.effects not in done]
            if not left:
                break
            for one in left:
                done.add(one.effects)
                self.found[one.effects] = self._as_it_bends(one)
        self._take_what_is_tolerated()

    def _take_what_is_tolerated(self) -> None:
        """Let no fitted set be worth more than its part without an effect that lies within its
        tolerance: so much of it is no gap.

        The part may lack what goes with the effect's tolerance, not its size: a gyro that was late
        by 0.4 ms +- 0.4, of which 2 are tolerated, gained 11 nats beside a slip.
        """
        for one in sorted(self._fitted(), key=lambda each: len(each.effects)):
            for effect in within_tolerance(one):
                less = self.found.get(one.effects - {effect})
                if less is not None and (less.refitted or not less.effects):
                    own = self.found[one.effects].log_evidence
                    self._lower(one.effects, max(own - less.log_evidence, 0.0))

    def _lower(self, effects: Effects, by: float) -> None:
        """Let a set be worth so much less [nat]."""
        one = self.found[effects]
        self.found[effects] = replace(
            one, log_evidence=one.log_evidence - by, log_likelihood=one.log_likelihood - by
        )

    def _as_it_bends(self, one: Found) -> Found:
        """Return a fitted set by what it explains as its effects act."""
        fit = one.refitted
        if fit is None or all(term.is_fixed for term in one.terms):
            return one
        exact = Bends(self.model, one.terms, fit, self.dispersion).corrected()
        gained = exact.log_evidence - fit.log_evidence
        return replace(
            one,
            log_evidence=one.log_evidence + gained,
            log_likelihood=one.log_likelihood + exact.log_likelihood - fit.log_likelihood,
            fell=max(one.fell - gained, 0.0),
            pareto_k=exact.pareto_k,
        )

    def _fitted(self) -> list[Found]:
        return [one for one in self.found.values() if one.refitted or not one.effects]

    def _at_levels(self, one: Found, levels: Floats) -> Found:
        """Return a fitted set at levels that were found beside it, if they suit it better."""
        if one.refitted is None:
            return one
        known = one.refitted
        there = self.model.evidence_about(one.terms, known.coefficients, levels)
        gained = there.log_evidence - known.log_evidence
        if gained > 0:
            again = self.model.refit(
                one.terms, levels, free_levels=False, steps=1, start=known.coefficients
            )
            explained = again.log_likelihood - known.log_likelihood
            self.found[one.effects] = replace(
                one,
                log_evidence=one.log_evidence + gained,
                log_likelihood=one.log_likelihood + explained,
                levels=again.levels,
                refitted=again,
            )
        return self.found[one.effects]

    def _add_levels(self, levels: Floats) -> None:
        """Compare all sets at these levels too."""
        if any(not is_far(levels, gram.levels) for gram in self._grams):
            return
        gram = self.model.gram(levels)
        self._grams.append(gram)
        density = self.model.level_prior.log_density(np.log(levels))
        offset = gram.log_nothing + density
        self._offer(Found(frozenset(), (), offset, offset, levels))
        singles = {
            effect: self._one(gram, [(term,) for term in terms], offset)
            for effect, terms in self.by_effect.items()
        }
        kept: dict[str, list[Term]] = {}
        for effect, (found, order) in singles.items():
            self._offer(found)
            kept[effect] = order[:_VARIANTS_KEPT]
        ranked = sorted(singles, key=lambda effect: -singles[effect][0].log_evidence)
        self._kept.append({effect: kept[effect] for effect in ranked})
        for first, second in combinations((one for one in ranked if one not in GROSS), 2):
            if {first, second} == _DELAYS or ranked.index(first) < _LEADERS:
                lead = kept[first] if {first, second} == _DELAYS else kept[first][:1]
                pairs = [(one, two) for one in lead for two in kept[second]]
            else:
                pairs = [(kept[first][0], kept[second][0])]
            self._offer(self._one(gram, pairs, offset)[0])

    def _one(
        self, gram: Gram, choices: Sequence[tuple[Term, ...]], offset: float
    ) -> tuple[Found, list[Term]]:
        """Return the account of a set of effects whose variants are *choices*."""
        scored = [score(gram, terms, self.model.prior) for terms in choices]
        weighed = [
            one.log_evidence
            + sum(t.log_weight + t.variant.log_share for t in one.terms)
            + self._as_one_wheel(gram, one)
            - self._beyond_belief(one.terms, self._sizes(one))
            for one in scored
        ]
        order = sorted(range(len(scored)), key=lambda i: -weighed[i])
        best = scored[order[0]]
        count = math.prod(self._choices(t.variant.effect) for t in best.terms)
        evidence = log_sum(np.array(weighed)) - math.log(count)
        effects = frozenset(term.variant.effect for term in best.terms)
        found = Found(
            effects,
            best.terms,
            offset + evidence,
            offset + max(one.log_likelihood for one in scored),
            gram.levels,
        )
        return found, [scored[i].terms[-1] for i in order]

    def _as_one_wheel(self, gram: Gram, scored: Scored) -> float:
        """Return what it adds to both sizes of wheels [nat] that most often they are one wheel's:
        the mean is off by half of by how much they differ.

        Along that line there is one size to find, and what lies within the mean's tolerance is a
        mismatch alone.
        """
        effects = {term.variant.effect for term in scored.terms}
        if not effects >= WHEELS:
            return 0.0
        (mean,) = (t for t in scored.terms if t.variant.effect == "radius_scale")
        (apart,) = (t for t in scored.terms if t.variant.effect == "radius_mismatch")
        share = self.model.prior.share_of_one_wheel(effects, max(len(self.by_effect), 1))
        if mean.variant.fixed != apart.variant.fixed:
            return math.log1p(-share)  # in windows of their own they are no one wheel's
        others = [term for term in scored.terms if term is not mean and term is not apart]
        tolerance = max(apart.tolerances[0], 2.0 * mean.tolerances[0])
        lines = []
        for half in (-0.5, 0.5):
            of_mean = tuple((column, half * weight) for column, weight in mean.weights[0])
            weights = ((*apart.weights[0], *of_mean),)
            lines.append(replace(apart, weights=weights, tolerances=(tolerance,)))
        prior = self.model.prior
        on_a_line = [score(gram, [*others, line], prior).log_evidence for line in lines]
        gained = log_sum(np.array(on_a_line)) - math.log(len(lines)) - scored.log_evidence
        return float(np.logaddexp(math.log1p(-share), math.log(share) + gained))

    def _beyond_a_line(self) -> list[Found]:
        """Return the account at the described levels of wheels that by a straight line would stand
        closer than on one another: turns go with the inverse of how far apart they stand, and about
        a robot that turns twice as far the line asks for less than nothing."""
        (gram, *_) = self._grams
        offset = gram.log_nothing + self.model.level_prior.log_density(np.log(gram.levels))
        wheels = [terms[:1] for terms in self.by_effect.values() if terms[0].variant.widens]
        return [
            self._one(gram, [tuple(whole)], offset)[0]
            for whole in wheels
            if self._beyond_belief(whole, self._sizes(score(gram, whole, self.model.prior)))
        ]

    @staticmethod
    def _sizes(scored: Scored) -> Sequence[float]:
        """Return the coefficients of the likeliest component."""
        return [float(one) for one in scored.means[int(np.argmax(scored.weights))]]

    def _beyond_belief(self, terms: Sequence[Term], sizes: Sequence[float]) -> float:
        """Return what speaks against sizes and windows that no effect has: nothing, or more than
        any evidence.

        The estimated motion leans on the reference: wheels that do not move at all in a room that
        is twice as large would explain it anywhere.
        """
        of = self.model.prior.of
        if says_twice(terms) or any(is_a_moment(t, self.model.nodes.motion) for t in terms):
            return NEVER
        effects = frozenset(term.variant.effect for term in terms)
        if len(of_one_quotient(effects, self.model.nodes)) > 1:
            return NEVER
        ranges = []
        for term in terms:
            for name, small in zip(term.variant.coefficients, term.tolerances, strict=False):
                most = min(
                    of(term.variant.effect, name).most,
                    _largest(term.variant.effect, name),
                    term.variant.most,
                )
                least = -small if term.variant.is_positive else -most
                # A wheelbase of less than nothing is two wheels that are swapped.
                ranges.append((max(least, -_NARROWER) if term.variant.widens else least, most))
        believed = all(low <= size <= high for size, (low, high) in zip(sizes, ranges, strict=True))
        return 0.0 if believed else NEVER

    def _choices(self, effect: str) -> int:
        """Return how many variants of an effect share its prior evenly."""
        return max(sum(term.is_on_the_grid for term in self.by_effect[effect]), 1)

    def _cost(self, term: Term) -> float:
        """Return what it costs [nat] that an effect is this variant of it."""
        own = term.log_weight + term.variant.log_share
        return math.log(self._choices(term.variant.effect)) - own

    def _offer(self, found: Found) -> None:
        known = self.found.get(found.effects)
        if known is None or found.log_evidence > known.log_evidence:
            self.found[found.effects] = found

    def gained(self, one: Found) -> tuple[float, float]:
        """Return what log evidence and log likelihood are worth beyond those of no effect, where
        the log's surprises scatter by more than they should."""
        nothing = self.found[frozenset()]
        return dispersed(
            one.log_evidence - nothing.log_evidence,
            one.log_likelihood - nothing.log_likelihood,
            self.dispersion,
        )

    @property
    def worth(self) -> tuple[float, float]:
        """By how much the likeliest account is likelier than no effect [nat], priors and all, and
        its log likelihood beyond that of none, both before the dispersion."""
        best, nothing = self.likeliest, self.found[frozenset()]
        likelihood = best.log_likelihood - nothing.log_likelihood
        told = self._belief(best) - self._belief(nothing)
        return told + (1 - 1 / self.dispersion) * likelihood, likelihood

    @property
    def likeliest(self) -> Found:
        """The likeliest account, priors and all."""
        return max(self.found.values(), key=self._belief)

    def _belief(self, one: Found) -> float:
        """Return the log evidence with the prior of so many effects among those of the motion."""
        even = dict.fromkeys(one.effects, -math.log(max(len(self.by_effect), 1)))
        return self.gained(one)[0] + self.model.prior.log_probability_of(one.effects, even)

    @property
    def _likeliest_expected(self) -> Found:
        """The set that is likeliest to be the likeliest once it is fitted."""
        falls = self._falls()
        return max(self.found.values(), key=lambda one: self._expected(one, falls))

    def _expected(self, one: Found, falls: Mapping[str, float]) -> float:
        """Return the belief in a set; if it is not fitted, less what every fitted set with one of
        its effects fell by.

        Beside wheels that stand far apart seventeen sets fell by 1,200 nats, one after another.
        """
        less = (
            0.0 if one.refitted else max((falls.get(each, 0.0) for each in one.effects), default=0)
        )
        return self._belief(one) - less / self.dispersion

    def _falls(self) -> dict[str, float]:
        """Return by how much sets with an effect lie at least below what straight lines promise
        [nat], for effects that were fitted by themselves and beside others, and never were near."""
        fell: dict[str, list[float]] = defaultdict(list)
        alone: set[str] = set()
        for one in self._fitted():
            alone |= one.effects if len(one.effects) == 1 else frozenset()
            for effect in one.effects:
                fell[effect].append(one.fell)
        least = {effect: min(fell[effect]) for effect in alone if len(fell[effect]) >= _FALLS}
        return {effect: by for effect, by in least.items() if by > NEAR}

    def _ranked(self) -> list[Found]:
        return sorted(self.found.values(), key=lambda one: -one.log_evidence)

    def _nothing_at(self, levels: Floats) -> Found:
        """Return the account of no effect at levels that were found beside one: it must not lose
        for want of a search as long as theirs."""
        evidence = self.model.evidence_at((), levels)
        evidence += self.model.level_prior.log_density(np.log(levels))
        return Found(frozenset(), (), evidence, evidence, levels)

    def _refit(self, one: Found, *, by_itself: bool = False) -> None:
        """Fit a set as it acts, at its own levels or at those of the best that was fitted before;
        *by_itself*, at its own: at what noise is left beside others it may end anywhere."""
        fitted = [each for each in self.found.values() if each.refitted is not None]
        best = max(fitted, key=lambda each: each.log_evidence, default=one)
        known = () if by_itself else (best.levels,)
        gram = next(gram for gram in self._grams if gram.levels is one.levels)
        linear = score(gram, one.terms, self.model.prior)
        start = along_lines(linear)
        again = self.model.refit(one.terms, one.levels, known=known, start=start)
        self._offer(self._nothing_at(again.levels))
        # The other variants' share of the evidence stays as the scan found it.
        density = self.model.level_prior.log_density(np.log(one.levels))
        others = one.log_evidence - (gram.log_nothing + density + linear.log_evidence)
        if is_never(others):
            others += NEVER  # what the line asks for is beyond belief, and not what was fitted
        evidence = again.log_evidence + others
        self.found[one.effects] = Found(
            one.effects,
            one.terms,
            evidence - self._beyond_belief(one.terms, [v for c in again.coefficients for v in c]),
            again.log_likelihood,
            again.levels,
            again,
            max(one.log_evidence - evidence, 0.0),
        )


def says_twice(terms: Sequence[Term]) -> bool:
    """Tell whether terms say one delay twice: where all sensors are late, the reference is early.

    Both may then be late by any time, and the later, the fewer rows are left to compare.
    """
    is_late = any(term.variant.report.get("frame") == SENSORS for term in terms)
    return is_late and {term.variant.effect for term in terms} >= _DELAYS


def within_tolerance(one: Found) -> Effects:
    """Return the effects of a fitted set whose sizes are sure to be no news."""
    if one.refitted is None:
        return frozenset()
    scored = one.refitted.scored
    shares = scored.weights / scored.weights.sum()
    middle = shares @ scored.means
    spread = np.einsum("s,sii->i", shares, scored.covariances)
    reach = np.abs(middle) + _SURELY * np.sqrt(spread + shares @ (scored.means - middle) ** 2)
    small: set[str] = set()
    column = 0
    for term in one.terms:
        if not term.is_fixed:
            told = reach[column : column + len(term.weights)]
            if (told < np.asarray(term.tolerances)).all():
                small.add(term.variant.effect)
            column += len(term.weights)
    return frozenset(small)


def is_never(log_evidence: float) -> bool:
    """Tell whether sizes are beyond belief that a set of this log evidence has."""
    return log_evidence < -0.5 * NEVER


def of_one_quotient(effects: Effects, nodes: Nodes) -> Effects:
    """Return those of these effects of which a log measures a quotient alone.

    What details of a turn would say of each is how their noise is described.
    """
    return frozenset() if nodes.has_reference else effects & _OF_A_TURN


@cache
def _largest(effect: str, parameter: str) -> float:
    """Return the largest size that makes sense: a wheel that slips by more than all of its way
    would drive backwards."""
    known = catalogue()
    parameters = known[effect].parameters if effect in known else ()
    return min((one.maximum for one in parameters if one.name == parameter), default=math.inf)
