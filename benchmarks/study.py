"""Many configurations against many ticks: 1,000 × 6,000 steps over one × 6 million.

    .venv/bin/python benchmarks/study.py [--configurations N] [--rounds N] [--json OUT]

Both go through what a study does per configuration: from its description to the kernel's integers,
kernel and float twin over the drive, largest and final errors. The many share one drive of the
lesson; the one drives 1,000 laps of it. Both take turns in one process, on one thread (processor
time, so that other work on the machine does not count), and then by the clock: the one on its one
thread, which is all it can use, the many on every core. Budgets and disk are left out. Compiling is
left out, and none takes place between configurations. The largest resident memory stands beside.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from hil_harness import Robot, load_robot, load_wire, scenario
from precision_study.study import Course, Point, build_points
from precision_study.study.drives import Drives, drive
from precision_study.study.measure import measure
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


def run(robot: Robot, points: list[Point], drives: Drives, threads: int) -> float:
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


def main() -> None:
    """Run both in turns and print medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--configurations", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    count = arguments.configurations
    robot, wire = load_robot(None), load_wire()
    short, long = (
        drive(
            scenario("lesson"),
            robot.plant,
            wire,
            PERIOD_US,
            Course(duration_s=laps * TICKS * PERIOD_US / 1e6),
            (7,),
        )
        for laps in (1, count)
    )
    points = points_of(robot, count)
    run(robot, points[:8], short, 1)
    cores = len(os.sched_getaffinity(0))
    names = ("one_s", "many_s", "one_by_the_clock_s", "many_by_the_clock_s")
    rows: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(arguments.rounds):
        rows["one_s"].append(run(robot, points[:1], long, 1))
        rows["many_s"].append(run(robot, points, short, 1))
        started = time.perf_counter()
        run(robot, points[:1], long, 1)
        rows["one_by_the_clock_s"].append(time.perf_counter() - started)
        rows["many_by_the_clock_s"].append(run(robot, points, short, max(cores, 2)))
    ratios = np.array(rows["many_s"]) / np.array(rows["one_s"])
    spread = np.array(rows["many_by_the_clock_s"]) / np.array(rows["one_by_the_clock_s"])
    result = {name: statistics.median(values) for name, values in rows.items()}
    result |= {
        "many_over_one": float(np.median(ratios)),
        "many_over_one_by_the_clock": float(np.median(spread)),
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    for name, value in result.items():
        print(f"{name:28} {value:9.3f}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(result | rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
