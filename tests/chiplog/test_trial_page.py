"""The page of a blind trial: figures with intervals, offline and escaped."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from chiplog.pages.trial import trial_page
from chiplog.pages.trial_words import (
    FIGURES,
    MISSED,
    NOT_MEASURED,
    REACHED,
    UNPROVED,
    figure,
    goal_of,
    verdict_on,
)
from gap_diagnosis.trials.case import OTHER_ENGINE, Case
from gap_diagnosis.trials.judge import Judged, judge
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.reference_noise import ReferenceLevels
from gap_diagnosis.trials.score import scores
from gap_diagnosis.trials.truth import canonical

LEVELS = ReferenceLevels("white", 5e-4, 5e-4, 2e-4, 2e-4, 1.0, 100.0)
CASE = Case(
    "0001", "limit", "single", {"gyro_bias": {"bias": 0.01}}, {}, (), {}, {}, "calibration",
    "familiar", LEVELS, 4, "00" * 16,
)  # fmt: skip


def told(verdict: str, stage: str, probability: float = 0.9) -> dict[str, Any]:
    which = [
        {"effects": [name], "probability": p, "group_probability": p, "parameters": {}}
        for name, p in ((verdict, probability), ("unknown", 1 - probability))
    ]
    return {"verdict": verdict, "stage": stage, "which": which, "seconds": 1.0, "gap": None}


def trial(*verdicts: tuple[str, str]) -> Opened:
    judged: list[Judged] = []
    for place, (verdict, stage) in enumerate(verdicts):
        case = replace(CASE, name=f"{place + 1:04d}", effects=CASE.effects if place % 2 else {})
        oracle = frozenset({canonical(case.true_effects)})
        judged.append(judge(case, told(verdict, stage), oracle, 4.0 if case.effects else None))
    return Opened(tuple(judged), 0)


RIGHT = trial(("no_gap", "none"), ("gyro_bias", "gyro"), ("no_gap", "none"), ("adc_offset", "gyro"))
WRONG = trial(("gyro_scale", "gyro"), ("gyro_scale", "gyro"), ("no_gap", "none"))


def test_the_page_shows_every_figure_the_rival_and_the_wrong_cases() -> None:
    page = trial_page("t", "chiplog", {"chiplog": RIGHT, "rival": WRONG})
    for one in FIGURES:
        assert one.label.split(",")[0] in page
    assert "The same 3 cases" in page
    assert "Told wrong" not in page
    assert "Told wrong" in trial_page("t", "rival", {"rival": WRONG})


def test_beside_a_calibration_error_stands_what_chance_alone_makes_of_so_many_cases() -> None:
    """Of 215 cases in fifteen bins a perfect forecaster shows 0.047: no goal of 0.03 is missed by
    that, nor could it be reached."""
    (by_chance,) = (one for one in FIGURES if one.key == "ece_by_chance")
    part = {"ece_by_chance": (0.047, 0.029, 0.07), "cases": 215}
    assert figure(part, by_chance) == "0.047 (0.029 to 0.070), 215"
    assert figure({"ece_by_chance": None, "cases": 0}, by_chance) == NOT_MEASURED


def test_only_all_of_them_is_one() -> None:
    stage = next(one for one in FIGURES if one.key == "stage")
    nearly = {"stage": {"value": 0.9986, "low": 0.9968, "high": 0.9994, "count": 2041}}
    assert figure(nearly, stage) == "0.999 (0.997 to 0.999), 2041"
    every = {"stage": {"value": 1.0, "low": 0.9968, "high": 1.0, "count": 2041}}
    assert figure(every, stage) == "1.00 (1.00 to 1.00), 2041"


def test_the_page_is_whole_offline_and_without_scripts() -> None:
    page = trial_page("t", "chiplog", {"chiplog": RIGHT})
    assert page.count("<svg") == 6
    assert "<script" not in page
    assert re.findall(r'(?:src|href)="(?!#)[^"]*"', page) == []
    assert "default-src 'none'" in page


def test_names_from_a_trial_are_escaped() -> None:
    page = trial_page("<b>t</b>", "<i>", {"<i>": WRONG})
    assert "<b>t</b>" not in page
    assert "&lt;b&gt;t&lt;/b&gt;" in page
    assert "<i>" not in page


def test_a_goal_is_reached_by_the_measured_value_and_missed_below_it() -> None:
    stage = next(one for one in FIGURES if one.key == "stage")
    right, wrong = (scores(one)["parts"]["all"] for one in (RIGHT, WRONG))
    assert verdict_on(right, goal_of(stage)) == UNPROVED  # two cases prove nothing
    certain = {**right, "stage": {"value": 1.0, "low": 0.985, "high": 1.0, "count": 300}}
    assert verdict_on(certain, goal_of(stage)) == REACHED
    alarms = next(one for one in FIGURES if one.key == "false_alarms")
    assert verdict_on(wrong, goal_of(alarms)) == MISSED
    assert goal_of(alarms, "new noise").value == pytest.approx(0.02)
    assert figure(right, stage).startswith("1.00 (")


def test_false_alarms_of_the_other_engine_stand_apart_with_a_goal_of_their_own() -> None:
    first = RIGHT.judged[0]
    other = replace(first, case=replace(first.case, engine=OTHER_ENGINE), verdict="gyro_bias")
    parts = scores(Opened((*RIGHT.judged, other), 0))["parts"]
    alarms = next(one for one in FIGURES if one.key == "false_alarms")
    assert parts["other engine"]["false_alarms"]["value"] == 1.0
    assert parts["familiar"]["false_alarms"]["value"] == 0.0
    assert goal_of(alarms, "other engine").value == pytest.approx(0.05)


def test_what_was_not_measured_has_no_verdict() -> None:
    pairs = next(one for one in FIGURES if one.key == "pairs_both_named")
    part = scores(RIGHT)["parts"]["all"]
    assert figure(part, pairs) == "–"
    assert verdict_on(part, goal_of(pairs)) == ""
