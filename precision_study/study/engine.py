"""Runs a study: every configuration over every scenario and seed, on all cores, resumable."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.metadata import version
from itertools import groupby, islice
from typing import Any, Final

from firmware_model import KernelConfig
from hil_harness.assembly import Wire
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from precision_study.budget import CAUSES, Path, Travel, expected_error, guaranteed_bound, trace
from precision_study.study.drives import Drives, course_ticks, drive, lap_commands, seed_blocks
from precision_study.study.measure import Errors, measure
from precision_study.study.requirement import Course
from precision_study.study.space import Point, build
from precision_study.study.store import Store

SCHEMA: Final = 1
_PATHS: Final = 4
"""Drives of a block that the expected error is averaged over."""


@dataclass(frozen=True)
class Study:
    """What is studied.

    Attributes:
        robot: as described.
        wire: the DBC, whose command frames the robots hear.
        points: the configurations.
        scenarios: each is repeated until the course is done.
        seeds: of the noise, for every scenario.
        course: how far the robots drive.
        force: run configurations that overflow, and count.
    """

    robot: Robot
    wire: Wire
    points: tuple[Point, ...]
    scenarios: tuple[Scenario, ...]
    seeds: tuple[int, ...]
    course: Course
    force: bool = False
    _laps: dict[tuple[str, int], str] = field(default_factory=dict, repr=False, compare=False)

    @property
    def runs(self) -> int:
        """How many runs the whole study has."""
        return len(self.points) * len(self.scenarios) * len(self.seeds)

    def unit(self, point: Point, scenario: Scenario) -> str:
        """Return the name of one configuration on one scenario: equal only for equal runs."""
        place = (scenario.name, point.tick_period_us)
        if place not in self._laps:
            lap = lap_commands(scenario, self.wire, point.tick_period_us)
            self._laps[place] = sha256(lap.tobytes()).hexdigest()
        asked = [
            *(SCHEMA, version("chiplog"), point.key, scenario.name, scenario.drive),
            *(scenario.encoder_model, scenario.noise, repr(scenario.effects)),
            *(self._laps[place], self.course.distance_m, self.course.duration_s),
        ]
        return sha256(json.dumps(asked).encode()).hexdigest()[:20]


@dataclass(frozen=True)
class _Block:
    """Drives to be made, and the configurations that go over them."""

    scenario: Scenario
    seeds: tuple[int, ...]
    points: tuple[tuple[Point, str], ...]


@dataclass
class _Traces:
    """Paths of the float twin over one block's drives, shared by all formats of a mode."""

    drives: Drives
    known: dict[str, list[Path]] = field(default_factory=dict)

    def of(self, config: KernelConfig) -> list[Path]:
        one = config.description
        rules = one.model_dump(exclude={"position", "step", "heading", "turn_step", "trig"})
        key = json.dumps(rules, sort_keys=True)
        if key not in self.known:
            self.known[key] = [
                trace(
                    config,
                    self.drives.left[row, :ticks],
                    self.drives.right[row, :ticks],
                    self.drives.gyro[row, :ticks],
                )
                for row, ticks in enumerate(self.drives.ticks[:_PATHS].tolist())
            ]
        return self.known[key]

    def travel(self, config: KernelConfig, errors: Errors) -> Travel:
        """Return the most that any drive of the block asks for."""
        travels = [
            Travel.of_drive(
                config,
                self.drives.left[row, :ticks],
                self.drives.right[row, :ticks],
                self.drives.gyro[row, :ticks],
                2 * errors.fallback_ticks[row],
            )
            for row, ticks in enumerate(self.drives.ticks.tolist())
        ]
        most = travels[0]
        for other in travels[1:]:
            most = most.joined(other)
        return most


def run_study(
    study: Study,
    store: Store,
    progress: Callable[[int, int], None] = lambda done, total: None,
    workers: int | None = None,
) -> None:
    """Do the runs that the store does not hold yet, and append them to it.

    Args:
        study: what is asked.
        store: where results go; what it holds is not run again.
        progress: hears how many runs are done, and of how many.
        workers: threads; None: one per core.

    Raises:
        StudyError: a scenario that cannot do the course.
    """
    blocks = list(_blocks(study, store))
    left = sum(len(one.seeds) * len(one.points) for one in blocks)
    done = study.runs - left
    progress(done, study.runs)
    threads = workers or _cores()
    with ThreadPoolExecutor(threads) as pool:
        for block in blocks:
            first = block.points[0][0]
            traces = _Traces(
                drive(
                    block.scenario,
                    first.plant,
                    study.wire,
                    first.tick_period_us,
                    study.course,
                    block.seeds,
                )
            )
            for record in _in_turn(pool, threads, study, block, traces):
                store.append(record)
                done += len(block.seeds)
                progress(done, study.runs)


def _in_turn(
    pool: ThreadPoolExecutor, threads: int, study: Study, block: _Block, traces: _Traces
) -> Iterator[dict[str, Any]]:
    """Yield the record of each configuration as it is done; few wait at a time."""
    waiting: set[Future[dict[str, Any]]] = set()
    points = iter(block.points)
    try:
        while True:
            for point, unit in islice(points, 2 * threads - len(waiting)):
                waiting.add(pool.submit(_record, study, block, traces, point, unit))
            if not waiting:
                return
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for one in finished:
                yield one.result()
    finally:
        for one in waiting:
            one.cancel()


def _record(
    study: Study, block: _Block, traces: _Traces, point: Point, unit: str
) -> dict[str, Any]:
    config = build(point, study.robot, force=study.force)
    errors = measure(config, traces.drives)
    bound = guaranteed_bound(config, traces.travel(config, errors))
    expected = expected_error(config, traces.of(config))
    together = expected.together
    return {
        "unit": unit,
        "scenario": block.scenario.name,
        "seeds": list(block.seeds),
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


def _blocks(study: Study, store: Store) -> Iterator[_Block]:
    """Yield what is left to do, drives that several configurations share together."""
    for scenario in study.scenarios:
        by_drive: dict[str, list[tuple[Point, str]]] = {}
        for point in study.points:
            name = json.dumps([point.tick_period_us, point.plant.model_dump()], sort_keys=True)
            by_drive.setdefault(name, []).append((point, ""))
        for points in by_drive.values():
            first = points[0][0]
            lap = lap_commands(scenario, study.wire, first.tick_period_us)
            ticks = course_ticks(scenario, lap, study.course, first.tick_period_us)
            named = [(point, study.unit(point, scenario)) for point, _ in points]
            missing = [
                (tuple(seed for seed in study.seeds if seed not in store.seeds(unit)), point, unit)
                for point, unit in named
            ]
            missing.sort(key=lambda one: one[0])
            for seeds, group in groupby(missing, key=lambda one: one[0]):
                these = tuple((point, unit) for _, point, unit in group)
                for part in seed_blocks(seeds, ticks):
                    yield _Block(scenario, part, these)


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
