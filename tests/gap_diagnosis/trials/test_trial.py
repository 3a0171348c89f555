"""A trial from its making to its scores, and what it must not give away."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from full_size import at_full_size

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.priors import default_prior
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Recording
from gap_diagnosis.trials import drives, make, mujoco_cases, other_engine
from gap_diagnosis.trials.case import OTHER_ENGINE, OWN_ENGINE, STRATA, Case, Kind, Stratum
from gap_diagnosis.trials.judge import judge
from gap_diagnosis.trials.layout import CASES, LOG, REFERENCE, ROBOT, TASK
from gap_diagnosis.trials.make import make_case, make_trial
from gap_diagnosis.trials.opening import Opened, open_trial
from gap_diagnosis.trials.oracle import Oracle
from gap_diagnosis.trials.plan import Counts, Planned, planned
from gap_diagnosis.trials.reference_noise import draw_levels
from gap_diagnosis.trials.run import run_trial
from gap_diagnosis.trials.score import scores
from gap_diagnosis.trials.seal import SEALED, seal, unseal
from gap_diagnosis.trials.secret import Secret
from gap_diagnosis.trials.sizes import SIZES, UNLISTED, tolerances
from gap_diagnosis.trials.truth import canonical, class_of
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot

COUNTS = Counts(
    2, nulls=1, pairs=0, strata=("limit",), factor=(8.0, 10.0), effects=("gyro_scale",), new_share=0
)
SECRET = Secret(bytes(range(16)))
PLAN = [replace(one, drive=drives.SHORT) for one in planned(COUNTS, SECRET.generator("plan"))]
"""What is drawn of it, in a hurry."""

SILENT = """
from __future__ import annotations

from dataclasses import dataclass

@dataclass
class Known:
    without: list[str]

def diagnose(log, robot, reference, without):
    assert log.stat().st_size > 0 and robot.exists() and reference.exists()
    assert Known(without).without == []
    which = [{"effects": [name], "probability": p, "group_probability": p, "parameters": {}}
             for name, p in (("no_gap", 1.0), ("unknown", 0.0))]
    return {"verdict": "no_gap", "stage": "none", "which": which, "seconds": 0.1, "gap": None}
"""
NOSY = """
def diagnose(log, robot, reference, without):
    folder = log.parent.parent.parent
    other = "0002" if log.parent.name == "0001" else "0001"
    for path in (folder / "answers.sealed", folder.with_name(folder.name + ".key"),
                 folder / "cases" / other / "bus.log"):
        try:
            open(path).close()
        except PermissionError as error:
            assert "closed to this process" in str(error)
        else:
            raise AssertionError(path)
    raise LookupError("nothing could be read")
