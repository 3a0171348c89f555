"""What a diagnosis costs: processor time of a case in batch, and what a long log takes.

    python benchmarks/diagnosis_cost.py [--durations 120 900 3600] [--rounds N] [--kinds size …]

For each duration [s] and kind of effect (of a size, in a window, above a threshold) one log of the
scenario `random`, 100 ticks a second with a reference sample each; whole library and pairs. Every
diagnosis is a fork of a process that has loaded what all need, as `chiplog blind run` makes them,
on one thread; reading is included. The median over rounds of processor time (user and system, so
that other work on the machine counts little), and the largest peak of resident memory, imports
included.
"""

import argparse
import itertools
import os
import statistics
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.trials.worker import load
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot

KINDS = {
    "size": ["wheelbase_scale.scale=0.02"],
    "window": [
        f"one_sided_slip.{one}" for one in ("side=left", "ratio=0.1", "start_s=40", "stop_s=60")
    ],
    "threshold": [
        f"missed_ticks.{one}" for one in ("side=left", "probability=0.02", "threshold=5")
    ],
}


def make_log(folder: Path, duration_s: int, kind: str) -> None:
    """Run the loop into a folder."""
    words = [sys.executable, "-m", "chiplog", "run", "--scenario", "random"]
    for effect in KINDS[kind]:
        words += ["--effect", effect]
    words += ["--duration-s", str(duration_s), "--out", str(folder)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)


def diagnose(folder: Path) -> None:
    """Read and diagnose as a trial's worker does."""
    robot, wire = load_robot(None), load_wire()
    recordings = read_recordings(
        [folder / "bus.log"], robot=robot, wire=wire, references=[folder / "reference.tum"]
    )
    diagnose_recordings(recordings, robot, wire)


def cost(folder: Path) -> tuple[float, float]:
    """Return processor time [s] and peak memory [MB] of one diagnosis in a fork."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            diagnose(folder)
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    if status != 0:
        raise SystemExit(f"{folder}: the diagnosis failed")
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1000  # kB on Linux


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--durations", type=int, nargs="+", default=[120, 900, 3600])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=["size"])
    options = parser.parse_args()
    load()
    print("| log | ticks | effect | processor time | per 120 s of log | peak memory |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as home:
        for duration_s, kind in itertools.product(options.durations, options.kinds):
            folder = Path(home) / f"{kind}_{duration_s}"
            make_log(folder, duration_s, kind)
            rounds = [cost(folder) for _ in range(options.rounds)]
            seconds = statistics.median(one[0] for one in rounds)
            peak_mb = max(one[1] for one in rounds)
            print(
                f"| {duration_s:,} s | {100 * duration_s:,} | {kind} | {seconds:.1f} core-s | "
                f"{seconds * 120 / duration_s:.1f} core-s | {peak_mb:,.0f} MB |",
                flush=True,
            )


if __name__ == "__main__":
    main()
