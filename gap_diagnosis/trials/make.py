"""Making a trial: cases on disk as a lab would have them, and the answers sealed."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Final, cast

import numpy as np

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.motion.levels import level_prior
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Recording
from gap_diagnosis.trials import drives, reference_noise
from gap_diagnosis.trials.case import OWN_ENGINE, Case, Effects
from gap_diagnosis.trials.draw import (
    Values,
    as_stepped,
    believed_wander,
    draw_nominal,
    draw_surroundings,
    draw_values,
    is_credible,
    scaled,
    world_of,
)
from gap_diagnosis.trials.drives import drive
from gap_diagnosis.trials.engine import finer
from gap_diagnosis.trials.layout import CASES, LOG, REFERENCE, ROBOT, SCHEMA, TASK
from gap_diagnosis.trials.logs import measured, tum_lines, write_log
from gap_diagnosis.trials.oracle import Oracle
from gap_diagnosis.trials.plan import Counts, Planned, planned
from gap_diagnosis.trials.processes import as_done
from gap_diagnosis.trials.reference_noise import ReferenceLevels
from gap_diagnosis.trials.robots import robot_text
from gap_diagnosis.trials.seal import seal
from gap_diagnosis.trials.secret import Secret
from gap_diagnosis.trials.sizes import UNLISTED
from hil_harness.assembly import Wire, load_wire
from hil_harness.effect_runs import EffectRun, run_with_effects
from hil_harness.effects import catalogue
from hil_harness.effects.model import EffectSetting
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios.model import Scenario

_STEPS: Final = (2, 4, 5)
_STAMP_S: Final = 946_684_800
"""Every file is of the first second of the year 2000: when it was made would say how."""
_ROUNDS: Final = 5
"""So often the size of an effect is sought that varies by chance: each halves what is missing."""
_TRIES: Final = 20
_SAME_DRIVE: Final = 3
"""After so many draws without a trace another drive is tried: a play needs a reversal."""


Drive = Callable[[Planned, Path, Wire, Secret], tuple[Case, EffectRun | None, Robot]]


def make_trial(
    counts: Counts,
    folder: Path,
    key: Path,
    secret: Secret,
    progress: Callable[[int, int], None] = lambda done, total: None,
    plan: Sequence[Planned] = (),
    jobs: int = 1,
) -> str:
    """Write a trial to *folder* and the key of its answers to *key*; return the commitment.

    *plan* names the cases; without one they are drawn. With more *jobs* than one so many processes
    make them; what is made is the same. Raises DiagnosisError where *folder* has something in it
    already.
    """
    new_trial(folder)
    plan = plan or planned(counts, secret.generator("plan"))
    width = max(4, len(str(len(plan))))
    todo = []
    for place, one in enumerate(plan):
        home = folder / CASES / f"{place + 1:0{width}d}"
        home.mkdir()
        todo.append((counts, one, home, secret.child(f"case {place}")))
    cases: dict[str, Case] = {}
    progress(0, len(plan))
    for case in as_done(_make_alone, todo, jobs):
        cases[case.name] = case
        progress(len(cases), len(plan))
    for _, _, home, _ in todo:
        date_alike(home)  # at once: since when a file is as it is would say how long its case took
    answers = [cases[home.name].as_json() for _, _, home, _ in todo]
    return seal({"schema": SCHEMA, "cases": answers}, folder, key)


def _make_alone(counts: Counts, one: Planned, home: Path, secret: Secret) -> Case:
    """Make a case in a process that has nothing yet."""
    return make_case(one, home, load_wire(), counts, secret)


def new_trial(folder: Path) -> None:
    """Make a trial's folder; raise DiagnosisError where it has something in it already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DiagnosisError(f"{folder}: there already: expected an empty folder or a new one")
    (folder / CASES).mkdir(parents=True)


