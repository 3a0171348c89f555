"""Whether several logs say the same of one robot: a test of each log's own estimates.

Every log is fitted by itself. A parameter that belongs to the robot must come out alike in all of
them, but for the logs' own uncertainty and the tolerance that is no news anyway.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2

from gap_diagnosis.hypothesis import Estimate
from gap_diagnosis.priors import Prior
from hil_harness.effects import Effect

_CHANCE: Final = 1e-3
"""Logs of one robot are said to contradict each other this rarely."""

_DRIFT: Final = 0.1
"""Where no tolerance is known, a robot may change by this share from one drive to the next."""

_OF_THE_LOG: Final = frozenset({"start_s", "stop_s", "time", "phase", "direction"})
"""Parameters that may well differ between logs: when and where something happened."""

_TOLD: Final = 3
"""So many parameters are told with their values."""

_STAGES: Final = frozenset({"reference", "bus"})
"""A reference is set up anew for each log, and a bus is as busy as it happens to be."""


@dataclass(frozen=True)
class Disagreement:
    """A parameter that two logs know well and differently.

    Attributes:
        parameter: ``effect.parameter``.
        logs: the places of the two that lie farthest apart.
        values: what each of them says, in the parameter's unit, or a choice.
    """

    parameter: str
    logs: tuple[int, int]
    values: tuple[float | int | str, float | int | str]


def disagreements(
    estimates: Mapping[str, Mapping[int, Estimate]], prior: Prior, known: Mapping[str, Effect]
) -> list[Disagreement]:
    """Return the parameters in which logs contradict each other.

    *estimates*: by parameter, then by the log's place. A chi-square test of equal values for
    numbers, the probability that all are the same for choices; the chance is shared by all tests.
    """
    tested = {
        key: by_log
        for key, by_log in estimates.items()
        if len(by_log) > 1 and _is_of_the_robot(key, known)
    }
    chance = _CHANCE / max(len(tested), 1)
    found = []
    for key, by_log in sorted(tested.items()):
        pair = _choices(by_log, chance) or _numbers(key, by_log, prior, chance)
        if pair is not None:
            values = (by_log[pair[0]].value, by_log[pair[1]].value)
            found.append(Disagreement(key, pair, values))
    return found


def contradiction(
    found: Sequence[Disagreement],
    names: Sequence[str],
    known: Mapping[str, Effect],
    *,
    is_unknown: bool = False,
) -> tuple[str, ...]:
    """Say which parameters differ between which logs, whose *names* are given by place.

    Where the verdict *is_unknown*, what is not listed may be the reason.
    """
    if not found:
        return ()
    told = "; ".join(_told(one, names, known) for one in found[:_TOLD])
    more = f"; and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    why = "different robots or of one that was changed"
    if is_unknown:
        why = "different robots, of one that was changed, or of a cause that is not listed"
    return (
        f"The logs contradict each other, as of {why}: {told}{more}. "
        "What is said of these lies between the logs: diagnose them one by one.",
    )


def _told(one: Disagreement, names: Sequence[str], known: Mapping[str, Effect]) -> str:
    effect, _, name = one.parameter.partition(".")
    unit = known[effect].parameter(name).unit
    suffix = "" if unit in ("", "1") else f" {unit}"
    sides = [
        f"{value if isinstance(value, str) else format(value, '.3g')}{suffix} in log {place + 1} "
        f"({names[place]})"
        for place, value in zip(one.logs, one.values, strict=True)
    ]
    return f"{one.parameter} is {' and '.join(sides)}"


def _is_of_the_robot(key: str, known: Mapping[str, Effect]) -> bool:
    effect, _, name = key.partition(".")
    stage = known[effect].stage if effect in known else ""
    return stage not in _STAGES and name not in _OF_THE_LOG


def _numbers(
    key: str, by_log: Mapping[int, Estimate], prior: Prior, chance: float
) -> tuple[int, int] | None:
    """Return the logs with the least and the largest value, if they are not the same number."""
    numbers = {place: one for place, one in by_log.items() if one.samples is not None}
    if len(numbers) < 2:
        return None
    values = np.array([float(one.value) for one in numbers.values()])
    allowed = _tolerance(key, prior, float(np.abs(values).max()))
    weights = 1 / (np.array([one.sd for one in numbers.values()]) ** 2 + allowed**2)
    mean = np.average(values, weights=weights)
    spread = float(weights @ (values - mean) ** 2)
    if chi2.sf(spread, len(values) - 1) > chance:
        return None
    places = list(numbers)
    return places[int(values.argmin())], places[int(values.argmax())]


def _tolerance(key: str, prior: Prior, largest: float) -> float:
    effect, _, name = key.partition(".")
    by_name = prior.parameters.get(effect, {})
    one = by_name.get(name) or by_name.get("all")
    return _DRIFT * largest if one is None else one.tolerance


def _choices(by_log: Mapping[int, Estimate], chance: float) -> tuple[int, int] | None:
    """Return two logs that choose differently, if it is as good as impossible that all agree."""
    odds = {
        place: one.probabilities or {str(one.value): 1.0}
        for place, one in by_log.items()
        if one.samples is None
    }
    every = {value for one in odds.values() for value in one}
    same = math.fsum(math.prod(one.get(value, 0.0) for one in odds.values()) for value in every)
    if len(odds) < 2 or same > chance:
        return None
    first, *others = odds
    value = str(by_log[first].value)
    return next(((first, other) for other in others if str(by_log[other].value) != value), None)
