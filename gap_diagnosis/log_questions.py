"""What logs leave open whatever is at work: effects that look alike in them, or do not show."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gap_diagnosis.contest import Contest, Hypothesis, contest_of
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.imitation import Imitators
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.priors import Prior
from gap_diagnosis.result import NO_GAP
from gap_diagnosis.result_parts import EffectSet, Structure
from gap_diagnosis.structure import sights_of, visible


def imitations(
    motions: Sequence[MotionBlock], structure: Structure
) -> list[tuple[EffectSet, tuple[Contest, ...]]]:
    """Return each group of effects that look alike, with who in it imitates whom in these logs.

    An effect is taken to be twice as large as shows at all. What nothing told apart in any log
    imitates no one here: such a group may have no contest.
    """
    sights = sights_of([(one.model, one.levels) for one in motions])
    search = Imitators(sights)
    found: list[Contest] = []
    for one in visible(sights).values():
        for truth in () if one is None else one.truths:
            sizes = tuple(float(size) for size in truth.cases[0][: len(truth.variant.coefficients)])
            accounts = search.accounts(truth)
            # Of pairs the best stands for all, as in the groups.
            for account in accounts if accounts and len(accounts[0]) == 1 else accounts[:1]:
                found.append(
                    contest_of(
                        sights.logs,
                        (truth.effect,),
                        Hypothesis((truth.variant,), (sizes,)),
                        tuple(sorted(variant.effect for variant in account)),
                        Hypothesis(account),
                    )
                )
    return [
        (group, tuple(one for one in found if {*one.truth, *one.rival} <= set(group)))
        for group in structure.groups
    ]


def unseen(motions: Sequence[MotionBlock], structure: Structure) -> tuple[Contest, ...]:
    """Return the contest with no effect of each effect of the motion that these logs cannot show.

    It is taken to be in the middle of what is believed, between its tolerance and its largest size.
    """
    model = motions[0].model
    sights = sights_of([(one.model, one.levels) for one in motions])
    found = []
    for effect, explanation in EXPLAINED.items():
        if structure.detectable.get(effect, 0.0) is not None:
            continue
        terms = sights.terms.get(effect, ())
        variants = [one.variant for one in terms] or list(explanation.variants(model.nodes.motion))
        if variants:
            acts = Hypothesis((variants[0],), (_usual(variants[0], model.prior),))
            found.append(contest_of(sights.logs, (effect,), acts, (NO_GAP,), Hypothesis(())))
    return tuple(found)


def _usual(variant: Variant, prior: Prior) -> tuple[float, ...]:
    known = [prior.of(variant.effect, name) for name in variant.coefficients]
    return tuple(math.sqrt(one.tolerance * one.high) for one in known)
