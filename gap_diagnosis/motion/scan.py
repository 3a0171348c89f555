"""All single effects and all pairs, compared on Gram matrices; the best are fitted again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Final

from gap_diagnosis.motion.accounts import NEAR, Effects, Found
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.dispersion import dispersion
from gap_diagnosis.motion.evidence import Gram, score
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.neighbours import DEAD, MORE_VARIANTS, Neighbours
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
from gap_diagnosis.motion.starts import with_slip
from gap_diagnosis.motion.thresholds import has_threshold, thresholds_of
from gap_diagnosis.motion.whitening import SPEED_NOISE
from gap_diagnosis.motion.windows import at_window, has_window, windows_of
from gap_diagnosis.recording import Floats
from gap_diagnosis.visibility import Sight, sight_of

_LEVELS_TRIED: Final = 3
_REFITTED: Final = 8
_GREEDY: Final = 3
_EXTENDED: Final = 4
_WORTH_MORE: Final = 10.0
"""One more effect is sought beside sets that gain this much on the best smaller one [nat]."""
_ALL_PARTS: Final = 3
"""Every part of sets so large is fitted again; of larger ones those without one effect."""
_LOOSE: Final = 0.25
"""Single effects so near are fitted, and those that lack at most this share of the best's gain."""
_CLEAR: Final = 20.0
"""An effect that gains this much [nat] after what stretches contradict is beyond doubt."""
_HARDLY: Final = 0.1
"""A slip that is now more and now less does not explain ten times what a steady one does."""
_AS_WELL: Final = 3.0
"""Sets whose likelihoods differ by no more [nat] explain a log as well as each other."""
_CONTRADICTED: Final = 2
"""Once stretches contradict so many of the best sets, they are asked of the next one before its
parts, windows and neighbours are fitted: on a wheel on ice they contradict every set."""
_ALWAYS: Final = 3
"""So many of the best single effects are fitted, whatever straight lines say of them."""
_ELSEWHERE: Final = 5.0
"""Two searches that end at as much [nat] as makes no difference ended at the same place."""
_CLOCKS: Final = frozenset({"reference_clock_skew", "reference_time_offset"})
"""Always fitted together: what two clocks are apart may shift samples from one row of a table to
the next, of which no straight line tells."""


