"""Which cases a trial has: how many of each kind and stratum, and of which effects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle, islice
from typing import Final

import numpy as np

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.priors import default_prior
from gap_diagnosis.trials import drives, reference_noise, robots
from gap_diagnosis.trials.case import OTHER_ENGINE, OWN_ENGINE, STRATA, Kind, Stratum
from gap_diagnosis.trials.sizes import SIZES, UNLISTED
from gap_diagnosis.trials.truth import canonical, class_of
from hil_harness.effects import catalogue

Draw = np.random.Generator

_NEW_SHARE: Final = 0.15


@dataclass(frozen=True)
class Counts:
    """How many cases.

    Attributes:
        cases: all of them; what is left beside the others has one effect each.
        nulls, pairs: without an effect, with two; None: a fifth, a tenth.
        withheld: whose effect is taken out of the library; as many decoys, where another one is.
            Of the nulls as large a share goes without names as of all the others.
        other_engine: without an effect, in another engine's physics.
        strata: among which all are shared out evenly.
        factor: smallest and largest size in stratum *limit*, over the detection limit.
        effects: only these; empty: all.
        new_share: of drives, reference noises and robots of kinds not used while developing.
    """

    cases: int
    nulls: int | None = None
    pairs: int | None = None
    withheld: int = 0
    other_engine: int = 0
    strata: tuple[Stratum, ...] = STRATA
    factor: tuple[float, float] = (0.3, 10.0)
    effects: tuple[str, ...] = ()
    new_share: float = _NEW_SHARE

    def __post_init__(self) -> None:
        """Refuse counts that do not fit."""
        unknown = [one for one in self.effects if one not in SIZES]
        if unknown:
            raise DiagnosisError(
                f"{unknown[0]}: no effect of trials: expected a name of `chiplog effects`"
            )
        if not self.strata or any(one not in STRATA for one in self.strata):
            raise DiagnosisError(
                f"strata {', '.join(self.strata)}: expected some of {', '.join(STRATA)}"
            )
        if not 0 < self.factor[0] <= self.factor[1]:
            raise DiagnosisError(f"factor {self.factor}: expected two sizes, the smaller one first")
        if self.singles < 0:
            raise DiagnosisError(
                f"{self.cases} cases: fewer than the nulls, pairs, withheld and other "
                "engine's together"
            )

    @property
    def null_count(self) -> int:
        """Cases without an effect."""
        return self.cases // 5 if self.nulls is None else self.nulls

    @property
    def pair_count(self) -> int:
        """Cases with two effects."""
        return self.cases // 10 if self.pairs is None else self.pairs

    @property
    def singles(self) -> int:
        """Cases with one effect."""
        others = self.null_count + self.pair_count + 2 * self.withheld + self.other_engine
        return self.cases - others


@dataclass(frozen=True)
class Planned:
    """A case to be drawn."""

    stratum: Stratum
    kind: Kind
    effects: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    drive: str = field(default=drives.FAMILIAR[0])
    robot: str = field(default=robots.FAMILIAR)
    noise: str = field(default=reference_noise.FAMILIAR[0])
    engine: str = OWN_ENGINE


def planned(counts: Counts, draw: Draw) -> list[Planned]:
    """Return the cases of a trial in an order that says nothing."""
    names = list(counts.effects or SIZES)
    order = cycle([names[place] for place in draw.permutation(len(names))])
    strata = cycle(counts.strata)
    found = [*_nulls(counts, strata), *_singles(counts, strata, order)]
    found += [Planned(next(strata), "pair", _pair(order)) for _ in range(counts.pair_count)]
    found += _withheld(counts, strata, order, draw)
    found += [Planned("field", "null", engine=OTHER_ENGINE) for _ in range(counts.other_engine)]
    if "prior" in counts.strata:
        found = [_of_prior(one, names, draw) if one.stratum == "prior" else one for one in found]
    found = _nulls_short_of_names(found, counts, draw)
    return [_world(found[place], counts, draw) for place in draw.permutation(len(found))]


def _nulls(counts: Counts, strata: Iterator[Stratum]) -> list[Planned]:
    return [Planned(next(strata), "null") for _ in range(counts.null_count)]


def _singles(counts: Counts, strata: Iterator[Stratum], order: Iterator[str]) -> list[Planned]:
    return [Planned(next(strata), "single", (next(order),)) for _ in range(counts.singles)]


def _pair(order: Iterator[str]) -> tuple[str, str]:
    """Return two effects that differ by more than a name."""
    firsts = islice(order, len(SIZES))
    for first in firsts:
        for second in islice(order, len(SIZES)):
            if _may_pair(first, second):
                return first, second
    raise DiagnosisError("pairs: expected two effects that differ by more than a name")


def _gross(effect: str) -> bool:
    """Tell whether an effect is a mistake of the set-up, which hides what stands beside it."""
    return effect.startswith("setup_")


def _may_pair(first: str, second: str) -> bool:
    one, other = canonical({first}), canonical({second})
    return not _gross(first) and not _gross(second) and one.isdisjoint(other)


def _withheld(
    counts: Counts, strata: Iterator[Stratum], order: Iterator[str], draw: Draw
) -> list[Planned]:
    """Return cases whose effect is withheld, and for each one a decoy with the full truth in it."""
    found = []
    listed = _listed(counts.effects or SIZES)
    away: Stratum = "limit" if "limit" in counts.strata else next(strata)
    for _ in range(counts.withheld):
        effect = listed[int(draw.integers(len(listed)))]
        others = [one for one in _listed(SIZES) if one not in class_of(effect)]
        other = others[int(draw.integers(len(others)))]
        found.append(Planned(away, "withheld", (effect,), tuple(sorted(class_of(effect)))))
        found.append(Planned(away, "decoy", (effect,), tuple(sorted(class_of(other)))))
    return found


def _listed(names: Iterable[str]) -> list[str]:
    return [one for one in names if one not in UNLISTED]


def _nulls_short_of_names(found: Sequence[Planned], counts: Counts, draw: Draw) -> list[Planned]:
    """Return the cases with names taken from as large a share of the nulls as of the rest: that
    something is withheld must not say that something is there."""
    nulls = [place for place, one in enumerate(found) if one.kind == "null"]
    short = sum(bool(one.without) for one in found)
    cases = list(found)
    if not short:
        return cases
    count = round(len(nulls) * short / (len(found) - len(nulls)))
    # in turn what a withheld effect may be, and what a decoy's may
    libraries = cycle([_listed(counts.effects or SIZES), _listed(SIZES)])
    for place in draw.permutation(nulls)[:count].tolist():
        names = next(libraries)
        gone = class_of(names[int(draw.integers(len(names)))])
        cases[place] = replace(cases[place], without=tuple(sorted(gone)))
    return cases


def _of_prior(one: Planned, names: Sequence[str], draw: Draw) -> Planned:
    """Return a case as the tool's own prior has them: how many at once, even over stages, then over
    effects; a cause without a name as often as it is believed in."""
    prior = default_prior()
    if draw.random() < prior.unknown:
        nameless = sorted(UNLISTED & frozenset(names))
        if nameless:
            return Planned("prior", "single", (nameless[int(draw.integers(len(nameless)))],))
    weights = np.array(prior.effects)
    count = int(draw.choice(len(weights), p=weights / weights.sum()))
    chosen: list[str] = []
    listed = [name for name in names if name not in UNLISTED and not (count > 1 and _gross(name))]
    while len(chosen) < count and listed:
        stages = sorted({catalogue()[name].stage for name in listed})
        stage = stages[int(draw.integers(len(stages)))]
        members = [name for name in listed if catalogue()[name].stage == stage]
        name = members[int(draw.integers(len(members)))]
        if all(_may_pair(other, name) for other in chosen):
            chosen.append(name)
        else:
            listed = [other for other in listed if other not in (*chosen, name)]
    kinds: tuple[Kind, ...] = ("null", "single", "pair", "several")
    return Planned("prior", kinds[min(len(chosen), len(kinds) - 1)], tuple(chosen))


def _world(one: Planned, counts: Counts, draw: Draw) -> Planned:
    """Return a case with kinds of drive, robot and reference noise; most of them familiar."""

    def pick(familiar: Sequence[str], new: Sequence[str]) -> str:
        names = new if draw.random() < counts.new_share else familiar
        return names[int(draw.integers(len(names)))]

    return replace(
        one,
        drive=pick(drives.FAMILIAR, drives.NEW),
        robot=pick(
            [robots.FAMILIAR], [robots.FAMILIAR if one.engine == OTHER_ENGINE else robots.NEW]
        ),
        noise=pick(reference_noise.FAMILIAR, reference_noise.NEW),
    )
