"""The compiled batch kernel against the C99 twin, and against fixed-point libraries.

    .venv/bin/pip install -e .[bench]
    .venv/bin/python benchmarks/kernels.py [--runs N] [--rounds N] [--json OUT]

One table per set of formats; every row of a table steps the same drive with the same formats, which
are read at run time, and ends in the same integers (checked). All rows take turns in each round, so
that other work on the machine slows them alike; a row gives its least and its median time, and
`CPU` the median of what it used of the processor. Machine code is compiled, and C built, before.

`lesson` is the lesson's drive from the simulated sensors; `faults` has glitches, lost frames,
gaps, standstills and saturated codes. The libraries' loops do only the arithmetic of a good tick
(rival_loops.py), over the first ticks of a drive that never rests.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from rival_loops import Inputs, apytypes_pose, fxpmath_pose

from firmware_model import FirmwareDescription, Kernel, KernelConfig, build_config, run_batch
from firmware_model.batch import BatchRuns, run_batch_c99
from hil_harness import load_robot, load_wire, scenario
from hil_harness.batch import simulate_batch
from hil_harness.nodes import firmware_config

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "firmware_model"))
from test_kernel_bit_equal import random_ticks

GCC_O3: Final = ("-std=c99", "-O3")
GCC_NATIVE: Final = ("-std=c99", "-O3", "-flto", "-march=native")
FLOOR: Final[dict[str, Any]] = {"turn_step": {"rounding": "floor"}, "trig": {"rounding": "floor"}}
NARROW: Final[dict[str, Any]] = {
    "step": {"word_bits": 24, "frac_bits": 20, "constant_frac_bits": 34},
    "gyro": {"offset_frac_bits": 8, "sensitivity_frac_bits": 48},
    "turn_step": {"word_bits": 48, "frac_bits": 36, "rounding": "floor"},
    "heading": {"frac_bits": 24},
    "trig": {"entries": 256, "frac_bits": 14, "rounding": "floor"},
    "position": {"word_bits": 32, "frac_bits": 16},
}
"""Products of at most 53 bits: fxpmath rescales by way of float64."""


@dataclass
class Row:
    """One way to do a table's work: what it takes, in ns a tick and core or cores."""

    name: str
    ticks: int
    run: Callable[[], Any]
    wall_ns: list[float] = field(default_factory=list)
    cpu_ns: list[float] = field(default_factory=list)

    def take(self) -> None:
        """Run once more."""
        wall, cpu = time.perf_counter(), time.process_time()
        self.run()
        self.cpu_ns.append((time.process_time() - cpu) / self.ticks * 1e9)
        self.wall_ns.append((time.perf_counter() - wall) / self.ticks * 1e9)


def kernels(config: KernelConfig, drive: tuple[npt.ArrayLike, ...], cores: int) -> list[Row]:
    """Return the rows of both kernels; their final states are equal, field by field."""
    ticks = int(np.asarray(drive[0]).size)

    def ours(workers: int) -> BatchRuns:
        return run_batch(config, *drive, twin=False, history=False, workers=workers)

    def c99(workers: int, flags: tuple[str, ...] = GCC_O3) -> BatchRuns:
        return run_batch_c99(config, *drive, history=False, workers=workers, flags=flags)

    expected = ours(1).final_states
    for flags in (GCC_O3, GCC_NATIVE):
        assert np.array_equal(c99(1, flags).final_states, expected)
    rows = [
        Row("compiled batch, 1 core", ticks, lambda: ours(1)),
        Row("C twin, gcc -O3, 1 core", ticks, lambda: c99(1)),
        Row("C twin, gcc -O3 -flto -march=native, 1 core", ticks, lambda: c99(1, GCC_NATIVE)),
    ]
    if np.asarray(drive[0]).shape[0] > 1:
        rows.append(Row(f"compiled batch, {cores} cores", ticks, lambda: ours(cores)))
        rows.append(Row(f"C twin, gcc -O3, {cores} cores", ticks, lambda: c99(cores)))
    return rows


def rivals(config: KernelConfig, drive: Inputs, loops: dict[str, tuple[Any, int]]) -> list[Row]:
    """Return the rows of the readable kernel and of the libraries; they end in one pose."""
    rows = [Row("the kernel as plain Python", 2000, lambda: python_pose(config, drive[:2000]))]
    for name, (loop, ticks) in loops.items():
        part = drive[:ticks]
        assert loop(config, part) == python_pose(config, part), name
        rows.append(Row(name, ticks, partial(loop, config, part)))
    return rows


