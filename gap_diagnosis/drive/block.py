"""The drive's block: which effects bend the way from command to wheel, and how much."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.columns import LINEAR, SHARED, Variant, may_be_dead, variants
from gap_diagnosis.drive.data import DriveData, drive_data
from gap_diagnosis.drive.grid import Values, Weighted, integrate, locate
from gap_diagnosis.drive.linear import Grams, draw_linear
from gap_diagnosis.drive.mistakes import COMMANDS, COUNTS, SETUP, possible
from gap_diagnosis.drive.noise import (
    STARTS,
    Levels,
    fit_levels,
    log_level_prior,
    marginal,
    whitened,
)
from gap_diagnosis.drive.shapes import BENT, WAVE, Coordinate, Shapes
from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_SAMPLES: Final = 2000
_LOOKED_AT_AGAIN: Final = 3
_HOPELESS: Final = 50.0
_UNLIKELY: Final = 1e-9
_FREE_SD: Final = 0.3
"""Of linear coefficients while noise levels and best likelihoods are sought."""
_NUISANCE_SD: Final = {"gain": 0.5 * prior.GAIN.tolerance, "lag": 0.005}
"""Deviations that every hypothesis may have, beside that of the delay: half the tolerances."""
_GIVES_WAY: Final = 0.006
"""Of its rate a wheel is off under load: what is unlisted must show beyond that."""


_HALF_S: Final = 0.5
_AS_TOLD: Final = 0.3 * prior.GAIN.tolerance
"""A drive that is off by less of its rates does as it is told: on a slope every loop gives way."""
_MENDED: Final = 0.5
_MATTERS: Final = 0.05
"""Where a mistake has been put right, wheels go no more than half as far wrong as they go, forwards
and in turns: in what of the two is not next to nothing beside the other."""
_IMPOSSIBLE: Final = -1e9
_STANDS: Final = -0.5
"""Of its rate a drive that does as it is told gives way by less, however slow that is: one that
gives way by more stands."""


def drive_block(
    recording: Recording, robot: Robot, doubted: frozenset[str] = COMMANDS | COUNTS
) -> DriveBlock | None:
    """Return the block, or None where the log holds no commands or no motion.

    *doubted*: the signals of which a mistake of the set-up may be.
    """
    data = drive_data(recording, robot)
    return None if data is None else DriveBlock(data, robot, doubted)


@dataclass(frozen=True)
class Setting:
    """A variant with everything that does not change from grid point to grid point."""

    variant: Variant
    shapes: Shapes
    coordinates: tuple[Coordinate, ...]
    has_gain: bool
    nuisances: Floats
    nuisance_sd: Floats

    @property
    def linear_sizes(self) -> tuple[prior.Size, ...]:
        gains = (prior.GAIN, prior.GAIN) if self.has_gain else ()
        return (*gains, *self.variant.sizes)

    @property
    def bounds(self) -> list[tuple[float, float]]:
        return [(one.low, one.high) for one in self.coordinates]

    def values(self, point: Floats) -> dict[str, float]:
        return {
            one.effect: float(one.value(point[i : i + 1])[0])
            for i, one in enumerate(self.coordinates)
        }

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Return residual, gain columns: float64[1 + 2 or 1, 2, m]."""
        angle = self.shapes.angle(values)
        measured = self.variant.data.angle
        residual = (measured - angle)[np.newaxis]
        if not self.has_gain:
            return residual
        return np.concatenate((residual, self.shapes.gain_columns(values, angle)))


@dataclass(frozen=True)
class Foreign:
    """What a drive explains that answers in some way of its own.

    Attributes:
        evidence, likelihood: their logarithms, less those of no effect.
        sizes: of its columns, the best ones.
    """

    evidence: float
    likelihood: float
    sizes: Floats


