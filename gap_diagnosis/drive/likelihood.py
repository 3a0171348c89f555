"""What commands and wheels say of one variant of a drive: noise levels, evidence, parameters."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.columns import Variant
from gap_diagnosis.drive.grid import Values, Weighted, integrate, locate
from gap_diagnosis.drive.linear import Grams, draw_linear
from gap_diagnosis.drive.noise import (
    Levels,
    Whitening,
    fit_levels,
    log_level_prior,
    marginal,
    whitened,
)
from gap_diagnosis.drive.shapes import AS_DESCRIBED, BENT, About, Coordinate, Shapes
from gap_diagnosis.hypothesis import Estimate
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_SAMPLES: Final = 2000
_FREE_SD: Final = 0.3
"""Of linear coefficients while noise levels and best likelihoods are sought."""
_NUISANCE_SD: Final = {"gain": 0.5 * prior.GAIN.tolerance, "lag": 0.5 * prior.LAG_S.tolerance}
"""Deviations that every hypothesis may have, beside that of the delay: half the tolerances."""

_NOTHING: Final[Mapping[str, float]] = {}
_SHORTLY_S: Final = 0.004
_SHORT_OF: Final = 2.0
"""A delay that may be more than so many times as long has a short chord besides."""
_MANNER_SD: Final = 1.0
"""Weight of an answer that no described drive has, beside the described one."""


@dataclass(frozen=True)
class Setting:
    """A variant with everything that does not change from grid point to grid point.

    *about*: gains of the wheels, and braking, about which what more of them adds is a straight
    line.
    """

    variant: Variant
    shapes: Shapes
    coordinates: tuple[Coordinate, ...]
    has_gain: bool
    nuisances: Floats
    nuisance_sd: Floats
    about: About = AS_DESCRIBED

    @property
    def brakes(self) -> bool:
        """Whether wheels may slow down faster than they speed up: friction helps a weak motor to
        brake, and hinders it otherwise."""
        return any(one.effect == "drive_acceleration_limit" for one in self.coordinates)

    @property
    def linear_sizes(self) -> tuple[prior.Size, ...]:
        """The prior's sizes of what acts linearly: gains, braking, then the variant's columns."""
        gains = (prior.GAIN, prior.GAIN) if self.has_gain else ()
        braking = (prior.BRAKING,) if self.brakes else ()
        return (*gains, *braking, *self.variant.sizes)

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Of what bends the drive's answer."""
        return [(one.low, one.high) for one in self.coordinates]

    @property
    def fixed(self) -> Floats:
        """Columns that no grid point bends: float64[k, 2, m]."""
        return np.concatenate((self.variant.acting, self.nuisances))

    def values(self, point: Floats) -> dict[str, float]:
        """Return the parameter of each bending effect at a point float64[coordinates]."""
        return {
            one.effect: float(one.value(point[i : i + 1])[0])
            for i, one in enumerate(self.coordinates)
        }

    def columns(self, values: Mapping[str, float]) -> Floats:
        """Return residual, and what gains and braking add: float64[1 to 4, 2, m]."""
        angle = self.shapes.angle(values, self.about)
        residual = self.variant.data.angle - angle
        added = []
        if self.has_gain:
            gains = self.shapes.gain_columns(values, angle, self.about)
            residual = residual + np.tensordot(np.array(self.about[:2]) - 1.0, gains, axes=1)
            added.append(gains)
        if self.brakes:
            braking = self.shapes.braking_column(values, angle, self.about)
            residual = residual + self.about[2] * braking[0]
            added.append(braking)
        return np.concatenate((residual[np.newaxis], *added))


def setting_of(variant: Variant, robot: Robot, effects: frozenset[str]) -> Setting:
    """Return the setting of a variant of these effects."""
    shapes = Shapes(variant.data, robot)
    coordinates = tuple(shapes.coordinate(one) for one in sorted(effects) if one in BENT)
    has_gain = "drive_gain" in effects
    nuisances, sd = _nuisances(variant, shapes, {}, effects)
    return Setting(variant, shapes, coordinates, has_gain, nuisances, sd)


def laid_at(setting: Setting, values: Mapping[str, float], there: About) -> Setting:
    """Return the setting with the lines of all that is linear about a point: what a gain, a lag or
    a delay does beside a limit is not what it does without."""
    own = frozenset({*values, "drive_gain"} if setting.has_gain else values)
    nuisances, _ = _nuisances(setting.variant, setting.shapes, values, own)
    return replace(setting, about=there, nuisances=nuisances)


