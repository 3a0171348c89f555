"""What comes beside the best set of effects, or in the place of one of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gap_diagnosis.motion.accounts import Effects, Found
from gap_diagnosis.motion.alike import alike, single_column
from gap_diagnosis.motion.beside import gains_beside
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.off_the_grid import OffTheGrid
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.recording import Floats

MORE_VARIANTS: Final = 3
"""So many of an effect's variants are tried beside a set."""
DEAD: Final = frozenset({"encoder_dead"})
"""About a wheel that stands no column says anything of what else is wrong."""
_BENT: Final = 200.0
"""Beside a set that gains this much [nat] others are sought along columns about it,"""
_BESIDE: Final = 2
"""so many are fitted,"""
_UNSURE: Final = 3.0
"""if along those columns they lack at most so many nats."""
_FITTED_ALIKE: Final = 2
"""So many effects that look like one of the best set are fitted in its place."""
_STRETCHED: Final = 4.0
"""Standard deviations of a constant within its tolerance, or two tolerances."""
_LOUD: Final = 5.0
"""Rows that are read so many times as early or late as is usual may be late by the same."""
_DELAYS: Final = frozenset({"frame_latency", "gyro_lag"})


class Neighbours(OffTheGrid):
    """What sets of effects say, the neighbours of the best one fitted from where its fit ended."""

    def __init__(self, model: MotionModel) -> None:
        super().__init__(model)
        # How likely a set was when stretches of the log were asked of it, and what that took.
        self._weighed: dict[Effects, tuple[float, float]] = {}
        self._parts_beside: dict[Effects, Refitted] = {}
        self._surrounded: set[Effects] = set()
        self._compared_alike: set[Effects] = set()
        self._stretched_beside: set[Effects] = set()

    def _sought_beside(self, head: Found) -> bool:
        """Fit, once, each part of the best set from where it ended, and what gains beside the set
        and beside its parts along columns about them; tell whether another set is believed now.

        What a straight line about no effect errs by goes with how much there is to explain.
        """
        fit = head.refitted
        is_bent = head.log_evidence > self.found[frozenset()].log_evidence + _BENT
        is_bent |= bool(head.effects & self._led_astray)
        if fit is None or not is_bent or head.effects & DEAD or head.effects in self._surrounded:
            return False
        self._surrounded.add(head.effects)
        self._fit_parts(head, fit)
        if len(head.effects) + 1 < len(self.model.prior.effects):
            self._seek_beside(head, fit)
            for effect in sorted(head.effects):
                less = self.found.get(head.effects - {effect})
                if less is not None and less.effects and less.refitted is not None:
                    self._seek_beside(less, less.refitted, instead_of=effect)
        return self._likeliest_expected.effects != head.effects

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
            effect: terms[:MORE_VARIANTS]
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
        return self._likeliest_expected.effects != head.effects

    def _sought_stretched(self, head: Found) -> bool:
        """Fit, once, beside the best set the effects whose tolerances it stretches; tell whether
        another set is believed now."""
        if not head.effects or head.effects & DEAD or head.effects in self._stretched_beside:
            return False
        self._stretched_beside.add(head.effects)
        for one in map(self.account, self._stretched(head)):
            if one.refitted is None:
                self._refit(one)
        return self._likeliest_expected.effects != head.effects

    def _sought_late(self, beside: Found) -> None:
        """Fit each delay by itself and beside a set, where rows that are read early or late by
        chance may stand for it.

        The few starts and stops of a drive leave to chance what is the same at each of them: of a
        gyro 40 ms late the line of no set showed a nat of the nine that a fit of the delay gains.
        """
        louder = self.found[frozenset()].levels > _LOUD * self.model.level_prior.median
        if not any(louder[LEVELS.index(one)] for one in ("wheels_late_s", "gyro_late_s")):
            return
        for delay in sorted(_DELAYS & self.effects - beside.effects):
            for effects in dict.fromkeys((frozenset({delay}), beside.effects | {delay})):
                one = self.account(effects)
                if one.refitted is None:
                    self._refit(one)

    def _stretched(self, beside: Found) -> list[Effects]:
        """Return a set with each one more effect of which far more than is within tolerance is
        taken beside it: whatever a straight line over their usual size says of them, they are
        fitted."""
        gram = self._gram_at(beside.levels)
        weights = [weight for term in beside.terms for weight in term.weights]
        free = np.zeros((len(gram.full_data), len(weights)))
        for coefficient, weight in enumerate(weights):
            for column, value in weight:
                free[column, coefficient] = value
        tolerated = np.zeros((len(gram.full_data), len(self.model.columns.nuisances)))
        for place, (column, sd) in enumerate(self.model.columns.nuisances):
            tolerated[column, place] = sd
        taken_by = np.hstack((tolerated, free))
        inner = taken_by.T @ gram.full_inner @ taken_by
        inner[np.diag_indices(tolerated.shape[1])] += 1.0
        taken = np.linalg.lstsq(inner, taken_by.T @ gram.full_data)[0]
        # What is free besides, as a function of something, is no effect's.
        little = self.model.columns.little
        nuisances = zip(self.model.columns.nuisances, taken, strict=False)
        far = [column for (column, _), one in nuisances if abs(one) > _STRETCHED]
        names = sorted({little[column][0].effect for column in far if column in little})
        known = [frozenset({name}) for name in names if frozenset({name}) in self.found]
        return [beside.effects | one for one in known if not one <= beside.effects]

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
            self._weighed.pop(effects, None)