class DriveBlock:
    """Evidence for effects between recorded commands and recorded wheel angles.

    Besides the actuation effects it weighs errors of counting (`SHARED`), of which it returns no
    parameters, and mistakes of the set-up, of which it does where the commands may be wrong.
    """

    name = "drive"

    def __init__(self, data: DriveData, robot: Robot, doubted: frozenset[str]) -> None:
        self._data = data
        self._doubted = doubted
        self._robot = robot
        shapes = Shapes(data, robot)
        # What scales with the counts is what a gain adds: a column that bent otherwise would let
        # counting errors explain the drive's dynamics.
        self._nominal = np.sum(shapes.gain_columns({}, shapes.angle({})), axis=0)
        self._fits: dict[frozenset[str], Fit] = {}
        self._levels_with: dict[frozenset[str], Floats] = {}
        self._levels: Floats = STARTS[0]
        self._nameless = -math.inf
        self._null = 0.0
        setting = self._setting(Variant(data, np.zeros((0, *self._nominal.shape)), ()), frozenset())
        found = [self._fit_levels(setting, {}, start) for start in STARTS]
        self._levels, self._null = max(found, key=lambda one: one[1])
        self._null_evidence = self._evidence(setting, self._levels)[0]
        self._fits[frozenset()] = Fit((), 0.0, 0.0)

    @cached_property
    def effects(self) -> frozenset[str]:
        """The effects that this log's drive residuals can tell."""
        dead = {"encoder_dead"} if may_be_dead(self._data) else set[str]()
        return frozenset({*BENT, *LINEAR, *dead, *possible(self._doubted)})

    @property
    def levels(self) -> Levels:
        """The noise levels without any effect."""
        return Levels.of(self._levels, self._data.tick_rad)

    def levels_with(self, effects: frozenset[str]) -> Levels:
        """The noise levels under these effects."""
        self.fit(effects)
        return Levels.of(self._levels_with.get(effects, self._levels), self._data.tick_rad)

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return the fit of these effects."""
        wanted = frozenset(effects)
        if wanted not in self._fits:
            self._fits[wanted] = self._fit(wanted)
        return self._fits[wanted]

    def unexplained(self) -> Fit:
        """Return the fit of a drive that follows its commands otherwise than any effect has it.

        Linear dynamics of other time constants with a speed that bends with the command, answers
        that come late, or a gain of each wheel, steady or some function of its speed, all of
        unknown size: what is left to a motor, a velocity loop or an engine not in the library. Or
        one that answers slow commands in a way of their own, or whose poles show in its rate.

        What a mistake of the commands explains without mending them, something does that is not
        listed.
        """
        shapes = Shapes(self._data, self._robot)
        does_as_told = self._off() < _AS_TOLD
        found = []
        for columns in shapes.foreign():
            one = self._foreign(columns)
            found.append(replace(one, evidence=min(one.evidence, 0.0)) if does_as_told else one)
        slow = shapes.slow()
        if len(slow):
            one = self._foreign(slow)
            if not does_as_told or one.sizes.min() < _STANDS:
                found.append(one)
        poles = self._poles(shapes.waves())
        if np.hypot(poles.sizes[::2], poles.sizes[1::2]).max() * WAVE > _AS_TOLD:
            found.append(poles)
        evidences = [one.evidence for one in found]
        evidence = float(np.logaddexp.reduce(evidences)) - math.log(len(found))
        for mistake in self.effects & set(SETUP):
            self.fit(frozenset({mistake}))
        likelihood = max(one.likelihood for one in found)
        return Fit((), max(evidence, self._nameless), max(likelihood, self._nameless))

    def _foreign(self, columns: Floats) -> Foreign:
        """Return what columns of unknown size explain."""
        variant = Variant(self._data, columns, (prior.FOREIGN,) * len(columns))
        setting = self._setting(variant, frozenset())
        levels, free = self._fit_levels(setting, {}, self._levels)
        # A load, a caster that swings round: a loop gives way by a little that no noise level has.
        nothing = self._setting(variants(self._data, self._nominal, ())[0], frozenset())
        before = self._evidence(nothing, _giving_way(self._levels), rough=True)[0]
        evidence = self._evidence(setting, _giving_way(levels), rough=True)[0] - before
        # Effects of the list are weighed without that allowance: it must not favour what is not.
        strictly = self._evidence(setting, levels, rough=True)[0] - self._null_evidence
        return Foreign(
            min(evidence, strictly), max(free - self._null, 0.0), self._sizes(setting, levels)
        )

    def _poles(self, waves: Sequence[Floats]) -> Foreign:
        """Return what the likeliest number of poles explains, as if any were as likely."""
        nothing = self._setting(variants(self._data, self._nominal, ())[0], frozenset())
        stacked = np.concatenate((nothing.columns({})[:1], *waves))
        white, _ = whitened(self._data, stacked, Levels.of(self._levels, self._data.tick_rad))
        columns = white[1:].reshape(len(waves), -1, white.shape[1])
        gains = []
        for one in columns:
            pull = one @ white[0]
            gains.append(float(pull @ np.linalg.lstsq(one @ one.T, pull)[0]))
        best = self._foreign(waves[int(np.argmax(gains))])
        return replace(best, evidence=best.evidence - math.log(len(waves)))

    def _sizes(self, setting: Setting, logs: Floats) -> Floats:
        """Return the best sizes of a setting's linear columns."""
        data = setting.variant.data
        linear = np.concatenate((setting.variant.columns, setting.nuisances))
        sd = np.concatenate(([one.high for one in setting.linear_sizes], setting.nuisance_sd))
        residual = setting.columns({})[:1]
        white, _ = whitened(
            data, np.concatenate((residual, linear)), Levels.of(logs, data.tick_rad)
        )
        stiff = white[1:] @ white[1:].T + np.diag(sd**-2.0)
        sizes = np.linalg.solve(stiff, white[1:] @ white[0])
        return np.asarray(sizes[: len(setting.variant.columns)])

    def _off(self) -> float:
        """Return by which share of their rates the wheels do otherwise than they are told."""
        told, gone, seen = self._ways(self._data)
        wrong, told = (gone - told)[seen], told[seen]
        return math.sqrt(float(np.mean(wrong**2)) / max(float(np.mean(told**2)), 1e-12))

    def _ways(self, data: DriveData) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Return [2, k] each: how far wheels are told to go in half a second, how far they go, and
        where that is seen.

        So long that the rounding of counts does not matter.
        """
        described = Shapes(data, self._robot).angle({})
        apart = max(1, round(_HALF_S / data.block_s))
        told, gone = (one[:, apart:] - one[:, :-apart] for one in (described, data.angle))
        return told, gone, data.seen[:, apart:] & data.seen[:, :-apart]

    def _mends(self, data: DriveData) -> bool:
        """Tell whether wheels do about as they are told, forwards and in turns, in data in which a
        mistake of the set-up has been put right."""
        told, gone, seen = self._ways(data)
        both = np.all(seen, axis=0)
        if not both.any():
            return True
        sides = np.array([[0.5, 0.5], [-0.5, 0.5]])
        wrong, told, gone = (
            np.sqrt(np.mean((sides @ one[:, both]) ** 2, axis=1))
            for one in (gone - told, told, gone)
        )
        moved = np.maximum(told, gone)
        matters = moved > _MATTERS * moved.max()
        return bool(np.all(wrong[matters] < _MENDED * moved[matters]))

    def _fit(self, effects: frozenset[str]) -> Fit:
        settings = [self._setting(one, effects) for one in self._variants(effects)]
        # The variant is chosen at the noise levels of no effect, then they are estimated anew.
        best, others, point = 0, 0.0, np.zeros(0)
        weights = np.ones(1)
        if len(settings) == 1:
            point = self._locate(settings[0])
        else:
            quick = [self._evidence(setting, self._levels, rough=True) for setting in settings]
            logs = np.array([one[0] for one in quick])
            if effects & set(SETUP) and logs.max() > self._null_evidence - _HOPELESS:
                logs = self._anew(settings, logs)
            best = int(np.argmax(logs))
            weights = np.exp(logs - logs[best])
            others = float(np.log(weights.sum())) - np.log(len(settings))
            point = quick[best][1].best
        levels, free = self._levels_of(settings[best], settings[best].values(point))
        self._levels_with[effects] = levels
        total, grid, scale_weights = self._evidence(settings[best], levels, start=point)
        parameters = self._parameters(settings[best], levels, grid, scale_weights)
        if self._doubted >= COMMANDS:
            parameters |= _choices(effects, [one.variant for one in settings], weights)
        found = Fit(
            effects=tuple(sorted(effects)),
            log_evidence=total + others - self._null_evidence,
            log_likelihood=max(free - self._null, 0.0),
            parameters=parameters,
            pareto_k=grid.pareto_k,
            log_silent=self._log_silent(effects),
        )
        doubted = bool(effects & set(SETUP)) and not self._doubted & COUNTS
        if doubted and not self._mends(settings[best].variant.data):
            self._nameless = max(self._nameless, found.log_evidence)
            return replace(found, log_evidence=_IMPOSSIBLE, log_likelihood=0.0)
        return found

    def _log_silent(self, effects: frozenset[str]) -> float:
        shapes = Shapes(self._data, self._robot)
        silent = [shapes.log_silent(one) for one in effects & set(BENT) if len(effects) == 1]
        return silent[0] if silent else -math.inf

    @property
    def data(self) -> DriveData:
        """Commands and wheels."""
        return self._data

    def setting_of(self, effect: str) -> Setting:
        """Return the setting of one effect without variants."""
        (variant,) = self._variants(frozenset({effect}))
        return self._setting(variant, frozenset({effect}))

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
            found[place] = self._evidence(settings[place], levels, rough=True)[0]
        return found

    def _levels_of(self, setting: Setting, values: Mapping[str, float]) -> tuple[Floats, float]:
        """Return noise levels, sought from those of no effect and, for other data, elsewhere."""
        starts = [
            self._levels,
            *(STARTS if setting.variant.log_constant or setting.variant.values else ()),
        ]
        found = [self._fit_levels(setting, values, start) for start in starts]
        levels, free = max(found, key=lambda one: one[1])
        return levels, free + setting.variant.log_constant

    def _setting(self, variant: Variant, effects: frozenset[str]) -> Setting:
        shapes = Shapes(variant.data, self._robot)
        nominal = shapes.angle({})
        has_gain = "drive_gain" in effects
        columns, sds = [], []
        if not has_gain:
            columns += list(shapes.gain_columns({}, nominal))
            sds += [_NUISANCE_SD["gain"]] * 2
        delays = {"drive_lag": _NUISANCE_SD["lag"], "drive_delay": self._data.delay_sd_s}
        for effect, step in delays.items():
            if effect not in effects:
                columns.append((shapes.angle({effect: step}) - nominal) / step)
                sds.append(step)
        nuisances = np.zeros((0, *nominal.shape))
        if columns:
            nuisances = np.stack(columns)
        return Setting(
            variant,
            shapes,
            tuple(shapes.coordinate(one) for one in sorted(effects) if one in BENT),
            has_gain,
            nuisances,
            np.array(sds),
        )

    def _fit_levels(
        self, setting: Setting, values: Mapping[str, float], start: Floats
    ) -> tuple[Floats, float]:
        made = setting.columns(values)
        linear = np.concatenate((made[1:], setting.variant.columns, setting.nuisances))
        free = np.array([_FREE_SD * max(1.0, one.high) for one in setting.linear_sizes])
        sd = np.concatenate((free, setting.nuisance_sd))
        data = setting.variant.data
        levels, value = fit_levels(data, made[0], linear, sd, start)
        # the width of the free coefficients' prior is no part of the best likelihood
        if len(free):
            white, _ = whitened(data, linear[: len(free)], Levels.of(levels, data.tick_rad))
            scaled = (white @ white.T) * np.outer(free, free) + np.eye(len(free))
            value += 0.5 * float(np.linalg.slogdet(scaled)[1])
        return levels, value

    def _evidence(
        self, setting: Setting, logs: Floats, *, rough: bool = False, start: Floats | None = None
    ) -> tuple[float, Weighted, Floats]:
        """Return the log evidence at noise levels, its points, and the prior's scales."""
        log_density, sd = self._density(setting, logs, rough=rough)
        points = integrate(log_density, setting.bounds, start)
        return points.log_integral, points, sd

    def _locate(self, setting: Setting) -> Floats:
        log_density, _ = self._density(setting, self._levels, rough=True)
        return locate(log_density, setting.bounds)

    def _density(self, setting: Setting, logs: Floats, *, rough: bool) -> tuple[Values, Floats]:
        """Return the log posterior density of the bending parameters, and the prior's scales."""
        data = setting.variant.data
        levels = Levels.of(logs, data.tick_rad)
        fixed = np.concatenate((setting.variant.columns, setting.nuisances))
        white_fixed, log_determinant = whitened(data, fixed, levels)
        constant = log_level_prior(logs) - 0.5 * log_determinant + setting.variant.log_constant
        sd = _scale_products(setting.linear_sizes, setting.nuisance_sd, count=2 if rough else 4)

        def log_density(points: Floats) -> Floats:
            grams = _grams(setting, levels, white_fixed, points)
            values = marginal(
                grams.gram[:, np.newaxis],
                grams.pull[:, np.newaxis],
                grams.power[:, np.newaxis],
                sd[np.newaxis],
            )
            total = np.logaddexp.reduce(values, axis=1) - np.log(len(sd)) + constant
            for i, one in enumerate(setting.coordinates):
                total = total + one.log_prior(points[:, i])
            return np.asarray(total, dtype=np.float64)

        return log_density, sd

    def _parameters(
        self, setting: Setting, logs: Floats, grid: Weighted, sd: Floats
    ) -> dict[str, Estimate]:
        """Return estimates from draws of the grid, and of the linear coefficients given a point."""
        random = np.random.default_rng(0)
        weight = np.exp(grid.log_value - grid.log_integral)
        chosen = random.choice(len(weight), size=_SAMPLES, p=weight / weight.sum())
        spread = random.uniform(-0.5, 0.5, (_SAMPLES, len(grid.cell))) * grid.cell
        points = grid.point[chosen] + spread
        found = {
            one.key: _estimate(one.value(np.clip(points[:, i], one.low, one.high)))
            for i, one in enumerate(setting.coordinates)
        }
        if setting.has_gain:
            data = setting.variant.data
            levels = Levels.of(logs, data.tick_rad)
            fixed = np.concatenate((setting.variant.columns, setting.nuisances))
            white_fixed, _ = whitened(data, fixed, levels)
            used, place = np.unique(chosen, return_inverse=True)
            grams = _grams(setting, levels, white_fixed, grid.point[used])
            gains = draw_linear(grams, sd, place, random)
            found["drive_gain.left"] = _estimate(gains[:, 0])
            found["drive_gain.right"] = _estimate(gains[:, 1])
        return found


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


