"""The batch path against the lesson's simulate() as printed.

    python benchmarks/batch.py [--runs N] [--rounds N] [--json OUT]

A run of the batch path is the lesson's truth, its noisy sensors and the fixed-point firmware, to
the final error, on both cores. The rival computes two float estimators in its one loop, so a
second row gives ours with the firmware run twice as well: wheel only and gyro heading. All take
turns in one process. Compiling is left out and stated.
"""

import argparse
import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np

from firmware_model import KernelConfig, build_config, run_batch
from hil_harness import Robot, Wire, load_robot, load_wire, scenario
from hil_harness.batch import simulate_batch
from hil_harness.nodes import firmware_config
from hil_harness.traces import LESSON_ESTIMATORS

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "hil_harness"))
from lesson_as_printed import simulate as simulate_as_printed

CHUNK_RUNS = 200  # the counts of so many runs take 29 MB, which the allocator hands out again


def lesson_runs(
    robot: Robot, wire: Wire, configs: dict[str, KernelConfig], seeds: range
) -> dict[str, float]:
    """Run the lesson once per seed with each configuration; return mean final position errors."""
    errors_m: dict[str, list[float]] = {name: [] for name in configs}
    for start in range(seeds.start, seeds.stop, CHUNK_RUNS):
        chunk = range(start, min(start + CHUNK_RUNS, seeds.stop))
        plant = simulate_batch(scenario("lesson"), robot, wire, chunk, outputs="odometry")
        for name, config in configs.items():
            final = run_batch(
                config,
                plant.left_count,
                plant.right_count,
                plant.gyro_code,
                twin=False,
                history=False,
            ).final_states
            x_m, y_m = (
                np.ldexp(final[axis].astype(np.float64), -config.position_frac_bits)
                for axis in ("x_m_q", "y_m_q")
            )
            truth = plant.truth[:, -1]
            errors_m[name] += np.hypot(x_m - truth[:, 0], y_m - truth[:, 1]).tolist()
    return {name: statistics.fmean(values) for name, values in errors_m.items()}


def main() -> None:
    """Run both in turns and print medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    robot, wire = load_robot(None), load_wire()
    own = firmware_config(robot, wire.signal_map, wire.tick_period_us)
    both = {
        name: build_config(own.description.model_copy(update=dict(choice)), own.constants)
        for name, choice in LESSON_ESTIMATORS.items()
    }
    one = {"gyro heading": both["gyro heading"]}
    started = time.perf_counter()
    lesson_runs(robot, wire, both, range(2))
    compile_s = time.perf_counter() - started
    rows: dict[str, list[float]] = {
        "one_firmware_ms_per_run": [],
        "both_estimators_ms_per_run": [],
        "printed_ms_per_run": [],
        "printed_over_one_firmware": [],
        "printed_over_both_estimators": [],
    }
    means: dict[str, float] = {}
    for _ in range(arguments.rounds):
        took = []
        for configs in (one, both):
            started = time.perf_counter()
            means = lesson_runs(robot, wire, configs, range(arguments.runs))
            took.append((time.perf_counter() - started) / arguments.runs * 1e3)
        started = time.perf_counter()
        simulate_as_printed()
        printed_ms = (time.perf_counter() - started) * 1e3
        for row, value in zip(
            rows.values(),
            (*took, printed_ms, printed_ms / took[0], printed_ms / took[1]),
            strict=True,
        ):
            row.append(value)
    result = {
        "runs": arguments.runs,
        "rounds": arguments.rounds,
        "compile_or_load_s": compile_s,
        **{name: _spread(values) for name, values in rows.items()},
        "mean_final_error_m": means,
    }
    print(f"machine code compiled or loaded in {compile_s:.2f} s (left out below)")
    for name, values in rows.items():
        low, median, high = _spread(values)
        print(f"{name:28s} median {median:9.3f}   {low:.3f} … {high:.3f}")
    for name, mean_m in means.items():
        print(f"mean final error, {name}: {mean_m:.4f} m")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


def _spread(values: list[float]) -> tuple[float, float, float]:
    return min(values), statistics.median(values), max(values)


if __name__ == "__main__":
    main()
