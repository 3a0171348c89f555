"""What a finished run prints: the answer in a sentence, then short aligned tables with units."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

from chiplog.pages import quantities as q
from chiplog.pages.findings import (
    ERROR_PARTS,
    answer,
    bus_clause,
    error_rows,
    estimator_rows,
    pose_rows,
)
from chiplog.pages.outage_words import outage_clause
from chiplog.terminal import show_line, show_table
from hil_harness.results import RunResult

_WIDTH = 80


def show_run(result: RunResult, report: Path) -> None:
    """Print the outcome of a run and where its page is."""
    summary = result.summary()
    show_line(fill("".join(part.text for part in answer(result)), _WIDTH))
    show_line()
    show_table(["final pose", "x [m]", "y [m]", "heading [°]"], pose_rows(summary["final"]))
    show_line()
    show_table(["error", *ERROR_PARTS], error_rows(summary["error"]))
    show_line()
    estimators = estimator_rows(result)
    if estimators:
        show_table(["estimator", "position", "heading", "arithmetic"], estimators)
        show_line()
    show_table(["", ""], _facts(result, report), words=2)


def _facts(result: RunResult, report: Path) -> list[list[str]]:
    """Return the rows below the tables: bus, speed or punctuality, and the page."""
    speed = (
        f"{q.count(result.ticks)} ticks, {q.duration(result.duration_s)} "
        f"at {q.factor(result.summary()['realtime_factor'])} real time, seed {result.seed}"
    )
    rows = [["run", speed], ["bus", bus_clause(result)]]
    if result.time == "real":
        late = result.timing
        rows.append(
            [
                "timing",
                f"{q.count(late.missed_deadlines)} missed deadlines, late by "
                f"{late.jitter_p50_us:.0f} µs (median), {late.jitter_p99_us:.0f} (99 %), "
                f"{late.jitter_max_us:.0f} at most{outage_clause(late)}",
            ]
        )
    overflows = result.kernel_state.get("overflow_count", 0)
    if overflows:
        rows.append(["firmware", q.overflows(overflows)])
    return [*rows, ["report", str(report)]]
