"""The rows of a trial's tables, as its page and the measured pages show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from chiplog.pages.trial_words import (
    FIGURES,
    MISSED,
    NOT_MEASURED,
    Figure,
    figure,
    goal_of,
    share_words,
    verdict_on,
)
from gap_diagnosis.result_parts import STAGES
from gap_diagnosis.trials.case import STRATA
from gap_diagnosis.trials.full import FAMILIAR, OTHER
from gap_diagnosis.trials.sizes import UNLISTED

Rows = list[list[str]]

_FALSE_ALARMS: Final = (
    ("familiar", FAMILIAR),
    ("new manoeuvre", "new drive"),
    ("new noise", "new noise"),
    ("new robot", "new robot"),
    ("other engine", OTHER),
)
FIGURE_HEAD: Final = ("figure", "measured (95 %), cases", "must be", "")
EFFECT_HEAD: Final = (
    "effect", "cases", "clear", "stage", "group-top-1", "top-1", "P(truth)",
    "nobody could tell it from, in so many",
)  # fmt: skip
MISS_HEAD: Final = (
    "size over its limit", "told as no gap (95 %), cases", "best of all tests",
    "truth in the group (95 %), cases",
)  # fmt: skip
CALIBRATION_HEAD: Final = ("said", "right", "a perfect forecaster", "cases")
ALARM_HEAD: Final = ("told", "cases", "probability", "in a group with")
_ALIKE: Final = 6
_COLUMNS: Final = (*STAGES, "unknown")
STAGE_HEAD: Final = ("true stage", "cases", *_COLUMNS)


def figure_rows(whole: Mapping[str, Any], parts: Mapping[str, Mapping[str, Any]]) -> Rows:
    """Return each figure with its goal; false alarms apart by what is new."""
    return [
        [label, figure(part, one), goal_of(one, name).words, verdict_on(part, goal_of(one, name))]
        for label, one, name, part in _lines(whole, parts)
    ]


def _lines(
    whole: Mapping[str, Any], parts: Mapping[str, Mapping[str, Any]]
) -> list[tuple[str, Figure, str, Mapping[str, Any]]]:
    """Return label, figure, name of the part that it is of, and that part."""
    found: list[tuple[str, Figure, str, Mapping[str, Any]]] = []
    for one in FIGURES:
        if one.key == "false_alarms":
            found += [
                (f"{one.label}, {label}", one, part, parts[part])
                for label, part in _FALSE_ALARMS
                if part in parts
            ]
        else:
            found.append((one.label, one, "all", whole))
    return found


def stratum_rows(found: Mapping[str, Any]) -> tuple[Rows, list[str]]:
    """Return each figure by stratum, held to the goals that are set for all strata together, under
    a row that names the strata; and, in words, what a single stratum misses."""
    strata = {
        name: figure_rows(found["parts"][name], found["alarms"][name])
        for name in STRATA
        if name in found["parts"]
    }
    rows, missed = [["figure", "must be", *strata]], []
    for beside in zip(*strata.values(), strict=True):
        label, _, must, _ = beside[0]
        rows.append([label, must, *(_flagged(said, verdict) for _, said, _, verdict in beside)])
        missed += [
            f"{name}, {label} {said} ({must})"
            for name, (_, said, _, verdict) in zip(strata, beside, strict=True)
            if verdict == MISSED
        ]
    return rows, missed


def _flagged(said: str, verdict: str) -> str:
    flag = f"**{verdict}**" if verdict == MISSED else verdict
    return f"{said}; {flag}" if flag else said


def effect_rows(effects: Mapping[str, Mapping[str, Any]]) -> Rows:
    """Return each effect's scores with their intervals, by name."""
    keys = ("stage", "group_top1", "top1", "true_probability")
    return [
        [
            f"{effect} (right: unknown)" if effect in UNLISTED else effect,
            str(one["cases"]),
            str(one["clear"]),
            *(share_words(one[key]) for key in keys),
            _like(one["like"]),
        ]
        for effect, one in effects.items()
    ]


def _like(counts: Mapping[str, int]) -> str:
    most = [f"{name} {count}" for name, count in list(counts.items())[:_ALIKE]]
    more = len(counts) - len(most)
    return ", ".join([*most, f"{more} more"] if more else most) or "none"


def miss_rows(curve: Sequence[Mapping[str, Any]]) -> Rows:
    """Return what was missed by size, beside the best that any test could do."""
    return [
        [
            f"{one['from']:g} and more"
            if one["to"] is None
            else f"{one['from']:g} to {one['to']:g}",
            share_words(one["missed"]),
            f"{one['best']:.3f}",
            share_words(one["in_group"]),
        ]
        for one in curve
    ]


def calibration_rows(bins: Sequence[Mapping[str, Any]]) -> Rows:
    """Return what was said and how often it was right, bold where no perfect forecaster is."""
    rows = []
    for one in bins:
        low, high = one["perfect"]
        right = f"{one['true']:.3f}"
        rows.append(
            [
                f"{one['said']:.3f}",
                right if low <= one["true"] <= high else f"**{right}**",
                f"{low:.3f} to {high:.3f}",
                str(one["count"]),
            ]
        )
    return rows


def stage_rows(stages: Sequence[Mapping[str, Any]]) -> Rows:
    """Return which stage was told for which; in brackets in what share of a row's cases an answer
    of that stage is one that nobody could tell from the truth."""

    def cell(row: Mapping[str, Any], stage: str) -> str:
        told, alike = row["told"].get(stage, 0), row["alike"].get(stage)
        if alike is None:
            return str(told) if told else ""
        return f"{told} ({alike:.3f})"

    return [
        [row["stage"], str(row["cases"]), *(cell(row, stage) for stage in _COLUMNS)]
        for row in stages
    ]


def alarm_rows(alarms: Sequence[Mapping[str, Any]]) -> Rows:
    """Return false alarms by name, each with its probability."""
    return [
        [
            one["verdict"],
            str(one["count"]),
            ", ".join(f"{p:.2f}" for p in one["probabilities"]),
            ", ".join(one["with"]) or NOT_MEASURED,
        ]
        for one in alarms
    ]
