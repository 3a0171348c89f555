"""The largest resident memory of the whole command `chiplog study`.

    .venv/bin/python benchmarks/study_memory.py [--workers N] [--only ticks|runs|configurations]

Each row is a command of its own, from start to page. Prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile

ONE = ("--sweep", "integration=midpoint", "--seeds", "1")
SWEEPS = (
    ("position.frac_bits=12..21",),
    ("rounding=floor,half_up", "stale_heading_ticks=0..4"),
    ("mode=gyro,wheel", "heading.frac_bits=16,20,24,28,32"),
)
ROWS: dict[str, dict[str, tuple[str, ...]]] = {
    "ticks": {
        f"one drive of {duration_s:,} s at 100 Hz": (*ONE, "--after", f"{duration_s} s")
        for duration_s in (10, 1_000, 10_000, 30_000)
    },
    "runs": {
        f"{seeds:,} drives of 1,000 s": (*ONE[:2], "--seeds", f"{seeds}", "--after", "1000 s")
        for seeds in (8, 64, 512, 1536)
    },
    "configurations": {
        f"{10 ** (count + 1):,} configurations over 4 drives of 100 s": (
            *(word for sweep in SWEEPS[: count + 1] for one in sweep for word in ("--sweep", one)),
            *("--seeds", "4", "--after", "100 s"),
        )
        for count in range(len(SWEEPS))
    },
}


def run(words: tuple[str, ...], workers: int) -> float:
    """Return the largest resident memory of one command [MB]."""
    command = [sys.executable, "-m", "chiplog", "study", "--scenario", "lesson", *words]
    with tempfile.TemporaryDirectory() as folder:
        command += ["--workers", str(workers), "--out", folder]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, command
    return float(usage.ru_maxrss) / 1024


def main() -> None:
    """Run every row and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=tuple(ROWS), action="append")
    arguments = parser.parse_args()
    print("| study of the lesson | largest memory |\n|---|---:|")
    for kind in arguments.only or ROWS:
        for name, words in ROWS[kind].items():
            print(f"| {name} | {run(words, arguments.workers):.0f} MB |", flush=True)


if __name__ == "__main__":
    main()
