"""`chiplog laws`: the lesson's laws, each predicted, measured on plant and firmware, and judged."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import JsonFileOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json
from chiplog.errors import CommandError, suggestion

if TYPE_CHECKING:
    from hil_harness.laws import Finding, Law

PAGE = "laws.html"


class Size(StrEnum):
    """How many runs stand behind a statistical law."""

    SMALL = "small"
    FULL = "full"


def command(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="LAW", help="Only these laws, as in gyro_bias_heading."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help=f"Folder for {PAGE}, the page with pictures."),
    ] = None,
    size: Annotated[
        Size,
        typer.Option("--size", help="small: 400 runs of a statistical law; full: 1600."),
    ] = Size.SMALL,
    json_file: JsonFileOption = None,
) -> None:
    """Check the laws of dead reckoning: prediction against measurement, with derived tolerances.

    Exit status 1 if a law is violated.
    """
    from chiplog.pages.laws import answer
    from chiplog.terminal import progress, show_line
    from hil_harness.laws import check_laws, default_bench, to_json

    chosen = _chosen(names or [])
    if out is not None and out.exists() and not out.is_dir():
        raise CommandError(f"{out}: is a file: --out expects a folder")
    bench = default_bench(size.value)
    with progress("laws", len(chosen)) as report:
        findings = check_laws(bench, chosen, progress=report)
    if json_file is not None:
        write_json(json_file, to_json(findings))
    if json_file != STANDARD_OUTPUT:
        _show(findings)
        show_line()
        show_line(answer([check for found in findings for check in found.evidence.checks]))
    if out is not None:
        page = _write_page(out, findings, bench.runs)
        if json_file != STANDARD_OUTPUT:
            show_line(f"{page}: each law with its picture, on to where it breaks")
    if not all(found.passed for found in findings):
        raise typer.Exit(1)


def _chosen(names: Sequence[str]) -> list[Law]:
    """Return the laws of these names, all where none is named."""
    from hil_harness.laws import LAWS

    known = {law.name: law for law in LAWS}
    for name in names:
        if name not in known:
            near = suggestion(name, list(known)) or f"; known are {', '.join(known)}"
            raise CommandError(f"no such law {name!r}{near}")
    return [law for law in LAWS if not names or law.name in names]


def _show(findings: Sequence[Finding]) -> None:
    from chiplog.pages.laws import CHECK_HEAD, check_row
    from chiplog.terminal import show_table

    rows = []
    for found in findings:
        for check in found.evidence.checks:
            name, predicted, measured, tolerance, unit, verdict = check_row(check)
            rows.append([name, unit, verdict, predicted, measured, tolerance])
    name, predicted, measured, tolerance, unit = CHECK_HEAD
    show_table([name, unit, "", predicted, measured, tolerance], rows, words=3)


def _write_page(out: Path, findings: Sequence[Finding], runs: int) -> Path:
    from chiplog.pages.laws import laws_page

    out.mkdir(parents=True, exist_ok=True)
    path = out / PAGE
    path.write_text(laws_page(findings, runs=runs), encoding="utf-8")
    return path
