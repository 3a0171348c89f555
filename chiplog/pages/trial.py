"""The page of a blind trial: each figure with its interval, beside what must be reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from chiplog.pages.rendering import render
from chiplog.pages.trial_pictures import calibration_picture, confusion_picture, miss_picture
from chiplog.pages.trial_words import (
    FIGURES,
    MISSED,
    NOT_MEASURED,
    REACHED,
    UNPROVED,
    figure,
    goal_of,
    verdict_on,
)
from gap_diagnosis.trials.full import OTHER
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.score import scores

_TOLD: Final = 3
_FALSE_ALARMS: Final = (
    ("familiar", "familiar"),
    ("new manoeuvre", "new drive"),
    ("new noise", "new noise"),
    ("new robot", "new robot"),
    ("other engine", OTHER),
)
FIGURE_HEAD: Final = ("figure", "measured (95 %), cases", "must be", "")
EFFECT_HEAD: Final = (
    "effect", "cases", "clear", "stage", "in the group", "top-1", "P(truth)", "told most often",
    "nobody could tell it from",
)  # fmt: skip


def trial_page(
    name: str, own: str, opened: Mapping[str, Opened], again: Opened | None = None
) -> str:
    """Return the self-contained page of a trial: *own* is the method, the others stand beside it.

    Rivals are compared on the cases that every method has a result for. *again*: the trial of its
    ambiguous cases with one log more.
    """
    found = scores(opened[own], again)
    parts = found["parts"]
    common = common_cases(opened)
    beside = {method: scores(one)["parts"]["all"] for method, one in common.items()}
    rows = figure_rows(parts["all"], parts)
    proved = sum(row[3] == REACHED for row in rows)
    unproved = sum(row[3] == UNPROVED for row in rows)
    missed = [row[0] for row in rows if row[3] == MISSED]
    return render(
        "trial.html.j2",
        {
            "name": name,
            "method": own,
            "cases": found["cases"],
            "missing": found["missing"],
            "crashes": found["crashes"],
            "reached": proved + unproved,
            "unproved": unproved,
            "judged": proved + unproved + len(missed),
            "missed": missed,
            "figure_head": FIGURE_HEAD,
            "figure_rows": rows,
            "not_measured": [row[0] for row in rows if row[1] == NOT_MEASURED],
            "parts_head": ("figure", *parts),
            "parts_rows": [
                [one.label, *(figure(part, one) for part in parts.values())] for one in FIGURES
            ],
            "rival_cases": len(next(iter(common.values())).judged),
            "rival_head": ("figure", *beside),
            "rival_rows": [
                [one.label, *(figure(part, one) for part in beside.values())] for one in FIGURES
            ]
            if len(beside) > 1
            else [],
            "effect_head": EFFECT_HEAD,
            "effect_rows": [_effect_row(effect, one) for effect, one in found["effects"].items()],
            "confusion": confusion_picture(found["stages"]),
            "miss": miss_picture(found["miss_curve"]),
            "calibration": calibration_picture(parts["all"]),
            "wrong_head": ("case", "truth", "told", "probability", "over its limit", "drive"),
            "wrong_rows": [_wrong_row(one) for one in found["wrong"]],
        },
    )


def common_cases(opened: Mapping[str, Opened]) -> dict[str, Opened]:
    """Return every method on the cases that all of them have a result for."""
    names = [frozenset(one.case.name for one in each.judged) for each in opened.values()]
    shared = frozenset.intersection(*names)
    if not shared:
        return {}
    return {
        method: replace(one, judged=tuple(j for j in one.judged if j.case.name in shared))
        for method, one in opened.items()
    }


def figure_rows(
    whole: Mapping[str, Any], parts: Mapping[str, Mapping[str, Any]]
) -> list[list[str]]:
    """Return each figure with its goal; false alarms apart by what is new."""
    rows = []
    for one in FIGURES:
        if one.key == "false_alarms":
            for label, part in _FALSE_ALARMS:
                if part in parts:
                    goal = goal_of(one, part)
                    said = figure(parts[part], one)
                    rows.append(
                        [f"{one.label}, {label}", said, goal.words, verdict_on(parts[part], goal)]
                    )
            continue
        goal = goal_of(one)
        rows.append([one.label, figure(whole, one), goal.words, verdict_on(whole, goal)])
    return rows


def _effect_row(effect: str, one: Mapping[str, Any]) -> list[str]:
    def share(key: str) -> str:
        value = one[key]["value"]
        return "" if value is None else f"{value:.2f}"

    told = [f"{name} {count}" for name, count in list(one["verdicts"].items())[:_TOLD]]
    return [
        effect,
        str(one["cases"]),
        str(one["clear"]),
        share("stage"),
        share("group_top1"),
        share("top1"),
        share("true_probability"),
        ", ".join(told),
        ", ".join(one["like"]) or "–",
    ]


def _wrong_row(one: Mapping[str, Any]) -> list[str]:
    over = one["over_limit"]
    return [
        one["case"],
        one["truth"],
        one["verdict"],
        f"{one['probability']:.2f}",
        "" if over is None else f"{over:.1f}",
        f"{one['drive']}, {one['noise']} noise, {one['robot']} robot",
    ]
