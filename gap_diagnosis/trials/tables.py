"""Tables of a trial's scores: by effect, by size, by what was told for what."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any, Final

from gap_diagnosis.result_parts import STAGES
from gap_diagnosis.trials.judge import Judged
from gap_diagnosis.trials.truth import UNKNOWN, Answer, canonical, stages_of
from gap_diagnosis.trials.yardsticks import best_miss, mean, share

_CURVE: Final = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 10.0, math.inf)
_UNLISTED: Final = "unknown"


def by_effect(judged: Sequence[Judged]) -> dict[str, Any]:
    """Return for each effect how its cases were told, and what it is like.

    Its cases are those that have it alone, whatever its size, with its name in the library if any
    library has one. What must be told of them is scored where the whole is; *like* counts in how
    many of the clear ones nobody could tell it from an answer.
    """
    alone: dict[str, list[Judged]] = {}
    for one in judged:
        if len(one.case.effects) == 1 and one.case.kind != "withheld":
            (name,) = one.case.effects
            alone.setdefault(name, []).append(one)
    found = {}
    for name, own in sorted(alone.items()):
        beyond = [one for one in own if not one.is_null]
        clear = [one for one in own if one.is_clear]
        certain = [one for one in clear if len(one.oracle) == 1]
        found[name] = {
            "cases": len(own),
            "clear": len(clear),
            "group_top1": asdict(share([one.in_group for one in clear])),
            "top1": asdict(share([one.top1 for one in certain])),
            "stage": asdict(share([one.stage_right for one in clear if one.has_one_stage])),
            "true_probability": asdict(mean([one.true_probability for one in certain], (0.0, 1.0))),
            "like": counted(
                name_of(answer) for one in clear for answer in one.oracle - {one.truth}
            ),
            "verdicts": counted(one.verdict for one in beyond),
        }
    return found


def miss_curve(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """Return by magnitude over limit how often nothing was said, and how often not the truth.

    Of one effect each, beyond its tolerance: of several the best test sees the largest.
    """
    sized = [
        (one.over_limit, one)
        for one in judged
        if one.over_limit and len(one.case.effects) == 1 and not one.is_null
    ]
    found = []
    for low, high in zip((0.0, *_CURVE[:-1]), _CURVE, strict=True):
        bin_ = [(over, one) for over, one in sized if low <= over < high]
        inside = [one for _, one in bin_]
        if inside:
            found.append(
                {
                    "from": low,
                    "to": high if math.isfinite(high) else None,
                    "best": math.fsum(best_miss(over) for over, _ in bin_) / len(bin_),
                    "missed": asdict(share([one.verdict == "no_gap" for one in inside])),
                    "in_group": asdict(share([one.in_group for one in inside])),
                }
            )
    return found


def confusion(judged: Sequence[Judged]) -> dict[str, dict[str, int]]:
    """Return for each truth how often each verdict was given, where one name is right."""
    alone = [one for one in judged if len(one.oracle) == 1 and (one.is_null or one.is_clear)]
    names = sorted({name_of(one.truth) for one in alone})
    return {
        name: counted(
            "error" if one.error else name_of(canonical(one.verdict.split("+")))
            for one in alone
            if name_of(one.truth) == name
        )
        for name in names
    }


def stages(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """Return for each true stage, and for what is unlisted, which stages were told.

    *told* counts cases; *alike* is in what share of them an answer that nobody could tell from the
    truth acts in a stage, and not in the true one. Nulls, and effects at two limits or above.
    """
    rows: dict[str, list[Judged]] = {stage: [] for stage in (*STAGES, _UNLISTED)}
    for one in judged:
        if (one.is_null or one.is_clear) and one.error is None:
            rows[_true_stage(one)].append(one)
    return [
        {
            "stage": stage,
            "cases": len(own),
            "told": counted(_told_stage(one) for one in own),
            "alike": {
                other: count / len(own)
                for other, count in counted(
                    other for one in own for other in _other_stages(one, stage)
                ).items()
            },
        }
        for stage, own in rows.items()
        if own
    ]


def _true_stage(one: Judged) -> str:
    """Return the true stage; of a pair's or a twin's several the one that was told, if any."""
    if one.truth == UNKNOWN:
        return _UNLISTED
    acting = stages_of(one.truth)
    return one.stage if one.stage in acting else min(acting)


def _told_stage(one: Judged) -> str:
    return _UNLISTED if one.verdict == _UNLISTED else one.stage


def _other_stages(one: Judged, stage: str) -> frozenset[str]:
    """Return the stages in which an answer like the truth acts that does not act in *stage*."""
    acting = [stages_of(answer) for answer in one.oracle if answer != UNKNOWN]
    return frozenset(other for each in acting if stage not in each for other in each)


def false_alarms(nulls: Sequence[Judged]) -> list[dict[str, Any]]:
    """Return by verdict what was told of cases without a gap: how often, how surely, with what."""
    told = counted(one.verdict for one in nulls if one.verdict != "no_gap")
    found = []
    for verdict, count in told.items():
        own = [one for one in nulls if one.verdict == verdict]
        group = {name_of(answer) for one in own for answer in one.group}
        found.append(
            {
                "verdict": verdict,
                "count": count,
                "probabilities": sorted((one.group_probability for one in own), reverse=True),
                "with": sorted(group - {name_of(canonical(verdict.split("+")))}),
            }
        )
    return found


def name_of(answer: Answer) -> str:
    """Return an answer as one word."""
    return "+".join(sorted(answer)) or "no_gap"


def counted(values: Iterable[str]) -> dict[str, int]:
    """Return how often each value is there, the most frequent first."""
    counts: dict[str, int] = {}
    for value in values:
        counts[value] = counts.get(value, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
