"""`assert_gap_below`: last week's log as a test of this week's simulator."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import diagnosis_samples as samples
import pytest

import chiplog
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.pictures import Report
from gap_diagnosis.result_parts import LogFacts


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    arguments: dict[str, Any] = {}

    def diagnose(logs: list[Path], **given: Any) -> Report:
        arguments.update(given, logs=logs)
        return samples.report()

    monkeypatch.setitem(sys.modules, "gap_diagnosis.diagnose", SimpleNamespace(diagnose=diagnose))
    return arguments


def test_a_gap_within_bounds_passes_and_the_diagnosis_comes_back(asked: dict[str, Any]) -> None:
    found = chiplog.assert_gap_below(
        "run.log",
        robot="our.toml",
        reference="run.tum",
        effects="explained.toml",
        position="10 cm per 10 m",
        heading="2 deg",
    )
    assert asked["effects"] == Path("explained.toml")
    assert found == samples.diagnosis()
    assert asked["logs"] == [Path("run.log")]
    assert (asked["robot"], asked["references"]) == (Path("our.toml"), [Path("run.tum")])


@pytest.mark.usefixtures("asked")
def test_a_larger_gap_fails_with_its_size_and_its_cause() -> None:
    with pytest.raises(AssertionError) as failure:
        chiplog.assert_gap_below("run.log", position="5 mm per 10 m", heading="2 deg")
    first, second = str(failure.value).splitlines()
    assert first.startswith("position: 96.2 mm per 10 m, more than the 5.00 mm per 10 m allowed")
    assert second.startswith("diagnosis: radius_mismatch + radius_scale or radius_mismatch + ticks")


@pytest.mark.usefixtures("asked")
@pytest.mark.parametrize(
    ("bounds", "line"),
    [
        ({}, "no bound: expected one of position, heading"),
        ({"speed": "1 m"}, "'speed': no such metric"),
        ({"position": "5"}, "'5': expected NUMBER UNIT"),
        ({"firmware": "5 mm"}, "no gap in firmware"),
    ],
)
def test_a_bound_that_cannot_be_held_is_no_failed_test(bounds: dict[str, str], line: str) -> None:
    with pytest.raises(DiagnosisError, match=line):
        chiplog.assert_gap_below("run.log", **bounds)


def test_several_logs_are_given_together(asked: dict[str, Any]) -> None:
    chiplog.assert_gap_below(["a.log", "b.log"], reference=["a.tum", "b.tum"], position="1 m")
    assert asked["logs"] == [Path("a.log"), Path("b.log")]
    assert asked["references"] == [Path("a.tum"), Path("b.tum")]


def test_a_failure_names_the_log_whose_gap_is_the_largest(monkeypatch: pytest.MonkeyPatch) -> None:
    gaps = {"a.log": samples.gap(before=0.003).all, "b.log": samples.gap(before=0.2).all}
    logs = tuple(
        LogFacts(name=name, duration_s=40.0, ticks=4000, metrics=gap) for name, gap in gaps.items()
    )
    report = Report(samples.diagnosis(logs=logs), samples.report().pictures)
    answer = SimpleNamespace(diagnose=lambda *_, **__: report)
    monkeypatch.setitem(sys.modules, "gap_diagnosis.diagnose", answer)
    with pytest.raises(AssertionError, match=r"position in b\.log: 200 mm, more than the 5.00 mm"):
        chiplog.assert_gap_below(["a.log", "b.log"], position="5 mm")
