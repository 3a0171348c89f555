"""Two sets of effects against each other: how far apart they stay in logs and in drives to come."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.edges import EDGES
from gap_diagnosis.recording import Floats
from gap_diagnosis.result_parts import EffectSet
from gap_diagnosis.visibility import Sight

_WINDOW: Final = ("start_s", "stop_s")


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects in the variants that fit best, with the sizes found (if it is the truth)."""

    variants: tuple[Variant, ...]
    sizes: tuple[tuple[float, ...], ...] = ()

    @property
    def effects(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(variant.effect for variant in self.variants)


@dataclass(frozen=True)
class View:
    """What one log says of a truth and an alternative.

    Attributes:
        power: of what the truth does beyond the alternative's fixed part.
        pull: float64[f] of it along the alternative's free coefficients.
        stiff: float64[f, f] of those with each other.
    """

    power: float
    pull: Floats
    stiff: Floats

    def __add__(self, other: View) -> View:
        """Return both logs together; sizes are the same in both."""
        return View(self.power + other.power, self.pull + other.pull, self.stiff + other.stiff)

    def separation(self, restraint: Floats) -> float:
        """Return how far the truth stays from the alternative's best fit."""
        if len(self.pull) == 0:
            return max(self.power, 0.0)
        sizes = np.linalg.solve(self.stiff + np.diag(restraint), self.pull)
        return max(self.power - float(self.pull @ sizes), 0.0)


def view(sight: Sight, truth: Hypothesis, alternative: Hypothesis) -> View:
    """Return what a log sees; an effect that leaves nothing in it adds nothing."""
    inner = sight.beside(*truth.effects)
    place = {key: row for row, key in enumerate(sight.keys)}
    count = len(sight.keys)
    done = np.zeros(count)
    for variant, sizes in zip(truth.variants, truth.sizes, strict=True):
        _add(done, sight, place, variant, sizes)
    free: list[Floats] = []
    for variant in alternative.variants:
        if not variant.coefficients:
            fixed = np.zeros(count)
            _add(fixed, sight, place, variant, ())
            done = done - fixed
        for index in range(len(variant.coefficients)):
            one = np.zeros(count)
            unit = tuple(float(other == index) for other in range(len(variant.coefficients)))
            _add(one, sight, place, variant, unit)
            free.append(one)
    columns = np.array(free).reshape(len(free), count)
    across = columns @ inner
    return View(float(done @ inner @ done), across @ done, across @ columns.T)


@dataclass(frozen=True, eq=False)
class Contest:
    """A truth that logs do not tell from another account of them.

    Attributes:
        truth: names of the effects taken for true.
        acts: how they act, as large as they are.
        rival: names of the other account.
        account: how that may act.
        known: what the logs see of the two.
        restraint: float64[f], of the other account's sizes.
    """

    truth: EffectSet
    acts: Hypothesis
    rival: EffectSet
    account: Hypothesis
    known: View
    restraint: Floats

    def gain(self, new: Sight) -> float:
        """Return what another drive is worth [bit].

        The separation to be expected is that of the truth from the rival's best fit to the logs and
        to the new drive together, beyond what the logs alone give.
        """
        known = self.known.separation(self.restraint)
        both = self.known + view(new, self.acts, self.account)
        return bits(both.separation(self.restraint) - known)


def contest_of(
    logs: Sequence[Sight],
    truth: EffectSet,
    acts: Hypothesis,
    rival: EffectSet,
    account: Hypothesis,
) -> Contest:
    """Return the contest of two accounts of these logs."""
    known = view(logs[0], acts, account)
    for log in logs[1:]:
        known = known + view(log, acts, account)
    return Contest(truth, acts, rival, account, known, restraint_of(logs[0], account))


def restraint_of(sight: Sight, alternative: Hypothesis) -> Floats:
    """Return float64[f]: inverse squares of sizes that are still believed."""
    return np.array(
        [
            sight.prior.of(variant.effect, name).high ** -2.0
            for variant in alternative.variants
            for name in variant.coefficients
        ]
    )


def bits(separation: float) -> float:
    """Return what an answer to two equally likely hypotheses so far apart is worth [bit].

    The better of them is taken; it is wrong with probability Phi(-sqrt(separation)/2).
    """
    wrong = float(ndtr(-0.5 * math.sqrt(max(separation, 0.0))))
    if wrong <= 0.0:
        return 1.0
    return 1.0 + wrong * math.log2(wrong) + (1.0 - wrong) * math.log2(1.0 - wrong)


def _add(
    total: Floats,
    sight: Sight,
    place: dict[tuple[str, int, int], int],
    variant: Variant,
    sizes: Sequence[float],
) -> None:
    terms = sight.terms.get(variant.effect)
    if terms is None:
        return
    index = _nearest(terms, variant)
    for coefficient, size in enumerate(sizes or (1.0,)):
        total[place[variant.effect, index, coefficient]] += size


def _nearest(terms: Sequence[Term], variant: Variant) -> int:
    """Return which variant of another log acts as this one does.

    Sides and bits are the same, thresholds the nearest; what acted in a window acts throughout.
    """

    def distance(term: Term) -> tuple[int, float]:
        other = term.variant
        if other is variant or other == variant:
            return (-1, 0.0)
        choices = [name for name in variant.report if name not in EDGES]
        unlike = sum(variant.report[name] != other.report.get(name) for name in choices)
        if all(name in other.fixed for name in _WINDOW):
            return (unlike, other.fixed["start_s"] - other.fixed["stop_s"])
        away = [
            abs(value - other.fixed.get(name, value))
            for name, value in variant.fixed.items()
            if name in EDGES
        ]
        return (unlike, sum(away))

    return min(range(len(terms)), key=lambda index: distance(terms[index]))
