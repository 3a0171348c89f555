"""From evidence to probabilities: every set of effects over all blocks, `no_gap` and `unknown`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from types import MappingProxyType
from typing import Final

import numpy as np
from scipy.stats import chi2

from gap_diagnosis.block_sums import Effects, quick_of, silent_of, total_of
from gap_diagnosis.company import OWN_BLOCK, Company
from gap_diagnosis.hypothesis import NEVER, REPLAYED_TOGETHER, Block, Remembering
from gap_diagnosis.no_news import NEAR, moved
from gap_diagnosis.priors import WHEELS, Prior
from gap_diagnosis.set_scores import Score, Scores, single_priors
from gap_diagnosis.setup_mistakes import LEAST_GAIN
from gap_diagnosis.unseen import with_one_unseen
from hil_harness.effects import catalogue

THRESHOLD: Final = 29.0
"""Separation below which two sets are not told apart (docs/design.md, section 5)."""

_BY_CHANCE: Final = 0.01
"""Effects that are not there gain more than `_gained_by_chance` in so many cases: twice the
log-likelihood is chi-square, with as many degrees of freedom as they have numbers."""

_PAIRED: Final = 10
_WORTH_PAIRING: Final = 2.0
"""Effects that do better than this alone [nat] are fitted in pairs in every block."""
_WORTH_TRIPLES: Final = 5.0
_TRIPLED: Final = 12
_WORTH_ONE: Final = 30.0
_LEAST_SHOWN: Final = 1e-4
"""Of an effect without a trace; integrals are not exact, and their difference may be nothing."""
_LARGER: Final = 6
_APART: Final = 2
_BESIDE: Final = 5
_TOGETHER: Final = 3
_COUNTED: Final = 2
"""So many errors of counting are asked of the drive together with what it alone sees."""
_MOST_OF: Final = {"drive": 1, "firmware": REPLAYED_TOGETHER}
"""So many effects of one block are told together: what they say does not add up."""
_BIT: Final = frozenset({"adc_stuck_bit"})
_BEND: Final = frozenset({"adc_inl"})
_BIAS: Final = frozenset({"gyro_bias"})


@dataclass(frozen=True)
class Ranked:
    """A set of effects with what speaks for it.

    Attributes:
        effects: their names; empty for no gap.
        log_evidence, log_likelihood: over all blocks, less those of no effect.
        probability: posterior.
        company: what unlisted causes beside it add to both.
    """

    effects: Effects
    log_evidence: float
    log_likelihood: float
    probability: float
    company: float = 0.0

    @property
    def explained(self) -> float:
        """The log likelihood with what unlisted causes beside it explain."""
        return self.log_likelihood + self.company


@dataclass(frozen=True)
class Ranking:
    """All answers.

    Attributes:
        sets: most probable first, no effect among them.
        unknown: probability of a cause that is not in the library, by stage.
        beside: stages in which the best set leaves something that no listed effect explains.
        small: effects at work beside the best set that are within tolerance.
    """

    sets: tuple[Ranked, ...]
    unknown: Mapping[str, float]
    beside: tuple[str, ...] = ()
    small: Effects = frozenset()

    @property
    def best(self) -> Ranked:
        """The most probable set."""
        return self.sets[0]

    def of(self, effects: Effects) -> Ranked:
        """Return the entry of one set."""
        return self._entries[effects]

    @cached_property
    def _entries(self) -> dict[Effects, Ranked]:
        return {one.effects: one for one in self.sets}

    def group(self, effects: Effects) -> list[Ranked]:
        """Return the other sets of at most as many causes that are not told apart from this.

        Where one effect of a set gains no more than chance gives, it names no cause: the others
        stand for themselves, whether they are in the group or just out of it. Nor do sizes that no
        effect has.
        """
        own = self.of(effects)
        near = [
            one
            for one in self.sets
            if one.effects != effects
            and (len(one.effects) <= len(effects) or _causes(one.effects) <= _causes(effects))
            and one.log_evidence > -0.5 * NEVER
            and 2 * (own.explained - _as_well(one, own)) < THRESHOLD
        ]
        return [one for one in near if not self._adds_nothing(one)]

    def _adds_nothing(self, one: Ranked) -> bool:
        """Tell whether a set is another with effects that gain what chance gives.

        What unlisted causes explain beside it is not its gain.
        """
        size = len(one.effects)
        less = (frozenset(part) for n in range(size) for part in combinations(one.effects, n))
        known = (self._entries[part] for part in less if part in self._entries)
        return any(
            2 * (one.log_likelihood - each.log_likelihood)
            < _gained_by_chance(_numbers(one.effects - each.effects))
            for each in known
        )


def rank(
    logs: Sequence[Sequence[Block]],
    prior: Prior,
    stage_of: Mapping[str, str],
    unknown: Mapping[str, float],
    several: Sequence[Effects] = (),
    *,
    as_ever: Mapping[str, float] = MappingProxyType({}),
) -> Ranking:
    """Return the probabilities of all single effects and pairs, and of some larger sets.

    *logs* are the blocks of each log; evidence adds up over logs and blocks. *unknown* is the log
    evidence, less that of no effect, of an unlisted cause by stage. *several* are sets of three
    effects and more of one block that are worth a look. *as_ever*: how likely it is, above
    nothing, that a stage is as it always is where a reference lost the robot for a while, or wheels
    lost hold; no block says anything of it.
    """
    logs = [[Remembering(block) for block in blocks] for blocks in logs]
    owned = sorted({effect for blocks in logs for block in blocks for effect in block.effects})
    singles = {effect: total_of(logs, frozenset({effect})) for effect in owned}
    owned = [
        effect
        for effect in owned
        if not effect.startswith("setup_") or singles[effect][0] > LEAST_GAIN
    ]
    order = sorted(owned, key=lambda effect: -singles[effect][0])[:_PAIRED]
    leaders = {effect for effect in order if singles[effect][0] > _WORTH_PAIRING}
    log_prior = single_priors(owned, stage_of)
    scored: Scores = {frozenset(): (0.0, 0.0, math.log(prior.effects[0]))}
    for effect in owned:
        evidence, likelihood = singles[effect]
        single = frozenset({effect})
        scored[single] = (evidence, likelihood, prior.log_probability_of(single, log_prior))
    bent = _bent_by_a_mistake(logs)
    driven = _of_alone("drive", logs) & singles.keys()
    first_seen = max(driven, key=lambda effect: singles[effect][0], default="")
    alone = singles[first_seen][0] if first_seen else -math.inf
    hides = first_seen if alone > _WORTH_ONE else ""
    # Taken alone, a delay and a lag that are as long say nothing where both do.
    no_single_does = unknown.get("actuation", -math.inf) > max(alone, _WORTH_ONE)
    replayed = _of_alone("firmware", logs)
    nearest = max((singles[effect][0] for effect in replayed & singles.keys()), default=0.0)
    no_program_does = unknown.get("firmware", -math.inf) > max(nearest, _WORTH_ONE)
    quick: set[Effects] = set()
    for first, second in combinations(owned, 2):
        pair = frozenset({first, second})
        if _is_hidden(pair, bent):
            continue
        exact = first in leaders and second in leaders
        exact |= (hides in pair or no_single_does) and pair <= driven
        exact |= no_program_does and pair <= replayed
        evidence, likelihood = total_of(logs, pair) if exact else quick_of(logs, pair)
        if not exact:
            quick.add(pair)
        scored[pair] = (evidence, likelihood, prior.log_probability_of(pair, log_prior))
    scored |= _triples(logs, prior, scored, singles, log_prior)
    scored |= _scores_of(logs, prior, log_prior, several)
    with_bit = _with_a_held_bit(logs, several, scored)
    scored |= _scores_of(logs, prior, log_prior, with_bit)
    several = [*several, *with_bit]
    scored |= _with_others_apart(logs, prior, scored, singles, log_prior, several)
    scored = {effects: one for effects, one in scored.items() if not _is_hidden(effects, bent)}
    scored |= _pairs_within(logs, scored, quick)
    scored = _at_work(logs, scored, owned)
    guesses = {
        stage: evidence + math.log(prior.unknown / len(unknown))
        for stage, evidence in unknown.items()
    }
    company = Company(logs, guesses)
    kept = {effects: company.of(effects) if effects else 0.0 for effects in scored}
    logs_of = {effects: one[0] + one[2] + kept[effects] for effects, one in scored.items()}
    guesses = {
        stage: value
        + max(company.of(frozenset(), but=stage), _elsewhere(logs, logs_of, stage, stage_of))
        for stage, value in guesses.items()
    }
    unseen = with_one_unseen(logs, scored, logs_of, prior, log_prior)
    for larger, (effects, one) in unseen.items():
        if not _is_hidden(larger, bent):
            scored[larger], kept[larger] = one, kept[effects]
            logs_of[larger] = one[0] + one[2] + kept[larger]
    for stage, usual in as_ever.items():
        if usual < 1.0:
            # Beside any cause there is that too; by itself it is one that is not listed.
            nothing, elsewhere = logs_of[frozenset()], guesses.get(stage, -math.inf)
            guesses[stage] = float(np.logaddexp(nothing + math.log1p(-usual), elsewhere))
            logs_of[frozenset()] = nothing + math.log(usual)
    news = moved(logs, prior, logs_of, {effects: one[1] for effects, one in scored.items()})
    logs_of = news.log_probability
    guesses = _no_surer(guesses, logs_of, prior.misdescribed)
    top = max([*logs_of.values(), *guesses.values()])
    total = math.fsum(math.exp(v - top) for v in [*logs_of.values(), *guesses.values()])
    sets = [
        Ranked(
            effects,
            one[0],
            news.log_likelihood[effects],
            math.exp(logs_of[effects] - top) / total,
            kept[effects],
        )
        for effects, one in scored.items()
    ]
    sets.sort(key=lambda one: (-one.probability, sorted(one.effects)))
    return Ranking(
        tuple(sets),
        {stage: math.exp(value - top) / total for stage, value in guesses.items()},
        company.beside(sets[0].effects),
        news.small.get(sets[0].effects, frozenset()),
    )


def _no_surer(
    guesses: Mapping[str, float], logs_of: Mapping[Effects, float], misdescribed: float
) -> dict[str, float]:
    """Return the log probabilities of unlisted causes, by stage, so that all others together keep
    what is *misdescribed* at least."""
    if not guesses:
        return {}
    listed = float(np.logaddexp.reduce(list(logs_of.values())))
    unlisted = float(np.logaddexp.reduce(list(guesses.values())))
    too_sure = unlisted - listed - math.log(1 / misdescribed - 1)
    return {stage: value - max(too_sure, 0.0) for stage, value in guesses.items()}


def _scores_of(
    logs: Sequence[Sequence[Block]],
    prior: Prior,
    log_prior: Mapping[str, float],
    sets: Sequence[Effects],
) -> Scores:
    """Return the scores of those sets of which every name is in the library."""
    return {
        effects: (*total_of(logs, effects), prior.log_probability_of(effects, log_prior))
        for effects in sets
        if effects <= log_prior.keys()
    }


def _at_work(
    logs: Sequence[Sequence[Block]], scored: Mapping[Effects, Score], owned: Sequence[str]
) -> Scores:
    """Return the sets with their evidence less what comes of values that leave no trace.

    A limit that is never reached, a message that is never lost: what has done nothing in these logs
    is not at work in them, and the set without it says the same.
    """
    silent = {effect: silent_of(logs, effect) for effect in owned}
    found: Scores = {}
    for effects, (evidence, likelihood, weight) in scored.items():
        shown = 0.0
        for effect in effects:
            less = scored.get(effects - {effect})
            if less is not None and silent[effect] > -math.inf:
                hidden = math.exp(min(less[0] + silent[effect] - evidence, 0.0))
                shown += math.log(max(1 - hidden, _LEAST_SHOWN))
        found[effects] = evidence + shown, likelihood, weight
    return found


def _triples(
    logs: Sequence[Sequence[Block]],
    prior: Prior,
    scored: Mapping[Effects, Score],
    singles: Mapping[str, tuple[float, float]],
    log_prior: Mapping[str, float],
) -> Scores:
    """Return sets of three: a pair of the motion with an effect that only other blocks see.

    Evidence of separate blocks adds up, so most of these cost nothing.
    """
    seen = {e for blocks in logs for b in blocks if b.name == "motion" for e in b.effects}
    apart = [
        effect for effect in log_prior if effect not in seen and singles[effect][0] > _WORTH_TRIPLES
    ]
    pairs = [effects for effects in scored if len(effects) == 2 and effects <= seen]
    pairs.sort(key=lambda effects: -scored[effects][0])
    found: Scores = {}
    for pair in pairs[:_TRIPLED]:
        for effect in apart:
            names = pair | {effect}
            weight = prior.log_probability_of(names, log_prior)
            if _is_shared(logs, pair, effect):
                found[names] = (*total_of(logs, names), weight)
                continue
            evidence, likelihood, _ = scored[pair]
            alone = singles[effect]
            found[names] = (evidence + alone[0], likelihood + alone[1], weight)
    return found


def _pairs_within(
    logs: Sequence[Sequence[Block]], scored: Mapping[Effects, Score], quick: Set[Effects]
) -> Scores:
    """Return the *quick* pairs within the likeliest larger sets, asked for as exactly as those.

    A dead band beside missed counts was asked for beside a late frame alone: what it gained there
    was the late frame's.
    """
    likely = {effects: one[0] + one[2] for effects, one in scored.items()}
    top = max(likely.values())
    larger = [one for one, value in likely.items() if len(one) > 2 and value > top - NEAR]
    within = {frozenset(pair) for one in larger for pair in combinations(sorted(one), 2)}
    return {pair: (*total_of(logs, pair), scored[pair][2]) for pair in within & quick}


@cache
def _gained_by_chance(numbers: int) -> float:
    """Return twice the log-likelihood that so many numbers gain by chance at most."""
    return float(chi2.isf(_BY_CHANCE, numbers))


def _numbers(effects: Effects) -> int:
    """Return how many numbers there are to fit in effects, of what is not in the catalogue one."""
    known = catalogue()
    told = [known[one].parameters for one in effects if one in known]
    unknown = len(effects) - len(told)
    return unknown + sum(max(1, sum(one.kind == "real" for one in each)) for each in told)


def _causes(effects: Effects) -> int:
    """Return how many causes a set is at least."""
    return len(effects) - (effects >= WHEELS)


def _as_well(one: Ranked, own: Ranked) -> float:
    """Return what a set explains with no more company than *own* has: what only an unlisted cause
    beside it explains, it does not."""
    return one.log_likelihood + min(one.company, own.company)


def _is_shared(logs: Sequence[Sequence[Block]], pair: Effects, effect: str) -> bool:
    """Tell whether a block that sees *effect* sees one of *pair* as well: they must not count
    the same misfit twice."""
    return any(
        effect in block.effects and pair & block.effects for blocks in logs for block in blocks
    )


def _with_a_held_bit(
    logs: Sequence[Sequence[Block]], several: Sequence[Effects], scored: Mapping[Effects, Score]
) -> list[Effects]:
    """Return the best sets with a bit that the codes show, in the place of a bend and beside a
    bias; none where they show none, or where one with it leads already.

    A motion that does not know how its gyro's samples tremble speaks rather of a bend.
    """
    codes = [b for blocks in logs for b in blocks if b.name == "codes" and b.effects >= _BIT]
    leading = max(scored, key=lambda one: scored[one][0] + scored[one][2])
    if leading >= _BIT or math.fsum(block.fit(_BIT).log_evidence for block in codes) < _WORTH_ONE:
        return []
    best = sorted((one for one in several if one in scored), key=lambda one: -scored[one][0])
    found = [(one - _BEND) | _BIT | more for one in best[:_LARGER] for more in (frozenset(), _BIAS)]
    return [one for one in dict.fromkeys(found) if one not in scored]


def _with_others_apart(
    logs: Sequence[Sequence[Block]],
    prior: Prior,
    scored: Mapping[Effects, Score],
    singles: Mapping[str, tuple[float, float]],
    log_prior: Mapping[str, float],
    several: Sequence[Effects],
) -> Scores:
    """Return effects of the motion with what only the drive, the bus or the codes see.

    On real robots wheels and gyro differ in several ways, a drive never does as it is told, and
    clocks and frames have ways of their own.
    """
    seen = {e for blocks in logs for b in blocks if b.name == "motion" for e in b.effects}
    apart = [
        effect for effect in log_prior if effect not in seen and singles[effect][0] > _WORTH_ONE
    ]
    apart.sort(key=lambda effect: -singles[effect][0])
    large = {one for one in several if one in scored}
    small = [one for one in scored if 0 < len(one) < 3 and one <= seen]
    small.sort(key=lambda one: -scored[one][0])
    # What counts lose or make up the drive sees too: both are asked of it together.
    counted = [one for one in small if len(one) == 1 and scored[one][0] > _WORTH_ONE][:_COUNTED]
    found: Scores = {}
    of_block = {
        name: {e for blocks in logs for b in blocks if b.name == name for e in b.effects}
        for name in _MOST_OF
    }
    # What no effect of a set moves stands beside it, the largest too, as it stands beside none:
    # else a clock takes the place of what the wheels do.
    singly = apart[:_BESIDE]
    pairs = _told_together(scored, singles, seen)
    choices = [frozenset(one) for n in range(len(singly) + 1) for one in combinations(singly, n)]
    beside = (one | pair for pair in (frozenset[str](), *pairs) for one in choices)
    for others in dict.fromkeys(one for one in beside if one):
        own = {name: others & of_block[name] for name in _MOST_OF}
        if any(len(own[name]) > n and own[name] not in pairs for name, n in _MOST_OF.items()):
            continue
        evidence, likelihood = total_of(logs, others)
        for some in [*sorted(large, key=sorted), *small[:_TRIPLED], frozenset[str]()]:
            names = some | others
            is_shared = any(_is_shared(logs, some, effect) for effect in others)
            if names in scored or (is_shared and some not in counted):
                continue
            gained, likelier, _ = scored[some]
            together = gained + evidence, likelier + likelihood
            weight = prior.log_probability_of(names, log_prior)
            found[names] = (*(total_of(logs, names) if is_shared else together), weight)
    known = {one for one in large if len(one) + 1 < len(prior.effects)}
    for some in sorted(known, key=lambda one: (-scored[one][0], sorted(one)))[:_LARGER]:
        for effect in apart[:_APART]:
            names = some | {effect}
            if names in found:
                continue
            weight = prior.log_probability_of(names, log_prior)
            found[names] = (*total_of(logs, names), weight)
    return found


def _told_together(
    scored: Mapping[Effects, Score], singles: Mapping[str, tuple[float, float]], seen: set[str]
) -> list[Effects]:
    """Return the best pairs that the motion does not see, and of which each effect tells something
    beside the other: two of a drive that were fitted together, a frame now and then beside a late
    one."""

    def alone(pair: Effects) -> float:
        return max(_WORTH_ONE, *(singles[effect][0] + _WORTH_PAIRING for effect in pair))

    pairs = [one for one in scored if len(one) == 2 and not one & seen]
    pairs = [one for one in pairs if scored[one][0] > alone(one)]
    return sorted(pairs, key=lambda one: (-scored[one][0], sorted(one)))[:_TOGETHER]


def _bent_by_a_mistake(logs: Sequence[Sequence[Block]]) -> tuple[Effects, Effects]:
    """Return the mistakes of the set-up that the motion sees, and the effects they hide."""
    motion = {e for blocks in logs for b in blocks if b.name == "motion" for e in b.effects}
    drive = {e for blocks in logs for b in blocks if b.name == "drive" for e in b.effects}
    gross = frozenset(effect for effect in motion if effect.startswith("setup_"))
    return gross, frozenset((motion | drive) - gross)


def _of_alone(name: str, logs: Sequence[Sequence[Block]]) -> Effects:
    """Return the effects that only one block tells: of these one may hide another.

    About a dead band and a long lag, taken alone, wheels do anything but what a dead band has them;
    and beside a wrong constant a coarse table shows in no digit.
    """
    own = {e for blocks in logs for b in blocks if b.name == name for e in b.effects}
    others = {e for blocks in logs for b in blocks if b.name != name for e in b.effects}
    return frozenset(effect for effect in own - others if not effect.startswith("setup_"))


def _is_hidden(effects: Effects, bent: tuple[Effects, Effects]) -> bool:
    """Tell whether a set names what cannot be told beside a mistake that bends the whole motion.

    A sign or a factor ten leaves no motion to linearise about: it is told alone, and what else
    there is after it has been put right.
    """
    gross, hidden = bent
    return bool(effects & gross) and bool(effects & hidden)


def _elsewhere(
    logs: Sequence[Sequence[Block]],
    logs_of: Mapping[Effects, float],
    stage: str,
    stage_of: Mapping[str, str],
) -> float:
    """Return what listed effects add in the blocks that an unlisted cause of the motion leaves.

    Not those of its own stage: what codes show counts for one cause in the gyro, listed or not.
    """
    if stage in OWN_BLOCK:
        return 0.0
    touched = {e for blocks in logs for b in blocks if b.name == "motion" for e in b.effects}
    touched |= {effect for effect, own in stage_of.items() if own == stage}
    others = [
        value
        for effects, value in logs_of.items()
        if len(effects) <= 2 and effects and not effects & touched
    ]
    return max(others, default=0.0)
