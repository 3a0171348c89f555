"""The prior, as data: how likely each kind of answer is, and how large parameters may be."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np

from gap_diagnosis.hypothesis import FORM
from gap_diagnosis.recording import Floats
from hil_harness.effects.model import Effect, EffectParameter

_BELIEVED: Final = 8.0

FOR_A_WHILE: Final = 0.1
"""One effect in ten does not act on the whole log."""
WHEELS: Final = frozenset({"radius_mismatch", "radius_scale"})
"""Together they say any two sizes of wheels: one wheel of another size, a tyre that is new or low,
is one cause and as likely as any other single one."""


@dataclass(frozen=True)
class ParameterPrior:
    """How large an effect's coefficient may be.

    Attributes:
        tolerance: a deviation up to this is no news.
        high: beyond the typical range; the prior is even over orders of magnitude up to here; of
            what the motion shows it falls with the square of a size beyond.
        most: sizes beyond this are no effect's; eight times *high* where it is not said.
    """

    tolerance: float
    high: float
    most: float = 0.0

    def __post_init__(self) -> None:
        """Fill in what is not said."""
        if self.most == 0.0:
            object.__setattr__(self, "most", _BELIEVED * self.high)

    def scales(self, count: int = 5) -> Floats:
        """Return standard deviations of the normal mixture that stands for the prior.

        They are spaced evenly in logarithm from the tolerance to the high end, with equal weight:
        nearly even over orders of magnitude, and proper.
        """
        return np.geomspace(max(self.tolerance, 1e-3 * self.high), self.high, count)

    def log_density(self, value: Floats) -> Floats:
        """Return the log density of the mixture's positive half."""
        scales = self.scales()
        ratio = value[..., np.newaxis] / scales
        logs = -0.5 * ratio**2 - np.log(scales) + 0.5 * np.log(2 / np.pi)
        return np.asarray(np.logaddexp.reduce(logs, axis=-1) - np.log(len(scales)))


Range = tuple[float, float]
"""Even in the logarithm between two ends."""


@dataclass(frozen=True)
class Prior:
    """The whole prior.

    Attributes:
        effects: probability of 0, 1, 2 and so on effects.
        unknown: probability that the cause is not in the library.
        misdescribed: how often a listed cause, or none, is at work that no account of it explains.
        parameters: by effect, one prior for all of its coefficients or one by coefficient.
        ranges: by effect, of thresholds, rates and levels.
        nuisances: by name, what is free beside every effect.
        laws: by effect, what is believed in words, where the law is in code.
        no_news: by effect with a range and parameter, a size up to which it is no news.
    """

    effects: tuple[float, ...]
    unknown: float
    misdescribed: float
    parameters: Mapping[str, Mapping[str, ParameterPrior]]
    ranges: Mapping[str, Mapping[str, Range]] = field(default_factory=dict)
    nuisances: Mapping[str, ParameterPrior] = field(default_factory=dict)
    laws: Mapping[str, str] = field(default_factory=dict)
    no_news: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def of(self, effect: str, coefficient: str) -> ParameterPrior:
        """Return the prior of one coefficient."""
        known = self.parameters[effect]
        return known.get(coefficient) or known["all"]

    def tolerance(self, effect: str, parameter: str) -> float | None:
        """Return the size up to which a parameter is no news; None where there is no such size."""
        sizes = self.parameters.get(effect, {})
        size = sizes.get(parameter) or (sizes.get("all") if parameter not in _NOT_SIZES else None)
        return self.no_news.get(effect, {}).get(parameter) if size is None else size.tolerance

    def chance_of(self, count: int) -> float:
        """Return the probability of so many effects; beyond the list it falls on as it ended."""
        last = len(self.effects) - 1
        if count <= last:
            return self.effects[count]
        return self.effects[last] * (self.effects[last] / self.effects[last - 1]) ** (count - last)

    def log_probability_of(self, effects: Set[str], log_prior: Mapping[str, float]) -> float:
        """Return the log probability of so many effects, and that they are these in any order.

        *log_prior*: of each, that a single one is this. One wheel of another size counts as one.
        """
        count = len(effects)
        usual = math.log(math.factorial(count) * self.chance_of(count))
        usual += math.fsum(log_prior[name] for name in effects)
        if not effects >= WHEELS:
            return usual
        as_one = self.log_probability_of(effects - {max(WHEELS)}, log_prior)
        return float(np.logaddexp(usual, as_one))

    def share_of_one_wheel(self, effects: Set[str], among: int) -> float:
        """Return how much of the probability of a set that has `WHEELS` is that of one wheel of
        another size; *among* so many effects, all as likely."""
        even = dict.fromkeys(effects, -math.log(among))
        as_one = self.log_probability_of(effects - {max(WHEELS)}, even)
        return math.exp(as_one - self.log_probability_of(effects, even))