"""


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trials") / "trial"
    make_trial(COUNTS, folder, folder.with_name("trial.key"), SECRET, plan=PLAN)
    return folder


def answers(folder: Path) -> list[Case]:
    content = unseal(folder, folder.with_name("trial.key"))
    return [Case.from_json(one) for one in content["cases"]]


def method(folder: Path, name: str, text: str) -> Path:
    path = folder.parent / f"{name}.py"
    path.write_text(text)
    return path


def worked(folder: Path, case: str, *methods: Path) -> dict[str, Any]:
    """Return what a process of its own finds in a case."""
    out = folder.parent / f"{case}.json"
    words = [sys.executable, "-m", "gap_diagnosis.trials.worker", str(folder / CASES / case)]
    given = [out, folder.with_name("trial.key"), *methods]
    subprocess.run([*words, *map(str, given)], check=True, timeout=300)
    found: dict[str, Any] = json.loads(out.read_text())
    return found


def test_every_case_has_what_a_lab_has_and_no_more(trial: Path) -> None:
    for case in answers(trial):
        home = trial / CASES / case.name
        assert {path.name for path in home.iterdir()} == {LOG, ROBOT, REFERENCE, TASK}
    assert {path.name for path in trial.iterdir()} == {CASES, SEALED, "seal.json"}


def test_how_long_a_case_took_to_make_is_not_told_by_since_when_its_files_are_as_they_are(
    tmp_path: Path,
) -> None:
    """A date of change cannot be set, and a size that is sought takes its time."""
    folder = tmp_path / "trial"
    last_made: list[int] = []

    def changed() -> list[int]:
        return [one.stat().st_ctime_ns for one in (folder / CASES).rglob("*")]

    make_trial(
        COUNTS,
        folder,
        tmp_path / "key",
        SECRET,
        lambda done, total: last_made.append(max(changed())) if done == total else None,
        PLAN,
    )
    assert min(changed()) >= last_made[0]


def test_a_trial_that_is_still_being_made_is_not_diagnosed(trial: Path, tmp_path: Path) -> None:
    making = tmp_path / "making"
    copytree(trial / CASES, making / CASES)
    with pytest.raises(DiagnosisError, match=r"not sealed yet: expected seal\.json"):
        run_trial(making, jobs=1, method=method(trial, "silent_early", SILENT))
    assert not (making / "results").exists()


def test_the_same_secret_makes_the_same_trial_in_however_many_processes(
    trial: Path, tmp_path: Path
) -> None:
    key = tmp_path / "again.key"
    make_trial(COUNTS, tmp_path / "again", key, SECRET, plan=PLAN, jobs=2)
    again = unseal(tmp_path / "again", key)
    assert again == unseal(trial, trial.with_name("trial.key"))
    for path in sorted((trial / CASES).rglob("*")):
        if path.is_file():
            other = tmp_path / "again" / path.relative_to(trial)
            assert path.read_bytes() == other.read_bytes(), path


@pytest.mark.parametrize(
    ("effect", "is_clear"), [("caster_kick", True), ("quadrature_phase", False)]
)
def test_of_an_effect_without_a_name_it_is_measured_how_clear_it_is(
    effect: str, is_clear: bool, tmp_path: Path
) -> None:
    """A caster kicks as nothing else does; where an edge of a count lies, no motion shows."""
    one = Planned("field", "single", (effect,), drive="one_way")
    made = make_case(one, tmp_path, load_wire(), COUNTS, SECRET)
    assert (made.over_limit[effect] > 1) == is_clear
    assert ("gyro_scale" in made.like[effect]) != is_clear


@pytest.mark.parametrize(
    "effect",
    [
        "gyro_temperature_scale",
        "missed_ticks",
        *at_full_size("extra_ticks", "supply_ratio", "wheelbase_scale"),
    ],
)
def test_a_size_is_so_often_its_limit_as_it_is_said_to_be(effect: str, tmp_path: Path) -> None:
    """Beside a gyro that never warms up nothing shows what warmth does: eight times the tolerance
    was called eight limits, and was one and a half. Counts that come by chance are the less certain
    the more they are."""
    one = Planned("limit", "single", (effect,), drive="calibration")
    made = make_case(one, tmp_path, load_wire(), COUNTS, SECRET)
    robot = load_robot(tmp_path / ROBOT)
    (recording,) = read_recordings([tmp_path / LOG], robot=robot, references=[tmp_path / REFERENCE])
    there = Oracle(recording, robot, made).over_limit(effect, made.effects[effect])
    assert there == pytest.approx(made.over_limit[effect], rel=0.05)


def test_a_trial_is_made_only_where_nothing_is(trial: Path) -> None:
    with pytest.raises(DiagnosisError, match="expected an empty folder or a new one"):
        make_trial(COUNTS, trial, trial.with_name("trial.key"), SECRET)


def test_a_killed_run_goes_on_where_it_was_and_silence_misses_everything(trial: Path) -> None:
    silent = method(trial, "silent", SILENT)
    ran = run_trial(trial, jobs=1, method=silent)
    assert (ran.done, ran.before) == (2, 0)
    (ran.results / "0002.json").unlink()
    ran = run_trial(trial, jobs=1, method=silent)
    assert (ran.done, ran.before) == (1, 1)
    part = scores(open_trial(trial, trial.with_name("trial.key"), method=silent))["parts"]["all"]
    assert part["false_alarms"]["value"] == 0.0
    assert part["group_top1"]["value"] == 0.0


def test_a_method_cannot_open_answers_key_or_other_cases(trial: Path) -> None:
    found = worked(trial, "0001", method(trial, "nosy", NOSY))
    assert found["error"] == "LookupError: nothing could be read", found["traceback"]


def test_a_fork_sees_no_more_than_a_process_begun_anew(trial: Path) -> None:
    """It reads no later case from what its parent is told, and has the answers closed to it."""
    text = f"import sys\nassert sys.stdin.read() == ''\n{NOSY}"
    ran = run_trial(trial, jobs=1, method=method(trial, "nosy_fork", text))
    assert ran.done == 2
    for path in ran.results.iterdir():
        found = json.loads(path.read_text())
        assert found["error"] == "LookupError: nothing could be read", found["traceback"]


def test_a_case_whose_process_dies_says_so_with_its_last_words(trial: Path) -> None:
    text = "import os, sys\ndef diagnose(*given):\n"
    text += "    print('no memory', file=sys.stderr, flush=True)\n    os._exit(3)\n"
    words = r"case 0001: its process ended with 3: no memory$"
    with pytest.raises(DiagnosisError, match=words):
        run_trial(trial, jobs=1, method=method(trial, "dying", text))


def test_answers_changed_between_run_and_score_are_refused(trial: Path, tmp_path: Path) -> None:
    content = unseal(trial, trial.with_name("trial.key"))
    commitment = (trial / "seal.json").read_text()
    sealed = (trial / SEALED).read_bytes()
    content["cases"][0]["kind"] = "pair"
    try:
        seal(content, trial, tmp_path / "forged.key")
        (trial / "seal.json").write_text(commitment)
        with pytest.raises(DiagnosisError, match="not those that"):
            open_trial(trial, tmp_path / "forged.key")
    finally:
        (trial / SEALED).write_bytes(sealed)


def test_a_strong_effect_is_found_through_the_same_door_as_any_log(trial: Path) -> None:
    case = next(one for one in answers(trial) if one.effects)
    found = worked(trial, case.name)
    assert "error" not in found, found["traceback"]
    assert set(found["verdict"].split("+")) & class_of("gyro_scale")


def test_the_plan_covers_every_effect_and_withholds_whole_classes() -> None:
    counts = Counts(400, nulls=40, pairs=30, withheld=40, strata=("limit", "field"))
    plan = planned(counts, np.random.default_rng(1))
    assert len(plan) == 400
    assert {one.effects[0] for one in plan if one.kind == "single"} == set(SIZES)
    for one in plan:
        if one.kind == "withheld":
            assert set(one.without) == class_of(one.effects[0])
        if one.kind == "decoy":
            assert one.without
            assert not set(one.without) & class_of(one.effects[0])
        if one.kind in ("single", "pair"):
            assert one.without == ()


@pytest.mark.parametrize("strata", [("limit", "field"), STRATA])
def test_that_names_are_withheld_does_not_say_that_something_is_there(
    strata: tuple[Stratum, ...],
) -> None:
    """No null went without a name: a task that withholds some was as good as an alarm."""
    counts = Counts(600, nulls=150, pairs=40, withheld=60, other_engine=50, strata=strata)
    plan = planned(counts, np.random.default_rng(1))
    short = [one for one in plan if one.without]
    nulls = [one for one in plan if one.kind == "null"]
    share = sum(one in nulls for one in short) / len(short)
    # of whole cases
    assert share == pytest.approx(len(nulls) / len(plan), abs=1 / len(short))
    gone = {one.without for one in short if one.kind == "null"}
    assert len(gone) > 20
    assert gone <= {tuple(sorted(class_of(name))) for name in SIZES if name not in UNLISTED}
    assert {one.engine for one in short if one.kind == "null"} == {OWN_ENGINE, OTHER_ENGINE}


def test_without_withheld_effects_no_task_withholds_a_name() -> None:
    plan = planned(Counts(100, nulls=50), np.random.default_rng(1))
    assert all(one.without == () for one in plan)


def test_a_null_short_of_names_is_a_false_alarm_or_none_and_no_negative_of_unknown() -> None:
    case = Case(
        name="0001", stratum="limit", kind="null", effects={}, over_limit={},
        without=tuple(sorted(class_of("gyro_scale"))), nominal={}, surroundings={},
        drive="tour", robot="familiar",
        noise=draw_levels("white", np.random.default_rng(1)), steps=2, secret="00" * 16,
    )  # fmt: skip

    def told(verdict: str) -> dict[str, Any]:
        which = [{"effects": [verdict], "probability": 0.9, "group_probability": 0.9}]
        which += [{"effects": ["unknown"], "probability": 0.1, "group_probability": 0.1}]
        return {"verdict": verdict, "stage": "none", "which": which, "seconds": 1.0, "gap": None}

    oracle = frozenset({canonical(case.true_effects)})
    judged = [judge(case, told(verdict), oracle, None) for verdict in ("no_gap", "gyro_bias")]
    assert [one.is_null for one in judged] == [True, True]
    part = scores(Opened(tuple(judged), 0))["parts"]["all"]
    assert (part["false_alarms"]["value"], part["false_alarms"]["count"]) == (0.5, 2)
    assert part["unknown_auroc"]["count"] == 0
    assert part["confident_wrong"]["count"] == 0


def test_what_a_trial_takes_for_no_gap_the_diagnosis_takes_for_none() -> None:
    known = default_prior().parameters
    told = {
        (effect, name): parameters.get(name, parameters.get("all"))
        for effect, parameters in known.items()
        if effect in SIZES
        for name in tolerances(effect)
    }
    drawn = {(effect, name): tolerances(effect)[name] for effect, name in told}
    assert len(drawn) > 30
    assert drawn == {key: drawn[key] if one is None else one.tolerance for key, one in told.items()}


def test_the_prior_stratum_has_as_many_at_once_as_the_prior_says() -> None:
    """Its forecasts are held against what is drawn here: a share that is believed in and never
    drawn would be told as doubt too much."""
    prior = default_prior()
    plan = planned(Counts(4000, strata=("prior",)), np.random.default_rng(1))
    nameless = sum(bool(UNLISTED & set(one.effects)) for one in plan)
    drawn = {count: sum(len(one.effects) == count for one in plan) for count in range(4)}
    drawn[1] -= nameless
    listed = 1 - prior.unknown
    expected = {count: listed * prior.effects[count] for count in range(4)}
    for share, count in [(prior.unknown, nameless), *((expected[n], drawn[n]) for n in range(4))]:
        # four standard deviations
        assert abs(count - 4000 * share) < 4 * np.sqrt(4000 * share * (1 - share))
    several = [one for one in plan if one.kind == "several"]
    assert {len(one.effects) for one in several} >= {3, 4}
    for one in several:
        assert len(canonical(one.effects)) >= len(one.effects)


def test_a_null_of_the_other_engine_lies_there_as_any_case_does(tmp_path: Path) -> None:
    """Its robot is drawn as any robot is, and described as a calibration in that engine has it."""
    texts = []
    for name in ("own", "mujoco"):
        home = tmp_path / name / CASES / "0001"
        home.mkdir(parents=True)
        one = Planned("field", "null", drive="short", engine=name)
        made = make_case(one, home, load_wire(), COUNTS, SECRET)
        assert (made.engine, made.true_effects) == (name, frozenset())
        assert {path.name for path in home.iterdir()} == {LOG, ROBOT, REFERENCE, TASK}
        texts.append((home / ROBOT).read_text())
    own, other = texts
    assert re.sub(r"\d", "0", own) == re.sub(r"\d", "0", other)
    radius_m, rolling_m = (tomllib.loads(one)["wheels"]["radius_m"] for one in texts)
    assert rolling_m == pytest.approx(radius_m, rel=0.002)


@pytest.mark.full_size
def test_a_null_of_the_other_engine_is_measured_and_driven_anew_where_it_is_none(
    tmp_path: Path,
) -> None:
    """Its answer was "no effect", whatever the engine had done."""
    for kind in ("one_way", "squares"):
        home = tmp_path / kind / CASES / "0001"
        home.mkdir(parents=True)
        one = Planned("field", "null", drive=kind, engine=OTHER_ENGINE)
        made = make_case(one, home, load_wire(), COUNTS, SECRET)
        assert abs(made.measured["radius_scale"]) < 0.002
        assert abs(made.measured["radius_mismatch"]) < 0.0005
        assert abs(made.measured["wheelbase_scale"]) < 0.003
        assert abs(made.measured["creep_lag_s"]) < 0.002
        assert made.measured["slides_left"] == made.measured["slides_right"] == 0
        assert made.measured["share_of_hold"] < 0.1
        assert Case.from_json(json.loads(json.dumps(made.as_json()))) == made


def test_where_no_draw_of_the_other_engine_is_a_null_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On soft tyres every robot slides outward."""
    world = mujoco_cases.nominal_world
    monkeypatch.setattr(
        other_engine, "nominal_world", lambda seed: replace(world(seed), soft_s=0.02)
    )
    monkeypatch.setattr(make, "_TRIES", 2)
    one = Planned("field", "null", drive=drives.SHORT, engine=OTHER_ENGINE)
    with pytest.raises(DiagnosisError, match="the engine did more than a description's tolerances"):
        make_case(one, tmp_path, load_wire(), COUNTS, SECRET)