def make_case(one: Planned, home: Path, wire: Wire, counts: Counts, secret: Secret) -> Case:
    """Draw until every effect acts, at a size that occurs: what nothing crosses is no case.

    Of the other engine, until nothing does.
    """
    for attempt in range(_TRIES):
        own = secret.child(f"attempt {attempt}")
        if attempt >= _SAME_DRIVE and one.engine == OWN_ENGINE:
            one = replace(one, drive=drives.FAMILIAR[attempt % len(drives.FAMILIAR)])
        if one.engine != OWN_ENGINE:
            case, run, robot = _other_engine(one, home, wire, own)
        else:
            maker = _Maker(one, home, wire, counts, own)
            case, run = maker.drawn()
            robot = maker.robot
        if run is not None:
            write_case(home, run, case, robot, wire)
            return case
    if one.engine != OWN_ENGINE:
        raise DiagnosisError(
            f"no effect in the other engine: {_TRIES} draws in a row of which the engine did more "
            "than a description's tolerances: expected a robot whose wheels roll as calibrated"
        )
    raise DiagnosisError(
        f"{' + '.join(one.effects)}: {_TRIES} draws in a row without a trace in the log: expected "
        "an effect that a drive of this kind can show"
    )


def _other_engine(
    one: Planned, home: Path, wire: Wire, secret: Secret
) -> tuple[Case, EffectRun | None, Robot]:
    try:
        engine = import_module("gap_diagnosis.trials.other_engine")
    except ModuleNotFoundError as error:
        raise DiagnosisError(
            f'cases of the other engine need {error.name}: pip install "chiplog[mujoco]"'
        ) from error
    return cast(Drive, engine.driven_null)(one, home, wire, secret)


def write_case(home: Path, run: EffectRun, case: Case, robot: Robot, wire: Wire) -> None:
    """Write what a lab would have; nothing in it tells more than its content."""
    task = {"schema": SCHEMA, "without": list(case.without)}
    (home / TASK).write_text(json.dumps(task) + "\n", encoding="ascii")
    write_drive(home, run, case, robot, wire)


def write_drive(home: Path, run: EffectRun, case: Case, robot: Robot, wire: Wire) -> None:
    """Write a log and its reference, and date all that is there alike."""
    secret = Secret(bytes.fromhex(case.secret))
    write_log(home / LOG, run, robot, wire)
    draw = secret.generator("reference")
    reference = measured(run, case.noise, draw, secret.seed("reference"))
    (home / REFERENCE).write_text("".join(tum_lines(reference)), encoding="ascii")
    date_alike(home)


def date_alike(home: Path) -> None:
    """Give a case's files and folder the one date that says nothing."""
    for path in (*home.iterdir(), home):
        os.utime(path, (_STAMP_S, _STAMP_S))


