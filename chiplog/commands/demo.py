"""`chiplog demo`: a robot with a sealed effect, its diagnosis, the seal opened, one page."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.diagnose import diagnose_shown, write_page
from chiplog.commands.run import QUIET, status_bits
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from chiplog.sealed import Sealed
    from gap_diagnosis.result import Diagnosis
    from hil_harness.results import RunResult

SCENARIO = "calibration"
PAGE, DIAGNOSIS, SEAL = "diagnosis.html", "diagnosis.json", "seal.json"
_CONTACT_NOISE_M_PER_SQRT_M = 0.0003
_REFERENCE_NOISE_M, _REFERENCE_NOISE_RAD = 0.0005, 0.001


def command(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the files go.")] = Path(
        "out/demo"
    ),
    seed: Annotated[
        int | None,
        typer.Option("--seed", help="Draw the same effect again; default: a secret one."),
    ] = None,
) -> None:
    """Show the whole story: simulated robot, "real" robot with a sealed effect, diagnosis, seal.

    The first line on standard output is the verdict; the seal is on standard error before it.
    """
    from chiplog.sealed import draw

    if out.exists() and not out.is_dir():
        raise CommandError(f"{out}: is a file: --out expects a folder")
    sealed = draw(seed)
    # On standard error: the first line of the answer is the verdict.
    print(f"an effect is drawn and sealed: SHA-256 {sealed.seal}", file=sys.stderr, flush=True)
    simulated = _drive_simulated(out / "simulated")
    log, reference = _drive_real(out / "real", sealed)
    report = diagnose_shown([log], references=[reference])
    found = report.diagnosis
    rows = _opened(sealed, found)
    (out / DIAGNOSIS).write_text(found.to_json(), encoding="utf-8")
    seal = {"sealed": sealed.line, "sha256": sealed.seal}
    (out / SEAL).write_text(json.dumps(seal, indent=2) + "\n", encoding="utf-8")
    write_page(out / PAGE, report, rows)
    _show(found, [*rows, *_files(out, simulated)])


def _drive_simulated(folder: Path) -> RunResult:
    """Drive the robot as it is described, and write what any run writes."""
    from chiplog.pages.report import report_page
    from chiplog.run_folder import BUS_LOG, RunFolder
    from chiplog.terminal import progress
    from hil_harness.assembly import RunConfig
    from hil_harness.robot import load_robot
    from hil_harness.running import run
    from hil_harness.scenarios import scenario

    run_folder = RunFolder(folder)
    found = scenario(SCENARIO)
    config = RunConfig(scenario=found, robot=load_robot(), log=run_folder.file(BUS_LOG))
    with (
        run_folder.recording(found.name, config.seed_in_use),
        progress("the simulated robot drives") as bar,
    ):
        result = run(config, bar)
    run_folder.write(result)
    run_folder.write_report(report_page(result, status_bits=status_bits(), quiet=QUIET))
    return result


def _drive_real(folder: Path, sealed: Sealed) -> tuple[Path, Path]:
    """Drive the robot that stands for the real one; write only what a lab would have of it."""
    from chiplog.run_folder import BUS_LOG, REFERENCE
    from chiplog.terminal import progress
    from hil_harness.assembly import RunConfig
    from hil_harness.effects import EffectSetting
    from hil_harness.robot import load_robot
    from hil_harness.running import run
    from hil_harness.scenarios import scenario

    folder.mkdir(parents=True, exist_ok=True)
    log, reference = folder / BUS_LOG, folder / REFERENCE
    noise = _CONTACT_NOISE_M_PER_SQRT_M
    contact = EffectSetting("micro_slip", (("left", noise), ("right", noise)))
    seed = int(sealed.word[:8], 16)
    config = RunConfig(
        scenario=scenario(SCENARIO),
        robot=load_robot(),
        effects=(sealed.setting, contact),
        seed=seed,
        log=log,
    )
    with progress("the real robot drives") as bar:
        result = run(config, bar)
    reference.write_text(_measured(result, seed), encoding="ascii")
    return log, reference


def _measured(result: RunResult, seed: int) -> str:
    """Return the truth as motion capture measures it: half a millimetre, a milliradian."""
    from dataclasses import replace

    import numpy as np

    from chiplog.run_folder import reference_tum

    sizes = (_REFERENCE_NOISE_M, _REFERENCE_NOISE_M, _REFERENCE_NOISE_RAD)
    noise = np.random.default_rng(seed).normal(0.0, sizes, result.truth.shape)
    return reference_tum(replace(result, truth=result.truth + noise))


def _opened(sealed: Sealed, found: Diagnosis) -> list[tuple[str, str]]:
    """Return what was sealed, and whether the diagnosis named it."""
    from chiplog.pages.diagnosis_words import group_name, parameter_words

    true = sealed.setting.effect
    named = (true,) in found.group
    verdict = "the verdict names it" if named else "the verdict does NOT name it"
    rows = [
        ("sealed before", f"SHA-256 {sealed.seal}"),
        ("seal opened", sealed.line),
        ("told right" if named else "told wrong", f"{verdict}: {group_name(found.group)}"),
    ]
    for candidate in found.which:
        if candidate.effects == (true,):
            for key, parameter in candidate.parameters.items():
                estimate, interval = parameter_words(key, parameter)
                rows.append(("estimate", f"{key} {estimate}, 95 %: {interval}"))
    return rows


def _files(out: Path, simulated: RunResult) -> list[tuple[str, str]]:
    from chiplog.pages import quantities as q

    speed = q.factor(simulated.summary()["realtime_factor"])
    return [
        (
            "simulated",
            f"{out / 'simulated'}: {q.count(simulated.ticks)} ticks at {speed} real time",
        ),
        ("real", f"{out / 'real'}: its log and what motion capture saw"),
        ("page", str(out / PAGE)),
    ]


def _show(found: Diagnosis, rows: list[tuple[str, str]]) -> None:
    from textwrap import fill

    from chiplog.pages.diagnosis_words import gap_sentence, headline
    from chiplog.terminal import show_line, show_table

    show_line(headline(found))
    show_line()
    show_line(fill(gap_sentence(found), 80))
    show_line()
    show_table(["", ""], [list(row) for row in rows], words=2)
