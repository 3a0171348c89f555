"""The page of a diagnosis: the verdict, the evidence, then what is open and what was assumed."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from chiplog.pages import diagnosis_words as words
from chiplog.pages import quantities as q
from chiplog.pages.diagnosis_data import embedded
from chiplog.pages.log_time import report_from_log_start
from chiplog.pages.rendering import render
from gap_diagnosis.pictures import Report
from gap_diagnosis.result import NO_GAP, Diagnosis
from gap_diagnosis.result_parts import (
    STAGES,
    Advice,
    Candidate,
    Metric,
    NumberEstimate,
    ParameterEstimate,
    StageOrNone,
    Waterfall,
)

_LIKELIEST = 5
_NEGLIGIBLE = 0.01


def diagnosis_page(report: Report, *, opened: Sequence[tuple[str, str]] = ()) -> str:
    """Return the self-contained page of one diagnosis: no network, one script of ours.

    `opened` are the rows of a seal that was opened after the diagnosis.
    """
    report = report_from_log_start(report)
    found, pictures = report.diagnosis, report.pictures
    script = files("chiplog.pages").joinpath("templates/diagnosis.js").read_text(encoding="utf-8")
    shown = [one for one in found.which if one is found.which[0] or one.probability >= _NEGLIGIBLE][
        :_LIKELIEST
    ]
    rest = [one for one in found.which if one not in shown]
    has_paths = bool(pictures.paths)
    return render(
        "diagnosis.html.j2",
        {
            "headline": words.headline(found),
            "title": ", ".join(log.name for log in found.logs) or "diagnosis",
            "facts": _facts(found),
            "verdict": words.verdict(found),
            "doubts": found.doubts,
            "known_already": words.known_already(found),
            "gap_sentence": words.gap_sentence(found),
            "unknown_sentence": words.unknown_sentence(found),
            "opened": [(name, [text]) for name, text in opened],
            "bars": [] if found.waterfall is None else _bars(found.waterfall),
            "bars_caption": _bars_caption(found),
            "stage_rows": _stage_rows(found),
            "stage_only_rows": _stage_only_rows(found),
            "has_map": pictures.residual_map is not None,
            "missing": "; ".join(pictures.missing),
            "residuals": pictures.residuals,
            "candidates": [_candidate(one) for one in shown],
            "rest_rows": [
                [words.set_name(one.effects), words.probability(one.probability)] for one in rest
            ],
            "has_paths": has_paths,
            "paths_caption": _paths_caption(report) if has_paths else "",
            "metric_rows": _metric_rows(found),
            "ambiguities": words.ambiguity_sentences(found),
            "notes": list(found.notes),
            "advices": [_advice(one) for one in found.advice if one.about != "log"],
            "log_advices": [_advice(one) for one in found.advice if one.about == "log"],
            "detectable_rows": _detectable_rows(found),
            "assumptions": found.assumptions,
            "data": Markup(embedded(report)),
            "script": Markup(script),
            "script_hash": _hash(script),
            "version": found.version,
            "seconds": f"diagnosed in {q.duration(found.seconds)}",
            "inputs": found.inputs,
        },
    )


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"


def _facts(found: Diagnosis) -> list[str]:
    facts = [words.logs_clause(found)]
    if found.logs:
        with_reference = sum(log.has_reference for log in found.logs)
        facts.append("with a reference" if with_reference else "without a reference")
    return facts


def _bars(fall: Waterfall) -> list[dict[str, Any]]:
    """Return the waterfall's bars, places in percent of its largest level."""
    levels = [fall.before]
    for step in fall.steps:
        levels.append(levels[-1] - step.reduction)
    low = min(0.0, *levels)
    span = max(*levels, fall.floor or 0.0) - low or 1.0
    floor = None if fall.floor is None else _percent((fall.floor - low) / span)

    def bar(label: str, kind: str, ends: tuple[float, float], value: str) -> dict[str, Any]:
        start, stop = min(ends), max(ends)
        return {
            "label": label,
            "kind": kind,
            "start": _percent((start - low) / span),
            "width": _percent((stop - start) / span),
            "value": value,
            "floor": floor,
        }

    bars = [bar("as described", "left", (0, fall.before), words.quantity(fall.before, fall.unit))]
    for step, above, below in zip(fall.steps, levels, levels[1:], strict=False):
        sign = q.MINUS if step.reduction >= 0 else "+"
        value = f"{sign}{words.quantity(abs(step.reduction), fall.unit)}"
        kind = "less" if step.reduction >= 0 else "more"
        bars.append(bar(step.effect, kind, (above, below), value))
    name = "explained" if fall.steps else "nothing to switch on"
    bars.append(bar(name, "whole", (0, fall.after), words.quantity(fall.after, fall.unit)))
    return bars


