"""How accurate the motion's estimates are, given the right name.

    python benchmarks/accuracy_motion.py limit --rounds 40 --results DIR
    python benchmarks/accuracy_motion.py exact --rounds 40 --results DIR
    python benchmarks/accuracy_motion.py prior --rounds 150 --results DIR
    python benchmarks/accuracy_motion.py page --results DIR --commit HASH \\
        --out docs/reference/accuracy.md

*limit*: each effect at 2 to 10 times its detection limit, every constant of the description off
within its tolerance; errors over the Cramér-Rao bound. *exact*: the same with constants that are
exact and known to be. *prior*: sizes from the published prior; coverage and ranks. A round is one
case of each effect; rounds before *--first* are those that mends were read from. Results are
appended to DIR as lines of JSON; what is there already is not done again, so that a run may be
stopped and gone on with.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any, get_args

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

from accuracy.fits import Study, run_case
from accuracy.page import page
from accuracy.sizes import NOISY, SMOOTH, STEPPED

Task = tuple[Study, str, int]


def main() -> None:
    """Run a study, or write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=[*get_args(Study), "page"])
    parser.add_argument("--results", type=Path, required=True, help="folder of results")
    parser.add_argument("--rounds", type=int, default=40, help="cases of each effect")
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--effects", help="names, separated by commas; all without it")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--until", help="HH:MM: begin no case after this time today")
    parser.add_argument("--out", type=Path, help="of the page")
    parser.add_argument("--commit", default="", help="that was measured, for the page")
    given = parser.parse_args()
    given.results.mkdir(parents=True, exist_ok=True)
    if given.what == "page":
        text = page(results(given.results), commit=given.commit)
        if given.out is None:
            print(text)
        else:
            given.out.write_text(text, encoding="utf-8")
        return
    names = given.effects.split(",") if given.effects else [*SMOOTH, *NOISY, *STEPPED]
    rounds = range(given.first, given.first + given.rounds)
    run(given.what, names, rounds, given.results, given.jobs, given.until)


def results(folder: Path) -> list[dict[str, Any]]:
    """Return every result in a folder."""
    lines = (
        line
        for path in sorted(folder.glob("*.jsonl"))
        for line in path.read_text(encoding="utf-8").splitlines()
    )
    return [json.loads(line) for line in lines]


def run(
    study: Study, names: list[str], rounds: range, folder: Path, jobs: int, until: str | None
) -> None:
    """Run what is not there yet and append it."""
    done = {(one["study"], one["effect"], one["number"]) for one in results(folder)}
    tasks: list[Task] = [
        (study, name, number)
        for number in rounds
        for name in names
        if (study, name, number) not in done
    ]
    print(f"{len(tasks)} cases to do, {len(done)} there")
    with (
        ProcessPoolExecutor(jobs) as pool,
        (folder / f"{study}.jsonl").open("a", encoding="utf-8") as out,
    ):
        for result in pool.map(_case, _in_time(tasks, until), chunksize=1):
            if result is not None:
                out.write(json.dumps(result) + "\n")
                out.flush()


def _in_time(tasks: list[Task], until: str | None) -> Iterator[tuple[Task, str | None]]:
    return ((task, until) for task in tasks)


def _case(given: tuple[Task, str | None]) -> dict[str, Any] | None:
    task, until = given
    if until is not None and f"{datetime.now():%H:%M}" >= until:
        return None
    try:
        return run_case(*task)
    except (ArithmeticError, LookupError, ValueError) as error:  # told on the page
        study, effect, number = task
        return {
            "study": study,
            "effect": effect,
            "number": number,
            "truth": None,
            "failed": repr(error),
        }


if __name__ == "__main__":
    main()