def python_pose(config: KernelConfig, drive: Inputs) -> tuple[int, int, int]:
    """Return the pose of the kernel as plain Python."""
    kernel = Kernel(config, "python")
    for left, right, code in drive.tolist():
        kernel.step(left, right, 0, code, 0)
    return kernel.pose_q


def restless_drive(ticks: int) -> Inputs:
    """Return a drive that turns both ways and never stands."""
    tick = np.arange(ticks)
    inputs = np.empty((ticks, 3), dtype=np.int64)
    inputs[:, 0] = np.cumsum(np.rint(60 + 40 * np.sin(tick / 70))) % 65536
    inputs[:, 1] = np.cumsum(np.rint(70 + 40 * np.sin(tick / 90))) % 65536
    inputs[:, 2] = 32768 + np.rint(9000 * np.sin(tick / 50)) + tick % 3
    return inputs


def tables(runs: int) -> dict[str, list[Row]]:
    """Return the rows of each table."""
    robot, wire = load_robot(None), load_wire()
    constants = firmware_config(robot, wire.signal_map, wire.tick_period_us).constants
    plant = simulate_batch(scenario("lesson"), robot, wire, range(runs), outputs="odometry")
    lesson = (plant.left_count, plant.right_count, plant.gyro_code)
    default = build_config(FirmwareDescription(), constants)
    columns = [random_ticks(default, seed, 20_000).T for seed in range(max(runs // 4, 1))]
    left, right, encoder, code, gyro = np.ascontiguousarray(np.stack(columns, axis=1))
    faults = (left, right, code, encoder.astype(np.int8), gyro.astype(np.int8))
    floor = build_config(FirmwareDescription.from_table(FLOOR), constants)
    narrow = build_config(FirmwareDescription.from_table(NARROW), constants)
    restless = restless_drive(2000)
    cores = len(os.sched_getaffinity(0))
    apytypes_row = {"apytypes, APyFixed scalars": (apytypes_pose, 1000)}
    fxpmath_row = {"fxpmath, Fxp objects": (fxpmath_pose, 60)}
    return {
        "lesson, default formats": kernels(default, lesson, cores),
        "faults, default formats": kernels(default, faults, cores),
        "default formats, floor": kernels(floor, lesson, cores)[:2]
        + rivals(floor, restless, apytypes_row),
        "narrow formats, floor": kernels(narrow, lesson, cores)[:2]
        + rivals(narrow, restless, apytypes_row | fxpmath_row),
    }


def main() -> None:
    """Run all rows in turns and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="of 6000 ticks")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results: dict[str, Any] = {"runs": arguments.runs, "rounds": arguments.rounds}
    for name, rows in tables(arguments.runs).items():
        for turn in range(arguments.rounds):
            for row in rows[:: 1 if turn % 2 == 0 else -1]:
                row.take()
        results[name] = print_table(name, rows)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")


def print_table(name: str, rows: list[Row]) -> dict[str, Any]:
    """Print one table, its speeds relative to the C twin's; return it as data."""
    print(
        f"\n{name:45}{'ns/tick, min':>14}{'median':>10}{'CPU':>10}{'speed / C twin':>16}{'CPU':>8}"
    )
    data = {}
    c_twin = rows[1]
    for row in rows:
        wall, cpu = statistics.median(row.wall_ns), statistics.median(row.cpu_ns)
        speed = min(c_twin.wall_ns) / min(row.wall_ns)
        by_cpu = statistics.median(
            theirs / own for theirs, own in zip(c_twin.cpu_ns, row.cpu_ns, strict=True)
        )
        least = min(row.wall_ns)
        print(f"{row.name:45}{least:14.1f}{wall:12.1f}{cpu:12.1f}{speed:16.2g}{by_cpu:9.2g}")
        data[row.name] = {
            "ns_per_tick": {"min": least, "median": wall, "cpu_median": cpu},
            "speed_over_c_twin": {"wall_min": speed, "cpu_median": by_cpu},
        }
    return data


if __name__ == "__main__":
    main()
