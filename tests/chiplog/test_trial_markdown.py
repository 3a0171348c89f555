"""The measured pages of a blind trial: every table is there, and misses are as large as hits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from chiplog.pages.trial_markdown import Source, measured_pages, table
from chiplog.pages.trial_rows import (
    alarm_rows,
    calibration_rows,
    effect_rows,
    miss_rows,
    stage_rows,
    stratum_rows,
)
from gap_diagnosis.trials.case import OTHER_ENGINE, Case, Stratum
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
SURE = {"value": 0.985, "low": 0.975, "high": 0.99, "count": 400}


def told(case: Case, verdict: str, stage: str, over: float | None = 4.0) -> Judged:
    which = [
        {"effects": [name], "probability": p, "group_probability": p, "parameters": {}}
        for name, p in ((verdict, 0.9), ("unknown", 0.1))
    ]
    found: dict[str, Any] = {"verdict": verdict, "stage": stage, "which": which, "seconds": 1.0}
    return judge(case, found, frozenset({canonical(case.true_effects)}), over)


def drawn(stratum: Stratum, verdict: str, stage: str) -> Judged:
    return told(replace(CASE, stratum=stratum), verdict, stage)


SLIPPED = told(replace(CASE, effects={}, engine=OTHER_ENGINE), "one_sided_slip", "wheel", None)
CASES = (
    drawn("limit", "gyro_bias", "gyro"), drawn("prior", "gyro_scale", "wheel"),
    told(replace(CASE, effects={}), "no_gap", "none", None), SLIPPED,
)  # fmt: skip
SOURCE = Source(
    {"chiplog": Opened(CASES, 3)}, {"chiplog": "abc"}, "chiplog blind make", "2026-11-29"
)


def test_a_stratum_that_misses_a_goal_says_so_in_its_cell_and_above_the_table() -> None:
    (head, *rows), missed = stratum_rows(scores(Opened(CASES, 0)))
    assert head == ["figure", "must be", "prior", "limit"]
    stage = next(row for row in rows if row[0] == "stage")
    assert stage[1] == "≥ 0.98"
    assert stage[2].endswith("; **MISSED**")
    assert stage[3].endswith("; reached, not proved")
    assert any(one.startswith("prior, stage 0.000") for one in missed)
    assert not any(one.startswith("limit, stage") for one in missed)


def test_false_alarms_of_a_stratum_are_held_to_the_goal_of_what_is_new_about_them() -> None:
    (_, *rows), missed = stratum_rows(scores(Opened(CASES, 0)))
    goals = {row[0]: row[1] for row in rows if row[0].startswith("false alarms")}
    assert goals == {
        "false alarms, familiar": "≤ 0.01", "false alarms, new manoeuvre": "≤ 0.02",
        "false alarms, new noise": "≤ 0.02", "false alarms, new robot": "≤ 0.02",
        "false alarms, other engine": "≤ 0.05",
    }  # fmt: skip
    assert [one for one in missed if "false alarms" in one] == [
        "limit, false alarms, other engine 1.00 (0.21 to 1.00), 1 (≤ 0.05)"
    ]


def test_an_effect_has_its_counts_its_intervals_and_what_it_is_like() -> None:
    one = {
        "cases": 50, "clear": 40, "stage": SURE, "group_top1": SURE, "top1": SURE,
        "true_probability": {"value": None, "low": None, "high": None, "count": 0},
        "like": {"adc_inl": 7, "no_gap": 1},
    }  # fmt: skip
    said = "0.98 (0.97 to 0.99), 400"
    first, second = effect_rows({"gyro_bias": one, "caster_kick": one})
    assert first == ["gyro_bias", "50", "40", said, said, said, "–", "adc_inl 7, no_gap 1"]
    assert second[0] == "caster_kick (right: unknown)"
    many = {**one, "like": dict.fromkeys("abcdefgh", 2)}
    assert effect_rows({"gyro_bias": many})[0][-1] == "a 2, b 2, c 2, d 2, e 2, f 2, 2 more"


def test_what_was_missed_stands_beside_what_the_best_test_would_miss() -> None:
    curve = [
        {"from": 1.4, "to": 2.0, "best": 0.01, "missed": SURE, "in_group": SURE},
        {"from": 10.0, "to": None, "best": 0.0, "missed": SURE, "in_group": SURE},
    ]
    said = "0.98 (0.97 to 0.99), 400"
    assert miss_rows(curve) == [
        ["1.4 to 2", said, "0.010", said],
        ["10 and more", said, "0.000", said],
    ]


def test_a_bin_that_no_perfect_forecaster_shows_is_bold() -> None:
    bins = [
        {"said": 0.9, "true": true, "count": 200, "perfect": (0.85, 0.94)} for true in (0.9, 0.8)
    ]
    assert calibration_rows(bins) == [
        ["0.900", "0.900", "0.850 to 0.940", "200"],
        ["0.900", "**0.800**", "0.850 to 0.940", "200"],
    ]


def test_what_was_told_of_a_stage_stands_beside_what_looks_like_it() -> None:
    (row,) = stage_rows(
        [{"stage": "gyro", "cases": 4, "told": {"gyro": 4}, "alike": {"wheel": 0.25}}]
    )
    assert [cell for cell in row if cell] == ["gyro", "4", "0 (0.250)", "4"]


def test_a_false_alarm_has_its_name_its_count_and_its_probabilities() -> None:
    alarm = {
        "verdict": "backlash",
        "count": 2,
        "probabilities": [0.96, 0.831],
        "with": ["drive_lag"],
    }
    assert alarm_rows([alarm]) == [["backlash", "2", "0.96, 0.83", "drive_lag"]]


def test_the_page_has_every_table_and_says_what_lacks_of_a_full_trial() -> None:
    whole, each = measured_pages(SOURCE)
    for heading in (
        "## What must be reached, and what is", "## By stratum", "## What is missed, by size",
        "## How far probabilities hold", "## Which stage was told for which",
        "## What the other engine's difference triggers", "## Told wrong",
    ):  # fmt: skip
        assert heading in whole
    assert "| one_sided_slip | 1 | 0.90 | – |" in whole
    assert "**Less than a full trial has: 40 cases of each effect alone: 82 of 82" in whole
    assert "1,000 nulls, familiar: 1;" in whole
    assert "**Missed in one stratum by itself: prior, stage" in whole
    assert "(blind-trial-effects.md)" in whole
    assert "3 more cases of the trial were not diagnosed" in whole
    assert "| gyro_bias | 2 | 2 | 0.50 (" in each


@pytest.mark.parametrize("page", [0, 1])
def test_every_row_of_a_table_has_as_many_cells_as_its_head(page: int) -> None:
    columns = None
    for line in measured_pages(SOURCE)[page].splitlines():
        cells = line.count("|") if line.startswith("|") else None
        assert None in (cells, columns) or cells == columns, line
        columns = cells


def test_a_bar_in_a_cell_is_no_border() -> None:
    assert table(["a"], [["b|c"]])[-1] == "| b\\|c |"
