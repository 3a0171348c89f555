"""The drive's block: which effects bend the way from command to wheel, and how much."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.chance import BY_CHANCE, likeliest_scatter
from gap_diagnosis.drive.columns import LINEAR, TICKS, Variant, may_be_dead, variants
from gap_diagnosis.drive.data import DriveData, Spell
from gap_diagnosis.drive.grid import Weighted
from gap_diagnosis.drive.leftover import Dependence, StandIn, depends_on, stand_in
from gap_diagnosis.drive.likelihood import (
    Setting,
    about,
    evidence,
    fitted_levels,
    laid_at,
    likeliest,
    linear_sizes,
    parameters,
    setting_of,
)
from gap_diagnosis.drive.mistakes import COMMANDS, COUNTS, SETUP, possible
from gap_diagnosis.drive.noise import IDEAL, STARTS, Levels, exact, is_inexact
from gap_diagnosis.drive.shapes import BENT, PARAMETERS, Shapes
from gap_diagnosis.drive.spell import Ends, ends, sought
from gap_diagnosis.drive.told import mends
from gap_diagnosis.drive.unlisted import Manner, Null, manner, own_manner, unlisted
from gap_diagnosis.explanations.known import COUNTING
from gap_diagnosis.hypothesis import Estimate, Fit
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_LOOKED_AT_AGAIN: Final = 3
_HOPELESS: Final = 50.0
_BENDS: Final = 3
"""So often lines of a gain, of braking, of what is within tolerance are laid anew beside what bends
the drive's answer,"""
_STRAIGHT: Final = 0.005
"""where they are straight for less than that, of a gain or as a share of what bends."""
_UNLIKELY: Final = 1e-9
_IMPOSSIBLE: Final = -1e9
_DRIVES: Final = frozenset({*BENT, "drive_gain"})
"""What a drive does."""
_MAY_BEGIN: Final = _DRIVES | COUNTING
"""What may begin and end: of counting the motion says when, but a drive is not to be blamed for
what counts do from then on."""
_AS_LIKELY: Final = 5.0
"""A way that lacks less [nat] is told if it comes first."""
_TOLERATED: Final = frozenset({"drive_gain", "drive_lag", "drive_delay"})
"""What a drive that does as it is told is off by less than its tolerances."""


