"""Running a trial: every case in a process of its own, several at once, resumable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryFile
from typing import Final

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.trials.forks import Worker
from gap_diagnosis.trials.layout import CASES, OWN_METHOD, RESULTS
from gap_diagnosis.trials.seal import COMMITMENT, key_of

_LINES: Final = 3
_MANY: Final = 8
"""Cases of a worker from which on it pays to load the diagnosis' machine code once for all."""


@dataclass(frozen=True)
class Ran:
    """What a run did.

    Attributes:
        results: the folder of one JSON per case.
        done: cases diagnosed now.
        before: cases that were diagnosed already.
    """

    results: Path
    done: int
    before: int


def run_trial(
    folder: Path,
    *,
    jobs: int | None = None,
    method: Path | None = None,
    key: Path | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Ran:
    """Diagnose every case that has no result yet.

    A killed run goes on where it stopped: results are written whole or not at all. *key*: of the
    answers, to be closed to whoever diagnoses; None: it lies beside the folder. Raises
    DiagnosisError where *folder* is no trial or a worker dies without a word of its own.
    """
    cases = case_folders(folder)
    results = results_of(folder, method)
    results.mkdir(parents=True, exist_ok=True)
    todo = [case for case in cases if not (results / f"{case.name}.json").exists()]
    before = len(cases) - len(todo)
    progress(before, len(cases))
    words = [key or key_of(folder), *([] if method is None else [method])]
    is_own = method is None
    for finished, _ in enumerate(_finished(todo, results, words, is_own, jobs or processors()), 1):
        progress(before + finished, len(cases))
    return Ran(results, len(todo), before)


def case_folders(folder: Path) -> list[Path]:
    """Return the cases of a sealed trial, by name.

    What was not committed to before it is diagnosed proves nothing, and while a trial is being made
    some of its cases are half written. Raises DiagnosisError where there are no cases or no seal.
    """
    home = folder / CASES
    found = sorted(one for one in home.iterdir() if one.is_dir()) if home.is_dir() else []
    if not found:
        raise DiagnosisError(f"{folder}: no cases: expected a folder of `chiplog blind make`")
    if not (folder / COMMITMENT).exists():
        raise DiagnosisError(
            f"{folder}: not sealed yet: expected {COMMITMENT}, which `chiplog blind make` writes "
            "last"
        )
    return found


def results_of(folder: Path, method: Path | None) -> Path:
    """Return where the results of a method lie."""
    return folder / RESULTS / (OWN_METHOD if method is None else method.stem)


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _finished(
    todo: Sequence[Path], results: Path, words: Sequence[Path], is_own: bool, jobs: int
) -> Iterator[Path]:
    """Yield cases as they are done; on the way out no further one is begun."""
    with ExitStack() as stack, ThreadPoolExecutor(jobs) as pool:
        idle: SimpleQueue[Worker] = SimpleQueue()
        for _ in range(min(jobs, len(todo))):
            said = stack.enter_context(TemporaryFile("w+", encoding="utf-8", errors="replace"))
            worker = Worker(said, is_many=is_own and len(todo) > _MANY * jobs)
            stack.callback(worker.close)
            idle.put(worker)
        waiting: set[Future[Path]] = set()
        places = iter(todo)
        try:
            for case in places:
                waiting.add(pool.submit(_one, idle, case, results, words))
                if len(waiting) >= jobs:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    yield from (one.result() for one in done)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (one.result() for one in done)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _one(idle: SimpleQueue[Worker], case: Path, results: Path, words: Sequence[Path]) -> Path:
    out = results / f"{case.name}.json"
    worker = idle.get()
    try:
        code, said = worker.work([case, out, *words])
    finally:
        idle.put(worker)
    if not out.exists():
        last = " | ".join(said.strip().splitlines()[-_LINES:]) or "no message"
        raise DiagnosisError(f"case {case.name}: its process ended with {code}: {last}")
    return out
