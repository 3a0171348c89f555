"""What the blocks of all logs say of a set of effects together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from gap_diagnosis.drive.prior import GAIN
from gap_diagnosis.explanations.known import COUNTING
from gap_diagnosis.hypothesis import Block, Fit

Effects = frozenset[str]

_CLEARLY: Final = 12.0
_SAME: Final = 1.5 * GAIN.tolerance
"""Counts in a turn are told alike by wheels and by commands to so much: three standard deviations
of what any drive is off by, half a tolerance each."""
_CONTINUOUS: Final = frozenset({"motion", "drive"})
"""Blocks whose explanations of what moves are good approximations, no more."""
_EXACT_UP_TO: Final = 1000.0
_TO_THE_COUNT: Final = frozenset({"encoder_dead", "encoder_wrap"})
_INEXACT: Final = 0.003
"""Share of the nats beyond that which an explanation may leave for want of exactness: 5 % of its
amplitude. At ten detection limits an effect gains 1,450."""


def total_of(logs: Sequence[Sequence[Block]], effects: Effects) -> tuple[float, float]:
    """Return log evidence and log likelihood of a set, over all logs and blocks."""
    return _sum(_of_block(*one) for one in concerned(logs, effects))


def quick_of(logs: Sequence[Sequence[Block]], pair: Effects) -> tuple[float, float]:
    """Return a pair's; a block that owns both is asked for both only where that costs nothing."""
    return _sum(
        _better(*(_of_block(block, frozenset({effect}), shown) for effect in own))
        if len(own) == 2 and block.name != "motion"
        else _of_block(block, own, shown)
        for block, own, shown in concerned(logs, pair)
    )


def _better(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """Return what the better of two effects says alone; the other adds nothing, but what speaks
    against it still does."""
    most, least = max(first, second), min(first, second)
    return most[0] + min(least[0], 0.0), max(most[1], least[1])


def silent_of(logs: Sequence[Sequence[Block]], effect: str) -> float:
    """Return what values that leave no trace in any log have of an effect's log evidence."""
    own = frozenset({effect})
    concerned = [block for blocks in logs for block in blocks if effect in block.effects]
    return math.fsum(block.fit(own).log_silent for block in concerned)


def _sum(parts: Iterable[tuple[float, float]]) -> tuple[float, float]:
    evidence = likelihood = 0.0
    for gained, likelier in parts:
        evidence += gained
        likelihood += likelier
    return evidence, likelihood


def concerned(
    logs: Sequence[Sequence[Block]], effects: Effects
) -> Iterator[tuple[Block, Effects, Effects]]:
    """Yield every block that speaks of some of these effects, with those, and with the errors of
    counting that the motion shows clearly."""
    for blocks in logs:
        doubtful, shown = _counting(blocks, effects)
        for block in blocks:
            own = effects & block.effects
            if block.name == "drive":
                own = own - doubtful
            if own:
                yield block, own, shown


def _counting(blocks: Sequence[Block], effects: Effects) -> tuple[Effects, Effects]:
    """Return the counting errors of a set that the motion denies, so that the drive must not name
    them alone, and all that it shows clearly."""
    motion = next((block for block in blocks if block.name == "motion"), None)
    drive = next((block for block in blocks if block.name == "drive"), None)
    if motion is None or drive is None:
        return frozenset(), frozenset()
    both = COUNTING & motion.effects & drive.effects
    denied = frozenset(one for one in both & effects if _denies(motion, drive, one, effects))
    shown = frozenset(one for one in both if motion.fit(frozenset({one})).log_evidence > _CLEARLY)
    return denied, shown


def _denies(motion: Block, drive: Block, effect: str, effects: Effects) -> bool:
    """Tell whether the motion, which measures counts more finely than commands do, hardly shows
    beside the rest of a set what they tell clearly, or shows it of another size."""
    beside = effects & motion.effects
    seen, less = motion.fit(beside), motion.fit(beside - {effect})
    told = drive.fit(frozenset({effect}))
    sizes = seen.counting.get(effect), told.counting.get(effect)
    if sizes[0] is not None and sizes[1] is not None and abs(sizes[0] - sizes[1]) > _SAME:
        return True
    hardly = min(_CLEARLY, told.log_likelihood - (seen.log_likelihood - less.log_likelihood))
    return seen.log_evidence - less.log_evidence <= max(hardly, 0.0)


def _of_block(block: Block, effects: Effects, shown: Effects) -> tuple[float, float]:
    """Return what a block says; a mistake of the set-up may lie where it cannot see.

    Commands count for errors of counting that the motion has *shown*, else only if they are clear.
    """
    fit = block.fit(effects)
    if block.name == "drive" and effects & COUNTING and not effects & shown:
        fit = _clearly(fit, block.fit(effects - COUNTING), block.fit(effects & COUNTING))
    if not any(effect.startswith("setup_") for effect in effects) or block.name == "motion":
        return _told(block, effects, fit.log_evidence), fit.log_likelihood
    rest = frozenset(effect for effect in effects if not effect.startswith("setup_"))
    blind = block.fit(rest)
    evidence = max(fit.log_evidence, blind.log_evidence) - math.log(2)
    return evidence, max(fit.log_likelihood, blind.log_likelihood)


def _told(block: Block, effects: Effects, evidence: float) -> float:
    """Return the log evidence of a set in a block, of which further effects have no more than what
    they gain beyond what the largest explains inexactly [nat].

    A clipped rate or a dead wheel of thousands of nats is not explained to the last of them, and
    what is left must not bring in effects that are not there. Neither does it speak against them:
    what gains less than that is as likely as it was before. What is put right to the last count
    leaves nothing, nor does a wheel of whose turns nothing is known.
    """
    if len(effects) < 2 or block.name not in _CONTINUOUS:
        return evidence
    alone = {one: block.fit(frozenset({one})).log_evidence for one in sorted(effects)}
    inexact = max((alone[one] for one in effects - _TO_THE_COUNT), default=0.0)
    if put_right := effects & _TO_THE_COUNT:
        # What others would take of it alone they do not explain beside it.
        inexact = min(inexact, evidence - block.fit(put_right).log_evidence)
    left = max(0.0, inexact - _EXACT_UP_TO)
    if left == 0.0:
        return evidence
    first = max(alone, key=lambda one: alone[one])
    found = []
    for one in sorted(effects - {first}):
        rest = effects - {one}
        before = block.fit(rest).log_evidence
        gain = evidence - before
        found.append(_told(block, rest, before) + gain - min(max(gain, 0.0), _INEXACT * left))
    return min(found)


def _clearly(fit: Fit, without: Fit, alone: Fit) -> Fit:
    """Return what commands say of counting errors: nothing that is not said clearly.

    Their size is not held against the one that the motion finds, so a small misfit of the drive
    must not speak for them; nor may what they explain *alone* speak for a drive effect beside them.
    """
    if 0 < alone.log_evidence < _CLEARLY:
        return replace(
            fit,
            log_evidence=fit.log_evidence - alone.log_evidence,
            log_likelihood=max(fit.log_likelihood - alone.log_likelihood, 0.0),
        )
    if 0 < fit.log_evidence - without.log_evidence < _CLEARLY:
        return replace(
            fit, log_evidence=without.log_evidence, log_likelihood=without.log_likelihood
        )
    return fit
