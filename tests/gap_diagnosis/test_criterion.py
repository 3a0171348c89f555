"""`position > 5 mm per 10 m`: what is accepted, what it means, and what it is held against."""

from __future__ import annotations

import math
from typing import Any, Literal

import diagnosis_samples as samples
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gap_diagnosis.criterion import METRICS, Bound, judge, parse_bound, parse_criterion
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import InputFile, LogFacts, Metric

SIZES = st.floats(1e-9, 1e9)
BOUNDS = st.builds(
    lambda metric, limit, per: Bound(metric, limit, *per),
    st.sampled_from(sorted(METRICS)),
    SIZES,
    st.one_of(st.just((None, "")), st.tuples(SIZES, st.sampled_from(["m", "s"]))),
)


@given(BOUNDS)
def test_a_bound_written_out_is_read_back(bound: Bound) -> None:
    assert parse_criterion(str(bound)) == bound


@given(st.text(max_size=200))
@example("position > 1" + "0" * 90 + " m")
@example("position > 1e999 m")
@example("position > 5 mm per 0 m")
@example("position > ٥ mm")
def test_any_text_is_a_bound_or_one_line_that_says_what_was_expected(text: str) -> None:
    try:
        assert math.isfinite(parse_criterion(text).limit)
        said = "expected"
    except DiagnosisError as error:
        said = str(error)
    assert "expected" in said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("text", "bound"),
    [
        ("position > 5 mm per 10 m", Bound("position", 0.005, 10.0, "m")),
        ("position>5mm per 10m", Bound("position", 0.005, 10.0, "m")),
        ("drive > 1.5 cm", Bound("drive", 0.015)),
        ("heading > 1 deg per min", Bound("heading", math.pi / 180, 60.0, "s")),
        ("turn > 0.5 ° per 2 min", Bound("turn", math.pi / 360, 120.0, "s")),
        ("timing > 2 ms", Bound("timing", 0.002)),
        ("firmware > 1e-3 m per km", Bound("firmware", 0.001, 1000.0, "m")),
    ],
)
def test_bounds_read_as_a_person_means_them(text: str, bound: Bound) -> None:
    read = parse_criterion(text)
    assert (read.metric, read.per, read.span) == (bound.metric, bound.per, bound.span)
    assert read.limit == pytest.approx(bound.limit, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("position", "'position': expected METRIC > NUMBER UNIT"),
        ("speed > 1 m", "'speed': no such metric: expected position, heading, drive, firmware"),
        ("position > five mm", "'five mm': expected NUMBER UNIT"),
        ("position > 5 deg", "'deg': no unit of position: expected m, cm, mm"),
        ("position > 5 mm per 10 turns", "per 'turns': expected a length or a time"),
        ("position > 5 mm per 0 m", "per 0 m: expected more than 0"),
        ("position > -5 mm", "'-5 mm': expected NUMBER UNIT"),
    ],
)
def test_a_mistake_is_told_with_what_would_be_right(text: str, line: str) -> None:
    with pytest.raises(DiagnosisError) as error:
        parse_criterion(text)
    assert str(error.value).startswith(line)


@given(SIZES, SIZES)
def test_a_bound_per_length_scales_with_the_windows(limit_m: float, per_m: float) -> None:
    found = samples.diagnosis()
    judgement = judge(Bound("position", limit_m, per_m, "m"), found)
    assert judgement.value == pytest.approx(0.0481 * per_m / 5.0)
    assert judgement.holds == (judgement.value <= limit_m)


def test_the_gap_as_described_counts_not_the_one_that_effects_leave() -> None:
    found = samples.diagnosis()
    assert not judge(parse_bound("position", "5 mm per 10 m"), found).holds
    assert judge(parse_bound("position", "97 mm per 10 m"), found).holds
    assert judge(parse_bound("position", "48.1 mm"), found).holds


def test_a_bound_per_time_uses_the_windows_seconds() -> None:
    judgement = judge(parse_bound("heading", "2 deg per min"), samples.diagnosis())
    assert judgement.value == pytest.approx(0.02 * 60 / 9)


@pytest.mark.parametrize(
    ("speed_m_s", "window_m", "window_s"),
    [(0.25, 2.5, 10.0), (0.8, 5.0, 6.25), (10.0, 50.0, 5.0), (None, 5.0, 10.0)],
)
def test_windows_of_unknown_length_are_those_of_the_mean_speed(
    speed_m_s: float | None, window_m: float, window_s: float
) -> None:
    distance_m = None if speed_m_s is None else 40 * speed_m_s
    facts = LogFacts(name="run.log", duration_s=40.0, ticks=4000, distance_m=distance_m)
    whole = samples.gap()
    bare = {
        name: one.model_copy(update={"window_m": None, "window_s": None})
        for name, one in whole.all.items()
    }
    found = samples.diagnosis(gap=whole.model_copy(update={"all": bare}), logs=(facts,))
    assert judge(parse_bound("position", "1 m per m"), found).scaled == window_m
    assert judge(parse_bound("position", "1 m per s"), found).scaled == window_s


