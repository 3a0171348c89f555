"""The page of a study: the answer, the front, what each choice buys, and the budget."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from chiplog.pages.quantities import count
from chiplog.pages.rendering import render
from chiplog.pages.study_pictures import budget_picture, choices_picture, front_picture
from chiplog.pages.study_words import (
    FRONT_HEAD,
    answer,
    front,
    front_row,
    kind_of,
    said_error,
)
from precision_study.budget import CAUSES
from precision_study.study import Outcome, Requirement, Study, cost_table, high_words

BUDGET_HEAD = ("cause", "expected", "at most", "grows with", "what it is")
SCENARIO_HEAD = ("at the end, RMS", "expected", "at most")
MAX_FRONT_ROWS = 40


def study_page(
    study: Study,
    found: Sequence[Outcome],
    requirement: Requirement | None,
    chosen: Outcome | None,
    margin: float,
) -> str:
    """Return the self-contained page of a study.

    Args:
        study: what was asked.
        found: every configuration's outcome.
        requirement: what must hold, or None.
        chosen: the cheapest that holds, or None.
        margin: how many times below the limit it must stay.
    """
    best = front(found, requirement)
    shown = chosen or (best[-1] if best else None)
    kind = kind_of(requirement)
    table = cost_table()
    first, *rest = answer(study, found, requirement, chosen, margin)
    return render(
        "study.html.j2",
        {
            "answer": first,
            "sentences": rest,
            "configurations": count(len(found)),
            "runs": count(study.runs),
            "course": study.course.words,
            "scenarios": ", ".join(one.name for one in study.scenarios),
            "seeds": len(study.seeds),
            "kind": kind,
            "front": front_picture(study, found, best, chosen, requirement, kind),
            "choices": choices_picture(study, found, requirement, kind),
            "budget": None if shown is None else budget_picture(shown),
            "shown": None if shown is None else _shown(shown, kind, chosen is not None),
            "front_head": FRONT_HEAD,
            "front_rows": [front_row(one, requirement, study) for one in best[:MAX_FRONT_ROWS]],
            "front_left": max(len(best) - MAX_FRONT_ROWS, 0),
            "budget_head": BUDGET_HEAD,
            "scenario_head": ("scenario", high_words(len(study.seeds)), *SCENARIO_HEAD),
            "cost_error": {
                "configurations": table.checked,
                "median": f"{100 * table.median_error:.2g}",
                "high": f"{100 * table.high_error:.2g}",
                "largest": f"{100 * table.largest_error:.2g}",
            },
            "core": table.core,
            "compiler": table.compiler,
            "code_bytes": count(table.code_bytes),
        },
    )


def _shown(one: Outcome, kind: str, is_chosen: bool) -> dict[str, Any]:
    """Return the configuration whose budget is shown, in words and rows."""
    worst = one.worst("arithmetic position")
    quantity = kind.split()[1]
    arithmetic = kind.startswith("arithmetic")
    return {
        "title": "The cheapest that holds" if is_chosen else "The most exact on the front",
        "words": one.point.words,
        "scenario": worst.scenario,
        "budget_rows": [
            [
                name.replace("_", " "),
                said_error(worst.budget[name][1], "position"),
                said_error(worst.budget[name][0], "position"),
                growth,
                meaning,
            ]
            for name, (growth, meaning) in CAUSES.items()
        ],
        "scenario_rows": [
            [
                here.scenario,
                said_error(here.high[kind], kind),
                said_error(here.final_rms[kind], kind),
                said_error(here.expected[quantity], kind) if arithmetic else "–",
                said_error(here.bound[quantity], kind) if arithmetic else "–",
            ]
            for here in one.scenarios
        ],
    }
