"""The batch path against the lesson's simulate() as printed.

    python benchmarks/batch.py [--runs N] [--rounds N] [--json OUT]

One of our runs is what one call of the rival is: truth, noisy sensors, and both estimators, wheel
only and gyro heading, to their final errors; ours are the fixed-point firmware's, on both cores.
The two take turns in one process. Compiling is left out and stated.
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

CHUNK_RUNS = 500  # the counts of so many runs take 72 MB


def lesson_runs(
    robot: Robot, wire: Wire, configs: list[KernelConfig], seeds: range
) -> dict[str, float]:
    """Run the lesson once per seed with each configuration; return mean final position errors."""
    errors_m: dict[str, list[float]] = {name: [] for name in LESSON_ESTIMATORS}
    for start in range(seeds.start, seeds.stop, CHUNK_RUNS):
        chunk = range(start, min(start + CHUNK_RUNS, seeds.stop))
        plant = simulate_batch(scenario("lesson"), robot, wire, chunk, outputs="odometry")
        for name, config in zip(LESSON_ESTIMATORS, configs, strict=True):
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
    configs = [
        build_config(own.description.model_copy(update=dict(choice)), own.constants)
        for choice in LESSON_ESTIMATORS.values()
    ]
    started = time.perf_counter()
    lesson_runs(robot, wire, configs, range(2))
    compile_s = time.perf_counter() - started
    ours_ms, printed_ms, ratios = [], [], []
    means: dict[str, float] = {}
    for _ in range(arguments.rounds):
        started = time.perf_counter()
        means = lesson_runs(robot, wire, configs, range(arguments.runs))
        ours_ms.append((time.perf_counter() - started) / arguments.runs * 1e3)
        started = time.perf_counter()
        simulate_as_printed()
        printed_ms.append((time.perf_counter() - started) * 1e3)
        ratios.append(printed_ms[-1] / ours_ms[-1])
    result = {
        "runs": arguments.runs,
        "rounds": arguments.rounds,
        "compile_or_load_s": compile_s,
        "ours_ms_per_run": _spread(ours_ms),
        "printed_ms_per_run": _spread(printed_ms),
        "printed_over_ours": _spread(ratios),
        "mean_final_error_m": means,
    }
    print(f"machine code compiled or loaded in {compile_s:.2f} s (left out below)")
    for name in ("ours_ms_per_run", "printed_ms_per_run", "printed_over_ours"):
        low, median, high = _spread(
            {"ours_ms_per_run": ours_ms, "printed_ms_per_run": printed_ms}.get(name, ratios)
        )
        print(f"{name:20s} median {median:9.3f}   {low:.3f} … {high:.3f}")
    for name, mean_m in means.items():
        print(f"mean final error, {name}: {mean_m:.4f} m")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


def _spread(values: list[float]) -> tuple[float, float, float]:
    return min(values), statistics.median(values), max(values)


if __name__ == "__main__":
    main()