class DriveBlock:
    """Evidence for effects between recorded commands and recorded wheel angles.

    Besides the actuation effects it weighs errors of counting (`SHARED`), of which it returns no
    parameters, and mistakes of the set-up, of which it does where the commands may be wrong.
    """

    name = "drive"

    def __init__(
        self,
        data: DriveData,
        robot: Robot,
        doubted: frozenset[str],
        without: frozenset[str] = frozenset(),
        own: Manner | None = None,
        answers: Robot | None = None,
    ) -> None:
        """Prepare; *without* are effects that nobody will ask for, *own* is the drive's manner of
        answering, which every hypothesis has; *answers*: the robot with a drive that this log
        alone describes, of which it is no news how it answers."""
        data = data if own is None else replace(data, manner=own.columns)
        self._left = 0.0 if own is None else own.leaves
        self._data = data
        self._doubted = doubted
        self._without = without
        self._robot = robot
        self.answers = answers
        shapes = self._shapes = Shapes(data, robot)
        # Errors of counting scale what the wheels turn, ramps at a limit of acceleration too, which
        # a gain does not: counts of 5 % less see a limit of 5 % less.
        self._nominal = shapes.angle({})
        self._fits: dict[frozenset[str], Fit] = {}
        self._settled: dict[frozenset[str], tuple[Setting, dict[str, float]]] = {}
        self._changes: dict[str, Ends] = {}
        self._levels_with: dict[frozenset[str], Floats] = {}
        self._nameless = -math.inf
        self._null = _null_of(data, robot)
        self._scattered: dict[frozenset[str], DriveBlock | None] = {}
        self._shared: tuple[Ends, ...] | None = None
        self._fits[frozenset()] = Fit((), 0.0, 0.0)

    @cached_property
    def effects(self) -> frozenset[str]:
        """The effects that this log's drive residuals can tell."""
        dead = {"encoder_dead"} if may_be_dead(self._data) else set[str]()
        told = frozenset({*BENT, *LINEAR, *dead, *possible(self._doubted)})
        return told if self.answers is None else told - set(BENT)

    @property
    def robot(self) -> Robot:
        """The robot with the drive that its wheels are held against."""
        return self._robot

    @property
    def undisturbed(self) -> Setting:
        """The drive without any effect, with all that is free beside every one."""
        return self._null.setting

    @property
    def levels(self) -> Levels:
        """The noise levels without any effect."""
        return Levels.of(self._null.levels, self._data.tick_rad)

    def levels_with(self, effects: frozenset[str]) -> Levels:
        """The noise levels under these effects."""
        self.fit(effects)
        return Levels.of(self._levels_with.get(effects, self._null.levels), self._data.tick_rad)

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return the fit of these effects."""
        wanted = frozenset(effects)
        if wanted not in self._fits:
            self._fits[wanted] = self._fit(wanted)
        return self._fits[wanted]

    def manner(self) -> Manner | None:
        """Return the manner in which a drive that does as it is told answers, if it has one that no
        listed effect explains as well."""
        if self.answers is not None:
            return own_manner(self._null, self._robot)
        listed = self.effects - set(SETUP) - self._without
        return manner(
            self._null,
            self._robot,
            lambda: max((self.fit(frozenset({one})).log_evidence for one in listed), default=0.0),
        )

    def answers_otherwise(self) -> bool:
        """Tell whether a drive without a name is likelier than any listed effect of it."""
        listed = (_DRIVES & self.effects) - self._without
        best = max((self.fit(frozenset({one})).log_evidence for one in listed), default=0.0)
        return self.unexplained().log_evidence > max(best, 0.0)

    def unexplained(self) -> Fit:
        """Return the fit of a drive that follows its commands otherwise than any effect has it.

        What a mistake of the commands explains without mending them, something does that is not
        listed. Of a drive that nobody described nothing is otherwise.
        """
        if self.answers is not None:
            return Fit((), 0.0, 0.0)
        for mistake in self.effects & set(SETUP):
            self.fit(frozenset({mistake}))
        found, likelihood = unlisted(self._null, self._robot, self._without, self._spell)
        found = self._beside_manner(found, frozenset())
        return Fit((), max(found, self._nameless), max(likelihood, self._nameless))

    @cached_property
    def goes_with(self) -> list[Dependence]:
        """What the leftover of the described drive goes with and speaks for itself, likeliest
        first."""
        found = [
            replace(one, log_evidence=self._beside_manner(one.log_evidence, frozenset()))
            for one in depends_on(self._null, self._robot)
        ]
        return [one for one in found if one.log_evidence > 0]

    def stand_in(self, one: Dependence, kept: NDArray[np.bool_]) -> StandIn:
        """Return what the leftover goes with as a model of it, fitted on some blocks, bool[m]."""
        return stand_in(self._null, self._robot, one, kept)

    def _fit(self, effects: frozenset[str]) -> Fit:
        counts = effects & BY_CHANCE
        if counts and effects - counts and not effects & set(SETUP):
            scattered = self._scattering(counts)
            if scattered is not None:
                return self._beside_chance(effects, counts, scattered)
        if self._spell is None or not effects & _MAY_BEGIN or effects & set(SETUP):
            return self._fit_all_along(effects)
        if len(effects) == 1 and self._shared is None:
            return self._for_a_while(self._spell, effects, self._fit_all_along(effects))
        return self._beside_others(effects)

    def _scattering(self, counts: frozenset[str]) -> DriveBlock | None:
        """Return the block whose counts scatter by as much as those do that come or go by chance;
        None where they do not."""
        if self._data.scatter.any():
            return None
        if counts not in self._scattered:
            drives = max(self._alone_of(_DRIVES), key=lambda one: one[0], default=None)
            own = self._alone_of(counts)
            ways = {
                one: [
                    way
                    for spell in (None, *(ends.spell for _, ends in self._alone_of({one})))
                    for way in variants(
                        replace(self._data, miscounting=spell), self._nominal, [one]
                    )
                ]
                for one in sorted(counts, key=lambda one: -self.fit(frozenset({one})).log_evidence)
            }
            scatter = likeliest_scatter(self._null, ways)
            changes = [ends for _, ends in (*own, *([drives] if drives else ()))]
            self._scattered[counts] = (
                self._with_scatter(scatter, changes) if scatter.any() else None
            )
        return self._scattered[counts]

    def _alone_of(self, effects: Set[str]) -> list[tuple[float, Ends]]:
        """Return the log evidence and the change of those effects that by themselves have one."""
        fits = {one: self.fit(frozenset({one})) for one in sorted(effects & self.effects)}
        return [
            (fit.log_evidence, self._changes[one])
            for one, fit in fits.items()
            if one in self._changes
        ]

    def _with_scatter(self, scatter: Floats, changes: Sequence[Ends]) -> DriveBlock:
        """Return the block whose counts scatter, and in which effects change where these do."""
        block = copy(self)
        block._data = replace(self._data, scatter=scatter)
        block._null = _null_of(replace(self._null.data, scatter=scatter), self._robot)
        block._fits, block._levels_with, block._settled = {frozenset(): Fit((), 0.0, 0.0)}, {}, {}
        block._shared = tuple({one.spell: one for one in changes}.values())
        return block

    def _beside_chance(
        self, effects: frozenset[str], counts: frozenset[str], scattered: DriveBlock
    ) -> Fit:
        """Return the fit of effects of which some are *counts* that come or go by chance.

        How these scatter is noise: it speaks for no effect beside them, nor for themselves, for the
        wheels of a robot are seldom as even as each other.
        """
        alone, less, found = self.fit(counts), scattered.fit(counts), scattered.fit(effects)
        self._levels_with[effects] = scattered._levels_with[effects]
        return replace(
            found,
            log_evidence=found.log_evidence + alone.log_evidence - less.log_evidence,
            log_likelihood=max(
                found.log_likelihood + alone.log_likelihood - less.log_likelihood, 0.0
            ),
        )

    @cached_property
    def _spell(self) -> Spell | None:
        """The blocks in which the drive answers otherwise, if that is not all along."""
        return sought(self._null, self._robot) if self._data.acting is None else None

    def _acting(self, spell: Spell, effects: frozenset[str]) -> DriveBlock:
        """Return the block of which some effects, all of a drive or of counting, act in a spell
        alone; without any it is the same."""
        block = copy(self)
        block._data = replace(
            self._data,
            acting=spell if effects & _DRIVES else None,
            miscounting=spell if effects & COUNTING else None,
        )
        block._shapes = Shapes(block._data, self._robot)
        block._fits, block._levels_with, block._settled = {frozenset(): Fit((), 0.0, 0.0)}, {}, {}
        block._spell = None
        return block

    def _for_a_while(self, spell: Spell, effect: frozenset[str], all_along: Fit) -> Fit:
        """Return the fit of an effect that acts all along or in a spell, sought about this one."""
        block = self._acting(spell, effect)
        block.fit(effect)
        if effect not in block._settled:
            return all_along
        setting, values = block._settled[effect]
        told = ends(setting, values, block._levels_with[effect], self._robot, spell)
        if not told.told:
            return all_along
        fit, levels = self._fit_within(told, effect, effect)
        if fit.log_evidence <= all_along.log_evidence:
            return all_along
        self._levels_with[effect] = levels
        self._changes |= dict.fromkeys(effect, told)
        return replace(
            fit,
            log_evidence=float(np.logaddexp(fit.log_evidence, all_along.log_evidence)),
            log_likelihood=max(fit.log_likelihood, all_along.log_likelihood),
        )

    def _beside_others(self, effects: frozenset[str]) -> Fit:
        """Return the fit of several effects: what the drive does begins and ends, or what is wrong
        with its counts, or both, each as likely as the others.

        A change is where it is alone, of several where the likeliest is. A gain all along beside
        counts that are wrong from some time on looks like the other way round, and that is told.
        """
        if not self._changes_of(effects, effects):
            return self._fit_all_along(effects)
        kinds = [one for one in (effects & _DRIVES, effects & COUNTING) if one]
        ways = kinds if len(kinds) == 1 else [*kinds, effects & _MAY_BEGIN]
        found = []
        for some in ways:
            places = self._changes_of(some, effects)
            within = [self._fit_within(place, some, effects) for place in places]
            found.append(max(within, key=lambda one: one[0].log_evidence))
        logs = np.array([fit.log_evidence for fit, _ in found])
        told, self._levels_with[effects] = found[int(np.argmax(logs > logs.max() - _AS_LIKELY))]
        every = float(np.logaddexp.reduce(logs)) - math.log(len(ways))
        return replace(told, log_evidence=every)

    def _changes_of(self, some: frozenset[str], effects: frozenset[str]) -> Sequence[Ends]:
        """Return where *some* of several effects may change: nowhere if none does alone."""
        if self._shared is not None:
            return self._shared
        likely = sorted(effects, key=lambda one: -self.fit(frozenset({one})).log_evidence)
        changed = [one for one in likely if one in self._changes]
        return [self._changes[one] for one in changed if one in some or not some & {*changed}][:1]

    def _fit_within(
        self, told: Ends, some: frozenset[str], effects: frozenset[str]
    ) -> tuple[Fit, Floats]:
        """Return the fit of effects of which *some* act in a spell, and its levels of noise."""
        block = self._acting(told.spell, some)
        fit = block.fit(effects)
        levels = block._levels_with.get(effects, self._null.levels)
        when = {name: end.estimate(self._data) for name, end in told.told.items()}
        begins_s, ends_s = self._data.time_s[0], self._data.time_s[-1] + self._data.block_s
        if "start_s" in when:
            begins_s = when["start_s"].value
        if "stop_s" in when:
            ends_s = when["stop_s"].value
        ends_of = {f"{one}.{name}": e for one in some & _DRIVES for name, e in when.items()}
        log_spell = prior.log_of_spell(self._data.angle.shape[1], len(told.told))
        within = replace(
            fit,
            log_evidence=fit.log_evidence + told.log_width + log_spell,
            parameters={**fit.parameters, **ends_of},
            windows=((begins_s, ends_s),) if ends_of else (),
            counting={},
        )
        return within, levels

    def _fit_all_along(self, effects: frozenset[str]) -> Fit:
        silent = {one: self._shapes.log_silent(one) for one in effects & set(BENT)}
        idle = {one for one, share in silent.items() if share == 0.0}
        if idle:
            alone = 0.0 if len(effects) == 1 else -math.inf
            rest = self.fit(effects - idle)
            self._levels_with[effects] = self._levels_with.get(effects - idle, self._null.levels)
            return replace(rest, effects=tuple(sorted(effects)), log_silent=alone)
        settings = [setting_of(one, self._robot, effects) for one in self._variants(effects)]
        best, others, point = 0, 0.0, np.zeros(0)
        weights = np.ones(1)
        if len(settings) == 1:
            (exactly, *_) = self._undisturbed_levels
            point = likeliest(settings[0], exactly, self._alone(effects))
        else:
            # The variant is chosen at the noise levels of no effect, then they are estimated anew.
            quick = self._quick(settings)
            logs = np.array([one[0] for one in quick])
            if effects & set(SETUP) and logs.max() > self._null.evidence - _HOPELESS:
                logs = self._anew(settings, logs)
            best = int(np.argmax(logs))
            weights = np.exp(logs - logs[best])
            others = float(np.log(weights.sum())) - np.log(len(settings))
            point = quick[best][1].best
        setting = settings[best]
        levels, free = self._levels_of(setting, setting.values(point))
        for _ in range(_BENDS if effects & set(BENT) else 0):
            # A larger step takes longer to the limit: what a gain adds there is no straight line.
            # Nor is a little delay beside a lag what it is beside none.
            there, before = about(setting, levels, point), setting.about
            values = setting.values(point)
            setting = laid_at(setting, values, there)
            point = likeliest(setting, levels, values)
            levels, free = self._levels_of(setting, setting.values(point))
            changes = [abs(a - b) for a, b in zip(there, before, strict=True)]
            bends = setting.values(point)
            settled = all(abs(bends[one] - was) <= _STRAIGHT * was for one, was in values.items())
            if settled and max(changes) < _STRAIGHT:
                break
        self._settled[effects] = setting, setting.values(point)
        total, grid, scale_weights = evidence(setting, levels, start=point)
        estimates = parameters(setting, levels, grid, scale_weights)
        self._levels_with[effects] = levels
        if self._doubted >= COMMANDS:
            estimates |= _choices(effects, [one.variant for one in settings], weights)
        gained = self._beside_manner(total + others - self._null.evidence, effects)
        likelihood = max(free - self._null.likelihood, 0.0)
        for one, share in silent.items():
            # A threshold that does nothing says what is said without it.
            if share > -math.inf:
                less = self.fit(effects - {one})
                gained = float(np.logaddexp(gained, less.log_evidence + share))
                likelihood = max(likelihood, less.log_likelihood)
        found = Fit(
            effects=tuple(sorted(effects)),
            log_evidence=gained,
            log_likelihood=likelihood,
            parameters=estimates,
            pareto_k=grid.pareto_k or None,
            log_silent=max(silent.values(), default=-math.inf) if len(effects) == 1 else -math.inf,
            counting=_counting(setting, levels) if effects == {TICKS} else {},
        )
        doubted = bool(effects & set(SETUP)) and not self._doubted & COUNTS
        if doubted and not mends(setting.variant.data, self._robot):
            self._nameless = max(self._nameless, found.log_evidence)
            return replace(found, log_evidence=_IMPOSSIBLE, log_likelihood=0.0)
        return found

    def _alone(self, effects: frozenset[str]) -> dict[str, float]:
        """Return the parameter of each bending effect of several, fitted by itself."""
        if len(effects & set(BENT)) < 2:
            return {}
        key = {one: f"{one}.{PARAMETERS[one]}" for one in effects & set(BENT)}
        fits = {one: self.fit(frozenset({one})).parameters for one in key}
        return {one: float(fits[one][key[one]].value) for one in key if key[one] in fits[one]}

    def _beside_manner(self, gained: float, effects: frozenset[str]) -> float:
        """Return what speaks for effects beside the drive's manner.

        That is not exact, and has what a gain, a lag or a delay could say: within tolerance.
        """
        if self._data.manner is None or gained <= 0.0:
            return gained
        return 0.0 if effects & _TOLERATED else max(gained - self._left, 0.0)

    def only(self, kept: NDArray[np.bool_]) -> DriveBlock:
        """Return the block that sees no more of the same drive than some of its blocks, bool[m]."""
        data = replace(
            self._data,
            seen=self._data.seen & kept,
            turning=np.where(kept, self._data.turning, 0.0),
        )
        data = data.told(data.commanded).beside(self._shapes.angle({}))
        return DriveBlock(data, self._robot, self._doubted, self._without, answers=self.answers)

    @property
    def data(self) -> DriveData:
        """Commands and wheels."""
        return self._data

    def setting_of(self, effect: str) -> Setting:
        """Return the setting of one effect without variants."""
        (variant,) = self._variants(frozenset({effect}))
        return setting_of(variant, self._robot, frozenset({effect}))

    def _variants(self, effects: frozenset[str]) -> list[Variant]:
        """Return the variants of a set; of a mistake beside other effects the best one alone."""
        made = variants(self._data, self._nominal, sorted(effects), self._doubted)
        wrong = effects & set(SETUP)
        if not wrong or wrong == effects:
            return made
        found = self.fit(wrong).parameters
        known = {name: one.value for name, one in found.items()}
        same = [
            one
            for one in made
            if all(
                known.get(f"{effect}.{n}", v) == v
                for effect in wrong
                for n, v in one.values.items()
            )
        ]
        return same or made

    def _anew(self, settings: Sequence[Setting], logs: Floats) -> Floats:
        """Return log evidences of the best few at noise levels of their own; the rest are lost.

        A wrong unit makes the noise of no effect so large that all units look alike.
        """
        found = np.full(len(logs), -np.inf)
        for place in np.argsort(-logs)[:_LOOKED_AT_AGAIN]:
            levels, _ = self._levels_of(settings[place], {})
            found[place] = evidence(settings[place], levels, rough=True)[0]
        return found

    def _quick(self, settings: Sequence[Setting]) -> list[tuple[float, Weighted, Floats]]:
        """Return the evidence of each variant, all at those noise levels of no effect that suit the
        best of them better."""
        found = [
            [evidence(setting, levels, rough=True) for setting in settings]
            for levels in self._undisturbed_levels
        ]
        return max(found, key=lambda some: max(one[0] for one in some))

    @property
    def _undisturbed_levels(self) -> list[Floats]:
        """The noise levels of no effect, whether what goes astray by it is another's or not."""
        own = self._null.levels
        return [exact(own), *([own.copy()] if is_inexact(own) else ())]

    def _levels_of(self, setting: Setting, values: Mapping[str, float]) -> tuple[Floats, float]:
        """Return noise levels, sought from those of no effect and, for other data, elsewhere."""
        starts = [
            *self._undisturbed_levels,
            *(STARTS if setting.variant.log_constant or setting.variant.values else ()),
        ]
        levels, free = fitted_levels(setting, values, *starts)
        return levels, free + setting.variant.log_constant


