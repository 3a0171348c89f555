"""All single effects and all pairs, compared on Gram matrices; the best are fitted again."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from gap_diagnosis.motion.beside import gains_beside
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.edges import best_edges, has_edges
from gap_diagnosis.motion.evidence import Gram, Scored, log_sum, score
from gap_diagnosis.motion.model import MotionModel, Refitted, is_far
from gap_diagnosis.motion.onset import LOG_WEIGHT, best_window, can_begin
from gap_diagnosis.motion.robust import excess
from gap_diagnosis.recording import Floats

Effects = frozenset[str]

_LEADERS: Final = 6
"""Single terms that are combined with every other term."""
_VARIANTS_KEPT: Final = 10
_LEVELS_TRIED: Final = 3
_REFITTED: Final = 8
_GREEDY: Final = 3
_EDGED: Final = 4
_WORTH_EDGES: Final = 5.0
_WINDOWED: Final = 8
_WORTH_WINDOW: Final = 20.0
_EXTENDED: Final = 4
_MORE_VARIANTS: Final = 3
_WORTH_MORE: Final = 10.0
"""One more effect is sought beside sets that gain this much on the best smaller one [nat]."""
_BENDING: Final = 0.1
"""A dead encoder for more than this share of the log leaves so little of the described motion that
beside it columns about it say little."""
_ALL_PARTS: Final = 3
"""Every part of sets so large is fitted again; of larger ones those without one effect."""
_NEAR: Final = 12.0
"""Sets this many nats below the best are not fitted again,"""
_LOOSE: Final = 0.25
"""single effects only if they lack this share of what the best gains as well."""
_CLEAR: Final = 20.0
"""An effect that gains this much [nat] after what stretches contradict is beyond doubt."""
_BELIEVED: Final = 8.0
"""Sizes beyond so many times the end of the prior are no effect's."""
_NEVER: Final = 1e6
_BENT: Final = 200.0
"""Beside a set that gains this much [nat] others are sought along columns about it,"""
_BESIDE: Final = 2
"""so many are fitted,"""
_UNSURE: Final = 3.0
"""if along those columns they lack at most so many nats."""


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
    """

    effects: Effects
    terms: tuple[Term, ...]
    log_evidence: float
    log_likelihood: float
    levels: Floats
    refitted: Refitted | None = None


class Scan:
    """The search through one log's motion.

    Attributes:
        model: the log.
        by_effect: the terms of each effect.
        spans: how far edges can move, by effect.
        found: the best account of every set of at most two effects that was scored, and of the
            larger sets that were worth it; no effect is the empty set.
    """

    def __init__(
        self, model: MotionModel, progress: Callable[[float], None] = lambda share: None
    ) -> None:
        """Search."""
        self.model = model
        self.by_effect: dict[str, list[Term]] = defaultdict(list)
        for term in model.columns.terms:
            self.by_effect[term.variant.effect].append(term)
        self._bending = frozenset({"encoder_dead"} if self._is_dead_for_long() else ())
        self.found: dict[Effects, Found] = {}
        self.spans: dict[str, dict[str, float]] = {}
        self._grams: list[Gram] = []
        self._kept: list[dict[str, list[Term]]] = []
        self._weighed: set[Effects] = set()
        self._surrounded: set[Effects] = set()
        self._search(progress)

    def _is_dead_for_long(self) -> bool:
        t_s = self.model.nodes.motion.t_s
        windows = (term.variant.fixed for term in self.by_effect.get("encoder_dead", ()))
        least_s = _BENDING * float(t_s[-1] - t_s[0])
        return any(one["stop_s"] - one["start_s"] > least_s for one in windows)

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
        gram = min(self._grams, key=lambda one: float(np.sum(np.log(one.levels / levels) ** 2)))
        return score(gram, terms, self.model.prior)

    def _search(self, progress: Callable[[float], None]) -> None:
        model = self.model
        self._add_levels(model.level_prior.median)
        greedy = self._greedy(self._grams[0])
        levels = model.levels_for(greedy, model.level_prior.median)
        better = model.better_start(greedy, levels)
        if better is not None:
            # What led at levels this wrong was noise.
            levels = model.levels_for(self._greedy(model.gram(better)), better)
        self._add_levels(levels)
        progress(0.2)
        self._add_levels(model.levels_for((), self._grams[-1].levels))
        progress(0.3)
        tried: set[Effects] = {frozenset()}
        self._off_the_grid()
        while len(tried) <= _LEVELS_TRIED:
            candidates = [f for f in self._ranked() if f.effects not in tried]
            if not candidates or candidates[0].log_evidence < self._ranked()[0].log_evidence - 5:
                break
            tried.add(candidates[0].effects)
            self._add_levels(model.levels_for(candidates[0].terms, candidates[0].levels, rounds=6))
            progress(0.3 + 0.05 * len(tried))
        self._seek_more()
        for done, one in enumerate(self._to_refit()):
            self._refit(one)
            progress(0.6 + 0.4 * (done + 1) / _REFITTED)
        self._sought_beside(max(self._fitted(), key=self._belief))
        for _ in range(_REFITTED):
            head = max(self.found.values(), key=self._belief)
            unfitted = [head] if head.refitted is None and head.effects else self._parts_of(head)
            if not unfitted and not self._doubted(head) and not self._sought_beside(head):
                break
            for one in unfitted:
                self._refit(one)
        self._hold_back_the_unfitted()

    def _sought_beside(self, head: Found) -> bool:
        """Fit, once, what gains beside the best set and beside each of its parts, along columns
        about them; tell whether another set is believed now.

        What a straight line about no effect errs by goes with how much there is to explain.
        """
        is_full = len(head.effects) + 1 >= len(self.model.prior.effects)
        if is_full or head.effects in self._surrounded:
            return False
        self._surrounded.add(head.effects)
        self._seek_beside(head)
        for effect in sorted(head.effects):
            less = self.found.get(head.effects - {effect})
            if less is not None and less.effects:
                self._seek_beside(less, instead_of=effect)
        return max(self.found.values(), key=self._belief).effects != head.effects

    def _seek_beside(self, one: Found, instead_of: str = "") -> None:
        """Fit the few effects that gain beside a set what is worth believing, or about as much as
        the one *instead_of* which they would come."""
        fit = one.refitted
        if fit is None or one.log_evidence < self.found[frozenset()].log_evidence + _BENT:
            return
        more = {
            effect: terms[:_MORE_VARIANTS]
            for effect, terms in self._kept[-1].items()
            if effect not in one.effects | GROSS
        }
        around = {
            effect: replace(new, log_evidence=new.log_evidence - math.log(self._choices(effect)))
            for effect, new in gains_beside(self.model, one.terms, fit, more).items()
        }
        if instead_of:
            rival = around.pop(instead_of, None)
            least = math.inf if rival is None else rival.log_evidence
        else:
            grown = replace(one, effects=one.effects | {"one more"})
            least = self._belief(one) - self._belief(grown)
        for new in sorted(around.values(), key=lambda each: -each.log_evidence)[:_BESIDE]:
            terms = (*one.terms, new.term)
            effects = one.effects | {new.term.variant.effect}
            known = self.found.get(effects)
            is_fitted = known is not None and known.refitted is not None
            if is_fitted or new.log_evidence < least - _UNSURE:
                continue
            again = self.model.refit(terms, one.levels, start=(*fit.coefficients, new.sizes))
            self._offer(self._nothing_at(again.levels))
            others = (
                one.log_evidence
                - fit.log_evidence
                - math.log(self._choices(new.term.variant.effect))
            )
            unlikely = self._beyond_belief(terms, [v for c in again.coefficients for v in c])
            evidence = again.log_evidence + others - unlikely
            likelihood = again.log_likelihood
            self._offer(Found(effects, terms, evidence, likelihood, again.levels, again))

    def _hold_back_the_unfitted(self) -> None:
        """Let no set win on straight lines alone: where those of one bent effect mislead, they do
        so beside every other effect, and no more fits are spent on them."""
        best = max(self._belief(one) for one in self._fitted())
        for effects, one in self.found.items():
            if one.refitted is None and self._belief(one) > best:
                less = self._belief(one) - (best - _NEAR)
                self.found[effects] = replace(
                    one,
                    log_evidence=one.log_evidence - less,
                    log_likelihood=one.log_likelihood - less,
                )

    def _fitted(self) -> list[Found]:
        return [one for one in self.found.values() if one.refitted or not one.effects]

    def _doubted(self, head: Found) -> bool:
        """Take from a set, once, what an effect gains in it that stretches of the log contradict;
        tell whether another set is believed now.

        What is clear all the same is not taken from: no explanation is exact, and rivals must be
        compared by what they explain.
        """
        if head.refitted is None or len(head.effects) < 2 or head.effects in self._weighed:
            return False
        self._weighed.add(head.effects)
        too_much = 0.0
        for effect, times in excess(self.model, head.terms, head.refitted).items():
            less = self._at_levels(self.account(head.effects - {effect}), head.levels)
            gained = max(head.log_likelihood - less.log_likelihood, 0.0)
            if gained / times < _CLEAR:
                too_much = max(too_much, gained * (1 - 1 / times))
        self.found[head.effects] = replace(
            head,
            log_evidence=head.log_evidence - too_much,
            log_likelihood=head.log_likelihood - too_much,
        )
        return max(self.found.values(), key=self._belief).effects != head.effects

    def _at_levels(self, one: Found, levels: Floats) -> Found:
        """Return a fitted set at levels that were found beside it, if they suit it better."""
        if one.refitted is None:
            return one
        again = self.model.evidence_about(one.terms, one.refitted.coefficients, levels)
        gained = again.log_evidence - one.refitted.log_evidence
        if gained > 0:
            self.found[one.effects] = replace(
                one,
                log_evidence=one.log_evidence + gained,
                log_likelihood=again.log_likelihood,
                levels=again.levels,
                refitted=again,
            )
        return self.found[one.effects]

    def _parts_of(self, head: Found) -> list[Found]:
        """Return what is left of the best set without one or more of its effects, unless fitted.

        A set that was fitted again must not beat its own parts for that reason alone.
        """
        nothing = self.found[frozenset()].log_evidence
        least = nothing + _LOOSE * (head.log_evidence - nothing)
        count = len(head.effects)
        least_size = 1 if count <= _ALL_PARTS else count - 1
        parts = [
            self.account(frozenset(some))
            for size in range(least_size, count)
            for some in combinations(sorted(head.effects), size)
        ]
        return [one for one in parts if one.refitted is None and one.log_evidence > least]

    def _seek_more(self) -> None:
        """Offer one more effect beside the best sets of two, of three and so on, as long as each
        pays, at their levels and at those that the larger set asks for."""
        for size in range(2, len(self.model.prior.effects) - 1):
            for _ in range(2):
                ranked = self._ranked()
                less = max(one.log_evidence for one in ranked if len(one.effects) < size)
                parents = [one for one in ranked if len(one.effects) == size][:_EXTENDED]
                parents = [one for one in parents if one.log_evidence > less + _WORTH_MORE]
                parents = [one for one in parents if not one.effects & self._bending]
                for parent in parents:
                    self._extend(parent)
                best = self._ranked()[0]
                if len(best.effects) <= size:
                    self._exchange(best)
                    return
                self._add_levels(self.model.levels_for(best.terms, best.levels, rounds=6))

    def _exchange(self, best: Found) -> None:
        """Put another effect in the place of each of a large set: one may have come too early."""
        for _ in range(len(best.effects) - 2):
            for effect in sorted(best.effects):
                self._extend(self.account(best.effects - {effect}))
            better = self._ranked()[0]
            if better.effects == best.effects:
                return
            best = better

    def _extend(self, parent: Found) -> None:
        places = range(len(self._grams))
        if len(parent.effects) > 2:
            # Of many levels only those that suit the set matter.
            places = range(max(len(self._grams) - 2, 0), len(self._grams))
        for place in places:
            for effect, terms in self._kept[place].items():
                if effect not in parent.effects | self._bending | GROSS:
                    choices = [(*parent.terms, term) for term in terms[:_MORE_VARIANTS]]
                    self._offer(self._compared(place, choices)[0])

    def _off_the_grid(self) -> None:
        """Give leading effects with edges a variant whose edges lie where they fit best."""
        singles = [one for one in self._ranked() if len(one.effects) == 1][:_EDGED]
        nothing = self.found[frozenset()].log_evidence
        added = False
        for one in singles:
            (term,) = one.terms
            if not has_edges(term) or one.log_evidence < nothing + _WORTH_EDGES:
                continue
            start = self.model.refit(one.terms, one.levels, free_levels=False, steps=2)
            edged = best_edges(self.model, one.terms, 0, start.coefficients, one.levels)
            better = self.model.add(edged.term.variant, term)
            self.by_effect[term.variant.effect].append(better)
            self.spans[term.variant.effect] = edged.spans
            added = True
        asked = self._part_of_the_log()
        if added or asked is not None:
            levels = [gram.levels for gram in self._grams]
            levels += [] if asked is None else [asked]
            self._grams.clear()
            self._kept.clear()
            self.found.clear()
            for one_levels in levels:
                self._add_levels(one_levels)

    def _part_of_the_log(self) -> Floats | None:
        """Give an effect a window where that makes it the best account of all; return its levels.

        It is sought at the described noise levels: where nothing explains a change, levels grow.
        """
        gram, kept = self._grams[0], self._kept[0]
        density = self.model.level_prior.log_density(np.log(gram.levels))
        best_so_far = self._ranked()[0].log_evidence
        if best_so_far < gram.log_nothing + density + _WORTH_EDGES:
            return None
        leading = [terms[0] for terms in kept.values() if can_begin(terms[0])][:_WINDOWED]
        best: tuple[float, Term] | None = None
        for term in leading:
            window = best_window(self.model, term, gram.levels)
            if window is not None and (best is None or window[1] > best[0]):
                best = window[1], window[0]
        if best is None or best[0] < gram.log_nothing + _WORTH_WINDOW:
            return None
        term = best[1]
        at_ends = self.model.refit((term,), gram.levels)
        if at_ends.log_evidence + LOG_WEIGHT < best_so_far - _WORTH_WINDOW:
            return None
        edged = best_edges(self.model, (term,), 0, at_ends.coefficients, at_ends.levels)
        between = self.model.refit(
            (edged.term,), at_ends.levels, start=at_ends.coefficients, steps=2
        )
        if between.log_evidence + LOG_WEIGHT < best_so_far - _WORTH_EDGES:
            return None
        added = replace(self.model.add(edged.term.variant, term), log_weight=LOG_WEIGHT)
        self.by_effect[term.variant.effect].append(added)
        self.spans[term.variant.effect] = edged.spans
        return between.levels

    def _greedy(self, gram: Gram) -> list[Term]:
        """Return a few terms that together take most of what is there."""
        chosen: list[Term] = []
        reached = 0.0
        for _ in range(_GREEDY):
            rest = [t for t in self.model.columns.terms if all(_differ(t, c) for c in chosen)]
            scored = [score(gram, [*chosen, term], self.model.prior) for term in rest]
            if not scored:
                break
            best = max(scored, key=lambda one: one.log_evidence)
            if best.log_evidence < reached + 3.0:
                break
            chosen, reached = list(best.terms), best.log_evidence
        return chosen

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
            if ranked.index(first) < _LEADERS:
                lead = kept[first][:1]
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

    @staticmethod
    def _sizes(scored: Scored) -> Sequence[float]:
        """Return the coefficients of the likeliest component."""
        return [float(one) for one in scored.means[int(np.argmax(scored.weights))]]

    def _beyond_belief(self, terms: Sequence[Term], sizes: Sequence[float]) -> float:
        """Return what speaks against sizes that no effect has: nothing, or more than any evidence.

        The estimated motion leans on the reference: wheels that do not move at all in a room that
        is twice as large would explain it anywhere.
        """
        of = self.model.prior.of
        ranges = []
        for term in terms:
            for name, small in zip(term.variant.coefficients, term.tolerances, strict=False):
                most = _BELIEVED * of(term.variant.effect, name).high
                ranges.append((-small if term.variant.is_positive else -most, most))
        believed = all(low <= size <= high for size, (low, high) in zip(sizes, ranges, strict=True))
        return 0.0 if believed else _NEVER

    def _choices(self, effect: str) -> int:
        """Return how many variants of an effect share its prior evenly."""
        return max(sum(term.log_weight == 0.0 for term in self.by_effect[effect]), 1)

    def _offer(self, found: Found) -> None:
        known = self.found.get(found.effects)
        if known is None or found.log_evidence > known.log_evidence:
            self.found[found.effects] = found

    def _belief(self, one: Found) -> float:
        """Return the log evidence with the prior of so many effects among those of the motion."""
        count = len(one.effects)
        prior = math.log(math.factorial(count) * self.model.prior.effects[count])
        return one.log_evidence + prior - count * math.log(max(len(self.by_effect), 1))

    def _ranked(self) -> list[Found]:
        return sorted(self.found.values(), key=lambda one: -one.log_evidence)

    def _to_refit(self) -> list[Found]:
        """Return the sets that may win, singles first, so that each kind of answer is exact."""
        ranked = [one for one in self._ranked() if one.effects]
        singles = [one for one in ranked if len(one.effects) == 1][: _REFITTED // 2]
        pairs = [one for one in ranked if len(one.effects) == 2][: _REFITTED // 2]
        for size in range(3, len(self.model.prior.effects)):
            pairs += [one for one in ranked if len(one.effects) == size][: _REFITTED // 4]
        best = self._ranked()[0].log_evidence
        least = best - _NEAR
        # A straight line errs the more, the more there is to explain: singles get a chance.
        loose = least - _LOOSE * (best - self.found[frozenset()].log_evidence)
        close = [one for one in singles[1:] if one.log_evidence > loose]
        return singles[:1] + close + [one for one in pairs if one.log_evidence > least]

    def _nothing_at(self, levels: Floats) -> Found:
        """Return the account of no effect at levels that were found beside one: it must not lose
        for want of a search as long as theirs."""
        evidence = self.model.evidence_at((), levels)
        evidence += self.model.level_prior.log_density(np.log(levels))
        return Found(frozenset(), (), evidence, evidence, levels)

    def _refit(self, one: Found) -> None:
        guess = frozenset(t.variant.effect for t in one.terms if t.variant.unsure is not None)
        if guess and guess != one.effects and self.account(guess).refitted is not None:
            self._refit_beside(self.account(guess), one)
            return
        again = self.model.refit(one.terms, one.levels)
        self._offer(self._nothing_at(again.levels))
        # The other variants' share of the evidence stays as the scan found it.
        gram = next(gram for gram in self._grams if gram.levels is one.levels)
        linear = score(gram, one.terms, self.model.prior).log_evidence
        density = self.model.level_prior.log_density(np.log(one.levels))
        others = one.log_evidence - (gram.log_nothing + density + linear)
        self.found[one.effects] = Found(
            one.effects,
            one.terms,
            again.log_evidence
            + others
            - self._beyond_belief(one.terms, [v for c in again.coefficients for v in c]),
            again.log_likelihood,
            again.levels,
            again,
        )

    def _refit_beside(self, guess: Found, one: Found) -> None:
        """Fit a set again in which one effect puts a guess in the place of counts: the others gain
        what they gain where the guess is not leant on."""
        levels = one.levels
        less = self.model.refit(guess.terms, levels, leans=False)
        more = self.model.refit(one.terms, levels, leans=False)
        others = math.fsum(
            t.log_weight - math.log(self._choices(t.variant.effect))
            for t in one.terms
            if t.variant.effect not in guess.effects
        )
        self.found[one.effects] = Found(
            one.effects,
            one.terms,
            guess.log_evidence
            + more.log_evidence
            - less.log_evidence
            + others
            - self._beyond_belief(one.terms, [v for c in more.coefficients for v in c]),
            guess.log_likelihood + max(more.log_likelihood - less.log_likelihood, 0.0),
            more.levels,
            more,
        )


def _differ(first: Term, second: Term) -> bool:
    return first.variant.effect != second.variant.effect
