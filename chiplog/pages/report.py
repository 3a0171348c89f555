"""`report.html`: first the answer in a sentence, then the pictures, then the tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from chiplog.pages import pictures
from chiplog.pages import quantities as q
from chiplog.pages.drawing import Picture
from chiplog.pages.rendering import render
from hil_harness.results import RunResult

ERROR_PARTS = ("arithmetic", "model", "total")
_NEGLIGIBLE = 1e-3  # below this share of the error, firmware and float are "both" equally far off


@dataclass(frozen=True)
class Words:
    """A piece of a sentence; the numbers that answer the question are `strong`."""

    text: str
    strong: bool = False


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
            "pose_rows": _pose_rows(summary["final"]),
            "estimator_rows": estimator_rows(result),
            "bus_sentence": bus_sentence(result),
            "message_rows": _message_rows(result),
            "rejected_rows": [
                (name.replace("_", " "), q.count(frames))
                for name, frames in result.bus.rejected.items()
            ],
            "timing_rows": _timing_rows(result),
            "status": timeline,
            "status_sentence": "No fault bit was set at any time.",
            "configuration_rows": list(_flattened(result.configuration)),
            "state_rows": [(name, q.count(value)) for name, value in result.kernel_state.items()],
            "versions": [f"{name} {text}" for name, text in summary["versions"].items()],
        },
    )


def answer(result: RunResult) -> list[Words]:
    """Return the sentence that says how far firmware strays from float, and both from truth."""
    if result.ticks == 0:
        return [Words("No tick ran, so there is nothing to compare.")]
    error = result.summary()["error"]
    total, arithmetic, model = (
        error[name]["position_m"] for name in ("total", "arithmetic", "model")
    )
    after = Words(f"After {q.duration(result.duration_s)} and {q.length(driven_m(result), 3)}, ")
    if total is None:
        return [after, Words("the firmware under test had sent no odometry.", strong=True)]
    if arithmetic is None or model is None:
        return [
            after,
            Words("the firmware is "),
            Words(q.length(total), strong=True),
            Words(" from the truth."),
        ]
    words = [
        after,
        Words("the fixed-point firmware is "),
        Words(q.length(arithmetic), strong=True),
        Words(" from its float twin. "),
    ]
    if abs(total - model) <= _NEGLIGIBLE * total:
        return [
            *words,
            Words("Both are "),
            Words(q.length(total), strong=True),
            Words(" from the truth."),
        ]
    return [
        *words,
        Words("The firmware is "),
        Words(q.length(total), strong=True),
        Words(" from the truth, its twin "),
        Words(q.length(model), strong=True),
        Words("."),
    ]


def driven_m(result: RunResult) -> float:
    """Return the length of the true path, m."""
    steps = np.diff(result.truth[:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def estimator_rows(result: RunResult) -> list[list[str]]:
    """Return a row per estimator: its name and its final errors."""
    rows = []
    for name, estimate in result.estimators.items():
        if len(estimate.firmware) == 0:
            continue
        error = estimate.firmware[-1] - result.truth[-1]
        arithmetic = estimate.firmware[-1] - estimate.float_twin[-1]
        rows.append(
            [
                name,
                q.length(math.hypot(error[0], error[1]), 7),
                q.angle(float(error[2]), 6),
                q.length(math.hypot(arithmetic[0], arithmetic[1])),
            ]
        )
    return rows


def bus_sentence(result: RunResult) -> str:
    """Return how much crossed the bus, and what was refused."""
    refused = sum(result.bus.rejected.values())
    load = "" if result.bus.load is None else f", bus load {q.share(result.bus.load)}"
    return f"{q.count(result.bus.frames)} frames{load}; {q.count(refused)} refused."


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
    return [
        pictures.trajectories(result),
        pictures.error_norms(result),
        pictures.arithmetic_errors(result),
    ]


def error_rows(error: Mapping[str, Mapping[str, float | None]]) -> list[list[str]]:
    """Return a row per component: its name, then arithmetic, model and their sum."""
    components = (
        ("x", "x_m", q.length),
        ("y", "y_m", q.length),
        ("heading", "heading_rad", q.angle),
    )
    rows = [
        [name, *(write(error[part][key]) for part in ERROR_PARTS)]
        for name, key, write in components
    ]
    # Lengths do not add up as components do: no sum is claimed for this row.
    return [*rows, ["distance", *(q.length(error[part]["position_m"]) for part in ERROR_PARTS)]]


def _pose_rows(final: Mapping[str, Mapping[str, float | None]]) -> list[list[str]]:
    return [
        [
            name,
            q.fixed(pose["x_m"], 6),
            q.fixed(pose["y_m"], 6),
            q.fixed(_degrees(pose["heading_rad"]), 6),
        ]
        for name, pose in final.items()
    ]


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
    ]


def _flattened(value: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, str]]:
    """Yield (dotted name, text) for every leaf of a nested table."""
    for name, item in value.items():
        full = f"{path}{name}"
        if isinstance(item, Mapping):
            yield from _flattened(item, f"{full}.")
        elif isinstance(item, list | tuple):
            yield full, ", ".join(map(str, item)) or "none"
        elif item is not None:
            yield full, str(item)


def _size(value: float | None) -> float | None:
    return None if value is None else abs(value)


def _degrees(value_rad: float | None) -> float | None:
    return None if value_rad is None else math.degrees(value_rad)