def _bars_caption(found: Diagnosis) -> str:
    fall = found.waterfall
    if fall is None:
        return ""
    text = (
        f"{words.metric_name(fall.metric).capitalize()}, RMS per window on held-out data; what "
        "switching each effect on takes away, averaged over the orders in which they can be "
        "switched on."
    )
    if fall.floor is None:
        return text
    return f"{text} Dashed: what noise alone leaves, {words.quantity(fall.floor, fall.unit)}."


def _stage_rows(found: Diagnosis) -> list[list[str]]:
    shares, chances = found.where.stages, found.stage_probabilities
    if not shares:
        return []
    return [
        [stage, _share(shares.get(stage)), words.probability(chances.get(stage, 0.0))]
        for stage in STAGES
        if shares.get(stage) or chances.get(stage, 0.0) >= _NEGLIGIBLE
    ]


def _stage_only_rows(found: Diagnosis) -> list[list[str]]:
    chances: dict[StageOrNone, float] = found.stage_probabilities
    return [
        [stage, words.probability(chances[stage])]
        for stage in STAGES
        if chances.get(stage, 0.0) >= _NEGLIGIBLE
    ]


def _share(value: float | None) -> str:
    return q.UNKNOWN if value is None else f"{q.fixed(100 * value, 1)} %"


def _candidate(one: Candidate) -> dict[str, Any]:
    return {
        "name": words.set_name(one.effects),
        "probability": words.probability(one.probability),
        "width": _percent(one.probability),
        "parameters": [_parameter(key, value) for key, value in one.parameters.items()],
        "ambiguous": words.group_name(one.ambiguous_with) if one.ambiguous_with else "",
        "facts": words.candidate_facts(one),
    }


def _parameter(key: str, value: ParameterEstimate) -> dict[str, Any]:
    estimate, interval = words.parameter_words(key, value)
    shown: dict[str, Any] = {"key": key, "estimate": estimate, "interval": interval}
    if not isinstance(value, NumberEstimate):
        return shown | {"intervals": [], "zero": 0}
    low, high = min(0.0, value.ci95[0]), max(0.0, value.ci95[1])
    span = high - low or 1.0
    return shown | {
        "interval": f"95 %: {interval}",
        "zero": _percent(-low / span),
        "intervals": [
            (name, _percent((bounds[0] - low) / span), _percent((bounds[1] - bounds[0]) / span))
            for name, bounds in (("ci95", value.ci95), ("ci80", value.ci80), ("ci50", value.ci50))
        ],
    }


def _paths_caption(report: Report) -> str:
    gap = report.diagnosis.gap
    where = "another log" if gap is not None and gap.held_out == "log" else "stretches of the log"
    return (
        f"Seen from above, {where} that no estimate has used. The simulation starts on the "
        "measured pose of the first second."
    )


def _metric_rows(found: Diagnosis) -> list[list[str]]:
    if found.gap is None:
        return []
    return [
        [
            words.metric_name(name),
            *(_value(value, metric) for value in (metric.before, metric.after, metric.floor)),
            _closed(metric.closed),
        ]
        for name, metric in found.gap.all.items()
    ]


def _closed(closed: float | None) -> str:
    """Return a share of what is above the floor; where less is left than noise leaves, all."""
    return q.UNKNOWN if closed is None else f"{q.fixed(100 * min(closed, 1.0), 0)} %"


def _value(value: float | None, metric: Metric) -> str:
    return q.UNKNOWN if value is None else words.quantity(value, metric.unit)


def _advice(one: Advice) -> dict[str, Any]:
    tells = f"Tells {' and '.join(map(words.set_name, one.separates))} apart"
    if one.about == "log" and (NO_GAP,) in one.separates:
        shown = [words.set_name(effects) for effects in one.separates if effects != (NO_GAP,)]
        tells = f"Shows {', '.join(shown)}, which this log could not have shown"
    return {
        "sentence": one.sentence,
        "tells": tells,
        "gain": q.fixed(one.expected_gain, 2),
        "file": one.scenario_file or "",
        "scenario": one.scenario or "",
    }


def _detectable_rows(found: Diagnosis) -> list[list[str]]:
    """Return per effect its limit at the noise found, and as it was foreseen, if it was."""
    known = found.structure.foreseen
    foreseen = {} if known is None else known.detectable
    return [
        [name, words.limit(name, size)]
        + ([words.limit(name, foreseen[name])] if name in foreseen else ["–"])
        for name, size in found.structure.detectable.items()
    ]


def _percent(share: float) -> str:
    return f"{100 * share:.3f}"
