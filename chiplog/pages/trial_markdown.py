"""The measured pages of the documentation: a blind trial's figures as tables of Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from chiplog.pages.trial import common_cases
from chiplog.pages.trial_rows import (
    ALARM_HEAD,
    CALIBRATION_HEAD,
    EFFECT_HEAD,
    FIGURE_HEAD,
    MISS_HEAD,
    STAGE_HEAD,
    Rows,
    alarm_rows,
    calibration_rows,
    effect_rows,
    figure_rows,
    miss_rows,
    stage_rows,
    stratum_rows,
)
from chiplog.pages.trial_words import FIGURES, MISSED, NOT_MEASURED, UNPROVED, figure
from gap_diagnosis.trials.full import tally
from gap_diagnosis.trials.layout import OWN_METHOD
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.score import scores

_NOTE: Final = "<!-- Written by benchmarks/blind_trial.py; run that again instead of editing. -->"


@dataclass(frozen=True)
class Source:
    """What a trial's pages are written from.

    Attributes:
        opened: the trial by method, our own among them.
        commits: by method, the version that it was run at; ``again`` for one manoeuvre more.
        made: the commands that the trial was made with.
        date: of the pages, as ISO 8601 has it.
        again: the trial of its ambiguous cases with one log more.
        effects_page: name of the page of each effect, beside that of the whole.
    """

    opened: Mapping[str, Opened]
    commits: Mapping[str, str]
    made: str
    date: str
    again: Opened | None = None
    effects_page: str = "blind-trial-effects.md"


def measured_pages(source: Source) -> tuple[str, str]:
    """Return the page of the whole, and that of each effect."""
    found = scores(source.opened[OWN_METHOD], source.again)
    return _whole(source, found), _effects_page(found)


def _whole(source: Source, found: Mapping[str, Any]) -> str:
    parts = found["parts"]
    rows = figure_rows(parts["all"], parts)
    judged = [row for row in rows if row[3]]
    missed = [row[0] for row in judged if row[3] == MISSED]
    unproved = sum(row[3] == UNPROVED for row in judged)
    crashes = found["crashes"]
    lines = [
        _NOTE,
        "",
        "# Blind trial, as measured",
        "",
        f"**{found['cases']} cases; {len(judged) - len(missed)} of {len(judged)} goals reached, "
        f"{unproved} of them without proof.** "
        f"{crashes} {'crash' if crashes == 1 else 'crashes'}. How it was made and what each word "
        f"means: [Blind trials](../how-to/blind-trials.md). Each effect by itself: "
        f"[Blind trial, by effect]({source.effects_page}).",
        *_lacking(source.opened[OWN_METHOD]),
        *_missing(found["missing"]),
        "",
        *_versions(source),
        "## What must be reached, and what is",
        "",
        *table(FIGURE_HEAD, rows),
    ]
    if missed:
        lines += ["", f"**Missed: {'; '.join(missed)}.**"]
    blank = [row[0] for row in rows if row[1] == NOT_MEASURED]
    if blank:
        lines += ["", f"**Not measured: {'; '.join(blank)}.**"]
    lines += ["", *_by_stratum(found), *_curves(found), *_rivals(source.opened)]
    lines += ["## Told wrong", ""]
    lines += table(
        ["case", "truth", "told", "probability"],
        [
            [one["case"], _at_work(one), one["verdict"], f"{one['probability']:.2f}"]
            for one in found["wrong"]
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


def _versions(source: Source) -> list[str]:
    """Return how the trial was made, and the command and version of each method."""
    rows = []
    for name, one in source.opened.items():
        option = "" if name == OWN_METHOD else f" --method gap_diagnosis/trials/rivals/{name}.py"
        command = f"`chiplog blind run DIR{option}`"
        rows.append([name, command, source.commits.get(name, ""), str(len(one.judged))])
    made = source.made
    if source.again is not None:
        made += "\n    chiplog blind again DIR --out AGAIN"
        at, count = source.commits.get("again", ""), len(source.again.judged)
        rows.append(["chiplog, one manoeuvre more", "`chiplog blind run AGAIN`", at, str(count)])
    return [
        f"Measured on {source.date}. Made with",
        "",
        f"    {made}",
        "",
        "Command and version of each method:",
        "",
        *table(["method", "command", "commit", "cases"], rows),
        "",
    ]


def _by_stratum(found: Mapping[str, Any]) -> list[str]:
    (head, *rows), missed = stratum_rows(found)
    return [
        "## By stratum",
        "",
        "The goals are set for all strata together; here each stratum is held to them by itself.",
        *(["", f"**Missed in one stratum by itself: {'; '.join(missed)}.**"] if missed else []),
        "",
        *table(head, rows),
        "",
    ]


def _curves(found: Mapping[str, Any]) -> list[str]:
    """Return the tables of what is missed, believed, mistaken and triggered."""
    alarms = found["other_engine_alarms"]
    return [
        "## What is missed, by size",
        "",
        "Cases of one effect beyond its tolerance, whether the library has its name or not. Of the "
        "best of all tests: what it would miss at 1 % false alarms over 60 candidates, had an "
        "effect one known shape in one known channel.",
        "",
        *table(MISS_HEAD, miss_rows(found["miss_curve"])),
        "",
        "## How far probabilities hold",
        "",
        "The reported group's probability, in fifteenths of the cases of the prior stratum and of "
        "leave-one-out. A perfect forecaster is right between the two ends 19 times in 20; what "
        "lies outside is bold.",
        "",
        *table(CALIBRATION_HEAD, calibration_rows(found["parts"]["all"]["forecast"]["bins"])),
        "",
        "## Which stage was told for which",
        "",
        "Nulls, and effects at two limits or above; a cause without a name in the library in the "
        "last row. In brackets: in what share of the row's cases an answer of that stage, and not "
        "of the true one, is within a separation of 29, so that nobody could tell which it was. "
        "Mistakes should lie there and nowhere else.",
        "",
        *table(STAGE_HEAD, stage_rows(found["stages"])),
        "",
        "## What the other engine's difference triggers",
        "",
        *(
            table(ALARM_HEAD, alarm_rows(alarms))
            if alarms
            else ["Nothing, in the matched nulls that there are."]
        ),
        "",
    ]


def _rivals(opened: Mapping[str, Opened]) -> list[str]:
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


def _at_work(one: Mapping[str, Any]) -> str:
    names = " + ".join(one["effects"]) or "no_gap"
    return f"{names} (right: unknown)" if one["truth"] == "unknown" else names


def _effects_page(found: Mapping[str, Any]) -> str:
    lines = [
        _NOTE,
        "",
        "# Blind trial, by effect",
        "",
        "The cases of the [blind trial](blind-trial.md) that have one effect, alone. *Clear*: at "
        "or above twice its detection limit; what stands to the right is of these, with 95 % "
        "intervals and the count that each is of: group-top-1 of all, the stage where the oracle "
        "group lies in one, top-1 and the probability of the truth where one name is right. Last: "
        "answers within a separation of 29 of the truth, which nobody could tell from it, and in "
        "how many of the clear cases. A noise has no detection limit, and no clear cases.",
        "",
        *table(EFFECT_HEAD, effect_rows(found["effects"])),
    ]
    return "\n".join(lines) + "\n"


def table(head: Sequence[str], rows: Rows) -> list[str]:
    """Return a table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
