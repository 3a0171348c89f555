"""Times for people: from the log's start, where OUT.json keeps the log's own clock.

A log stamped with wall clock says 1717400012.3 s; nobody counts from there, and in a drawing eight
digits of it are steps of ten seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gap_diagnosis.pictures import Report
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import (
    Candidate,
    LogFacts,
    NumberEstimate,
    ParameterEstimate,
)

_MOMENTS = (".start_s", ".stop_s")
"""Parameters of effects that are moments of the log."""

_Interval = tuple[float, float]


def from_log_start(found: Diagnosis) -> Diagnosis:
    """Return a diagnosis whose moments count from the start of the log that they lie in."""
    logs = found.logs
    unknown = found.unknown
    if unknown is not None:
        unknown = unknown.model_copy(update={"windows": _moved(unknown.windows, logs)})
    segments = tuple(
        one.model_copy(
            update={
                "start_s": one.start_s - _start_s(one.start_s, logs),
                "stop_s": one.stop_s - _start_s(one.start_s, logs),
            }
        )
        for one in found.where.segments
    )
    return found.model_copy(
        update={
            "which": tuple(_candidate(one, logs) for one in found.which),
            "unknown": unknown,
            "where": found.where.model_copy(update={"segments": segments}),
        }
    )


def report_from_log_start(report: Report) -> Report:
    """Return a report whose moments, and those of its drawings, count from the log's start."""
    logs, pictures = report.diagnosis.logs, report.pictures
    residuals = tuple(
        replace(one, t_s=one.t_s - _start_s(float(one.t_s[0]), logs)) if len(one.t_s) else one
        for one in pictures.residuals
    )
    shown = pictures.residual_map
    if shown is not None:
        edges_s = shown.edges_s - _start_s(float(shown.edges_s[0]), logs)
        shown = replace(shown, edges_s=edges_s)
    return Report(
        from_log_start(report.diagnosis),
        replace(pictures, residuals=residuals, residual_map=shown),
    )


def _start_s(moment_s: float, logs: Sequence[LogFacts]) -> float:
    """Return when the log began in which a moment lies; 0 where it lies near none."""

    def away_s(log: LogFacts) -> float:
        return max(log.start_s - moment_s, moment_s - log.start_s - log.duration_s, 0.0)

    nearest = min(logs, key=away_s, default=None)
    if nearest is None or away_s(nearest) > nearest.duration_s:
        return 0.0
    return nearest.start_s


def _moved(windows: Sequence[_Interval], logs: Sequence[LogFacts]) -> tuple[_Interval, ...]:
    starts_s = [_start_s(start_s, logs) for start_s, _ in windows]
    return tuple((a - at, b - at) for (a, b), at in zip(windows, starts_s, strict=True))


def _candidate(one: Candidate, logs: Sequence[LogFacts]) -> Candidate:
    return one.model_copy(
        update={
            "windows": _moved(one.windows, logs),
            "parameters": _parameters(one.parameters, logs),
        }
    )


def _parameters(
    parameters: Mapping[str, ParameterEstimate], logs: Sequence[LogFacts]
) -> dict[str, ParameterEstimate]:
    moved = dict(parameters)
    for key, one in parameters.items():
        if key.endswith(_MOMENTS) and isinstance(one, NumberEstimate):
            at_s = _start_s(one.estimate, logs)
            names = ("ci50", "ci80", "ci95")
            bounds = {name: tuple(b - at_s for b in getattr(one, name)) for name in names}
            moved[key] = one.model_copy(update={"estimate": one.estimate - at_s, **bounds})
    return moved
