"""The full blind trial in one command, and its measured page.

    python benchmarks/blind_trial.py DIR --cases 8400 [--jobs N]
    python benchmarks/blind_trial.py DIR --keep benchmarks/blind/NAME.jsonl.gz
    python benchmarks/blind_trial.py TRIAL... --page docs/reference/blind-trial.md
        [--at METHOD=COMMIT] [--again AGAIN --at again=COMMIT]

The first makes a trial in DIR where there is none, has it diagnosed by this tool and by every rival
(a run that was stopped goes on where it was), and writes DIR/scores.html. The second keeps what its
cases were and how each was judged: a full trial takes longer than a machine may be there for. The
third writes the page from one or several trials, each a folder or such a file.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

import gap_diagnosis.trials.rivals
from chiplog.pages.trial import common_cases, figure_rows, trial_page
from chiplog.pages.trial_words import FIGURES, MISSED, NOT_MEASURED, UNPROVED, figure
from gap_diagnosis.trials.full import FULL, full_counts, tally
from gap_diagnosis.trials.kept import keep, kept
from gap_diagnosis.trials.layout import CASES, OWN_METHOD
from gap_diagnosis.trials.make import make_trial
from gap_diagnosis.trials.opening import Opened, methods_run, open_methods, together
from gap_diagnosis.trials.run import processors, run_trial
from gap_diagnosis.trials.score import scores
from gap_diagnosis.trials.seal import key_of
from gap_diagnosis.trials.secret import fresh_secret

RIVALS: Final = ("least_squares", "least_squares_bic", "whitened_bic", "umbmark")
_WRONG_MOST: Final = 12


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


def markdown(
    opened: Mapping[str, Opened], commits: Mapping[str, str], made: str, again: Opened | None
) -> str:
    """Return the measured page."""
    own = scores(opened[OWN_METHOD], again)
    parts = own["parts"]
    rows = figure_rows(parts["all"], parts)
    judged = [row for row in rows if row[3]]
    missed = [row[0] for row in judged if row[3] == MISSED]
    unproved = sum(row[3] == UNPROVED for row in judged)
    lines = [
        "<!-- Written by benchmarks/blind_trial.py; run that again instead of editing. -->",
        "",
        "# Blind trial, as measured",
        "",
        f"**{own['cases']} cases; {len(judged) - len(missed)} of {len(judged)} goals reached, "
        f"{unproved} of them without proof.** "
        f"{own['crashes']} crashes. How it was made and what each word means: "
        "[Blind trials](../how-to/blind-trials.md).",
        *_lacking(opened[OWN_METHOD]),
        *_missing(own["missing"]),
        "",
        f"Measured on {datetime.now(UTC):%Y-%m-%d}. Made with",
        "",
        f"    {made}",
        *(["    chiplog blind again DIR --out AGAIN"] if again else []),
        "",
        "Command and version of each method:",
        "",
        "| method | command | commit | cases |",
        "| --- | --- | --- | --- |",
    ]
    for name, one in opened.items():
        option = "" if name == OWN_METHOD else f" --method gap_diagnosis/trials/rivals/{name}.py"
        command = f"`chiplog blind run DIR{option}`"
        lines.append(f"| {name} | {command} | {commits.get(name, '')} | {len(one.judged)} |")
    if again is not None:
        of_again = f"{commits.get('again', '')} | {len(again.judged)}"
        lines.append(f"| chiplog, one manoeuvre more | `chiplog blind run AGAIN` | {of_again} |")
    lines += ["", "## What must be reached, and what is", ""]
    lines += table(["figure", "measured (95 %), cases", "must be", ""], rows)
    if missed:
        lines += ["", f"**Missed: {'; '.join(missed)}.**"]
    blank = [row[0] for row in rows if row[1] == NOT_MEASURED]
    if blank:
        lines += ["", f"**Not measured: {'; '.join(blank)}.**"]
    lines += ["", "## By stratum", ""]
    strata = [name for name in ("prior", "limit", "field") if name in parts]
    lines += table(
        ["figure", *strata],
        [[one.label, *(figure(parts[name], one) for name in strata)] for one in FIGURES],
    )
    lines += ["", *rivals(opened), "## Told wrong", ""]
    lines += table(
        ["case", "truth", "told", "probability"],
        [
            [one["case"], _effects(one), one["verdict"], f"{one['probability']:.2f}"]
            for one in own["wrong"][:_WRONG_MOST]
        ],
    )
    return "\n".join(lines) + "\n"


def _lacking(own: Opened) -> list[str]:
    """Return the lines that say of what a trial has less than a full one."""
    lacking = tally(one.case for one in own.judged).lacking
    if not lacking:
        return []
    return ["", f"**Less than a full trial has: {'; '.join(lacking)}.** Read the intervals."]


def _missing(count: int) -> list[str]:
    """Say how many cases have no result of ours here: they stand in an order that says nothing of
    them, sealed still or diagnosed at other commits."""
    if not count:
        return []
    return ["", f"{count:,} more cases of the trial were not diagnosed at what is named below."]


def _effects(one: Mapping[str, Any]) -> str:
    names = " + ".join(one["effects"]) or "no_gap"
    return f"{names} (right: unknown)" if one["truth"] == "unknown" else names


def rivals(opened: Mapping[str, Opened]) -> list[str]:
    """Return the table of all methods on the cases that all of them have."""
    common = common_cases(opened)
    if len(common) < 2:
        return []
    parts = {name: scores(one)["parts"]["all"] for name, one in common.items()}
    count = len(next(iter(common.values())).judged)
    return [
        "## Rivals",
        "",
        f"On the same {count} cases: those that every method was run on.",
        "",
        *table(
            ["figure", *parts],
            [[one.label, *(figure(part, one) for part in parts.values())] for one in FIGURES],
        ),
        "",
    ]


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]


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
        chosen.page.write_text(markdown(opened, commits, chosen.made, again), encoding="utf-8")


if __name__ == "__main__":
    main()