class Scan(Neighbours):
    """The search through one log's motion.

    Attributes:
        foreseen: what the log can show at the described levels of noise, before any fit.
        where_it_turns: the search through the log in which the wheel of a dead encoder turns again;
            None where that is not at work.
    """

    foreseen: Sight
    where_it_turns: Scan | None = None

    def __init__(
        self,
        model: MotionModel,
        progress: Callable[[float], None] = lambda share: None,
        begin: Floats | None = None,
    ) -> None:
        """Search, about the levels of noise to *begin* at instead of those that a search from the
        described ones ends at."""
        super().__init__(model)
        self._begin = begin
        self._contradicted = 0
        self._looked_behind = False
        self._windowed: set[Effects] = set()
        self._steady: dict[Effects, Found] = {}
        self._search(progress)

    def _search(self, progress: Callable[[float], None]) -> None:
        model = self.model
        self._add_levels(model.level_prior.median)
        self.foreseen = sight_of(model.columns, self._grams[0], model.prior)
        greedy = self._greedy(self._grams[0])
        better = self._begin
        if better is None:
            levels = model.levels_for(greedy, model.level_prior.median)
            better = model.better_start(greedy, levels)
        if better is not None:
            # What led at levels this wrong was noise.
            levels = model.levels_for(self._greedy(model.gram(better)), better)
        self._add_levels(levels)
        progress(0.2)
        self._add_levels(model.levels_for((), self._grams[-1].levels))
        if SPEED_NOISE not in model.level_prior.silent:
            # One noise more may stand for another: from levels beside an effect a search ended 18
            # nats below the best beside none, and a healthy tractor's gyro lagged by 5.
            self._add_levels(model.no_effect_levels)
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
            if not self._will_fall(one):
                self._refit(one)
            progress(0.6 + 0.4 * (done + 1) / len(refitted))
        for one in self._beyond_a_line():
            self._led_astray |= one.effects
            self._refit(one, by_itself=True)
        self._moved_windows(max(self._fitted(), key=self._belief))
        self._loosened()
        self._sought_beside(max(self._fitted(), key=self._belief))
        self._sought_late(max(self._fitted(), key=self._belief))
        self._settle()
        self.dispersion = self._dispersion()
        if self.dispersion > 1:
            self._held_to_one_way()
            self._settle()
        self._take_in_bends()
        self._hold_back_the_unfitted()
        if self.likeliest.effects & DEAD:
            self._seek_beside_the_dead()

    def slipping(self) -> Floats | None:
        """Return levels of noise of wheels that slip, float64[levels], at which the likeliest set
        or none is likelier than it is; None if there are none.

        Last of all: from the first, such levels take up large effects of which a line shows little.
        """
        head = self.likeliest
        slips = with_slip(head.levels, self.model.level_prior)
        if slips is None or head.effects & DEAD:
            return None
        nothing = self._nothing_at(self.model.levels_for((), slips))
        self._offer(nothing)
        if nothing.log_evidence > head.log_evidence + _ELSEWHERE:
            return nothing.levels
        if head.refitted is None:
            return None
        fit = self.model.refit(head.terms, slips, start=head.refitted.coefficients)
        is_better = fit.log_evidence > head.refitted.log_evidence + _ELSEWHERE
        return fit.levels if is_better else None

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

    def turning_with(self, effects: Effects) -> Scan | None:
        """Return the search in which the wheel turns again that died beside these effects; None
        without any, or where one of them is not told there: turns put in have no jumps of a
        counter."""
        there = self.where_it_turns
        return there if there is not None and DEAD < effects <= there.effects | DEAD else None

    def account(self, effects: Effects) -> Found:
        """Return the best account of a set; of a set that was not worth it, an approximate one."""
        there = self.turning_with(effects)
        if there is None or effects in self.found:
            return super().account(effects)
        nothing, one = there.found[frozenset()], there.account(effects - DEAD)
        self.found[effects] = beside(self.found[DEAD], nothing, one, self.by_effect)
        return self.found[effects]

    def _settle(self) -> None:
        """Fit the best set, its parts and what comes beside it, until another one is no better."""
        for _ in range(_REFITTED):
            self._take_what_is_tolerated()
            head = self._likeliest_expected
            if self._contradicted >= _CONTRADICTED and self._doubted(head):
                continue
            unfitted = [head] if head.refitted is None and head.effects else self._parts_of(head)
            if not unfitted and self._moved_windows(head):
                continue
            is_settled = not unfitted and not self._doubted(head) and not self._sought_beside(head)
            if is_settled and not self._sought_stretched(head) and not self._sought_alike(head):
                hidden = self._hidden()
                if hidden is None:
                    break
                unfitted = [hidden]
            for one in unfitted:
                self._refit(one)

    def _will_fall(self, one: Found) -> bool:
        """Tell whether a set that is not fitted will lose as sets like it did, and so be none of
        the best."""
        expected = self._expected(one, self._falls())
        best = max(self._belief(each) for each in self._fitted())
        return expected < min(self._belief(one), best - NEAR)

    def _hidden(self) -> Found | None:
        """Return, once, the set that would win if it alone did not fall as sets like it did."""
        likeliest = max(self.found.values(), key=self._belief)
        if likeliest.refitted is not None or not likeliest.effects or self._looked_behind:
            return None
        self._looked_behind = True
        return likeliest

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
            return self._likeliest_expected is not head
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
            if one.log_evidence < nothing + max(_CLEAR, _HARDLY * (best - nothing)):
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
                        if not is_a_slip(again, place):
                            continue
                    self._steady.setdefault(effects, one)
                    self._take(terms, again, others)

    def _held_to_one_way(self) -> None:
        """Let a slip that may go to and fro, as much as the log scatters, be as steady as before.

        Of a lawnmower a wheel slipped by -3 % (-83 to 66) for 8 s, 91 %.
        """
        loosely = {each: one for each, one in self.found.items() if any(map(is_loose, one.terms))}
        to_and_fro = {
            effects
            for effects, one in loosely.items()
            if one.refitted is not None
            for at, term in enumerate(one.terms)
            if is_loose(term) and not is_a_slip(one.refitted, at, self.dispersion)
        }
        if frozenset({SLIP}) in to_and_fro:
            to_and_fro |= {effects for effects, one in loosely.items() if one.refitted is None}
        for effects in to_and_fro:
            del self.found[effects]
            self._weighed.pop(effects, None)
            if effects in self._steady:
                self.found[effects] = self._steady.pop(effects)

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

        About a straight line of a wrong sign or factor everything scatters.
        """
        head = max(self._fitted(), key=self._belief)
        if GROSS & head.effects:
            return 1.0
        coefficients = () if head.refitted is None else head.refitted.coefficients
        return dispersion(self.model, head.terms, coefficients, head.levels)

    def _doubted(self, head: Found) -> bool:
        """Take from a set, once, what an effect gains in it that stretches of the log contradict;
        tell whether another set is believed now.

        What is clear all the same is not taken from: no explanation is exact, and rivals must be
        compared by what they explain.
        """
        if head.refitted is None or len(head.effects) < 2 or head.effects in self._weighed:
            return False
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
        self._weighed[head.effects] = head.log_likelihood, too_much
        self._take_no_more_than_from_rivals(head.effects)
        self._lower(head.effects, self._weighed[head.effects][1])
        is_beaten = self._likeliest_expected.effects != head.effects
        self._contradicted += is_beaten
        return is_beaten

    def _take_no_more_than_from_rivals(self, effects: Effects) -> None:
        """Let sets that explain the log as well as this one, and differ in one effect, lose as
        little to stretches as any of them: what is clear of one by a hair is so of its twin."""
        likelihood = self._weighed[effects][0]
        alike = [
            one
            for one, (as_well, _) in self._weighed.items()
            if len(one) == len(effects)
            and len(one & effects) >= len(effects) - 1
            and abs(as_well - likelihood) <= _AS_WELL
        ]
        least = min(self._weighed[one][1] for one in alike)
        for one in alike:
            explained, taken = self._weighed[one]
            self._weighed[one] = explained, least
            if one != effects:
                self._lower(one, least - taken)

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
                    choices = [(*parent.terms, term) for term in terms[:MORE_VARIANTS]]
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
        stretched = self._stretched(self.found[frozenset()])
        if self.by_effect.keys() >= _CLOCKS:
            # A line of delays that crosses none amid a log has no slope there in either.
            stretched = [*stretched, _CLOCKS]
        return near + [self.account(one) for one in dict.fromkeys(stretched) if one not in known]


def search(model: MotionModel, progress: Callable[[float], None] = lambda share: None) -> Scan:
    """Search, and once more from wheels that slip where that is likelier than the rough ones or the
    long wander at which the search ended."""
    first = Scan(model, progress)
    slips = first.slipping()
    if slips is None:
        return first
    return max(first, Scan(model, begin=slips), key=lambda one: one.likeliest.log_evidence)


def _differ(first: Term, second: Term) -> bool:
    return first.variant.effect != second.variant.effect