def _giving_way(logs: Floats) -> Floats:
    """Return log levels with a rate error of at least what any velocity loop has under load."""
    return np.asarray(np.maximum(logs, np.log([1e-9, 1e-9, _GIVES_WAY, 1e-9])))


def _scale_products(sizes: Sequence[prior.Size], nuisance_sd: Floats, count: int) -> Floats:
    """Return the products of the prior's scales: float64[s, linear + nuisances]."""
    products = list(itertools.product(*(one.scales(count) for one in sizes)))
    rows = np.array(products, dtype=np.float64).reshape(len(products), len(sizes))
    return np.hstack([rows, np.tile(nuisance_sd, (len(rows), 1))])


def _grams(setting: Setting, levels: Levels, white_fixed: Floats, points: Floats) -> Grams:
    data = setting.variant.data
    own = 2 if setting.has_gain else 0
    size = own + len(white_fixed)
    gram = np.zeros((len(points), size, size))
    pull = np.zeros((len(points), size))
    power = np.zeros(len(points))
    shared = white_fixed @ white_fixed.T
    for i, point in enumerate(points):
        white, _ = whitened(data, setting.columns(setting.values(point)), levels)
        power[i] = white[0] @ white[0]
        pull[i, :own] = white[1:] @ white[0]
        pull[i, own:] = white_fixed @ white[0]
        gram[i, :own, :own] = white[1:] @ white[1:].T
        gram[i, own:, own:] = shared
        gram[i, :own, own:] = white[1:] @ white_fixed.T
        gram[i, own:, :own] = gram[i, :own, own:].T
    return Grams(gram, pull, power)


def _estimate(samples: Floats) -> Estimate:
    return Estimate(float(np.mean(samples)), float(np.std(samples)), samples)


__all__ = ["SHARED", "DriveBlock", "drive_block"]
