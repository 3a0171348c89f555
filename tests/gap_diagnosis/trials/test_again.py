"""Driving again what a diagnosis recommends, and what that is worth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.trials import worker
from gap_diagnosis.trials.again import make_again
from gap_diagnosis.trials.case import RANDOM, RECOMMENDED, Case
from gap_diagnosis.trials.judge import judge
from gap_diagnosis.trials.layout import AGAIN, CASES, LOG, REFERENCE, ROBOT
from gap_diagnosis.trials.make import make_trial
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.plan import Counts, Planned
from gap_diagnosis.trials.run import results_of
from gap_diagnosis.trials.score import scores
from gap_diagnosis.trials.seal import key_of, unseal
from gap_diagnosis.trials.secret import Secret

SECRET = Secret(bytes(range(16)))
COUNTS = Counts(2, nulls=1, pairs=0)
PLAN = [
    Planned("field", "single", ("gyro_scale",), drive="short"),
    Planned("field", "null", drive="short"),
]


def told(advice: list[dict[str, Any]], on_truth: float = 0.5) -> dict[str, Any]:
    which = [
        {"effects": [name], "probability": p, "group_probability": p, "parameters": {}}
        for name, p in (("gyro_scale", on_truth), ("gyro_bias", 1 - on_truth))
    ]
    return {
        "verdict": "gyro_scale", "stage": "gyro", "which": which, "seconds": 1.0, "gap": None,
        "advice": advice,
    }  # fmt: skip


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a trial of a case and a null, both told as ambiguous."""
    folder = tmp_path_factory.mktemp("trials") / "trial"
    make_trial(COUNTS, folder, key_of(folder), SECRET, plan=PLAN)
    results = results_of(folder, None)
    results.mkdir(parents=True)
    advice = [{"scenario_file": None}, {"scenario_file": "arcs_three_radii.toml"}]
    for name in ("0001", "0002"):
        (results / f"{name}.json").write_text(json.dumps(told(advice)))
    return folder


@pytest.fixture(scope="module")
def driven(trial: Path) -> Path:
    out = trial.with_name("again")
    assert make_again(trial, key_of(trial), out, key_of(out), SECRET) == 2
    return out


def answers(folder: Path) -> list[Case]:
    return [Case.from_json(one) for one in unseal(folder, key_of(folder))["cases"]]


def test_an_ambiguous_case_is_driven_twice_and_a_null_not_at_all(trial: Path, driven: Path) -> None:
    made = answers(driven)
    assert {(one.of, one.again) for one in made} == {("0001", RECOMMENDED), ("0001", RANDOM)}
    first, second = (driven / CASES / one.name for one in made)
    for home in (first, second):
        for name in (LOG, ROBOT, REFERENCE):
            assert (home / name).read_bytes() == (trial / CASES / "0001" / name).read_bytes()
        assert {path.name for path in (home / AGAIN).iterdir()} == {LOG, REFERENCE}
    assert (first / AGAIN / LOG).read_bytes() != (second / AGAIN / LOG).read_bytes()


def test_both_logs_of_a_case_are_diagnosed_together(
    driven: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    durations_s: list[float] = []

    def look(recordings: Any, *_: Any, **__: Any) -> Any:
        durations_s.extend(one.duration_s for one in recordings)
        return SimpleNamespace(diagnosis=SimpleNamespace(to_json=lambda: "{}"))

    monkeypatch.setattr(worker, "diagnose_recordings", look)
    worker._own(driven / CASES / "0001")
    assert len(durations_s) == 2
    assert durations_s[0] != durations_s[1]


def test_where_nothing_is_recommended_there_is_nothing_to_drive(
    trial: Path, tmp_path: Path
) -> None:
    silent = tmp_path / "silent"
    make_trial(Counts(1, nulls=1, pairs=0), silent, key_of(silent), SECRET, plan=PLAN[1:])
    with pytest.raises(DiagnosisError, match="no diagnosis in it recommends a manoeuvre"):
        make_again(silent, key_of(silent), tmp_path / "out", tmp_path / "out.key", SECRET)
    with pytest.raises(DiagnosisError, match="expected an empty folder or a new one"):
        make_again(trial, key_of(trial), trial, tmp_path / "out.key", SECRET)


def test_advice_is_worth_what_it_adds_to_the_truth_over_another_drive(driven: Path) -> None:
    truth = frozenset({frozenset({"gyro_scale"})})
    judged = [
        judge(replace(one, of=of), told([], p), truth, 4.0)
        for of, advised, other in (("0001", 0.9, 0.6), ("0002", 0.7, 0.8))
        for one in answers(driven)
        for p in [advised if one.again == RECOMMENDED else other]
    ]
    first = [judge(replace(one.case, name=one.case.of, again="", of=""), told([]), truth, 4.0)
             for one in judged]  # fmt: skip
    found = scores(Opened(tuple(first), 0), Opened(tuple(judged), 0))["parts"]["all"]["again"]
    assert found[RECOMMENDED]["value"] == pytest.approx(0.8)
    assert found[RANDOM]["value"] == pytest.approx(0.7)
    assert found["more"]["value"] == pytest.approx(0.1)
    assert found["more"]["count"] == 2
