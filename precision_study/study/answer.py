"""What a study says: the error of each configuration, the Pareto front, the cheapest that holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from precision_study.budget import CAUSES
from precision_study.study.cost import Cost, cost_table
from precision_study.study.engine import Study
from precision_study.study.requirement import Requirement
from precision_study.study.space import Point, build
from precision_study.study.store import Store

LEVEL: Final = 0.99
_ENOUGH_SEEDS: Final = 100
"""Fewer have no 99th percentile other than their largest."""


@dataclass(frozen=True)
class ScenarioOutcome:
    """One configuration on one scenario, over all seeds.

    Attributes:
        scenario: its name.
        runs: how many seeds.
        high: "kind quantity" to what `high_words` says, of the largest error on the way [m or rad].
        final_rms: the same keys, to the root mean square of the error at the end.
        bound: "position" and "heading", to the guaranteed bound of the arithmetic error.
        expected: likewise, to the expected arithmetic error at the end.
        budget: cause to (bound, expected) of position, then of heading.
        overflows: in all runs together.
    """

    scenario: str
    runs: int
    high: Mapping[str, float]
    final_rms: Mapping[str, float]
    bound: Mapping[str, float]
    expected: Mapping[str, float]
    budget: Mapping[str, tuple[float, float, float, float]]
    overflows: int


@dataclass(frozen=True)
class Outcome:
    """One configuration: what it costs, and how it fares on each scenario."""

    point: Point
    cost: Cost
    scenarios: tuple[ScenarioOutcome, ...]
    is_forced: bool = False
    in_c: bool = True

    def worst(self, what: str) -> ScenarioOutcome:
        """Return the scenario with the largest error of a kind, as in "arithmetic position"."""
        return max(self.scenarios, key=lambda one: one.high[what])

    def error(self, what: str) -> float:
        """Return the high error over seeds on the worst scenario [m or rad]; see `high_words`."""
        return self.worst(what).high[what]

    def bound(self, quantity: str) -> float:
        """Return the guaranteed bound of the arithmetic error on any of the scenarios."""
        return max(one.bound[quantity] for one in self.scenarios)

    @property
    def is_sound(self) -> bool:
        """Whether no word has overflowed and nothing was forced: others are never chosen."""
        return self.overflows == 0 and not self.is_forced

    @property
    def overflows(self) -> int:
        """How often a word has overflowed in all runs."""
        return sum(one.overflows for one in self.scenarios)


def high_words(seeds: int) -> str:
    """Return what is looked at of the errors of so many seeds."""
    if seeds < _ENOUGH_SEEDS:
        return f"largest of {seeds} seed{'s' if seeds > 1 else ''}"
    return f"99th percentile of {seeds} seeds"


def outcomes(study: Study, store: Store) -> list[Outcome]:
    """Return every configuration of a study whose runs the store holds, in the study's order."""
    table = cost_table()
    found = []
    for point in study.points:
        by_scenario = tuple(
            _scenario(scenario.name, store.records(study.unit(point, scenario)), study.seeds)
            for scenario in study.scenarios
        )
        config = build(point, study.robot, force=study.force)
        found.append(
            Outcome(
                point,
                table.cost(config),
                by_scenario,
                is_forced=point.key in study.forced,
                in_c=not config.beyond_c,
            )
        )
    return found


def _scenario(
    name: str, records: Sequence[Mapping[str, Any]], seeds: Sequence[int]
) -> ScenarioOutcome:
    wanted = set(seeds)

    def runs(field: str) -> np.ndarray[Any, Any]:
        return np.array(
            [
                value
                for record in records
                for seed, value in zip(record["seeds"], record[field], strict=True)
                if seed in wanted
            ]
        )

    high, rms = {}, {}
    for kind in ("arithmetic", "total"):
        for quantity, unit in (("position", "m"), ("heading", "rad")):
            key, field = f"{kind} {quantity}", f"{kind}_{quantity}_{unit}"
            largest = runs(f"largest_{field}")
            # The next run above the quantile: never less than what has been seen of it.
            high[key] = float(np.quantile(largest, LEVEL, method="higher"))
            rms[key] = float(np.sqrt(np.mean(runs(field) ** 2)))
    budget = {}
    for cause in CAUSES:
        parts = np.array([record["budget"][cause] for record in records])
        weights = np.array([len(record["seeds"]) for record in records])
        mean = np.sqrt(np.average(parts**2, axis=0, weights=weights))
        most = parts.max(axis=0)
        budget[cause] = (float(most[0]), float(mean[1]), float(most[2]), float(mean[3]))
    expected = np.array([record["expected"] for record in records])
    expected = np.sqrt(
        np.average(expected**2, axis=0, weights=[len(one["seeds"]) for one in records])
    )
    return ScenarioOutcome(
        scenario=name,
        runs=len(runs("overflows")),
        high=high,
        final_rms=rms,
        bound={
            "position": math.fsum(one[0] for one in budget.values()),
            "heading": math.fsum(one[2] for one in budget.values()),
        },
        expected={"position": float(expected[0]), "heading": float(expected[1])},
        budget=budget,
        overflows=int(runs("overflows").sum()),
    )


def pareto_front(found: Sequence[Outcome], what: str) -> list[Outcome]:
    """Return the configurations that none beats in error, instructions a second and memory.

    All of them are sound; of equals the first stays. From the cheapest to the most exact.
    """
    sound = [one for one in found if one.is_sound]
    if not sound:
        return []
    values = np.array(
        [[one.cost.instructions_per_s, one.cost.memory_bytes, one.error(what)] for one in sound]
    )
    kept: list[int] = []
    for index in np.lexsort((np.arange(len(sound)), values[:, 2], values[:, 1], values[:, 0])):
        if not any(np.all(values[other] <= values[index]) for other in kept):
            kept.append(int(index))
    return [sound[index] for index in kept]


def holds(one: Outcome, requirement: Requirement, margin: float) -> bool:
    """Tell whether a configuration stays *margin* times below the limit, and is sound."""
    what = f"{requirement.kind} {requirement.quantity}"
    return one.is_sound and one.error(what) * margin <= requirement.limit


def cheapest(found: Sequence[Outcome], requirement: Requirement, margin: float) -> Outcome | None:
    """Return the configuration that holds with the fewest instructions a second, or None.

    Those that the cost table cannot tell from it count as equal: of them the one with the least
    memory, and of these the most exact.
    """
    what = f"{requirement.kind} {requirement.quantity}"
    fit = [one for one in found if holds(one, requirement, margin)]
    if not fit:
        return None
    least = min(one.cost.instructions_per_s for one in fit)
    about_equal = cost_table().about_equal
    near = [one for one in fit if one.cost.instructions_per_s <= about_equal * least]
    return min(near, key=lambda one: (one.cost.memory_bytes, one.error(what)))