@pytest.mark.full_size
def test_rooms_warm_up_and_batteries_sag_in_the_other_engine_as_in_our_own(tmp_path: Path) -> None:
    """Thermometer and voltmeter stood still there, and so they told the engine."""
    read: dict[tuple[str, int], Recording] = {}
    for seed in range(3):
        for engine in (OWN_ENGINE, OTHER_ENGINE):
            home = tmp_path / f"{engine}{seed}" / CASES / "0001"
            home.mkdir(parents=True)
            one = Planned("field", "null", drive=drives.SHORT, engine=engine)
            secret = SECRET.child(str(seed))
            made = make_case(one, home, load_wire(), COUNTS, secret)
            assert {"warm_up", "supply_change"} >= made.surroundings.keys() - {"micro_slip"}
            robot = load_robot(home / ROBOT)
            (read[engine, seed],) = read_recordings(
                [home / LOG], robot=robot, references=[home / REFERENCE]
            )
    moved = set()
    for seed in range(3):
        own, other = read[OWN_ENGINE, seed], read[OTHER_ENGINE, seed]
        count = min(len(own.t_s), len(other.t_s))
        # a code, and the half of one by which ties are rounded
        step_k, step_v = 1.5 / 340.0, 1.5 / 4096.0
        assert other.temperature_k[:count] == pytest.approx(own.temperature_k[:count], abs=step_k)
        assert other.supply_v[:count] == pytest.approx(own.supply_v[:count], abs=step_v)
        moved |= {np.ptp(other.temperature_k) > 1.0, np.ptp(other.supply_v) > 0.01}
    assert moved == {False, True}