def _nuisances(
    variant: Variant, shapes: Shapes, values: Mapping[str, float], effects: frozenset[str]
) -> tuple[Floats, Floats]:
    """Return what every hypothesis may deviate by beside its effects, float64[k, 2, m], at values
    of these; and the deviations' scales."""
    angle = shapes.angle(values)
    columns, sds = [], []
    if "drive_gain" not in effects:
        columns += list(shapes.lasting_gain_columns(values, angle))
        sds += [_NUISANCE_SD["gain"]] * 2
    delay_s = variant.data.delay_sd_s
    delays = [("drive_lag", _NUISANCE_SD["lag"]), ("drive_delay", delay_s)]
    # A chord over most of a row is not what a few milliseconds do about a step of the command.
    delays += [("drive_delay", _SHORTLY_S)] if delay_s > _SHORT_OF * _SHORTLY_S else []
    for effect, step in delays:
        if effect not in effects:
            columns.append((shapes.angle(values, always={effect: step}) - angle) / step)
            sds.append(step)
    nuisances = np.zeros((0, *angle.shape))
    if columns:
        nuisances = np.stack(columns)
    if variant.data.manner is not None:
        nuisances = np.concatenate((nuisances, variant.data.manner))
        sds += [_MANNER_SD] * len(variant.data.manner)
    return nuisances, np.array(sds)


def fitted_levels(
    setting: Setting, values: Mapping[str, float], *starts: Floats
) -> tuple[Floats, float]:
    """Return logarithms of noise levels, sought from *starts*, and of the best likelihood there."""
    made = setting.columns(values)
    linear = np.concatenate((made[1:], setting.fixed))
    free = np.array([_FREE_SD * max(1.0, one.high) for one in setting.linear_sizes])
    sd = np.concatenate((free, setting.nuisance_sd))
    data = setting.variant.data
    found = []
    for levels, height in fit_levels(data, made[0], linear, sd, starts):
        # the width of the free coefficients' prior is no part of the best likelihood
        width = 0.0
        if len(free):
            white, _ = whitened(data, linear[: len(free)], Levels.of(levels, data.tick_rad))
            scaled = (white @ white.T) * np.outer(free, free) + np.eye(len(free))
            width = 0.5 * float(np.linalg.slogdet(scaled)[1])
        found.append((levels, height + width))
    return max(found, key=lambda one: one[1])


def evidence(
    setting: Setting, logs: Floats, *, rough: bool = False, start: Floats | None = None
) -> tuple[float, Weighted, Floats]:
    """Return the log evidence at noise levels, its points, and the prior's scales."""
    log_density, sd = _density(setting, logs, rough=rough)
    points = integrate(log_density, setting.bounds, start)
    return points.log_integral, points, sd


def likeliest(setting: Setting, logs: Floats, alone: Mapping[str, float] = _NOTHING) -> Floats:
    """Return the likeliest bending parameters at noise levels; *alone*: by effect, the likeliest
    one of each by itself, or of all before they are laid anew, where that is known."""
    log_density, _ = _density(setting, logs, rough=True)
    known = [
        one.at(alone[one.effect]) if one.effect in alone else None for one in setting.coordinates
    ]
    return locate(log_density, setting.bounds, known)


def linear_sizes(setting: Setting, logs: Floats) -> Floats:
    """Return the best sizes of the variant's columns at noise levels."""
    data = setting.variant.data
    sd = np.concatenate(([one.high for one in setting.linear_sizes], setting.nuisance_sd))
    stacked = np.concatenate((setting.columns({})[:1], setting.fixed))
    white, _ = whitened(data, stacked, Levels.of(logs, data.tick_rad))
    return _best(white, sd)[: len(setting.variant.columns)]


def about(setting: Setting, logs: Floats, point: Floats) -> About:
    """Return the best gains and braking at a point float64[coordinates] and noise levels."""
    data = setting.variant.data
    made = setting.columns(setting.values(point))
    sd = np.concatenate(([one.high for one in setting.linear_sizes], setting.nuisance_sd))
    white, _ = whitened(data, np.concatenate((made, setting.fixed)), Levels.of(logs, data.tick_rad))
    sizes = _best(white, sd)[: len(made) - 1]
    left, right = (1.0 + sizes[:2]) if setting.has_gain else setting.about[:2]
    return float(left), float(right), float(sizes[-1]) if setting.brakes else 0.0