def _null_of(data: DriveData, robot: Robot) -> Null:
    """Return what data say of no effect."""
    none = Variant(data, np.zeros((0, *data.angle.shape)), ())
    setting = setting_of(none, robot, frozenset())
    found = [fitted_levels(setting, {}, start) for start in (*STARTS, IDEAL)]
    levels, likelihood = max(found, key=lambda one: one[1])
    # From here every effect's levels are sought: what is found there is no effect's doing.
    again = fitted_levels(setting, {}, exact(levels))
    levels, likelihood = max((levels, likelihood), again, key=lambda one: one[1])
    return Null(setting, levels, likelihood, evidence(setting, levels)[0])


def _counting(setting: Setting, levels: Floats) -> dict[str, float]:
    """Return the size of counts too many in a turn, where nothing else acts."""
    return {TICKS: float(linear_sizes(setting, levels)[0])}


def _choices(
    effects: frozenset[str], made: Sequence[Variant], weights: Floats
) -> dict[str, Estimate]:
    """Return what the variants say of mistakes: each parameter with its probabilities."""
    found: dict[str, Estimate] = {}
    best = made[int(np.argmax(weights))]
    for effect in effects & set(SETUP):
        for name, value in best.values.items():
            shares: dict[str, float] = {}
            for one, weight in zip(made, weights / weights.sum(), strict=True):
                key = str(one.values[name])
                shares[key] = shares.get(key, 0.0) + float(weight)
            likely = {key: share for key, share in shares.items() if share > _UNLIKELY}
            found[f"{effect}.{name}"] = Estimate(value, probabilities=likely)
    return found
