"""Two effects at once: replayed together where that may matter, else the better one alone."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Final

from gap_diagnosis.firmware.candidates import Candidate, RealParameter, listed, smooth
from gap_diagnosis.firmware.comparison import LOG_NO_EXCUSE
from gap_diagnosis.firmware.scored import Scored, log_sum
from gap_diagnosis.firmware.singles import P_DESCRIBED, Singles

_KEPT: Final = 4
_HIDDEN: Final = 2
"""Of an effect so many programs are tried as they come nearest alone, and beside another."""
_LEADERS: Final = 3
_NEWS_NATS: Final = 5.0
_EXPLAINED_NATS: Final = 25.0
_REPRESENTATIVES: Final = ("wheel_radius", "wheelbase", "gyro_sensitivity")
"""Constants that stand for all in a pair: the others leave the same log as one of these."""


class Pairs:
    """All pairs of effects of one log."""

    def __init__(self, singles: Singles, effects: frozenset[str]) -> None:
        """Prepare; which effects lead is found when a pair is first asked for."""
        self._singles = singles
        self._effects = effects
        self._leading: frozenset[str] | None = None

    def pair(self, first: str, second: str) -> list[Scored]:
        """Return the scored candidates of both together.

        Where one effect alone explains the record, the other may be there without a trace; its
        prior then counts only as far as its values leave none. Otherwise both are replayed, if one
        of them is among the few that explain most.
        """
        found = []
        for name, other in ((first, second), (second, first)):
            silent = self._silent(other)
            if silent is not None:
                found += [
                    Scored(
                        one.candidate.beside(silent),
                        one.log_prior + silent.log_prior,
                        one.log_likelihood,
                    )
                    for one in self._singles.single(name)
                ]
        if self._leaders & {first, second}:
            found += [self._no_nearer(one) for one in self._product(first, second)]
        return found

    def _no_nearer(self, one: Scored) -> Scored:
        """Return a candidate that, unless it gives the record, explains no more than a listed
        program with an unlisted change: beside it such a change would explain as much."""
        as_near = self._changed + LOG_NO_EXCUSE
        is_near = one.log_likelihood <= one.log_changed
        return replace(one, log_likelihood=min(one.log_likelihood, as_near)) if is_near else one

    @cached_property
    def _changed(self) -> float:
        return self._singles.changed(self._effects)

    @property
    def _leaders(self) -> frozenset[str]:
        """The effects that explain most, where neither they nor no effect explain all."""
        if self._leading is None:
            self._leading = self._find_leaders()
        return self._leading

    def _find_leaders(self) -> frozenset[str]:
        singles = self._singles
        without = max(one.log_likelihood for one in singles.no_effect)
        enough = singles.bench.highest_score - _EXPLAINED_NATS
        if without >= enough:
            return frozenset()
        best = {
            name: max((one.log_likelihood for one in singles.single(name)), default=without)
            for name in self._effects
        }
        if max(best.values()) >= enough:
            return frozenset()
        order = sorted(best, key=lambda name: -best[name])[:_LEADERS]
        return frozenset(name for name in order if best[name] > without + _NEWS_NATS)

    def _silent(self, effect: str) -> Candidate | None:
        """Return the values of an effect that leave the described program's output as it is."""
        bench = self._singles.bench
        described = bench.score(bench.described)
        same = [
            one
            for one in self._singles.single(effect)
            if abs(one.log_likelihood - described) < 1e-6
        ]
        if not same:
            return None
        best = max(same, key=lambda one: one.log_prior)
        share = min(log_sum(one.log_prior for one in same) - P_DESCRIBED, 0.0)
        return replace(best.candidate, log_prior=share)

    def _product(self, first: str, second: str) -> list[Scored]:
        """Return the candidates of both together: those of the one that explains less as they come
        nearest beside the other, whose real parameter is then sought anew."""
        lead, other = sorted((first, second), key=lambda name: -self._alone(name))
        ours, theirs = self._parameters(lead), self._parameters(other)
        groups: list[list[Candidate]] = []
        if ours and theirs:
            for own, parameter in product(ours, theirs):
                groups += [[one] for one in self._singles.around_both(own, parameter)]
        elif ours:
            for rest in self._best(other, self._best(lead)[0][0]):
                groups += self._around(ours, rest)
        elif theirs:
            for one in self._best(lead):
                groups += self._around(theirs, one)
        else:
            groups = [
                [a.beside(b) for a in one for b in rest]
                for one in self._best(lead)
                for rest in self._best(other, one[0])
            ]
        return self._scored_once(groups)

    def _around(
        self, parameters: list[RealParameter], alike: list[Candidate]
    ) -> list[list[Candidate]]:
        """Return candidates that are one program, with the real parameters sought beside it."""
        return [
            [one.beside(same) for same in alike]
            for parameter in parameters
            for one in self._singles.around(parameter, alike[0])
        ]

    def _alone(self, effect: str) -> float:
        """Return the log likelihood of an effect by itself."""
        scored = self._singles.single(effect)
        return max((one.log_likelihood for one in scored), default=-math.inf)

    def _parameters(self, effect: str) -> list[RealParameter]:
        found = smooth(effect, self._singles.bench.config)
        return [one for one in found if _stands_for_others(one)]

    def _scored_once(self, groups: list[list[Candidate]]) -> list[Scored]:
        """Return the scored candidates of groups that are one program each, replayed once."""
        alike = {id(group[0]): group for group in groups}
        return [
            replace(one, candidate=same, log_prior=one.log_prior + same.log_prior - known.log_prior)
            for one in self._singles.scored(self._singles.programs(group[0] for group in groups))
            for known in [one.candidate]
            for same in alike[id(known)]
        ]

    def _best(self, effect: str, beside: Candidate | None = None) -> list[list[Candidate]]:
        """Return the candidates of the few programs of an effect that come nearest, by program:
        alone, and *beside* another effect, which may hide what they do alone.

        How probable it is that a tick is missed changes no program, and is told all the same.
        """
        singles = self._singles
        alone = sorted(singles.single(effect), key=lambda one: -one.total)
        found: dict[str, list[Candidate]] = {}
        for one in alone:
            alike = found.setdefault(repr(one.candidate.changes), [])
            # One that is there with and without an offset is one.
            if all(one.candidate is not known for known in alike):
                alike.append(one.candidate)
        programs = list(found.values())
        if beside is None:
            return programs[:_KEPT]
        # What another effect hides was dropped, when it was alone, for how the log begins.
        known = listed(effect, singles.bench.config)
        programs += [[one] for one in known if repr(one.changes) not in found]
        together = [alike[0].beside(beside) for alike in programs]
        alike_of = {id(one): alike for one, alike in zip(together, programs, strict=True)}
        nearest = sorted(singles.scored(singles.programs(together)), key=lambda one: -one.total)
        hidden = [alike_of[id(one.candidate)] for one in nearest[:_HIDDEN]]
        likeliest = list(found.values())[:_KEPT]
        return hidden + [one for one in likeliest if all(one is not o for o in hidden)]


def _stands_for_others(parameter: RealParameter) -> bool:
    return parameter.fixed.get("constant", "wheel_radius") in _REPRESENTATIVES
