"""Mistakes of the set-up, each judged by what a log is like once it is put right.

About so gross an error nothing is linear: which of them is likelier shows only then.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Final

import numpy as np

from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.motion.accounts import NEAR, Found
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.gross import Agreement, Order, agreement_of, put_right
from gap_diagnosis.motion.mended import Mended, in_its_own_unit
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.setup_mistakes import LEAST_GAIN

_BOTH_WHEELS: Final = "ticks"


class Mending:
    """What putting right each mistake of the set-up makes of one log.

    Attributes:
        choices: of each mistake whose variants a straight line does not tell apart, those that
            mend the log.
        put_right: the likely mistakes, each with what the log is like without it.
    """

    def __init__(self, model: MotionModel, scan: Scan) -> None:
        """Judge the mistakes that a search has found, and let it take the variants that mend."""
        self._model, self._scan = model, scan
        self._nothing = scan.found[frozenset()]
        self.choices: dict[str, list[Found]] = {}
        for effect in sorted(GROSS & scan.effects):
            self._choose_what_mends(effect)
        self.put_right = self._judged_right()

    def told_of(self, effect: str) -> dict[str, Estimate]:
        """Return a mistake's parameters, by the log as each of its variants would put it right."""
        mending = self.choices[effect]
        logs = np.array([one.log_evidence for one in mending])
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        best = mending[int(np.argmax(logs))].terms[0].variant
        told: dict[str, Estimate] = {}
        for name, value in best.report.items():
            shares: dict[str, float] = {}
            for one, weight in zip(mending, weights, strict=True):
                said = str(one.terms[0].variant.report[name])
                shares[said] = shares.get(said, 0.0) + float(weight)
            told[f"{best.effect}.{name}"] = Estimate(value, probabilities=shares)
        return told

    def _choose_what_mends(self, effect: str) -> None:
        """Take that of a mistake's variants which, put right, leaves a log in order and likeliest.

        A straight line about so gross an error does not tell them apart.
        """
        alone = frozenset({effect})
        first = self._scan.found[alone].terms[0]
        mending = [term for term in self._scan.by_effect[effect] if self._mends(term)]
        if not mending or mending == [first]:
            return
        found = [self._put_right_by(term) for term in mending]
        best = max(found, key=lambda one: one.log_evidence)
        self.choices[effect] = found
        if best.terms[0] is not first:
            self._scan.found = {
                effects: one for effects, one in self._scan.found.items() if effect not in effects
            } | {alone: best}

    def _mends(self, term: Term) -> bool:
        """Tell whether a mistake of the set-up, put right, leaves a log in order; where none does,
        in that of wheels that stand far apart."""
        return self._orders[_told_as(term)] <= self._least_order

    @cached_property
    def _orders(self) -> dict[tuple[object, ...], Order]:
        """In what order each mistake of the set-up, put right, leaves a log."""
        recording, robot = self._model.recording, self._model.robot
        mistakes = [
            one for effect in GROSS & self._scan.effects for one in self._scan.by_effect[effect]
        ]
        found: dict[tuple[object, ...], Order] = {}
        for one in mistakes:
            told = one.variant.report
            right = agreement_of(put_right(recording, one.variant.effect, told)[0], robot)
            # A factor of both wheels brings their ways to the reference's. Wheels that skid turn a
            # robot by 0.7 of what they say: half their counts left the turns 1.4 times too small,
            # which is little enough, and the ways 1.5 times (setup_unit, 99.9 %).
            is_farther = right.ways_apart > self._as_it_is.ways_apart
            is_wrong = told.get("signal") == _BOTH_WHEELS and is_farther
            found[_told_as(one)] = Order.NONE if is_wrong else right.order
        return found

    @cached_property
    def _as_it_is(self) -> Agreement:
        """How the sources of the log go together before any mistake is put right."""
        return agreement_of(self._model.recording, self._model.robot)

    @cached_property
    def _least_order(self) -> Order:
        """In what order a log must be that is put right: wheels that stand far apart need no
        mistake besides."""
        is_none = self._as_it_is.order is Order.NONE
        return min((*self._orders.values(), Order.FAR_APART if is_none else Order.WHOLE))

    def _judged_right(self) -> dict[frozenset[str], Mended]:
        """The likely mistakes of the set-up, each judged by what the log is like without it.

        About so gross an error nothing is linear: which of them is likelier shows only then. What
        else is wrong with the robot is not told yet, but must not speak for an unlisted cause.
        """
        mending = [one for one in self._mistakes if not one.effects & self.in_vain]
        tried = {one.effects: self._without_mistake(one) for one in mending}
        found = {effects: right for effects, right in tried.items() if right is not None}
        _, explained = self._scan.worth
        more = max((right.fit.log_likelihood for right in found.values()), default=0.0) - explained
        if more > NEAR * self._scan.dispersion:
            # About an account that is none everything scatters.
            self._scan.dispersion = 1.0
        return {one: right.dispersed(self._scan.dispersion) for one, right in found.items()}

    def _without_mistake(self, mistake: Found) -> Mended | None:
        """Return a mistake with what the log is like without it; None where it gains nothing."""
        (term,) = mistake.terms
        by_line = mistake.log_evidence - self._nothing.log_evidence
        gain = self._put_right_by(term).log_evidence - self._nothing.log_evidence
        if max(by_line, gain) < LEAST_GAIN:
            return None
        model, log_scale = self._right(term)
        right = Scan(model)
        worth, explained = right.worth
        best = right.likeliest
        # Beside what explains it the gyro has less noise of its own.
        steps = self._model.recording.counts_per_step
        gain = right.found[frozenset()].log_evidence - self._nothing.log_evidence
        gain += in_its_own_unit(model, best.levels, log_scale, steps)
        gain -= math.log(len(self._scan.by_effect[term.variant.effect]))
        likelihood = max(gain + explained, mistake.log_likelihood - self._nothing.log_likelihood)
        # Counts that were rounded far too coarse are no finer for it: a line does not need them so.
        fit = Fit((term.variant.effect,), max(gain + worth, by_line), likelihood)
        return Mended(fit, best.effects, best.levels, explained, right.dispersion)

    def _put_right_by(self, term: Term) -> Found:
        """Return what a mistake accounts for: the log as it is without it."""
        effect = term.variant.effect
        model, log_scale = self._right(term)
        levels = model.no_effect_levels
        density = model.level_prior.log_density(np.log(levels))
        evidence = model.evidence_at((), levels) + density
        steps = self._model.recording.counts_per_step
        evidence += in_its_own_unit(model, levels, log_scale, steps)
        evidence -= math.log(len(self._scan.by_effect[effect]))
        return Found(frozenset({effect}), (term,), evidence, evidence, levels)

    def _right(self, term: Term) -> tuple[MotionModel, float]:
        """Return the motion of the log without a mistake, and the log of how much that narrows its
        rates."""
        effect, told = term.variant.effect, term.variant.report
        right, log_scale = put_right(self._model.recording, effect, told)
        without = self._model.without | GROSS
        return MotionModel(right, self._model.robot, self._model.prior, without=without), log_scale

    @property
    def _mistakes(self) -> list[Found]:
        singles = (frozenset({effect}) for effect in sorted(GROSS))
        return [self._scan.found[one] for one in singles if one in self._scan.found]

    @cached_property
    def in_vain(self) -> frozenset[str]:
        """Mistakes of the set-up that, put right, leave the log as gross as it was."""
        return frozenset(
            effect
            for one in self._mistakes
            for effect in one.effects
            if not self._mends(one.terms[0])
        )


def _told_as(term: Term) -> tuple[object, ...]:
    return term.variant.effect, *sorted(term.variant.report.items())
