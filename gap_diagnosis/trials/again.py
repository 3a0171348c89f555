"""Driven again: ambiguous cases of an opened trial with one log more, to see what advice is worth.

The same robot with the same effect drives the manoeuvre that the diagnosis recommends, and, as a
case of its own, any other one of the same menu. Both are diagnosed from both logs.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.manoeuvres import Manoeuvre, manoeuvres
from gap_diagnosis.trials.case import OWN_ENGINE, RANDOM, RECOMMENDED, Case
from gap_diagnosis.trials.engine import finer
from gap_diagnosis.trials.layout import AGAIN, CASES, ROBOT, SCHEMA
from gap_diagnosis.trials.make import new_trial, write_drive
from gap_diagnosis.trials.run import results_of
from gap_diagnosis.trials.seal import seal, unseal
from gap_diagnosis.trials.secret import Secret
from gap_diagnosis.trials.sizes import UNLISTED
from hil_harness.assembly import Wire, load_wire
from hil_harness.effect_runs import run_with_effects
from hil_harness.robot import load_robot


def make_again(
    folder: Path,
    key: Path,
    out: Path,
    out_key: Path,
    secret: Secret,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Write a trial of every ambiguous case of *folder*, twice; return how many cases it has.

    Raises DiagnosisError where *folder* was not diagnosed, nothing is recommended in it, or *out*
    has something in it.
    """
    answers = [Case.from_json(one) for one in unseal(folder, key)["cases"]]
    asked = [(case, best) for case in answers if (best := _recommended(folder, case)) is not None]
    if not asked:
        raise DiagnosisError(
            f"{folder}: no diagnosis in it recommends a manoeuvre: expected results of "
            f"`chiplog blind run {folder}` with an ambiguous case"
        )
    new_trial(out)
    wire = load_wire()
    draw = secret.generator("manoeuvres")
    todo: list[tuple[Case, str, Manoeuvre]] = []
    for case, best in asked:
        others = [one for one in manoeuvres() if one.file != best.file]
        other = others[int(draw.integers(len(others)))]
        todo += [(case, RECOMMENDED, best), (case, RANDOM, other)]
    order = secret.generator("order").permutation(len(todo)).tolist()
    made = []
    for place, chosen in enumerate(order):
        progress(place, len(todo))
        case, kind, manoeuvre = todo[chosen]
        home = out / CASES / f"{place + 1:04d}"
        shutil.copytree(folder / CASES / case.name, home)
        # one secret for both drives of a case: their noise is the same as far as it can be
        again = replace(case, secret=secret.child(case.name).word.hex())
        _drive(again, manoeuvre, home, wire)
        made.append(replace(again, name=home.name, again=kind, of=case.name))
    seal({"schema": SCHEMA, "cases": [one.as_json() for one in made]}, out, out_key)
    progress(len(todo), len(todo))
    return len(todo)


def _recommended(folder: Path, case: Case) -> Manoeuvre | None:
    """Return the manoeuvre recommended for a case that has a name in the library."""
    path = results_of(folder, None) / f"{case.name}.json"
    if case.engine != OWN_ENGINE or case.true_effects & (UNLISTED | frozenset(case.without)):
        return None
    if not case.true_effects or not path.exists():
        return None
    told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    own = [one for one in told.get("advice", ()) if one.get("about", "verdict") == "verdict"]
    files = [one["scenario_file"] for one in own]
    menu = {one.file: one for one in manoeuvres()}
    return next((menu[file] for file in files if file in menu), None)


def _drive(case: Case, manoeuvre: Manoeuvre, home: Path, wire: Wire) -> None:
    robot, secret = load_robot(home / ROBOT), Secret(bytes.fromhex(case.secret))
    (run,) = run_with_effects(
        manoeuvre.scenario,
        robot,
        wire,
        [(case.settings, secret.seed("plant"))],
        simulator=finer(case.steps),
    )
    (home / AGAIN).mkdir()
    write_drive(home / AGAIN, run, case, robot, wire)
