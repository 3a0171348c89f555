"""What a run found, in words and rows: the same on the terminal and on the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from chiplog.pages import quantities as q
from hil_harness.results import Reception, RunResult

ERROR_PARTS = ("arithmetic", "model", "total")
OUR_DEVICE = "chiplog firmware"
_NEGLIGIBLE = 1e-3  # below this share of the error, firmware and float are "both" equally far off


@dataclass(frozen=True)
class Words:
    """A piece of a sentence; the numbers that answer the question are `strong`."""

    text: str
    strong: bool = False


def answer(result: RunResult) -> list[Words]:
    """Return the sentence that says how far firmware strays from float, and both from truth.

    A firmware under test whose odometry was refused or never came is told so.
    """
    words = _answer(result)
    if _has_pose(result) and (_missing(result) or _any_refused(result)):
        words.append(Words(f" The firmware under test {_what_it_sent(result)}."))
    return words


def _answer(result: RunResult) -> list[Words]:
    if result.ticks == 0:
        return [Words("No tick ran, so there is nothing to compare.")]
    error = result.summary()["error"]
    total, arithmetic, model = (
        error[name]["position_m"] for name in ("total", "arithmetic", "model")
    )
    after = Words(f"After {q.duration(result.duration_s)} and {q.length(driven_m(result), 3)}, ")
    if total is None:
        return [after, Words(f"{_why_no_pose(result)}.", strong=True)]
    if arithmetic is None or model is None:
        return [
            after,
            Words("the firmware is "),
            Words(q.length(total), strong=True),
            Words(" from the truth."),
        ]
    subject = "the fixed-point firmware" if is_ours(result) else "the firmware under test"
    words = [
        after,
        Words(f"{subject} is "),
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


def _has_pose(result: RunResult) -> bool:
    return result.ticks > 0 and bool(np.isfinite(result.firmware[-1, :2]).all())


def _any_refused(result: RunResult) -> bool:
    return any(reception.refused for reception in result.odometry.values())


def _missing(result: RunResult) -> list[str]:
    return [name for name, reception in result.odometry.items() if not reception.frames]


def _why_no_pose(result: RunResult) -> str:
    """Return the clause that says why a firmware under test has no position at the end."""
    if len(_missing(result)) == len(result.odometry):
        return "the firmware under test had sent no odometry"
    why = f"the firmware under test has no position: it {_what_it_sent(result)}"
    if not _missing(result) and not _any_refused(result):
        why += ", the last of them marked as not available"
    return why


def _what_it_sent(result: RunResult) -> str:
    """Return `sent 800 ODOMETRY_X, all refused: crc; ODOMETRY_Y never came`."""
    missing = _missing(result)
    sent = [
        _reception_clause(name, reception)
        for name, reception in result.odometry.items()
        if reception.frames
    ]
    only = " only" if missing and not _any_refused(result) else ""
    never = f"; {_listed(missing)} never came" if missing else ""
    return f"sent {('; ' if _any_refused(result) else ', ').join(sent)}{only}{never}"


def _reception_clause(name: str, reception: Reception) -> str:
    clause = f"{q.count(reception.frames)} {name}"
    if not reception.refused:
        return clause
    if reception.refused_frames < reception.frames:
        amount = q.count(reception.refused_frames)
    else:
        amount = "all"
    reasons = (
        (why, "" if len(reception.refused) == 1 else f"{q.count(frames)} ")
        for why, frames in reception.refused.items()
    )
    return f"{clause}, {amount} refused: {', '.join(count + why for why, count in reasons)}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def is_ours(result: RunResult) -> bool:
    """Tell whether the firmware was Chiplog's own, not a user's device."""
    return bool(result.configuration.get("device", OUR_DEVICE) == OUR_DEVICE)


def driven_m(result: RunResult) -> float:
    """Return the length of the true path, m."""
    steps = np.diff(result.truth[:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def estimator_rows(result: RunResult) -> list[list[str]]:
    """Return a row per estimator: its name and its final errors.

    The lesson's are shown to the digits in which textbooks can be compared.
    """
    digits = 7 if result.scenario == "lesson" else 4
    rows = []
    for name, estimate in result.estimators.items():
        if len(estimate.firmware) == 0:
            continue
        error = estimate.firmware[-1] - result.truth[-1]
        arithmetic = estimate.firmware[-1] - estimate.float_twin[-1]
        rows.append(
            [
                name,
                q.length(math.hypot(error[0], error[1]), digits),
                q.angle(float(error[2]), digits),
                q.length(math.hypot(arithmetic[0], arithmetic[1])),
            ]
        )
    return rows


def bus_clause(result: RunResult) -> str:
    """Return how much crossed the bus, and what was refused and why."""
    bus = result.bus
    load = "" if bus.load is None else f", load {q.share(bus.load)}"
    reasons = [
        f"{q.count(frames)} {name.replace('_', ' ')}"
        for name, frames in bus.rejected.items()
        if frames
    ]
    refused = f"{', '.join(reasons)} refused" if reasons else "none refused"
    return f"{q.count(bus.frames)} frames{load}, {refused}"


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


def pose_rows(final: Mapping[str, Mapping[str, float | None]]) -> list[list[str]]:
    """Return a row per trajectory: its name, then x [m], y [m] and heading [°]."""
    return [
        [
            name,
            q.fixed(pose["x_m"], 6),
            q.fixed(pose["y_m"], 6),
            q.fixed(_degrees(pose["heading_rad"]), 6),
        ]
        for name, pose in final.items()
    ]


def _degrees(value_rad: float | None) -> float | None:
    return None if value_rad is None else math.degrees(value_rad)
