"""What lies within a tolerance is no cause: its probability is that of the set without it.

The motion's evidence leaves it out by itself. The other blocks tell an effect's whole prior, and a
replay tells a constant to the digit: one that is off by half of what is no news is found with
certainty, and is none all the same ("a parameter inside its tolerance is reported as an estimate
and never named as a cause", docs/design.md, section 5). So is a drive's threshold that moves no
wheel by more than any drive may be off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.block_sums import Effects
from gap_diagnosis.hypothesis import EVERYTHING, Block, Estimate
from gap_diagnosis.priors import Prior
from hil_harness.effects import catalogue

NEAR: Final = 12.0
"""Sets that are less likely by more than this [nat] are left as they are."""
_NOTHING: Final = 5.0
"""Of a set so much less likely than the one without the effect, none is worth counting there."""
_NEVER: Final = -1e4


@dataclass(frozen=True)
class Moved:
    """Sets with what lies within tolerance counted for the set without it.

    Attributes:
        log_probability, log_likelihood: by set.
        small: by set, the effects within tolerance that most of its probability has.
    """

    log_probability: dict[Effects, float]
    log_likelihood: dict[Effects, float]
    small: dict[Effects, Effects]


def moved(
    logs: Sequence[Sequence[Block]],
    prior: Prior,
    probabilities: Mapping[Effects, float],
    likelihoods: Mapping[Effects, float],
) -> Moved:
    """Return the log probabilities and log likelihoods of sets, with what each has within the
    tolerance of an effect counted for the set without that effect.

    A set that most of another one comes down to explains what that one explains.
    """
    found = Moved(dict(probabilities), dict(likelihoods), {})
    logs_of = found.log_probability
    top = max(logs_of.values())
    near = [effects for effects, value in logs_of.items() if value > top - NEAR]
    for effects in sorted(near, key=lambda one: (-len(one), sorted(one))):
        for effect in sorted(effects):
            less = effects - {effect}
            if logs_of[effects] < logs_of.get(less, math.inf) - _NOTHING:
                continue
            share = _share(_inside(logs, prior, effects, effect))
            if share == 0.0:
                continue
            within = logs_of[effects] + math.log(share)
            if within > logs_of[less]:
                found.log_likelihood[less] = max(
                    found.log_likelihood[less], found.log_likelihood[effects]
                )
                found.small[less] = found.small.get(effects, frozenset()) | {effect}
            logs_of[less] = float(np.logaddexp(logs_of[less], within))
            logs_of[effects] += math.log1p(-share) if share < 1.0 else _NEVER
    return found


def notes(
    logs: Sequence[Sequence[Block]], prior: Prior, effects: Effects, small: Effects
) -> list[str]:
    """Return a sentence on each effect that is at work beside a set, but within tolerance."""
    return [
        f"{effect} is within tolerance, and no cause: "
        + ", ".join(one.told for one in _inside(logs, prior, effects | small, effect))
        + "."
        for effect in sorted(small)
    ]


class _Inside(NamedTuple):
    """A parameter, what it may be at most without being news, and the values that are some."""

    key: str
    said: Estimate
    tolerance: float | None
    news: tuple[float, float]

    @property
    def draws(self) -> NDArray[np.bool_]:
        """Which draws are no news."""
        assert self.said.samples is not None  # `_inside` takes no others
        least, most = self.news
        draws = self.said.samples
        inside = (draws < least) | (draws > most)
        if self.tolerance is not None:
            inside |= np.abs(draws) <= self.tolerance
        return np.asarray(inside)

    @property
    def told(self) -> str:
        """The estimate and why it is no news."""
        effect, _, name = self.key.partition(".")
        unit = catalogue()[effect].parameter(name).unit
        unit = "" if unit == "1" else f" {unit}"
        why = "moves no wheel by more than any drive may"
        if self.tolerance is not None and abs(float(self.said.value)) <= self.tolerance:
            why = f"no news up to {self.tolerance:g}{unit}"
        return f"{self.key} = {self.said.value:.2g}{unit} ({why})"


def _inside(
    logs: Sequence[Sequence[Block]], prior: Prior, effects: Effects, effect: str
) -> list[_Inside]:
    """Return the parameters of an effect of a set that may be no news, as the surest block tells
    them; none of one that the motion tells."""
    seen = [block for blocks in logs for block in blocks if effect in block.effects]
    if any(block.name == "motion" for block in seen):
        return []
    surest: dict[str, _Inside] = {}
    for block in seen:
        for key, said in block.fit(effects & block.effects).parameters.items():
            name, _, parameter = key.partition(".")
            tolerance = prior.tolerance(name, parameter) if name == effect else None
            may_be = tolerance is not None or said.news != EVERYTHING
            if not may_be or said.samples is None or name != effect:
                continue
            # What is news in one log is news.
            known = surest.get(key, _Inside(key, said, tolerance, (math.inf, -math.inf)))
            news = min(known.news[0], said.news[0]), max(known.news[1], said.news[1])
            surer = said if said.sd < known.said.sd else known.said
            surest[key] = _Inside(key, surer, tolerance, news)
    return list(surest.values())


def _share(inside: Sequence[_Inside]) -> float:
    """Return the probability that all are within tolerance."""
    draws = [one.draws for one in inside]
    if not draws:
        return 0.0
    if len({len(one) for one in draws}) == 1:
        return float(np.logical_and.reduce(draws).mean())
    return math.prod(float(one.mean()) for one in draws)