@dataclass(frozen=True)
class Stated:
    """What is believed of one parameter before a log is seen.

    Attributes:
        tolerance: a size up to this is no news; None where there is no such size.
        span: the prior is even over orders of magnitude between these sizes, without sign; None
            where it is a law in code.
        of: what the sizes are shares of; empty where they are in the parameter's unit.
        most: how large it seldom is, where that is more than eight times the span's end.
    """

    tolerance: float | None
    span: Range | None
    of: str = ""
    most: float | None = None


_NOT_SIZES: Final = frozenset({"phase", "direction", "threshold", FORM, "start_s", "stop_s"})
"""Parameters that place an effect: angles are even over a turn, the others have their own laws."""


def stated(prior: Prior, effect: Effect) -> dict[str, Stated]:
    """Return what the data of *prior* states, by parameter; absent where it states nothing."""
    sizes = prior.parameters.get(effect.name, {})
    ranges = prior.ranges.get(effect.name, {})
    found = {}
    for parameter in effect.parameters:
        name = parameter.name
        size = sizes.get(name) or (sizes.get("all") if name not in _NOT_SIZES else None)
        if parameter.kind != "real":
            continue
        if size is not None:
            most = size.most if size.most > _BELIEVED * size.high else None
            found[name] = Stated(size.tolerance, (size.tolerance, size.high), most=most)
        elif name in ranges:
            # `usual` is of how much or how often, which is what the effect begins with.
            follows = "usual" in ranges and ranges[name][0] == ranges["usual"][1]
            tolerance = ranges["usual"][1] if follows else prior.tolerance(effect.name, name)
            found[name] = Stated(tolerance, ranges[name])
        elif "share" in ranges:
            tolerance = prior.tolerance(effect.name, name)
            found[name] = Stated(tolerance, ranges["share"], "the largest")
        elif (tolerance := prior.tolerance(effect.name, name)) is not None:
            found[name] = Stated(tolerance, None)
    return found


def with_library(prior: Prior, library: Mapping[str, Effect]) -> Prior:
    """Return the prior with the tolerances and typical sizes of a user's effects.

    Without any it is the same one: what is known of a robot's next drives is kept by it.
    """
    if not library:
        return prior
    parameters = dict(prior.parameters)
    for name, effect in library.items():
        if effect.explain is None:
            continue
        parameters[name] = {
            one.name: _user_prior(effect.tolerance.get(one.name), one)
            for one in effect.parameters
            if one.kind == "real"
        }
    return replace(prior, parameters=parameters)


def _user_prior(tolerance: float | None, parameter: EffectParameter) -> ParameterPrior:
    high = None
    if parameter.typical is not None:
        high = 2 * parameter.typical.high
    elif math.isfinite(parameter.maximum):
        high = parameter.maximum
    if tolerance is None:
        tolerance = 1e-3 if high is None else 0.01 * high
    return ParameterPrior(tolerance, 100 * tolerance if high is None else high)


@cache
def default_prior() -> Prior:
    """Return the prior that ships, from data/prior.toml."""
    text = (files("gap_diagnosis") / "data" / "prior.toml").read_text(encoding="utf-8")
    return _prior(tomllib.loads(text))


def _prior(table: Mapping[str, Any]) -> Prior:
    return Prior(
        tuple(table["effects"]),
        float(table["unknown"]),
        float(table["misdescribed"]),
        {
            effect: {name: _size(one) for name, one in coefficients.items()}
            for effect, coefficients in table["parameters"].items()
        },
        {
            effect: {name: (float(low), float(high)) for name, (low, high) in spans.items()}
            for effect, spans in table["ranges"].items()
        },
        {name: _size(one) for name, one in table["nuisances"].items()},
        dict(table["laws"]),
        {effect: {n: float(v) for n, v in one.items()} for effect, one in table["no_news"].items()},
    )


def _size(one: Mapping[str, Any]) -> ParameterPrior:
    return ParameterPrior(*(float(one.get(key, 0.0)) for key in ("tolerance", "high", "most")))