class _Maker:
    """One case under way."""

    def __init__(
        self, one: Planned, home: Path, wire: Wire, counts: Counts, secret: Secret
    ) -> None:
        self._one, self._home, self._wire, self._secret = one, home, wire, secret
        self._counts = counts
        (home / ROBOT).write_text(
            robot_text(one.robot, secret.generator("robot")), encoding="ascii"
        )
        self.robot: Robot = load_robot(home / ROBOT)
        fastest = min(0.8, 14.0 * self.robot.plant.wheels.radius_m)
        self._scenario: Scenario = drive(one.drive, secret.generator("drive"), fastest)

    def drawn(self) -> tuple[Case, EffectRun | None]:
        """Return the case with its run; None for a run in which some effect did nothing."""
        one, secret = self._one, self._secret
        draw = secret.generator("effects")
        world = world_of(self._scenario, self.robot, self._wire)
        steps = int(secret.generator("steps").choice(_STEPS))
        step_s = 1e-6 * self._wire.tick_period_us / steps
        effects: Effects = {
            name: as_stepped(name, draw_values(name, one.stratum, world, draw), step_s)
            for name in one.effects
        }
        case = Case(
            name=self._home.name,
            stratum=one.stratum,
            kind=one.kind,
            effects=effects,
            over_limit={},
            without=one.without,
            nominal=draw_nominal(
                self.robot, frozenset(effects), one.stratum, secret.generator("nominal")
            ),
            surroundings=self._surroundings(one, secret),
            drive=one.drive,
            robot=one.robot,
            noise=self._noise(one, secret),
            steps=steps,
            secret=secret.word.hex(),
        )
        if one.stratum == "limit" and effects:
            case = self._at_limit(case, draw)
            if not all(is_credible(name, values) for name, values in case.effects.items()):
                return case, None
        runs = self._runs(case)
        if any(_is_same(runs[0], other) for other in runs[1:]):
            return case, None
        return self._with_unlisted(case, runs), runs[0]

    def _surroundings(self, one: Planned, secret: Secret) -> dict[str, Values]:
        found = draw_surroundings(secret.generator("surroundings"))
        if one.stratum == "prior":
            share = believed_wander(level_prior(self.robot), secret.generator("slip wander"))
            found["micro_slip"] |= {"wander_left": share, "wander_right": share}
        return found

    def _noise(self, one: Planned, secret: Secret) -> ReferenceLevels:
        draw = secret.generator("noise")
        if one.stratum == "prior":
            return reference_noise.believed_levels(one.noise, level_prior(self.robot), draw)
        return reference_noise.draw_levels(one.noise, draw)

    def _with_unlisted(self, case: Case, runs: Sequence[EffectRun]) -> Case:
        """Return the case with what anyone could know of its effects that no library has.

        How far they are over their limits is twice what the log likelihood of no effect loses by
        them, with the same noise; not of what only commands show. What wins it back is like them.
        """
        known = catalogue()
        over, like = dict(case.over_limit), {}
        for name, without in zip(case.effects, runs[1:], strict=True):
            if name in UNLISTED and known[name].stage != "actuation":
                here, there = self._oracle(runs[0], case), self._oracle(without, case)
                lost = 2 * max(there.log_nothing - here.log_nothing, 0.0)
                over[name] = math.sqrt(lost / THRESHOLD)
                like[name] = [
                    other
                    for other, fit in here.fits().items()
                    if 2 * (there.log_nothing - fit) < THRESHOLD
                ]
        return replace(case, over_limit=over, like=like)

    def _oracle(self, run: EffectRun, case: Case) -> Oracle:
        write_case(self._home, run, case, self.robot, self._wire)
        return Oracle(self._read(), self.robot, case)

    def _at_limit(self, case: Case, draw: np.random.Generator) -> Case:
        """Return the case with its sizes spread about the detection limit."""
        quiet = replace(case, effects={}, without=())
        oracle = self._oracle(self._simulated(quiet, [quiet.settings])[0], quiet)
        low, high = self._counts.factor
        if case.kind in ("withheld", "decoy"):
            low, high = 2.0, max(high, 2.0)
        undisturbed = self._read()
        factors, effects = {}, {}
        for name, values in case.effects.items():
            factor = float(np.exp(draw.uniform(np.log(low), np.log(high))))
            unit = oracle.over_limit(name, dict(values))
            effects[name] = dict(values)
            if unit is not None:
                effects[name] = scaled(name, dict(values), factor / max(unit, 1e-3))
                factors[name] = factor
            for _ in range(_ROUNDS if oracle.is_by_chance(name) else 0):
                own = replace(quiet, effects={name: effects[name]})
                here = Oracle(undisturbed, self.robot, own).over_limit(name, effects[name])
                if here is not None:
                    effects[name] = scaled(name, effects[name], factor / max(here, 1e-3))
        return replace(case, effects=effects, over_limit=factors)

    def _read(self) -> Recording:
        (recording,) = read_recordings(
            [self._home / LOG],
            robot=self.robot,
            wire=self._wire,
            references=[self._home / REFERENCE],
        )
        return recording

    def _runs(self, case: Case) -> list[EffectRun]:
        """Return the case's run, then those in which one of its effects each is missing."""
        everything = case.settings
        worlds = [everything]
        worlds += [tuple(s for s in everything if s.effect != name) for name in case.effects]
        return self._simulated(case, worlds)

    def _simulated(self, case: Case, worlds: list[tuple[EffectSetting, ...]]) -> list[EffectRun]:
        seed = self._secret.seed("plant")
        return run_with_effects(
            self._scenario,
            self.robot,
            self._wire,
            [(world, seed) for world in worlds],
            simulator=finer(case.steps),
        )


def _is_same(one: EffectRun, other: EffectRun) -> bool:
    """Tell whether two runs leave the same log and the same reference."""
    arrays = ("truth", "left_count", "right_count", "gyro_code", "commands", "pose", "executed")
    if any(not np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays):
        return False
    if one.arrivals.keys() != other.arrivals.keys():
        return False
    if one.settings.reference != other.settings.reference or one.settings.later:
        return False
    if one.settings.setup != other.settings.setup:
        return False
    if one.settings.plant.clock_skew != other.settings.plant.clock_skew:
        return False
    return all(
        np.array_equal(one.arrivals[name].time_us, other.arrivals[name].time_us)
        and np.array_equal(one.arrivals[name].payload, other.arrivals[name].payload)
        for name in one.arrivals
    )
