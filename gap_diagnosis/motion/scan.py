"""All single effects and all pairs, compared on Gram matrices; the best are fitted again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np

from gap_diagnosis.motion.accounts import NEAR, Effects, Found
from gap_diagnosis.motion.alike import alike, single_column
from gap_diagnosis.motion.beside import gains_beside
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.dispersion import dispersion
from gap_diagnosis.motion.evidence import Gram, score
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.off_the_grid import OffTheGrid
from gap_diagnosis.motion.revived import beside, revived
from gap_diagnosis.motion.robust import excess
from gap_diagnosis.motion.slips import (
    LOOSE,
    SLIP,
    in_its_window,
    is_a_slip,
    is_loose,
    loose,
)
from gap_diagnosis.motion.thresholds import has_threshold, thresholds_of
from gap_diagnosis.motion.windows import at_window, has_window, windows_of
from gap_diagnosis.recording import Floats
from gap_diagnosis.visibility import Sight, sight_of

_LEVELS_TRIED: Final = 3
_REFITTED: Final = 8
_GREEDY: Final = 3
_EXTENDED: Final = 4
_MORE_VARIANTS: Final = 3
_WORTH_MORE: Final = 10.0
"""One more effect is sought beside sets that gain this much on the best smaller one [nat]."""
DEAD: Final = frozenset({"encoder_dead"})
"""About a wheel that stands no column says anything of what else is wrong."""
_ALL_PARTS: Final = 3
"""Every part of sets so large is fitted again; of larger ones those without one effect."""
_LOOSE: Final = 0.25
"""Single effects so near are fitted, and those that lack at most this share of the best's gain."""
_STRETCHED: Final = 4.0
"""Standard deviations of a constant within its tolerance, or two tolerances."""
_CLEAR: Final = 20.0
"""An effect that gains this much [nat] after what stretches contradict is beyond doubt."""
_CONTRADICTED: Final = 2
"""Once stretches contradict so many of the best sets, they are asked of the next one before its
parts, windows and neighbours are fitted: on a wheel on ice they contradict every set."""
_BENT: Final = 200.0
"""Beside a set that gains this much [nat] others are sought along columns about it,"""
_BESIDE: Final = 2
"""so many are fitted,"""
_ALWAYS: Final = 3
"""So many of the best single effects are fitted, whatever straight lines say of them."""
_FITTED_ALIKE: Final = 2
"""So many effects that look like one of the best set are fitted in its place."""
_UNSURE: Final = 3.0
"""if along those columns they lack at most so many nats."""