def parameters(setting: Setting, logs: Floats, grid: Weighted, sd: Floats) -> dict[str, Estimate]:
    """Return estimates from draws of the grid, and of the linear coefficients given a point."""
    random = np.random.default_rng(0)
    weight = np.exp(grid.log_value - grid.log_integral)
    chosen = random.choice(len(weight), size=_SAMPLES, p=weight / weight.sum())
    spread = random.uniform(-0.5, 0.5, (_SAMPLES, len(grid.cell))) * grid.cell
    points = grid.point[chosen] + spread
    found = {
        one.key: replace(
            _estimate(one.value(np.clip(points[:, i], one.low, one.high))), news=one.newsworthy
        )
        for i, one in enumerate(setting.coordinates)
    }
    if setting.has_gain:
        data = setting.variant.data
        whitening = Whitening(data, Levels.of(logs, data.tick_rad))
        white_fixed = whitening.of(setting.fixed)
        used, place = np.unique(chosen, return_inverse=True)
        grams = _grams(setting, whitening, white_fixed, grid.point[used])
        gains = draw_linear(grams, sd, place, random)
        found["drive_gain.left"] = _estimate(gains[:, 0])
        found["drive_gain.right"] = _estimate(gains[:, 1])
    return found


def _density(setting: Setting, logs: Floats, *, rough: bool) -> tuple[Values, Floats]:
    """Return the log posterior density of the bending parameters, and the prior's scales."""
    data = setting.variant.data
    whitening = Whitening(data, Levels.of(logs, data.tick_rad))
    white_fixed = whitening.of(setting.fixed)
    constant = log_level_prior(logs) - 0.5 * whitening.log_determinant
    constant += setting.variant.log_constant
    sd = _scale_products(setting.linear_sizes, setting.nuisance_sd, count=2 if rough else 4)

    def log_density(points: Floats) -> Floats:
        grams = _grams(setting, whitening, white_fixed, points)
        values = np.stack([marginal(*one, sd) for one in grams.by_point])
        total = np.logaddexp.reduce(values, axis=1) - np.log(len(sd)) + constant
        for i, one in enumerate(setting.coordinates):
            total = total + one.log_prior(points[:, i])
        return np.asarray(total, dtype=np.float64)

    return log_density, sd


def _scale_products(sizes: Sequence[prior.Size], nuisance_sd: Floats, count: int) -> Floats:
    """Return the products of the prior's scales: float64[s, linear + nuisances]."""
    products = list(itertools.product(*(np.unique(one.scales(count)) for one in sizes)))
    rows = np.array(products, dtype=np.float64).reshape(len(products), len(sizes))
    return np.hstack([rows, np.tile(nuisance_sd, (len(rows), 1))])


def _grams(setting: Setting, whitening: Whitening, white_fixed: Floats, points: Floats) -> Grams:
    own = len(setting.linear_sizes) - len(setting.variant.sizes)
    size = own + len(white_fixed)
    gram = np.zeros((len(points), size, size))
    pull = np.zeros((len(points), size))
    power = np.zeros(len(points))
    shared = white_fixed @ white_fixed.T
    for i, point in enumerate(points):
        white = whitening.of(setting.columns(setting.values(point)))
        power[i] = white[0] @ white[0]
        pull[i, :own] = white[1:] @ white[0]
        pull[i, own:] = white_fixed @ white[0]
        gram[i, :own, :own] = white[1:] @ white[1:].T
        gram[i, own:, own:] = shared
        gram[i, :own, own:] = white[1:] @ white_fixed.T
        gram[i, own:, :own] = gram[i, :own, own:].T
    return Grams(gram, pull, power)


def _best(white: Floats, sd: Floats) -> Floats:
    """Return the best sizes of whitened columns, the first of which is the residual."""
    stiff = white[1:] @ white[1:].T + np.diag(sd**-2.0)
    return np.asarray(np.linalg.solve(stiff, white[1:] @ white[0]))


def _estimate(samples: Floats) -> Estimate:
    return Estimate(float(np.mean(samples)), float(np.std(samples)), samples)
