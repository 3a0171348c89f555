"""Runs a study: every configuration over every scenario and seed, on all cores, resumable."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.metadata import version
from itertools import islice
from typing import Any, Final

from hil_harness.assembly import Wire
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from precision_study.study.drives import course_ticks, lap_commands, seed_blocks
from precision_study.study.requirement import Course
from precision_study.study.space import Point, build
from precision_study.study.store import Store
from precision_study.study.together import Share, path_rules, run_together

SCHEMA: Final = 1
_VERSION: Final = version("chiplog")
_TOGETHER: Final = 16
"""Configurations that share a drive: making it costs a tenth of what they do, …"""
_LOOK_S: Final = 0.25
"""… and so often is looked how far they are."""


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
        forced: keys of the points that only force runs, from `refuse_unfit`; never chosen.
    """

    robot: Robot
    wire: Wire
    points: tuple[Point, ...]
    scenarios: tuple[Scenario, ...]
    seeds: tuple[int, ...]
    course: Course
    force: bool = False
    forced: frozenset[str] = frozenset()
    _laps: dict[tuple[str, int], str] = field(default_factory=dict, repr=False, compare=False)

    @property
    def runs(self) -> int:
        """How many runs the whole study has."""
        return len(self.points) * len(self.scenarios) * len(self.seeds)

    def ticks(self, scenario: Scenario, point: Point) -> int:
        """Return how many ticks surely do the course. Raises StudyError as `course_ticks`."""
        lap = lap_commands(scenario, self.wire, point.tick_period_us)
        return course_ticks(scenario, lap, self.course, point.tick_period_us)

    def unit(self, point: Point, scenario: Scenario) -> str:
        """Return the name of one configuration on one scenario: equal only for equal runs."""
        place = (scenario.name, point.tick_period_us)
        if place not in self._laps:
            lap = lap_commands(scenario, self.wire, point.tick_period_us)
            self._laps[place] = sha256(lap.tobytes()).hexdigest()
        asked = [
            *(SCHEMA, _VERSION, point.key, scenario.name, scenario.drive),
            *(scenario.encoder_model, scenario.noise, repr(scenario.effects)),
            *(self._laps[place], self.course.distance_m, self.course.duration_s),
        ]
        return sha256(json.dumps(asked).encode()).hexdigest()[:20]


def run_study(
    study: Study,
    store: Store,
    progress: Callable[[float, int], None] = lambda done, total: None,
    workers: int | None = None,
) -> None:
    """Do the runs that the store does not hold yet, and append them to it.

    Args:
        study: what is asked.
        store: where results go; what it holds is not run again.
        progress: hears how many runs are done, those under way in part, and of how many.
        workers: threads; None: one per core.

    Raises:
        StudyError: a scenario that cannot do the course.
    """
    threads = workers or cores()
    shares = list(_shares(study, store, threads))
    done = study.runs - sum(one.runs for one in shares)
    progress(done, study.runs)
    with ThreadPoolExecutor(threads) as pool:
        under_way: dict[Future[list[dict[str, Any]]], Share] = {}
        left = iter(shares)
        try:
            while True:
                for share in islice(left, threads - len(under_way)):
                    under_way[pool.submit(_records, study, share)] = share
                if not under_way:
                    return
                finished, _ = wait(under_way, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
                for one in finished:
                    done += under_way.pop(one).runs
                    for record in one.result():
                        store.append(record)
                part = sum(one.driven * one.runs for one in under_way.values())
                progress(done + part, study.runs)
        finally:
            for one in under_way:
                one.cancel()


def _records(study: Study, share: Share) -> list[dict[str, Any]]:
    configs = [build(point, study.robot, force=study.force) for point, _ in share.points]
    return run_together(share, configs, study.wire, study.course)


def _shares(study: Study, store: Store, threads: int) -> Iterator[Share]:
    """Yield what is left to do, drives that several configurations share together."""
    for scenario in study.scenarios:
        by_drive: dict[str, list[Point]] = {}
        for point in study.points:
            name = json.dumps([point.tick_period_us, point.plant.model_dump()], sort_keys=True)
            by_drive.setdefault(name, []).append(point)
        for points in by_drive.values():
            period_us = points[0].tick_period_us
            lap = lap_commands(scenario, study.wire, period_us)
            ticks = course_ticks(scenario, lap, study.course, period_us)
            missing: dict[tuple[int, ...], list[tuple[Point, str]]] = {}
            for point in sorted(points, key=path_rules):
                unit = study.unit(point, scenario)
                done = store.seeds(unit)
                seeds = tuple(seed for seed in study.seeds if seed not in done)
                missing.setdefault(seeds, []).append((point, unit))
            for seeds, group in missing.items():
                size = min(_TOGETHER, -(-len(group) // threads))
                for part in seed_blocks(seeds, ticks):
                    for start in range(0, len(group), size):
                        yield Share(scenario, part, tuple(group[start : start + size]))


def cores() -> int:
    """Return how many processors this process has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