class Scan(OffTheGrid):
    """The search through one log's motion.

    Attributes:
        foreseen: what the log can show at the described levels of noise, before any fit.
        where_it_turns: the search through the log in which the wheel of a dead encoder turns again;
            None where that is not at work.
    """

    foreseen: Sight
    where_it_turns: Scan | None = None

    def __init__(
        self, model: MotionModel, progress: Callable[[float], None] = lambda share: None
    ) -> None:
        """Search."""
        super().__init__(model)
        self._weighed: set[Effects] = set()
        self._contradicted = 0
        self._parts_beside: dict[Effects, Refitted] = {}
        self._surrounded: set[Effects] = set()
        self._compared_alike: set[Effects] = set()
        self._windowed: set[Effects] = set()
        self._steady: dict[Effects, Found] = {}
        self._search(progress)

    def _search(self, progress: Callable[[float], None]) -> None:
        model = self.model
        self._add_levels(model.level_prior.median)
        self.foreseen = sight_of(model.columns, self._grams[0], model.prior)
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
        self._add_off_the_grid(greedy)
        while len(tried) <= _LEVELS_TRIED:
            candidates = [f for f in self._ranked() if f.effects not in tried]
            if not candidates or candidates[0].log_evidence < self._ranked()[0].log_evidence - 5:
                break
            tried.add(candidates[0].effects)
            self._add_levels(model.levels_for(candidates[0].terms, candidates[0].levels))
            progress(0.3 + 0.05 * len(tried))
        self._seek_more()
        refitted = self._to_refit()
        for done, one in enumerate(refitted):
            self._refit(one)
            progress(0.6 + 0.4 * (done + 1) / len(refitted))
        self._moved_windows(max(self._fitted(), key=self._belief))
        self._loosened()
        self._sought_beside(max(self._fitted(), key=self._belief))
        self._settle()
        self.dispersion = self._dispersion()
        if self.dispersion > 1:
            self._settle()
        self._take_in_bends()
        self._hold_back_the_unfitted()
        if self.likeliest.effects & DEAD:
            self._seek_beside_the_dead()

    def _seek_beside_the_dead(self) -> None:
        """Seek what else is wrong beside a dead encoder in the log in which its wheel turns again,
        and let every set be worth beside it what it is worth there."""
        if self.account(DEAD).refitted is None:
            self._refit(self.account(DEAD))
        there = Scan(revived(self.model, self.account(DEAD).terms[0]))
        self.found = {one: found for one, found in self.found.items() if not one > DEAD}
        self.where_it_turns, self.dispersion = there, there.dispersion
        for effects in list(there.found):
            if effects <= self.effects:
                self.account(effects | DEAD)

    def account(self, effects: Effects) -> Found:
        """Return the best account of a set; of a set that was not worth it, an approximate one."""
        there = self.where_it_turns
        if there is None or effects in self.found or not DEAD < effects <= there.effects | DEAD:
            return super().account(effects)
        nothing, one = there.found[frozenset()], there.account(effects - DEAD)
        self.found[effects] = beside(self.found[DEAD], nothing, one, self.by_effect)
        return self.found[effects]

    def _settle(self) -> None:
        """Fit the best set, its parts and what comes beside it, until another one is no better."""
        for _ in range(_REFITTED):
            head = max(self.found.values(), key=self._belief)
            if self._contradicted >= _CONTRADICTED and self._doubted(head):
                continue
            unfitted = [head] if head.refitted is None and head.effects else self._parts_of(head)
            if not unfitted and self._moved_windows(head):
                continue
            is_settled = not unfitted and not self._doubted(head) and not self._sought_beside(head)
            if is_settled and not self._sought_alike(head):
                break
            for one in unfitted:
                self._refit(one)

    def _moved_windows(self, head: Found) -> bool:
        """Seek the windows and thresholds of a fitted set again, once, about its fit and at its
        noise levels; tell whether one was better elsewhere.

        One tick beside where an effect begins its whole rate is missing, or too much: noise that
        another effect can take up.
        """
        if head.refitted is None or head.effects in self._windowed:
            return False
        self._windowed.add(head.effects)
        terms, fit = list(head.terms), head.refitted
        others = head.log_evidence - fit.log_evidence
        for place, term in enumerate(head.terms):
            if has_window(term):
                windows = windows_of(self.model, terms, place, fit.coefficients, fit.levels)
                self.spans[term.variant.effect] = windows.spans_s
                best, log_width = at_window(term, *windows.best_s), windows.log_width
            elif has_threshold(term):
                known = thresholds_of(self.model, terms, place, fit.coefficients, fit.levels)
                best, log_width = known.best[place], known.log_width
            else:
                continue
            terms[place] = self._in_sum(best, log_width)
            others += terms[place].log_weight - term.log_weight
            if len(terms) == 1:
                # Other windows that are as likely are in the sum over all: not once more.
                others = -self._cost(terms[place])
        if all(one is other for one, other in zip(terms, head.terms, strict=True)):
            return False
        weighed = tuple(
            term
            if term is moved
            else replace(term, log_weight=moved.log_weight, is_on_the_grid=False)
            for term, moved in zip(head.terms, terms, strict=True)
        )
        head = replace(head, terms=weighed, log_evidence=fit.log_evidence + others)
        self.found[head.effects] = head
        self._fit(tuple(terms), head.levels, fit.coefficients, others)
        better = self.found[head.effects]
        if better is head or better.refitted is None:
            return max(self.found.values(), key=self._belief) is not head
        self._fit_parts(better, better.refitted)
        self._surrounded.discard(head.effects)
        return True

    def _loosened(self) -> None:
        """Let a slip be now more and now less, by itself and in the best set."""
        nothing = self.found[frozenset()].log_evidence
        head = max(self._fitted(), key=self._belief)
        sets, best = {frozenset({SLIP}), head.effects}, head.log_evidence
        for effects in sorted(sets, key=sorted):
            if SLIP not in effects or effects not in self.found:
                continue
            one = self.found[effects]
            if one.log_evidence < nothing + _CLEAR:
                continue
            fit = one.refitted or self.model.refit(one.terms, one.levels)
            others = one.log_evidence - fit.log_evidence - math.log(1 + len(LOOSE))
            (place,) = (at for at, t in enumerate(one.terms) if t.variant.effect == SLIP)
            for term in loose(one.terms[place]):
                terms = (*one.terms[:place], term, *one.terms[place + 1 :])
                again = self.model.refit(terms, fit.levels, start=fit.coefficients)
                if is_a_slip(again, place) and again.log_evidence + others > one.log_evidence:
                    if 2.0 * (again.log_evidence + others - nothing) > best - nothing:
                        # Elsewhere a window hardly lets a slip explain twice as much.
                        terms = in_its_window(self.model, terms, place, again)
                        again = self.model.refit(terms, again.levels, start=again.coefficients)
                    self._steady.setdefault(effects, one)
                    self._take(terms, again, others)

    @property
    def best_steady(self) -> Found:
        """The best account of all in which no slip is now more and now less: beside that one, what
        it would explain of rough contact and pushes is left."""
        accounts = [self._steady.get(effects, one) for effects, one in self.found.items()]
        return max(
            (one for one in accounts if not any(map(is_loose, one.terms))),
            key=lambda one: one.log_evidence,
        )

    def _dispersion(self) -> float:
        """Return by how much the log scatters about its best account.

        Where something is wrong by a sign or a factor, everything scatters.
        """
        if GROSS & self.by_effect.keys():
            return 1.0
        head = max(self._fitted(), key=self._belief)
        coefficients = () if head.refitted is None else head.refitted.coefficients
        return dispersion(self.model, head.terms, coefficients, head.levels)

    def _sought_beside(self, head: Found) -> bool:
        """Fit, once, each part of the best set from where it ended, and what gains beside the set
        and beside its parts along columns about them; tell whether another set is believed now.

        What a straight line about no effect errs by goes with how much there is to explain.
        """
        fit = head.refitted
        is_clear = head.log_evidence > self.found[frozenset()].log_evidence + _BENT
        if fit is None or not is_clear or head.effects & DEAD or head.effects in self._surrounded:
            return False
        self._surrounded.add(head.effects)
        self._fit_parts(head, fit)
        if len(head.effects) + 1 < len(self.model.prior.effects):
            self._seek_beside(head, fit)
            for effect in sorted(head.effects):
                less = self.found.get(head.effects - {effect})
                if less is not None and less.effects and less.refitted is not None:
                    self._seek_beside(less, less.refitted, instead_of=effect)
        return max(self.found.values(), key=self._belief).effects != head.effects

    def _sought_alike(self, head: Found) -> bool:
        """Fit, once, what looks like an effect of the best set in its place, from where its fit
        ended; tell whether another set is believed now.

        A late gyro and a slow one are told alike by columns of little of each, and along chords to
        their usual sizes one may seem to lack by far more than there is to tell them apart.
        """
        fit = head.refitted
        if fit is None or head.effects & DEAD or head.effects in self._compared_alike:
            return False
        self._compared_alike.add(head.effects)
        inner = self._gram_at(head.levels).full_inner
        not_asked = head.effects | GROSS | DEAD
        asked = [t for t in self.model.columns.terms if t.variant.effect not in not_asked]
        for place, term in enumerate(head.terms):
            own = single_column(term)
            if own is None:
                continue
            for other, column in alike(own, asked, inner)[:_FITTED_ALIKE]:
                swapped = head.effects - {term.variant.effect} | {other.variant.effect}
                known = self.found.get(swapped)
                if known is not None and known.refitted is not None:
                    continue
                size = fit.coefficients[place][0] * inner[own, column] / inner[column, column]
                start = [*fit.coefficients]
                start[place] = (max(size, 0.0) if other.variant.is_positive else size,)
                terms = (*head.terms[:place], other, *head.terms[place + 1 :])
                others = head.log_evidence - fit.log_evidence
                others += self._cost(term) - self._cost(other)
                self._fit(terms, head.levels, start, others)
        return max(self.found.values(), key=self._belief).effects != head.effects

    def _fit_parts(self, head: Found, fit: Refitted) -> None:
        """Fit a set without each of its effects, once from where a fit of the set ended."""
        if self._parts_beside.get(head.effects) is fit:
            return
        self._parts_beside[head.effects] = fit
        for effect in sorted(head.effects) if len(head.effects) > 1 else ():
            self._fit_without(effect, head, fit)

    def _fit_without(self, effect: str, head: Found, fit: Refitted) -> None:
        """Fit a set without one of its effects from where a fit of the set ended."""
        (left_out,) = (term for term in head.terms if term.variant.effect == effect)
        kept = [place for place, term in enumerate(head.terms) if term is not left_out]
        terms = tuple(head.terms[place] for place in kept)
        start = tuple(fit.coefficients[place] for place in kept)
        others = head.log_evidence - fit.log_evidence + self._cost(left_out)
        self._fit(terms, head.levels, start, others)

    def _seek_beside(self, one: Found, fit: Refitted, instead_of: str = "") -> None:
        """Fit the few effects that gain beside a set what is worth believing, or about as much as
        the one *instead_of* which they would come."""
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
            effect = new.term.variant.effect
            known = self.found.get(one.effects | {effect})
            is_fitted = known is not None and known.refitted is not None
            if is_fitted or new.log_evidence < least - _UNSURE:
                continue
            others = one.log_evidence - fit.log_evidence - self._cost(new.term)
            start = (*fit.coefficients, new.sizes)
            self._fit((*one.terms, new.term), one.levels, start, others)

    def _fit(
        self,
        terms: tuple[Term, ...],
        levels: Floats,
        start: Sequence[tuple[float, ...]],
        others: float,
    ) -> None:
        """Fit a set from where another one ended; *others* is the share of the other variants."""
        self._take(terms, self.model.refit(terms, levels, start=start), others)

    def _take(self, terms: tuple[Term, ...], again: Refitted, others: float) -> None:
        """Take a fit of a set if it is better than what is known of that."""
        self._offer(self._nothing_at(again.levels))
        effects = frozenset(term.variant.effect for term in terms)
        unlikely = self._beyond_belief(terms, [v for c in again.coefficients for v in c])
        evidence, likelihood = again.log_evidence + others - unlikely, again.log_likelihood
        known = self.found.get(effects)
        if known is None or known.refitted is None or evidence > known.log_evidence:
            self.found[effects] = Found(effects, terms, evidence, likelihood, again.levels, again)
            # What stretches contradicted was of the fit before.
            self._weighed.discard(effects)

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
            if times == 1.0:
                continue
            if self.account(head.effects - {effect}).refitted is None:
                # Along straight lines a set without it may seem to lack far more than it does.
                self._fit_without(effect, head, head.refitted)
            less = self._at_levels(self.account(head.effects - {effect}), head.levels)
            gained = max(head.log_likelihood - less.log_likelihood, 0.0)
            if gained / times < _CLEAR:
                too_much = max(too_much, gained * (1 - 1 / times))
        self.found[head.effects] = replace(
            head,
            log_evidence=head.log_evidence - too_much,
            log_likelihood=head.log_likelihood - too_much,
        )
        is_beaten = max(self.found.values(), key=self._belief).effects != head.effects
        self._contradicted += is_beaten
        return is_beaten

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
                parents = [one for one in parents if not one.effects & DEAD]
                for parent in parents:
                    self._extend(parent)
                best = self._ranked()[0]
                if len(best.effects) <= size:
                    self._exchange(best)
                    return
                self._add_levels(self.model.levels_for(best.terms, best.levels))

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
                if effect not in parent.effects | DEAD | GROSS:
                    choices = [(*parent.terms, term) for term in terms[:_MORE_VARIANTS]]
                    self._offer(self._compared(place, choices)[0])

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

    def _stretched(self) -> list[str]:
        """Return the effects of which no gap takes far more than is within tolerance: whatever a
        straight line over their usual size says of them, they are fitted."""
        gram = self._gram_at(self.found[frozenset()].levels)
        places = [place for place, _ in self.model.columns.nuisances]
        sds = np.array([sd for _, sd in self.model.columns.nuisances])
        loaded = gram.full_inner[np.ix_(places, places)] + np.diag(sds**-2)
        taken = np.linalg.solve(loaded, gram.full_data[places]) / sds
        # What is free besides, as a function of something, is no effect's.
        little = self.model.columns.little
        far = [place for place, one in zip(places, taken, strict=True) if abs(one) > _STRETCHED]
        return sorted({little[place][0].effect for place in far if place in little})

    def _to_refit(self) -> list[Found]:
        """Return the sets that may win, singles first, so that each kind of answer is exact."""
        ranked = [one for one in self._ranked() if one.effects]
        singles = [one for one in ranked if len(one.effects) == 1][: _REFITTED // 2]
        pairs = [one for one in ranked if len(one.effects) == 2][: _REFITTED // 2]
        for size in range(3, len(self.model.prior.effects)):
            pairs += [one for one in ranked if len(one.effects) == size][: _REFITTED // 4]
        best = self._ranked()[0].log_evidence
        least = best - NEAR
        # A straight line errs the more, the more there is to explain: singles get a chance. The
        # first few always: along a play to its usual size one of four sizes as wide lacked 2,400 of
        # 2,600 nats, and pairs of what it was not led.
        loose = least - _LOOSE * (best - self.found[frozenset()].log_evidence)
        close = [one for one in singles[_ALWAYS:] if one.log_evidence > loose]
        near = singles[:_ALWAYS] + close + [one for one in pairs if one.log_evidence > least]
        known = {one.effects for one in near}
        stretched = [frozenset({effect}) for effect in self._stretched()]
        return near + [self.found[one] for one in stretched if one in self.found.keys() - known]


def _differ(first: Term, second: Term) -> bool:
    return first.variant.effect != second.variant.effect
