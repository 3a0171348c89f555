"""Opening a trial: the seal checked, every result held against its answer."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.judge import Judged, judge
from gap_diagnosis.trials.layout import CASES, LOG, OWN_METHOD, REFERENCE, RESULTS, ROBOT
from gap_diagnosis.trials.oracle import Oracle
from gap_diagnosis.trials.processes import as_done
from gap_diagnosis.trials.run import results_of
from gap_diagnosis.trials.seal import unseal
from gap_diagnosis.trials.sizes import UNLISTED
from gap_diagnosis.trials.truth import Answer, canonical
from hil_harness.assembly import Wire, load_wire
from hil_harness.robot import load_robot

_WORTH_LOADING: Final = 10
"""A process of its own takes as long to load as so many cases to be opened."""


@dataclass(frozen=True)
class Opened:
    """A trial with its seal opened.

    Attributes:
        judged: the cases that have a result.
        missing: how many have none.
    """

    judged: tuple[Judged, ...]
    missing: int


@dataclass(frozen=True)
class Known:
    """What anyone could know of a case.

    Attributes:
        oracle: the answers nobody could tell from the truth, the truth among them.
        over_limit: how far its smallest effect is over its detection limit; None where none has.
        bounds: by ``effect.parameter``, the smallest standard deviation that any estimate can have.
    """

    oracle: frozenset[Answer]
    over_limit: float | None
    bounds: Mapping[str, float]


def open_trial(
    folder: Path,
    key: Path,
    *,
    method: Path | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    jobs: int = 1,
) -> Opened:
    """Check the seal, open it and judge every result of a method, so many at once.

    Raises DiagnosisError where the answers are not those committed to, or nothing was run.
    """
    results = results_of(folder, method)
    return open_methods(folder, key, [results.name], progress, jobs)[results.name]


def methods_run(folder: Path) -> list[str]:
    """Return the methods that have results, our own first."""
    home = folder / RESULTS
    names = sorted({one.parent.name for one in home.glob("*/*.json")})
    return sorted(names, key=lambda name: name != OWN_METHOD)


def open_methods(
    folder: Path,
    key: Path,
    methods: Iterable[str],
    progress: Callable[[int, int], None] = lambda done, total: None,
    jobs: int = 1,
) -> dict[str, Opened]:
    """Open the results of several methods; what anyone could know is found once for each case, of
    so many cases at once."""
    cases = [Case.from_json(one) for one in unseal(folder, key)["cases"]]
    results = {name: _results_of(folder / RESULTS / name, cases) for name in methods}
    told = {name for found in results.values() for name in found}
    todo = [(folder / CASES / case.name, case) for case in cases if case.name in told]
    known: dict[str, Known] = {}
    progress(0, len(todo))
    for case_name, one in as_done(_known_alone, todo, min(jobs, 1 + len(todo) // _WORTH_LOADING)):
        known[case_name] = one
        progress(len(known), len(todo))
    opened = {}
    for name, found in results.items():
        if not found:
            raise DiagnosisError(
                f"{folder / RESULTS / name}: no results: expected those of `chiplog blind run "
                f"{folder}`"
            )
        judged = tuple(
            _judged(case, found[case.name], known[case.name])
            for case in cases
            if case.name in found
        )
        opened[name] = Opened(judged, len(cases) - len(judged))
    return opened


def together(trials: Sequence[Mapping[str, Opened]]) -> dict[str, Opened]:
    """Return several trials, each by method, as one; a case's name begins with its trial's number,
    and so does that of the case of which it is one manoeuvre more.

    What a method was not run on is missing.
    """

    def numbered(case: Case, number: int) -> Case:
        of = f"{number}-{case.of}" if case.of else case.of
        return replace(case, name=f"{number}-{case.name}", of=of)

    sizes = [max(len(one.judged) + one.missing for one in methods.values()) for methods in trials]
    joined = {}
    for method in dict.fromkeys(name for methods in trials for name in methods):
        judged: list[Judged] = []
        for number, methods in enumerate(trials, start=1):
            if method in methods:
                judged += [
                    replace(one, case=numbered(one.case, number)) for one in methods[method].judged
                ]
        joined[method] = Opened(tuple(judged), sum(sizes) - len(judged))
    return joined


def _judged(case: Case, told: Mapping[str, Any], known: Known) -> Judged:
    return judge(case, told, known.oracle, known.over_limit, known.bounds)


def _results_of(home: Path, cases: Iterable[Case]) -> dict[str, dict[str, Any]]:
    """Return by case what a method told."""
    paths = {case.name: home / f"{case.name}.json" for case in cases}
    return {
        name: json.loads(path.read_text(encoding="utf-8"))
        for name, path in paths.items()
        if path.exists()
    }


def _known_alone(home: Path, case: Case) -> tuple[str, Known]:
    """Return a case's name and what anyone could know of it, in a process that has nothing yet."""
    return case.name, known_of(home, case, load_wire())


def known_of(home: Path, case: Case, wire: Wire) -> Known:
    """Return what anyone could know of a case, from its files and its answer."""
    truth = canonical(case.true_effects)
    if not case.effects:
        return Known(frozenset({truth}), None, {})
    robot = load_robot(home / ROBOT)
    (recording,) = read_recordings(
        [home / LOG], robot=robot, wire=wire, references=[home / REFERENCE]
    )
    oracle = Oracle(recording, robot, case)
    over = [_over_limit(oracle, case, name) for name in case.effects]
    known = [one for one in over if one is not None]
    imitators = {
        canonical(case.true_effects - {name} | {other})
        for name, others in case.like.items()
        for other in others
    }
    return Known(
        oracle.group(case.effects) | imitators,
        min(known) if known else None,
        oracle.bounds(case.effects),
    )


def _over_limit(oracle: Oracle, case: Case, effect: str) -> float | None:
    """Return an effect's magnitude over its detection limit.

    A noise never reaches one: its level is free in every hypothesis. What the library has no name
    for was measured when the case was made.
    """
    if effect in NOISES:
        return 0.0
    if effect in UNLISTED and effect in case.over_limit:
        return case.over_limit[effect]
    return oracle.over_limit(effect, case.effects[effect])
