"""What is too small to be seen beside several effects takes its share of their probability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from gap_diagnosis.block_sums import Effects
from gap_diagnosis.hypothesis import NEVER, Block
from gap_diagnosis.no_news import NEAR
from gap_diagnosis.priors import Prior
from gap_diagnosis.set_scores import Score, Scores

_NEARLY: Final = 5.0
"""Sets within so many nats of the likeliest have something of the probability."""
_FITTED_TOGETHER: Final = frozenset({"drive", "firmware"})
"""In these blocks an effect beside another one must be fitted to be told; it is left out."""


def with_one_unseen(
    logs: Sequence[Sequence[Block]],
    scored: Scores,
    logs_of: Mapping[Effects, float],
    prior: Prior,
    log_prior: Mapping[str, float],
) -> dict[Effects, tuple[Effects, Score]]:
    """Return sets with one effect more than a likely one of two and more, where they were not
    weighed or not fitted: that likely one, and the score of both together.

    Beside one effect every second one is weighed, beside more only what gains. But most of what is
    there as well is too small to: of 125 sealed cases told two, with .92, two were all in .84.
    """
    top = max(logs_of.values())
    likely = [one for one in scored if len(one) > 1 and logs_of[one] > top - _NEARLY]
    fitted = [b.effects for blocks in logs for b in blocks if b.name in _FITTED_TOGETHER]
    weighed, beside = dict(scored), dict[Effects, Effects]()
    for effects in sorted(likely, key=lambda one: (-logs_of[one], sorted(one))):
        evidence, likelihood, _ = scored[effects]
        taken = {e for own in fitted if own & effects for e in own} | effects
        for effect in sorted(log_prior.keys() - taken):
            larger = effects | {effect}
            gained, likelier = _gained_beside(effect, effects, scored)
            if larger in weighed and weighed[larger][0] > evidence + gained - NEAR:
                continue
            weight = prior.log_probability_of(larger, log_prior)
            weighed[larger] = evidence + gained, likelihood + likelier, weight
            beside[larger] = effects
    return {larger: (effects, weighed[larger]) for larger, effects in beside.items()}


def _gained_beside(effect: str, effects: Effects, scored: Scores) -> tuple[float, float]:
    """Return what an effect that shows little adds to a set: at most nothing, and as little as
    beside none of them or one, except where only that one was fitted exactly; never what cannot be
    beside one of them."""
    less = [frozenset[str](), *(frozenset({one}) for one in effects)]
    pairs = [(scored[one], scored[one | {effect}]) for one in less if one | {effect} in scored]
    if min(both[0] for _, both in pairs) < -0.5 * NEVER:
        return -NEVER, 0.0
    gains = [(both[0] - one[0], both[1] - one[1]) for one, both in pairs]
    evidence, likelihood = min(one for one in gains if one[0] > -NEAR or one == max(gains))
    return min(evidence, 0.0), max(likelihood, 0.0)
