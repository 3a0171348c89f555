"""`chiplog study`: what each bit buys, and the cheapest firmware that holds what is asked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chiplog.commands.options import JsonFileOption, RobotOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from hil_harness.assembly import Wire
    from hil_harness.scenarios import Scenario
    from precision_study.study import Course, Outcome, Requirement, Study

PAGE = "study.html"
ROBOT = "robot.toml"
DBC = "chiplog.dbc"
DEFAULT_COURSE = "100 m"
SHOWN = 12


class TableFormat(StrEnum):
    """How the results are written."""

    CSV = "csv"
    PARQUET = "parquet"


def command(
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            "--sweep",
            metavar="FIELD=VALUE,…",
            help="Values of a field of [firmware], of rounding, overflow or carry_remainder "
            "everywhere, of tick_rate_hz or adc.bits (repeatable; 12..16 counts).",
        ),
    ] = None,
    meet: Annotated[
        str | None,
        typer.Option(
            "--meet",
            metavar="TEXT",
            help="What must hold, as in 'arithmetic position 5 mm after 100 m'.",
        ),
    ] = None,
    margin: Annotated[
        float, typer.Option("--margin", help="How many times below the limit it must stay.")
    ] = 1.0,
    after: Annotated[
        str | None,
        typer.Option("--after", help="Course without --meet, as in '100 m' or '10 min'."),
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(
            "--scenario",
            metavar="NAME|FILE",
            help="Drive, repeated until the course is done (repeatable); default: lesson, square, "
            "figure8 and random.",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option("--seeds", help="How many seeds of each scenario.")] = 8,
    robot: RobotOption = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for results and page.")
    ] = Path("study"),
    table_format: Annotated[
        TableFormat, typer.Option("--format", help="Of the results; parquet needs pyarrow.")
    ] = TableFormat.CSV,
    table_bytes: Annotated[
        int, typer.Option("--table-bytes", help="Largest sine table that fits the flash.")
    ] = 65_536,
    force: Annotated[
        bool,
        typer.Option(
            "--force",
            help="Run configurations that overflow, and count how often; those that C cannot hold "
            "(in Python, some hundred times slower), tables that do not fit and constants that "
            "round to zero are run as well.",
        ),
    ] = False,
    workers: Annotated[
        int | None, typer.Option("--workers", help="Threads; default: one per core.")
    ] = None,
    json_file: JsonFileOption = None,
) -> None:
    """Sweep the firmware's formats, roundings, tables and rates; say what each buys and costs.

    Every configuration drives every scenario with every seed. A study that was stopped goes on
    where it was when it is started again with the same --out. Exit status 1 if nothing holds
    --meet.
    """
    from chiplog.pages.study import study_page
    from chiplog.pages.study_words import answer
    from chiplog.terminal import progress, show_line, show_table
    from precision_study.study import (
        Store,
        cheapest,
        cores,
        outcomes,
        parse_requirement,
        run_study,
    )
    from precision_study.study.results import pyarrow_modules, rows, write_table

    _check_numbers(margin, seeds, workers, table_bytes)
    requirement = None if meet is None else parse_requirement(meet)
    study = _study(
        sweep or [],
        _course(requirement, after),
        scenario or ["lesson", "square", "figure8", "random"],
        seeds,
        robot,
        table_bytes,
        force,
    )
    table_path = out / f"results.{table_format.value}"
    if table_format is TableFormat.PARQUET:
        pyarrow_modules(table_path)
    threads = workers or cores()
    at_once = f"study, up to {threads} worker{'s' if threads > 1 else ''}"
    with Store(out) as store, progress(at_once, study.runs, then="drawing") as report:
        run_study(study, store, report or (lambda done, total: None), threads)
        found = outcomes(study, store)
    chosen = None if requirement is None else cheapest(found, requirement, margin)
    write_table(table_path, rows(found))
    said = answer(study, found, requirement, chosen, margin)
    page = study_page(study, found, requirement, chosen, margin)
    (out / PAGE).write_text(page, encoding="utf-8")
    written = [] if chosen is None else _write_chosen(out, study, chosen, said)
    if json_file is not None:
        write_json(json_file, _to_json(study, found, requirement, chosen, margin))
    if json_file != STANDARD_OUTPUT:
        from chiplog.pages.study_words import (
            FRONT_HEAD,
            OVERFLOW_HEAD,
            front,
            front_row,
            overflow_rows,
        )

        best = front(found, requirement)
        for head, shown in (
            (FRONT_HEAD, [front_row(one, requirement, study) for one in best]),
            (OVERFLOW_HEAD, overflow_rows(found, study)),
        ):
            if shown:
                show_table(head, shown[:SHOWN])
            if len(shown) > SHOWN:
                show_line(f"… and {len(shown) - SHOWN} more, in {out}")
        show_line()
        for line in said:
            show_line(line)
        for line in written:
            show_line(line)
        show_line(f"{out / PAGE}: pictures and budgets; {table_path}: every configuration")
    if requirement is not None and chosen is None:
        raise typer.Exit(1)


def _check_numbers(margin: float, seeds: int, workers: int | None, table_bytes: int) -> None:
    if not (math.isfinite(margin) and 1.0 <= margin <= 1e6):
        raise CommandError(f"--margin {margin:g}: expected 1 to 1000000")
    for option, value, most in (
        ("--seeds", seeds, 100_000),
        ("--workers", 1 if workers is None else workers, 1024),
        ("--table-bytes", table_bytes, 1 << 20),
    ):
        if not 1 <= value <= most:
            raise CommandError(f"{option} {value}: expected a whole number from 1 to {most}")


def _course(requirement: Requirement | None, after: str | None) -> Course:
    from precision_study.study import parse_course

    if requirement is None:
        return parse_course(after or DEFAULT_COURSE)
    if after is not None:
        raise CommandError(f"--after {after!r}: --meet says how far: expected only one of them")
    return requirement.course


def _study(
    sweep: Sequence[str],
    course: Course,
    names: Sequence[str],
    seeds: int,
    robot: Path | None,
    table_bytes: int,
    force: bool,
) -> Study:
    """Return what is studied, everything refused that cannot be."""
    from hil_harness.assembly import load_wire
    from hil_harness.robot import load_robot
    from hil_harness.scenarios import scenario as find_scenario
    from precision_study.study import (
        DEFAULT_AXES,
        Study,
        build_points,
        parse_axis,
        refuse_unfit,
        require_drives_fit,
    )

    axes: dict[str, Sequence[Any]] = {}
    for text in sweep:
        axis, values = parse_axis(text)
        if axis in axes:
            raise CommandError(f"--sweep {text!r}: {axis} stands twice: expected each axis once")
        axes[axis] = values
    described, wire = load_robot(robot), load_wire()
    points = build_points(described, axes or DEFAULT_AXES, wire.tick_period_us)
    scenarios = tuple(find_scenario(name) for name in names)
    known = [one.name for one in scenarios]
    for name in known:
        if known.count(name) > 1:
            raise CommandError(f"--scenario {name}: stands twice: expected each name once")
    distance_m, mission_s = _mission(scenarios, course, wire)
    forced = refuse_unfit(
        points,
        described,
        distance_m=max(distance_m, 1e-3),  # turning on the spot goes nowhere
        mission_s=mission_s,
        table_bytes=table_bytes,
        force=force,
    )
    study = Study(
        robot=described,
        wire=wire,
        points=tuple(points),
        scenarios=scenarios,
        seeds=tuple(range(1, seeds + 1)),
        course=course,
        force=force,
        forced=forced,
    )
    require_drives_fit(study)
    return study


def _mission(scenarios: Sequence[Scenario], course: Course, wire: Wire) -> tuple[float, float]:
    """Return how far a drive goes at most [m], and how long it takes [s]."""
    import numpy as np

    from precision_study.study.drives import course_ticks, lap_commands

    period_us = wire.tick_period_us
    if course.distance_m is not None:
        ticks = [
            course_ticks(one, lap_commands(one, wire, period_us), course, period_us)
            for one in scenarios
        ]
        return course.distance_m, max(ticks) * period_us / 1e6
    assert course.duration_s is not None  # a course is one or the other
    speeds = (
        float(np.abs(one.commands(max(one.tick_count(period_us), 1), period_us)[:, 0]).max())
        for one in scenarios
    )
    return max(speeds) * course.duration_s, course.duration_s


def _write_chosen(out: Path, study: Study, chosen: Outcome, said: Sequence[str]) -> list[str]:
    """Write the chosen configuration; return what to do with it."""
    from can_bus.database import shipped_path
    from precision_study.study.results import dbc_at_tick, robot_toml

    distance_m, mission_s = _mission(study.scenarios, study.course, study.wire)
    limits = {"distance_m": max(distance_m, 1e-3), "mission_s": mission_s}
    design = study.robot.design.model_copy(update=limits)
    robot = replace(study.robot, design=design)
    text = robot_toml(robot, chosen.point, ["Written by chiplog study.", *said])
    (out / ROBOT).write_text(text, encoding="utf-8")
    lines = [f"write it in C: chiplog export-c --robot {out / ROBOT}"]
    old, new = study.wire.tick_period_us, chosen.point.tick_period_us
    if new == old:
        return lines
    scaled = dbc_at_tick(shipped_path().read_text(encoding="utf-8"), old, new)
    if scaled is None:
        return [
            *lines,
            f"run it: chiplog run --robot {out / ROBOT} --dbc FILE, with a tick of {new} µs in "
            "FILE (a DBC holds whole milliseconds: the shipped one cannot be scaled to it)",
        ]
    (out / DBC).write_text(scaled, encoding="utf-8")
    return [*lines, f"run it: chiplog run --robot {out / ROBOT} --dbc {out / DBC}"]


def _to_json(
    study: Study,
    found: Sequence[Outcome],
    requirement: Requirement | None,
    chosen: Outcome | None,
    margin: float,
) -> dict[str, Any]:
    from chiplog.pages.study_words import front, kind_of
    from precision_study.study.results import rows

    return {
        "schema": 1,
        "configurations": len(found),
        "scenarios": [one.name for one in study.scenarios],
        "seeds": len(study.seeds),
        "course": {"distance_m": study.course.distance_m, "duration_s": study.course.duration_s},
        "meet": None if requirement is None else requirement.text,
        "margin": margin,
        "kind": kind_of(requirement),
        "cheapest": None if chosen is None else rows([chosen]),
        "front": rows(front(found, requirement)),
    }
