"""Many configurations against many ticks: 1,000 × 6,000 steps over one × 6 million.

    .venv/bin/python benchmarks/study.py [--configurations N] [--rounds N] [--json OUT]

Both go through what a study does per configuration: from its description to the kernel's integers,
kernel and float twin over the drive, largest and final errors. The many share one drive of the
lesson; the one drives 1,000 laps of it, made and forgotten a block of ticks at a time. Both take
turns in one process, on one thread (processor time, so that other work on the machine does not
count), and then by the clock: the one on its one thread, which is all it can use, the many on every
core. Budgets and disk are left out, and so is making the drives. Compiling is left out, and none
takes place between configurations. Last, both as whole studies, with drives, budgets and disk
(processor time). The largest resident memory stands beside.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from hil_harness import Robot, load_robot, load_wire, scenario
from hil_harness.assembly import Wire
from precision_study.study import Course, Point, Store, Study, build_points, cores, run_study
from precision_study.study.drives import Drives, drive_in_blocks
from precision_study.study.measure import Measurement, measure
from precision_study.study.space import build

TICKS = 6_000
PERIOD_US = 10_000


def points_of(robot: Robot, count: int) -> list[Point]:
    """Return *count* configurations that differ in formats, tables, rounding and rules."""
    axes = {
        "position.frac_bits": tuple(range(12, 37)),
        "rounding": ("floor", "half_up", "half_even", "toward_zero"),
        "trig.entries": (64, 256, 1024, 4096, 16384),
        "integration": ("euler_before", "midpoint"),
    }
    points = build_points(robot, axes, PERIOD_US)
    return [points[index % len(points)] for index in range(count)]


def drives_of(robot: Robot, wire: Wire, laps: int) -> Iterator[Drives]:
    """Yield so many laps of the lesson, a block of ticks at a time."""
    here = (robot.plant, wire, PERIOD_US, course(laps), (7,))
    return drive_in_blocks(scenario("lesson"), *here)


def course(laps: int) -> Course:
    """Return the course of so many laps."""
    return Course(duration_s=laps * TICKS * PERIOD_US / 1e6)


def run_one(robot: Robot, point: Point, wire: Wire, laps: int) -> tuple[float, float]:
    """Return the processor time and the clock's that one point takes over so many laps [s]."""
    used, started = -time.process_time(), time.perf_counter()
    one = Measurement(build(point, robot), 1)
    used += time.process_time()
    clock = time.perf_counter() - started
    for part in drives_of(robot, wire, laps):
        used -= time.process_time()
        started = time.perf_counter()
        one.add(part)
        used += time.process_time()
        clock += time.perf_counter() - started
    return used, clock


def run_many(robot: Robot, points: list[Point], drives: Drives, threads: int) -> float:
    """Return the seconds that all points take: processor time on one thread, else the clock's."""

    def one(point: Point) -> None:
        measure(build(point, robot), drives)

    if threads == 1:
        started = time.process_time()
        for point in points:
            one(point)
        return time.process_time() - started
    started = time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, points))
    return time.perf_counter() - started


def run_whole(robot: Robot, points: list[Point], wire: Wire, laps: int) -> float:
    """Return the processor time of a whole study of the lesson on one thread [s]."""
    study = Study(robot, wire, tuple(points), (scenario("lesson"),), (7,), course(laps))
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder)) as store:
        started = time.process_time()
        run_study(study, store, workers=1)
        return time.process_time() - started


def main() -> None:
    """Run both in turns and print medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--configurations", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    count = arguments.configurations
    robot, wire = load_robot(None), load_wire()
    (short,) = drives_of(robot, wire, 1)
    points = points_of(robot, count)
    run_many(robot, points[:8], short, 1)
    threads = max(cores(), 2)
    names = ("one_s", "many_s", "one_by_the_clock_s", "many_by_the_clock_s")
    rows: dict[str, list[float]] = {name: [] for name in (*names, "one_study_s", "many_study_s")}
    for _ in range(arguments.rounds):
        used, clock = run_one(robot, points[0], wire, count)
        rows["one_s"].append(used)
        rows["one_by_the_clock_s"].append(clock)
        rows["many_s"].append(run_many(robot, points, short, 1))
        rows["many_by_the_clock_s"].append(run_many(robot, points, short, threads))
        rows["one_study_s"].append(run_whole(robot, points[:1], wire, count))
        rows["many_study_s"].append(run_whole(robot, points, wire, 1))
    ratios = {
        "many_over_one": ("many_s", "one_s"),
        "many_over_one_by_the_clock": ("many_by_the_clock_s", "one_by_the_clock_s"),
        "many_over_one_study": ("many_study_s", "one_study_s"),
    }
    result = {name: statistics.median(values) for name, values in rows.items()}
    result |= {
        name: float(np.median(np.array(rows[many]) / np.array(rows[one])))
        for name, (many, one) in ratios.items()
    }
    result |= {
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    for name, value in result.items():
        print(f"{name:28} {value:9.3f}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(result | rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
