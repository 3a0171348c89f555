"""Several configurations over the same drives, which are made once, some ticks at a time.

Nothing of a drive stays but what its statistics need: the state of the robots, of each kernel and
float twin, and sums. So memory depends on neither how long a drive is nor how many there are.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from firmware_model import KernelConfig
from hil_harness.assembly import Wire
from hil_harness.scenarios import Scenario
from precision_study.budget import (
    CAUSES,
    Asked,
    Expectation,
    Path,
    Tracer,
    guaranteed_bound,
)
from precision_study.study.drives import Drives, course_ticks, drive_in_blocks, lap_commands
from precision_study.study.measure import Measurement
from precision_study.study.requirement import Course
from precision_study.study.space import Point


@dataclass
class Share:
    """Drives, and the configurations that one thread takes over them.

    Attributes:
        scenario, seeds: what is driven.
        points: configurations and their units, all of one robot and tick.
        driven: how much of the drives is done, 0 to 1.
    """

    scenario: Scenario
    seeds: tuple[int, ...]
    points: tuple[tuple[Point, str], ...]
    driven: float = 0.0

    @property
    def runs(self) -> int:
        """How many runs these are."""
        return len(self.seeds) * len(self.points)


def path_rules(point: Point) -> str:
    """Return what the float twin's path depends on besides the drive; formats do not matter."""
    formats = {"position", "step", "heading", "turn_step", "trig"}
    return json.dumps(point.firmware.model_dump(exclude=formats), sort_keys=True)


def run_together(
    share: Share, configs: Sequence[KernelConfig], wire: Wire, course: Course
) -> list[dict[str, Any]]:
    """Drive the course with every configuration; return a record for each.

    Args:
        share: what is driven; hears how far it is.
        configs: of its points, in their order.
        wire: the DBC, whose command frames the robots hear.
        course: how far.

    Raises:
        StudyError: a scenario that cannot do the course.
    """
    first, seeds = share.points[0][0], share.seeds
    drives = share.scenario, first.plant, wire, first.tick_period_us, course
    lap = lap_commands(share.scenario, wire, first.tick_period_us)
    ticks = course_ticks(share.scenario, lap, course, first.tick_period_us)
    asked = Asked(configs[0], len(seeds))
    by_rules = groupby(zip(share.points, configs, strict=True), lambda one: path_rules(one[0][0]))
    families = [Family([config for _, config in group], len(seeds)) for _, group in by_rules]
    for part in drive_in_blocks(*drives, seeds):
        asked.add(part.left, part.right, part.gyro, part.ticks)
        for family in families:
            family.add(part)
        share.driven = min(share.driven + part.left.shape[1] / ticks, 1.0)
    found = [one for family in families for one in family.statistics(asked)]
    return [
        {"unit": unit, "scenario": share.scenario.name, "seeds": list(seeds), **one}
        for (_, unit), one in zip(share.points, found, strict=True)
    ]


class Family:
    """Configurations that share the path of the float twin; see `path_rules`."""

    def __init__(self, configs: Sequence[KernelConfig], rows: int) -> None:
        """Begin so many drives."""
        self._members = [_One(config, rows) for config in configs]
        self._tracers = [Tracer(configs[0]) for _ in range(rows)]

    def add(self, part: Drives) -> None:
        """Go on over the next ticks of the same drives."""
        for one in self._members:
            one.measure(part)
        for row, ticks in enumerate(part.ticks.tolist()):
            if ticks > 0:
                inputs = (one[row, :ticks] for one in (part.left, part.right, part.gyro))
                path = self._tracers[row].add(*inputs)
                for one in self._members:
                    one.expect(row, path)

    def statistics(self, asked: Asked) -> list[dict[str, Any]]:
        """Return errors, budget and expected error of each configuration over the whole drives."""
        return [one.statistics(asked) for one in self._members]


class _One:
    """One configuration: its errors and its budget so far."""

    def __init__(self, config: KernelConfig, rows: int) -> None:
        self._config = config
        self._measurement = Measurement(config, rows)
        self._expectation = Expectation(config, rows)

    def measure(self, part: Drives) -> None:
        """Go on over the next ticks of all drives."""
        self._measurement.add(part)

    def expect(self, row: int, path: Path) -> None:
        """Go on along the next ticks of one drive."""
        self._expectation.add(row, path)

    def statistics(self, asked: Asked) -> dict[str, Any]:
        errors = self._measurement.errors()
        interruptions = [2 * ticks for ticks in errors.fallback_ticks]
        bound = guaranteed_bound(self._config, asked.most(self._config, interruptions))
        expected = self._expectation.result()
        together = expected.together
        return {
            **errors.to_json(),
            "budget": {
                name: [
                    *(bound[name].position_m, expected.shares[name].position_m),
                    *(bound[name].heading_rad, expected.shares[name].heading_rad),
                ]
                for name in CAUSES
            },
            "expected": [together.position_m, together.heading_rad],
        }
