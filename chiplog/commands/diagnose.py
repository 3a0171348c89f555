"""`chiplog diagnose`: where real differs from simulated, which effect causes it, and how far."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import DbcOption, EffectLibraryOption, RobotOption, SignalsOption
from chiplog.commands.output import STANDARD_OUTPUT
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from gap_diagnosis.criterion import Bound
    from gap_diagnosis.pictures import Report
    from gap_diagnosis.result import Diagnosis


def command(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Recorded with the real robot: candump .log, .asc, .blf, .mf4, or a table "
            "(.csv, .parquet).",
        ),
    ],
    robot: RobotOption = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="Trajectory measured from outside, one per LOG in their order (repeatable): .tum, "
            "a table (.csv, .parquet) with columns such as latitude and longitude or x_m and y_m, "
            "or .mcap, rosbag2 or .bag, with :/topic behind it where several state poses.",
        ),
    ] = None,
    holdout: Annotated[
        Path | None,
        typer.Option("--holdout", metavar="LOG", help="Measure the gap on this log instead."),
    ] = None,
    holdout_reference: Annotated[
        Path | None,
        typer.Option("--holdout-reference", metavar="FILE.tum", help="Its trajectory."),
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", metavar="OUT.json", help="Write the diagnosis; - prints it."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", metavar="OUT.html", help="Write a page that shows it."),
    ] = None,
    effects: Annotated[
        Path | None,
        typer.Option(
            "--effects",
            metavar="FILE.toml",
            help="What is known of the robot already, as --write-effects wrote it: the diagnosis "
            "says what is left.",
        ),
    ] = None,
    effect_library: EffectLibraryOption = None,
    write_effects: Annotated[
        Path | None,
        typer.Option(
            "--write-effects",
            metavar="FILE.toml",
            help="Write what was found for `chiplog run --effects`.",
        ),
    ] = None,
    write_robot: Annotated[
        Path | None,
        typer.Option(
            "--write-robot",
            metavar="FILE.toml",
            help="Write the description with its constants corrected; --write-effects then holds "
            "the rest.",
        ),
    ] = None,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(
            "--fail-if",
            metavar="BOUND",
            help='Exit with 1 if the gap is larger, as in "position > 5 mm per 10 m" (repeatable).',
        ),
    ] = None,
    advice_dir: Annotated[
        Path | None,
        typer.Option(
            "--advice-dir",
            metavar="DIR",
            help="Where the scenarios to drive next go; default: beside OUT.json or OUT.html.",
        ),
    ] = None,
) -> None:
    """Diagnose the gap between simulated and real from logs of the real robot.

    Exit status 1 only if a --fail-if bound is not met: a verdict of any kind is status 0.
    """
    from gap_diagnosis.criterion import parse_criterion

    bounds = [parse_criterion(text) for text in fail_if or ()]
    if holdout_reference is not None and holdout is None:
        raise CommandError("--holdout-reference without --holdout: expected the log it belongs to")
    for path in (json_file, html, write_effects, write_robot):
        if path is not None and path != STANDARD_OUTPUT:
            _refuse_unwritable(path)
    report = diagnose_shown(
        logs,
        robot=robot,
        dbc=dbc,
        signals=signals,
        references=reference or (),
        holdout=holdout,
        holdout_reference=holdout_reference,
        effects=effects,
        effect_library=effect_library,
        # The terminal has no room for more than the verdict's.
        every_drive=any(one is not None for one in (json_file, html, advice_dir)),
    )
    found = report.diagnosis
    if json_file is not None and json_file != STANDARD_OUTPUT:
        json_file.write_text(found.to_json(), encoding="utf-8")
    if html is not None:
        write_page(html, report)
    written = _write_advice(found, advice_dir or _beside(json_file, html))
    try:
        _take_home(found, robot, effect_library, write_effects, write_robot)
    finally:  # what cannot be written takes nothing of the answer with it
        if json_file == STANDARD_OUTPUT:
            typer.echo(found.to_json(), nl=False)
        else:
            from chiplog.diagnosis_table import show_diagnosis

            files = (json_file, html, write_effects, write_robot)
            made = [path for path in files if path is not None and path.exists()]
            show_diagnosis(found, made, written)
    if not _hold(bounds, found, quiet=json_file == STANDARD_OUTPUT):
        raise typer.Exit(1)


def diagnose_shown(
    logs: Sequence[Path],
    *,
    robot: Path | None = None,
    dbc: Path | None = None,
    signals: Path | None = None,
    references: Sequence[Path] = (),
    holdout: Path | None = None,
    holdout_reference: Path | None = None,
    effects: Path | None = None,
    effect_library: Path | None = None,
    every_drive: bool = False,
) -> Report:
    """Diagnose with a progress bar on the terminal; see `gap_diagnosis.diagnose.diagnose`."""
    from chiplog.terminal import progress
    from gap_diagnosis.diagnose import diagnose

    with progress("diagnosing", 1000) as bar:

        def show(step: str, share: float) -> None:
            if bar is not None:
                bar(round(1000 * share), 1000)

        return diagnose(
            logs,
            robot=robot,
            dbc=dbc,
            signals=signals,
            references=references,
            holdout=holdout,
            holdout_reference=holdout_reference,
            effects=effects,
            effect_library=effect_library,
            progress=show,
            every_drive=every_drive,
        )


def write_page(path: Path, report: Report, opened: Sequence[tuple[str, str]] = ()) -> None:
    """Write the page of `report`, with what was `opened` after it where an effect was sealed."""
    from chiplog.pages.diagnosis import diagnosis_page

    path.write_text(diagnosis_page(report, opened=opened), encoding="utf-8")


def _refuse_unwritable(path: Path) -> None:
    """Say before the work what would stop its result from being written."""
    if path.is_dir():
        raise CommandError(f"{path}: is a folder: expected the name of a file")
    if not path.parent.is_dir():
        raise CommandError(f"{path}: there is no folder {path.parent}: make it first")


def _beside(*files: Path | None) -> Path | None:
    return next((f.parent for f in files if f is not None and f != STANDARD_OUTPUT), None)


def _write_advice(found: Diagnosis, folder: Path | None) -> list[Path]:
    """Write the scenarios to drive next; nowhere to write to is no error."""
    if folder is None:
        return []
    written = []
    for advice in found.advice:
        if advice.scenario is not None and advice.scenario_file is not None:
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / Path(advice.scenario_file).name
            path.write_text(advice.scenario, encoding="utf-8")
            written.append(path)
    return list(dict.fromkeys(written))


def _take_home(
    found: Diagnosis,
    robot: Path | None,
    library: Path | None,
    effects_file: Path | None,
    robot_file: Path | None,
) -> None:
    if effects_file is None and robot_file is None:
        return
    from gap_diagnosis.take_home import corrected_effects, effects_text, robot_text
    from hil_harness.effects.user_effects import load_effect_library
    from hil_harness.robot import load_robot

    described = load_robot(robot)
    taken = () if robot_file is None else corrected_effects(found, described)
    if robot_file is not None:
        # Bytes: the line ends are those of the user's own file.
        robot_file.write_bytes(robot_text(found, described).encode())
    if effects_file is not None:
        known = None if library is None else load_effect_library(library)
        text = effects_text(found, without=taken, known=known)
        effects_file.write_text(text, encoding="utf-8")


def _hold(bounds: Sequence[Bound], found: Diagnosis, *, quiet: bool) -> bool:
    """Say of each bound whether it holds; return whether all do."""
    from chiplog.pages.diagnosis_words import judgement_sentence
    from chiplog.terminal import show_line
    from gap_diagnosis.criterion import judge

    judgements = [judge(bound, found) for bound in bounds]
    if not quiet:
        for judgement in judgements:
            show_line(judgement_sentence(judgement))
    return all(judgement.holds for judgement in judgements)
