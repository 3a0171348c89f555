"""`report.html`: first the answer in a sentence, then the pictures, then the tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from chiplog.pages import pictures
from chiplog.pages import quantities as q
from chiplog.pages.drawing import Picture
from chiplog.pages.findings import (
    ERROR_PARTS,
    answer,
    bus_clause,
    error_rows,
    estimator_rows,
    pose_rows,
)
from chiplog.pages.outage_words import outage_span
from chiplog.pages.rendering import render
from hil_harness.results import RunResult


def report_page(
    result: RunResult, *, status_bits: Mapping[str, int], quiet: tuple[str, ...] = ()
) -> str:
    """Return the self-contained page of one run.

    `status_bits` maps the names of the status word's bits to their masks; `quiet` ones are set in
    normal operation and alone make no timeline.
    """
    summary = result.summary()
    timeline = pictures.status_timeline(result, status_bits, quiet=quiet)
    return render(
        "report.html.j2",
        {
            "scenario": result.scenario,
            "facts": _facts(result),
            "notice": _notice(result),
            "answer": answer(result),
            "explanation": _explanation(result),
            "pictures": _pictures(result),
            "error_head": ["", *ERROR_PARTS],
            "error_rows": error_rows(summary["error"]),
            "pose_rows": pose_rows(summary["final"]),
            "estimator_rows": estimator_rows(result),
            "bus_sentence": f"{bus_clause(result)}.",
            "message_rows": _message_rows(result),
            "timing_rows": _timing_rows(result),
            "status": timeline,
            "status_sentence": "No fault bit was set at any time.",
            "configuration_rows": _configuration_rows(result),
            "detail_rows": list(_flattened(_tables(result.configuration))),
            "state_rows": [(name, q.count(value)) for name, value in result.kernel_state.items()],
            "versions": [f"{name} {text}" for name, text in summary["versions"].items()],
        },
    )


def _facts(result: RunResult) -> list[str]:
    period = q.duration(result.tick_period_us * 1e-6)
    return [
        f"seed {result.seed}",
        f"{q.count(result.ticks)} ticks of {period}",
        "lockstep on simulated time" if result.time == "lockstep" else "real time",
        f"{q.factor(result.summary()['realtime_factor'])} real time",
    ]


def _notice(result: RunResult) -> str:
    if not result.interrupted:
        return ""
    return (
        f"Interrupted after {q.duration(result.duration_s)}: "
        "what follows covers the ticks that ran."
    )


def _explanation(result: RunResult) -> str:
    if result.ticks == 0:
        return ""
    error = result.summary()["error"]
    heading = f"In heading: {q.angle(_size(error['total']['heading_rad']))} from the truth"
    if error["arithmetic"]["heading_rad"] is not None:
        heading += f", {q.angle(_size(error['arithmetic']['heading_rad']))} of it arithmetic"
    return heading + "."


def _pictures(result: RunResult) -> list[Picture]:
    if result.ticks < 2:
        return []
    drawn = (
        pictures.trajectories(result),
        pictures.error_norms(result),
        pictures.arithmetic_errors(result),
    )
    return [picture for picture in drawn if picture is not None]


def _message_rows(result: RunResult) -> list[list[str]]:
    duration_s = result.duration_s
    return [
        [name, q.count(frames), f"{frames / duration_s:.4g}" if duration_s > 0 else q.UNKNOWN]
        for name, frames in result.bus.frames_by_message.items()
    ]


def _timing_rows(result: RunResult) -> list[tuple[str, str]]:
    if result.time == "lockstep":
        return []
    timing = result.timing
    return [
        ("missed deadlines", q.count(timing.missed_deadlines)),
        ("lateness, median", q.prefixed(timing.jitter_p50_us * 1e-6, "s", 3)),
        ("lateness, 99th percentile", q.prefixed(timing.jitter_p99_us * 1e-6, "s", 3)),
        ("lateness, largest", q.prefixed(timing.jitter_max_us * 1e-6, "s", 3)),
        *((f"{one.node} out", outage_span(one)) for one in timing.outages),
        *([("frames not taken", q.count(timing.unsent_frames))] if timing.unsent_frames else []),
    ]


def _configuration_rows(result: RunResult) -> list[tuple[str, list[str]]]:
    """Return (name, lines) for every plain entry of the configuration."""
    return [
        (name.replace("_", " "), [str(line) for line in _as_list(value)] or ["none"])
        for name, value in result.configuration.items()
        if not isinstance(value, Mapping) and value is not None
    ]


def _tables(configuration: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in configuration.items() if isinstance(value, Mapping)}


def _flattened(value: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, list[str]]]:
    """Yield (dotted name, lines) for every leaf of nested tables."""
    for name, item in value.items():
        full = f"{path}{name}"
        if isinstance(item, Mapping):
            yield from _flattened(item, f"{full}.")
        elif item is not None:
            yield full, [str(line) for line in _as_list(item)] or ["none"]


def _as_list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _size(value: float | None) -> float | None:
    return None if value is None else abs(value)
