"""The laws hold on our plant and firmware, and what is reported of them is complete."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from hil_harness.laws import LAWS, Bench, Check, Finding, check_laws, to_json

LAW_NAMES = [law.name for law in LAWS]


def checks_of(findings: list[Finding]) -> list[Check]:
    return [check for finding in findings for check in finding.evidence.checks]


@pytest.mark.parametrize("name", LAW_NAMES)
def test_the_law_holds_on_plant_and_firmware(findings: list[Finding], name: str) -> None:
    finding = next(finding for finding in findings if finding.law.name == name)
    assert [check for check in finding.evidence.checks if not check.passed] == []


def test_no_check_would_accept_twice_or_half_of_what_it_predicts(findings: list[Finding]) -> None:
    for check in checks_of(findings):
        if check.predicted != 0:
            for factor in (2.0, 0.5, -1.0):
                assert not replace(check, predicted=factor * check.predicted).passed, check.law


def test_a_correct_implementation_fails_fewer_than_one_time_in_two_hundred(
    findings: list[Finding],
) -> None:
    assert sum(check.false_alarm for check in checks_of(findings)) < 1 / 200


def test_statistical_checks_state_their_false_alarm_rate_and_others_have_none(
    findings: list[Finding],
) -> None:
    for check in checks_of(findings):
        assert check.false_alarm in (0.0, 1e-4), check.law
        if check.interval is not None:
            assert check.false_alarm > 0, check.law


def test_errors_of_statistical_laws_are_split_into_systematic_and_random_part(
    findings: list[Finding],
) -> None:
    for finding in findings:
        if any(check.interval is not None for check in finding.evidence.checks):
            assert finding.evidence.splits, finding.law.name


def test_every_law_has_a_picture_that_shows_prediction_and_measurement(
    findings: list[Finding],
) -> None:
    for finding in findings:
        styles = {series.style for panel in finding.evidence.panels for series in panel.series}
        assert "law" in styles, finding.law.name
        assert styles & {"line", "dots"}, finding.law.name
        for panel in finding.evidence.panels:
            for series in panel.series:
                assert series.x.shape == series.y.shape, (finding.law.name, series.label)
                assert np.all(np.isfinite(series.x)), (finding.law.name, series.label)


def test_every_law_names_its_range_of_validity_and_its_source() -> None:
    named = " ".join(law.source for law in LAWS)
    for author in ("Borenstein", "Kelly", "Chong & Kleeman", "Martinelli", "Barfoot", "Woodman"):
        assert author in named
    assert all(law.validity and law.formula and law.title for law in LAWS)


def test_names_of_laws_and_of_numbers_are_unique(findings: list[Finding]) -> None:
    names = [check.law for check in checks_of(findings)]
    assert len(set(names)) == len(names)
    assert len(set(LAW_NAMES)) == len(LAW_NAMES)


def test_the_json_list_is_the_contract_s(findings: list[Finding]) -> None:
    listed = json.loads(json.dumps(to_json(findings), allow_nan=False))
    by_name = {entry["law"]: entry for entry in listed}
    assert {"law", "predicted", "measured", "tolerance", "pass", "unit"} <= set(listed[0])
    assert by_name["lesson_wheel_m"]["measured"] == pytest.approx(6.850364433010, abs=1e-9)
    assert by_name["lesson_gyro_m"]["measured"] == pytest.approx(5.280131440064, abs=1e-9)
    assert by_name["lesson_wheel_m"]["tolerance"] == 1e-9
    assert all(entry["pass"] is True for entry in listed)


def test_a_measurement_that_is_not_a_number_is_null_and_does_not_pass(
    findings: list[Finding],
) -> None:
    first = findings[0]
    lost = replace(first.evidence.checks[0], measured=math.nan)
    evidence = replace(first.evidence, checks=(lost,))
    (entry,) = to_json([replace(first, evidence=evidence)])
    assert entry["measured"] is None
    assert entry["pass"] is False


def test_the_same_seeds_give_the_same_numbers(bench: Bench, findings: list[Finding]) -> None:
    chosen = [law for law in LAWS if law.name in ("gyro_bias_heading", "se2_recursion")]
    again = checks_of(check_laws(bench, chosen))
    before = {check.law: check.measured for check in checks_of(findings)}
    assert {check.law: check.measured for check in again}.items() <= before.items()


def test_progress_counts_the_laws_that_are_done(bench: Bench) -> None:
    done: list[int] = []
    quick = [law for law in LAWS if law.name in ("distance_drift", "contact_biased")]
    check_laws(bench, quick, progress=done.append)
    assert done == [1, 2]
