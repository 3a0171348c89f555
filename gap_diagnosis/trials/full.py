"""The full trial: how many cases of each kind it needs, a plan that has them, what others lack."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

from gap_diagnosis.trials import drives, reference_noise, robots
from gap_diagnosis.trials.case import OWN_ENGINE, Case
from gap_diagnosis.trials.plan import Counts, Planned
from gap_diagnosis.trials.sizes import SIZES

FAMILIAR: Final = "familiar"
OTHER: Final = "other engine"
NEW: Final = ("new drive", "new noise", "new robot", OTHER)

EACH_EFFECT: Final = 40
NULLS: Final[Mapping[str, int]] = {FAMILIAR: 1000, **dict.fromkeys(NEW, 400)}
CALIBRATION: Final = 3000

FULL: Final = Counts(8400, nulls=2000, pairs=240, withheld=400, other_engine=400, new_share=0.21)
"""Two thirds of the singles alone are 40 of each effect, whatever is drawn of the prior; the rest
lies four standard deviations or more above what is needed."""

Drawn: TypeAlias = Case | Planned


def full_counts(cases: int) -> Counts:
    """Return the counts of a trial of so many cases, in the proportions of a full one."""

    def part(count: int | None) -> int:
        return (count or 0) * cases // FULL.cases

    return Counts(
        cases,
        nulls=part(FULL.nulls),
        pairs=part(FULL.pairs),
        withheld=part(FULL.withheld),
        other_engine=part(FULL.other_engine),
        new_share=FULL.new_share,
    )


@dataclass(frozen=True)
class Tally:
    """How many cases of each kind there are.

    Attributes:
        effects: by name, those that have it alone, with its name in the library if any has it.
        nulls: without an effect beyond tolerance, by what is new about them.
        calibration: those on which probabilities are held to their word.
    """

    effects: Mapping[str, int]
    nulls: Mapping[str, int]
    calibration: int

    @property
    def lacking(self) -> list[str]:
        """Return in words of what there is less than a full trial has."""
        few = {name: count for name, count in self.effects.items() if count < EACH_EFFECT}
        words = []
        if few:
            least = min(few, key=lambda name: few[name])
            words.append(
                f"{EACH_EFFECT} cases of each effect alone: {len(few)} of {len(self.effects)} have "
                f"fewer, {least} {few[least]}"
            )
        words += [
            f"{needed:,} nulls, {name}: {self.nulls[name]:,}"
            for name, needed in NULLS.items()
            if self.nulls[name] < needed
        ]
        if self.calibration < CALIBRATION:
            words.append(f"{CALIBRATION:,} cases for the calibration: {self.calibration:,}")
        return words


def tally(cases: Iterable[Drawn]) -> Tally:
    """Count cases by what a full trial needs of each kind."""
    effects, nulls, calibration = dict.fromkeys(SIZES, 0), dict.fromkeys(NULLS, 0), 0
    for one in cases:
        if len(one.effects) == 1 and one.kind != "withheld":
            (name,) = one.effects
            effects[name] += 1
        if not (one.true_effects if isinstance(one, Case) else one.effects):
            for name in newness(one) or {FAMILIAR}:
                nulls[name] += 1
        calibration += is_of_the_prior(one)
    return Tally(effects, nulls, calibration)


def newness(one: Drawn) -> frozenset[str]:
    """Return what of a case was not used while the diagnosis was developed."""
    noise = one.noise if isinstance(one, Planned) else one.noise.kind
    new = {
        "new drive": one.drive in drives.NEW,
        "new noise": noise in reference_noise.NEW,
        "new robot": one.robot == robots.NEW,
        OTHER: one.engine != OWN_ENGINE,
    }
    return frozenset(name for name, is_new in new.items() if is_new)


def is_of_the_prior(one: Drawn) -> bool:
    """Tell whether a forecaster may be held to its probabilities: sizes are as it believes before,
    or what was at work was taken from it, or another name."""
    return one.stratum == "prior" or one.kind in ("withheld", "decoy")
