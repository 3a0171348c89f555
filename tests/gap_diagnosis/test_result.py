"""OUT.json: what holds of every diagnosis, whoever made it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import diagnosis_samples as samples
import pytest
from pydantic import ValidationError

from gap_diagnosis.result import Diagnosis, diagnosis_schema
from gap_diagnosis.result_parts import Candidate, Gap, NumberEstimate, Waterfall, Where

EVERY = (samples.diagnosis(), samples.single(), samples.nothing(), samples.unlisted())


def changed(**changes: Any) -> dict[str, Any]:
    return samples.diagnosis().model_dump(by_alias=True) | changes


@pytest.mark.parametrize("found", EVERY, ids=lambda found: found.verdict)
def test_a_diagnosis_is_read_back_as_it_was_written(found: Diagnosis) -> None:
    text = found.to_json()
    assert Diagnosis.from_json(text).to_json() == text


@pytest.mark.parametrize("found", EVERY, ids=lambda found: found.verdict)
def test_the_names_of_the_contract_are_all_there(found: Diagnosis) -> None:
    content = json.loads(found.to_json())
    contract = (
        "verdict stage stage_probabilities which other where unknown gap structure advice inputs "
        "version seconds schema"
    )
    assert set(contract.split()) <= content.keys()
    assert {"stages", "segments"} <= content["where"].keys()
    assert {"detectable", "groups"} <= content["structure"].keys()
    named = "effects probability group_probability parameters windows ambiguous_with"
    assert all(set(named.split()) <= entry.keys() for entry in content["which"])
    if content["gap"] is not None:
        named = "metric unit before after floor closed ci95 held_out all"
        assert set(named.split()) <= content["gap"].keys()


def test_the_same_diagnosis_gives_the_same_bytes() -> None:
    assert samples.diagnosis().to_json() == samples.diagnosis().to_json()


def test_the_order_of_summation_does_not_reach_the_bytes() -> None:
    one, other = (0.1 + 0.2) + 0.3, 0.1 + (0.2 + 0.3)
    assert one != other
    texts = {samples.diagnosis(seconds=seconds).to_json() for seconds in (one, other)}
    assert len(texts) == 1


def test_the_schema_names_every_field_and_says_what_it_means() -> None:
    schema = diagnosis_schema()
    content = json.loads(samples.diagnosis().to_json())
    assert schema["properties"].keys() == content.keys()
    assert schema["$defs"]["Candidate"]["properties"]["group_probability"]["description"]


@pytest.mark.parametrize("missing", ["no_gap", "unknown"])
def test_no_gap_and_unknown_always_have_an_entry(missing: str) -> None:
    kept = [entry for entry in samples.diagnosis().which if entry.effects != (missing,)]
    other = 1 - sum(entry.probability for entry in kept)
    with pytest.raises(ValidationError, match=f'no entry for \\["{missing}"\\]'):
        Diagnosis(**changed(which=tuple(kept), other=other))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"other": 0.5}, "sum to 1.49, not 1"),
        ({"which": samples.diagnosis().which[::-1]}, "not sorted"),
        ({"which": samples.diagnosis().which[:1] * 2}, "no entry"),
        ({"verdict": "radius_scale"}, "is not which"),
        ({"stage": "none"}, "does not go with verdict"),
        ({"stage_probabilities": {"wheel": 0.9}}, "stage_probabilities do not sum to 1"),
        ({"seconds": float("nan")}, "finite"),
        ({"surprise": 1}, "Extra inputs"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_does_not_hang_together_is_no_diagnosis(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Diagnosis(**changed(**change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"effects": ("b", "a")}, "sorted"),
        ({"effects": ("a", "a")}, "each once"),
        ({"ambiguous_with": (("d", "c"),)}, "sorted"),
        ({"parameters": {"other.scale": samples.number(1, 1)}}, "belongs to none"),
        ({"group_probability": 0.1}, "below probability"),
    ],
)
def test_a_candidate_is_in_order(change: dict[str, Any], message: str) -> None:
    content: dict[str, Any] = {"effects": ("a",), "probability": 0.5, "group_probability": 0.5}
    with pytest.raises(ValidationError, match=message):
        Candidate(**(content | change))


def test_intervals_lie_within_each_other() -> None:
    with pytest.raises(ValidationError, match="not nested"):
        NumberEstimate(
            estimate=0, unit="1", sd=1, ci50=(-2.0, 2.0), ci80=(-1.0, 1.0), ci95=(-3.0, 3.0)
        )


def test_shares_of_stages_add_up_and_may_be_negative() -> None:
    assert Where(stages={"wheel": 1.2, "gyro": -0.2}).stages["gyro"] < 0
    with pytest.raises(ValidationError, match="do not sum to 1"):
        Where(stages={"wheel": 0.5})


def test_nothing_is_closed_where_there_is_hardly_a_gap() -> None:
    content = samples.gap().model_dump() | {"before": 0.0023}
    with pytest.raises(ValidationError, match=r"below 1\.2 floors"):
        Gap(**content)
    assert Gap(**(content | {"closed": None})).closed is None


def test_the_waterfall_ends_where_the_gap_after_stands() -> None:
    content = samples.diagnosis().waterfall
    assert content is not None
    with pytest.raises(ValidationError, match="waterfall ends at"):
        Waterfall(**(content.model_dump() | {"after": 0.01}))


def test_the_group_is_the_winner_and_all_that_equal_it() -> None:
    assert samples.diagnosis().group == (
        ("radius_mismatch", "radius_scale"),
        ("radius_mismatch", "ticks_per_rev"),
    )


def test_pictures_stay_out_of_the_json() -> None:
    report = samples.report()
    bare = replace(report, pictures=samples.pictures(points=10))
    assert bare.diagnosis.to_json() == report.diagnosis.to_json()
