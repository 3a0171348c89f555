"""The page of a blind trial: each figure with its interval, beside what must be reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from chiplog.pages.rendering import render
from chiplog.pages.trial_pictures import calibration_picture, confusion_picture, miss_picture
from chiplog.pages.trial_rows import EFFECT_HEAD, FIGURE_HEAD, effect_rows, figure_rows
from chiplog.pages.trial_words import (
    FIGURES,
    MISSED,
    NOT_MEASURED,
    REACHED,
    UNPROVED,
    figure,
)
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.score import scores

_TOLD: Final = 3


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
            "effect_head": (*EFFECT_HEAD, "told most often"),
            "effect_rows": [
                [*row, _told_most(one)]
                for row, one in zip(
                    effect_rows(found["effects"]), found["effects"].values(), strict=True
                )
            ],
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


def _told_most(one: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {count}" for name, count in list(one["verdicts"].items())[:_TOLD])


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
