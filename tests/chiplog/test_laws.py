"""`chiplog laws` and its page."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import Chiplog

import hil_harness.laws
from chiplog.pages.laws import answer, check_row, laws_page, split_row, with_subscripts
from hil_harness.laws import LAWS, Bench, Check, Finding, Law, Split, check_laws, default_bench
from hil_harness.laws.statistics import Interval

QUICK = ("distance_drift", "contact_biased", "heading_increment")


@pytest.fixture(scope="module")
def quick_findings() -> list[Finding]:
    return check_laws(default_bench(), [law for law in LAWS if law.name in QUICK])


def violated(finding: Finding) -> Finding:
    """Return *finding* with its first number wrong."""
    first, *others = finding.evidence.checks
    wrong = replace(first, measured=first.predicted + 2 * first.tolerance)
    return replace(finding, evidence=replace(finding.evidence, checks=(wrong, *others)))


def test_laws_that_hold_are_status_0_and_a_table(chiplog: Chiplog) -> None:
    done = chiplog("laws", *QUICK)
    assert done.status == 0
    assert re.search(r"^distance_drift +m +agrees +0\.180000 +0\.1799", done.out, re.M)
    assert "\nAll 7 numbers agree with the laws that predict them.\n" in done.out


def test_a_violated_law_is_status_1_and_named(
    chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch, quick_findings: list[Finding]
) -> None:
    def one_violated(_: Bench, laws: Sequence[Law], progress: object) -> list[Finding]:
        return [violated(quick_findings[0])]

    monkeypatch.setattr(hil_harness.laws, "check_laws", one_violated)
    done = chiplog("laws", "distance_drift")
    assert done.status == 1
    assert "DISAGREES" in done.out
    assert "1 of 2 numbers disagree: distance_drift." in done.out


def test_json_is_the_contract_s_list(chiplog: Chiplog, tmp_path: Path) -> None:
    done = chiplog("laws", "lesson", "--json", "laws.json")
    listed = {entry["law"]: entry for entry in json.loads((tmp_path / "laws.json").read_text())}
    assert done.status == 0
    assert listed["lesson_wheel_m"]["measured"] == pytest.approx(6.850364433010, abs=1e-9)
    assert listed["lesson_gyro_m"]["measured"] == pytest.approx(5.280131440064, abs=1e-9)
    assert listed["lesson_gyro_m"]["pass"] is True


def test_json_on_standard_output_is_json_alone(chiplog: Chiplog) -> None:
    done = chiplog("laws", "distance_drift", "--json", "-")
    assert [entry["law"] for entry in json.loads(done.out)] == [
        "distance_drift",
        "distance_drift_per_metre",
    ]


def test_out_gets_the_page(chiplog: Chiplog, tmp_path: Path) -> None:
    done = chiplog("laws", "contact_biased", "--out", "deep/folder")
    page = (tmp_path / "deep" / "folder" / "laws.html").read_text(encoding="utf-8")
    assert done.status == 0
    assert "Persistent slip drifts" in page


def test_a_law_that_does_not_exist_is_one_line_with_the_nearest_name(chiplog: Chiplog) -> None:
    done = chiplog("laws", "distance_drif")
    assert (done.status, done.err) == (
        2,
        "chiplog: no such law 'distance_drif'; did you mean distance_drift?\n",
    )


def test_a_file_in_place_of_the_folder_is_one_line(chiplog: Chiplog, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    done = chiplog("laws", "distance_drift", "--out", "taken")
    assert (done.status, done.err) == (2, "chiplog: taken: is a file: --out expects a folder\n")
    assert (tmp_path / "taken").read_text() == "mine"


def test_the_page_is_self_contained(quick_findings: list[Finding]) -> None:
    page = laws_page(quick_findings, runs=400)
    assert page.count("<svg") == 2 * len(quick_findings)
    assert "<script" not in page
    assert not re.search(r'(?:src|href)="(?!#)', page)
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_the_page_is_the_same_each_time(quick_findings: list[Finding]) -> None:
    assert laws_page(quick_findings, runs=400) == laws_page(quick_findings, runs=400)


def test_the_page_escapes_what_it_is_given(quick_findings: list[Finding]) -> None:
    law = replace(quick_findings[0].law, formula="<b>Ŝ</b> & ε_r", validity="x < y")
    page = laws_page([replace(quick_findings[0], law=law)], runs=400)
    assert "&lt;b&gt;Ŝ&lt;/b&gt; &amp; ε<sub>r</sub>" in page
    assert "x &lt; y" in page


def test_the_answer_names_every_number_that_disagrees(quick_findings: list[Finding]) -> None:
    checks = [
        check for finding in quick_findings[:2] for check in violated(finding).evidence.checks
    ]
    assert answer(checks) == "2 of 4 numbers disagree: distance_drift, contact_biased_distance."


@pytest.mark.parametrize(
    ("predicted", "measured", "tolerance", "unit", "shown"),
    [
        (0.18, 0.179921, 0.000154, "m", ["0.180000", "0.179921", "0.000154", "m"]),
        (1.2e-6, 1.26684e-6, 3.43e-7, "m²", ["1.200", "1.267", "0.343", "10⁻⁶ m²"]),
        (-0.5, -0.499868, 0.0145, "ticks", ["−0.5000", "−0.4999", "0.0145", "ticks"]),
        (0.0, 0.0, 0.0, "m, rad", ["0", "0", "0", "m, rad"]),
        (1.0, 1.0, 0.0, "1", ["1", "1", "0", ""]),
    ],
)
def test_numbers_show_three_digits_of_their_tolerance(
    predicted: float, measured: float, tolerance: float, unit: str, shown: list[str]
) -> None:
    check = Check("law", predicted, measured, tolerance, unit, "none")
    assert check_row(check)[1:-1] == shown


def test_a_split_shows_both_parts_with_their_intervals() -> None:
    split = Split(
        "heading error after 60 s",
        "rad",
        400,
        0.299916,
        Interval(0.299765, 0.300067),
        0.00153334,
        Interval(0.00143393, 0.00164757),
    )
    assert split_row(split) == [
        "heading error after 60 s [rad]",
        "400",
        "0.29992 ± 0.00015",
        "0.00153 [0.00143, 0.00165]",
    ]


def test_subscripts_end_where_their_letters_end() -> None:
    assert with_subscripts("ε_b², e_{k+1} = e_k·t") == (
        "ε<sub>b</sub>², e<sub>k+1</sub> = e<sub>k</sub>·t"
    )
