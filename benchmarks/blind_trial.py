"""The full blind trial in one command, and its measured page.

    python benchmarks/blind_trial.py DIR --cases 8400 [--jobs N]
    python benchmarks/blind_trial.py DIR --keep benchmarks/blind/NAME.jsonl.gz
    python benchmarks/blind_trial.py TRIAL... --page docs/reference/blind-trial.md
        [--at METHOD=COMMIT] [--again AGAIN --at again=COMMIT]

The first makes a trial in DIR where there is none, has it diagnosed by this tool and by every rival
(a run that was stopped goes on where it was), and writes DIR/scores.html. The second keeps what its
cases were and how each was judged: a full trial takes longer than a machine may be there for. The
third writes the page, and that of each effect beside it, from one or several trials, each a folder
or such a file.
"""

from __future__ import annotations

import argparse
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

import gap_diagnosis.trials.rivals
from chiplog.pages.trial import trial_page
from chiplog.pages.trial_markdown import Source, measured_pages
from gap_diagnosis.trials.full import FULL, full_counts
from gap_diagnosis.trials.kept import keep, kept
from gap_diagnosis.trials.layout import CASES, OWN_METHOD
from gap_diagnosis.trials.make import make_trial
from gap_diagnosis.trials.opening import Opened, methods_run, open_methods, together
from gap_diagnosis.trials.run import processors, run_trial
from gap_diagnosis.trials.seal import key_of
from gap_diagnosis.trials.secret import fresh_secret

RIVALS: Final = ("least_squares", "least_squares_bic", "whitened_bic", "umbmark")


def run(folder: Path, cases: int, jobs: int | None) -> None:
    """Make the trial where there is none, and diagnose what has no result yet by every method."""
    if not (folder / CASES).is_dir():
        make_trial(
            full_counts(cases),
            folder,
            key_of(folder),
            fresh_secret(),
            told("making"),
            jobs=jobs or processors(),
        )
    home = Path(gap_diagnosis.trials.rivals.__file__).parent
    for method in (None, *(home / f"{name}.py" for name in RIVALS)):
        run_trial(folder, jobs=jobs, method=method, progress=told(method.stem if method else "own"))
    opened = open_methods(folder, key_of(folder), methods_run(folder), jobs=jobs or processors())
    page = trial_page(folder.name, OWN_METHOD, opened)
    (folder / "scores.html").write_text(page, encoding="utf-8")


def judged_in(trial: Path, jobs: int) -> dict[str, Opened]:
    """Return the judged cases of a trial's folder, or of a file that keeps them, by method."""
    if trial.is_file():
        return kept(trial)
    return open_methods(trial, key_of(trial), methods_run(trial), jobs=jobs)


def told(step: str) -> Any:
    """Return a progress line's printer."""
    return lambda done, total: print(f"\r{step}: {done} of {total}", end="", flush=True)


def main() -> None:
    """Run the trial, or write its page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("trials", type=Path, nargs="+", metavar="TRIAL")
    parser.add_argument("--cases", type=int, help=f"a full trial has {FULL.cases}")
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--keep", type=Path, metavar="FILE")
    parser.add_argument("--at", action="append", default=[], metavar="METHOD=COMMIT")
    parser.add_argument(
        "--again",
        type=Path,
        metavar="DIR",
        help="results of `chiplog blind again` on the first DIR, run",
    )
    parser.add_argument("--made", default="chiplog blind make --out DIR", help="how DIR was made")
    chosen = parser.parse_args()
    if chosen.cases is not None:
        (folder,) = chosen.trials
        run(folder, chosen.cases, chosen.jobs)
    jobs = chosen.jobs or processors()
    if chosen.keep is not None:
        (trial,) = chosen.trials
        keep(chosen.keep, judged_in(trial, jobs))
    if chosen.page is not None:
        trials = [judged_in(trial, jobs) for trial in chosen.trials]
        opened = trials[0] if len(trials) == 1 else together(trials)
        again = None
        if chosen.again is not None:
            again = judged_in(chosen.again, jobs)[OWN_METHOD]
            if len(trials) > 1:
                again = together([{OWN_METHOD: again}])[OWN_METHOD]
        commits = dict(one.split("=", 1) for one in chosen.at)
        effects_page = chosen.page.with_name(f"{chosen.page.stem}-effects.md")
        today = f"{datetime.now(UTC):%Y-%m-%d}"
        whole, each = measured_pages(
            Source(opened, commits, chosen.made, today, again, effects_page.name)
        )
        chosen.page.write_text(whole, encoding="utf-8")
        effects_page.write_text(each, encoding="utf-8")


if __name__ == "__main__":
    main()