def test_without_the_other_engine_its_cases_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [one for one in sys.modules if one.startswith("gap_diagnosis.trials.mujoco")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "gap_diagnosis.trials.other_engine", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    counts = Counts(1, nulls=0, pairs=0, other_engine=1)
    with pytest.raises(DiagnosisError, match=r'need mujoco: pip install "chiplog\[mujoco\]"'):
        make_trial(counts, tmp_path / "trial", tmp_path / "trial.key", SECRET)


def test_nulls_of_the_other_engine_are_planned_beside_the_rest_with_familiar_robots() -> None:
    plan = planned(Counts(100, nulls=20, pairs=5, other_engine=30), np.random.default_rng(1))
    other = [one for one in plan if one.engine == OTHER_ENGINE]
    assert (len(plan), len(other)) == (100, 30)
    assert {(one.kind, one.effects, one.robot) for one in other} == {("null", (), "familiar")}


def test_the_order_of_cases_says_nothing_of_what_they_are() -> None:
    plan = planned(Counts(1000, nulls=500, pairs=0), np.random.default_rng(1))
    is_null = np.array([one.kind == "null" for one in plan], dtype=float)
    place = np.arange(len(plan))
    assert abs(np.corrcoef(place, is_null)[0, 1]) < 4 / np.sqrt(len(plan))


@pytest.mark.parametrize("effect", ["gyro_scale", "coarse_trig_table", "reference_lever_arm"])
def test_files_are_as_long_and_as_old_without_an_effect_as_with_it(
    effect: str, tmp_path: Path
) -> None:
    files: list[dict[str, Path]] = []
    for name, effects in (("null", ()), ("single", (effect,))):
        home = tmp_path / name / CASES / "0001"
        home.mkdir(parents=True)
        kind: Kind = "single" if effects else "null"
        make_case(Planned("field", kind, effects), home, load_wire(), COUNTS, SECRET)
        files.append({path.name: path for path in home.iterdir()})
    null, single = files
    assert null.keys() == single.keys()
    for name in null:
        assert null[name].stat().st_mtime_ns == single[name].stat().st_mtime_ns
    for name in (LOG, ROBOT, TASK):
        assert null[name].stat().st_size == single[name].stat().st_size, name
    # Of a number only the sign and the digits before the point may differ.
    rows = [re.sub(r"-|\d+\.", "", one[REFERENCE].read_text()) for one in files]
    assert len(rows[0]) == len(rows[1])