def _on_logs(*gaps: dict[str, Metric]) -> Diagnosis:
    """Return a diagnosis of logs a.log, b.log, ... each with its own gap."""
    logs = tuple(
        LogFacts(name=f"{name}.log", duration_s=40.0, ticks=4000, metrics=metrics)
        for name, metrics in zip("abc", gaps, strict=False)
    )
    return samples.diagnosis(logs=logs)


def test_of_several_logs_the_worst_counts_wherever_it_stands() -> None:
    small, large = samples.gap(before=0.003).all, samples.gap(before=0.2).all
    for gaps, name in (([small, large], "b.log"), ([large, small, small], "a.log")):
        judgement = judge(parse_bound("position", "5 mm"), _on_logs(*gaps))
        assert not judgement.holds
        assert (judgement.value, judgement.log) == (0.2, name)
    assert judge(parse_bound("position", "5 mm"), _on_logs(small, small)).holds


def test_logs_of_one_name_are_told_apart_by_their_place() -> None:
    both = _on_logs(samples.gap(before=0.003).all, samples.gap(before=0.2).all)
    same = tuple(log.model_copy(update={"name": "bus.log"}) for log in both.logs)
    found = both.model_copy(update={"logs": same})
    assert judge(parse_bound("position", "5 mm"), found).log == "bus.log (log 2)"


def test_a_log_that_does_not_have_the_metric_does_not_pass_in_silence() -> None:
    with pytest.raises(DiagnosisError, match=r"b\.log: this data has no gap in position"):
        judge(parse_bound("position", "1 m"), _on_logs(samples.gap().all, {}))


SHORT = "nothing is held out: the log lasts 12 s, and a held-out stretch needs at least 25 s"


def _facts(**known: Any) -> LogFacts:
    return LogFacts(name="run.log", duration_s=12.0, ticks=1200, **known)


def _short(*, has_reference: bool) -> Diagnosis:
    """Return a diagnosis of a log of which nothing could be held out."""
    facts = _facts(has_reference=has_reference, unmeasured=SHORT)
    return samples.nothing().model_copy(update={"logs": (facts,)})


def _held_out(roles: tuple[Literal["holdout", "holdout_reference"], ...]) -> Diagnosis:
    """Return a diagnosis without an odometry gap on another log that was held out."""
    inputs = tuple(InputFile(role=one, name="b", sha256=samples.SHA256) for one in roles)
    found = _without("odometry_position_m", "odometry_heading_rad")
    return found.model_copy(update={"inputs": inputs})


def _without(*missing: str) -> Diagnosis:
    """Return a diagnosis of a log with a reference, and with a gap but in these metrics."""
    whole = samples.gap()
    timing = whole.all["odometry_heading_rad"].model_copy(update={"unit": "s"})
    there = whole.all | {"timing_s": timing}
    kept = {name: one for name, one in there.items() if name not in missing}
    gap = whole.model_copy(update={"all": kept})
    return samples.diagnosis(gap=gap, logs=(_facts(has_reference=True),))


def test_of_several_logs_the_one_that_is_too_short_is_named_with_its_reason() -> None:
    both = _on_logs(samples.gap().all, {})
    short = both.logs[1].model_copy(update={"unmeasured": SHORT, "has_reference": True})
    found = both.model_copy(update={"logs": (both.logs[0], short)})
    with pytest.raises(DiagnosisError) as error:
        judge(parse_bound("position", "1 m"), found)
    assert str(error.value) == f"b.log: this data has no gap in position: {SHORT}"


@pytest.mark.parametrize(
    ("metric", "found", "line"),
    [
        ("firmware", samples.diagnosis(), "no gap in firmware: it has position, heading"),
        ("position", samples.nothing(), "needs a reference): nothing was held out"),
        ("position", _short(has_reference=True), f"no gap in position: {SHORT}"),
        ("position", _short(has_reference=False), f"position (it needs a reference): {SHORT}"),
        ("turn", _short(has_reference=True), f"no gap in turn: {SHORT}"),
        ("heading", _without("odometry_heading_rad"), "(its reference has no headings): it has"),
        (
            "position",
            _without("odometry_position_m", "odometry_heading_rad", "turn_difference_rad"),
            "(its reference tells too little of what was held out): it has timing",
        ),
        ("position", _held_out(("holdout",)), "position (it needs a reference): it has timing"),
        ("position", _held_out(("holdout", "holdout_reference")), "(its reference tells too"),
    ],
)
def test_a_metric_that_the_data_does_not_have_is_an_error(
    metric: str, found: Diagnosis, line: str
) -> None:
    with pytest.raises(DiagnosisError) as error:
        judge(
            parse_bound(metric, "1 mm" if metric in {"position", "firmware"} else "1 mrad"), found
        )
    assert line in str(error.value)
