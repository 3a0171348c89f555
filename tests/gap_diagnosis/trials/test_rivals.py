"""Rivals answer through the same door, and find what they are able to find."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

from gap_diagnosis.result import Diagnosis
from gap_diagnosis.trials.layout import CASES, LOG, REFERENCE, ROBOT
from gap_diagnosis.trials.make import make_case
from gap_diagnosis.trials.plan import Counts, Planned
from gap_diagnosis.trials.rivals import umbmark
from gap_diagnosis.trials.rivals.choosing import pooled
from gap_diagnosis.trials.rivals.door import job_of, softmax
from gap_diagnosis.trials.rivals.trajectory import Fitted
from gap_diagnosis.trials.secret import Secret
from hil_harness.assembly import load_wire

COUNTS = Counts(1, nulls=0, pairs=0, strata=("limit",), factor=(9.0, 10.0), new_share=0)


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a case whose wheels stand farther apart than described, about ten times the limit."""
    home = tmp_path_factory.mktemp("rivals") / CASES / "0001"
    home.mkdir(parents=True)
    one = Planned("limit", "single", ("wheelbase_scale",), drive="calibration")
    make_case(one, home, load_wire(), COUNTS, Secret(bytes(range(16))))
    return home


@pytest.mark.parametrize("name", ["least_squares", "umbmark", "whitened_bic"])
def test_every_rival_names_a_wide_wheelbase_and_closes_the_gap(name: str, wide: Path) -> None:
    rival = importlib.import_module(f"gap_diagnosis.trials.rivals.{name}")
    found: dict[str, Any] = rival.diagnose(wide / LOG, wide / ROBOT, wide / REFERENCE, [])
    told = Diagnosis.model_validate(found, strict=False)
    assert "wheelbase_scale" in told.verdict.split("+")
    assert told.gap is not None
    turns = told.gap.all["turn_difference_rad"]
    assert turns.after is not None
    assert turns.after < 0.5 * turns.before


def test_a_rival_does_not_name_what_is_withheld(wide: Path) -> None:
    rival = importlib.import_module("gap_diagnosis.trials.rivals.umbmark")
    found = rival.diagnose(wide / LOG, wide / ROBOT, wide / REFERENCE, ["wheelbase_scale"])
    assert "wheelbase_scale" not in found["verdict"].split("+")


def test_umbmark_gets_the_offset_of_the_clocks_that_every_rival_gets(
    wide: Path, tmp_path: Path
) -> None:
    """A lab would start both clocks together; a recording of a trial is late by what it is."""
    late = tmp_path / REFERENCE
    lines = (wide / REFERENCE).read_text(encoding="ascii").splitlines()
    moved = [
        f"{float(stamp) + 0.3:.6f} {rest}"
        for stamp, rest in (line.split(" ", 1) for line in lines if not line.startswith("#"))
    ]
    late.write_text("\n".join(moved) + "\n", encoding="ascii")
    on_time, delayed = (
        umbmark.calibrate(job_of(wide / LOG, wide / ROBOT, one, []))
        for one in (wide / REFERENCE, late)
    )
    for effect, sd in on_time.sds.items():
        assert abs(delayed.values[effect] - on_time.values[effect]) < 0.5 * sd


def fitted(effect: str, squares: float, free: int, *, is_news: bool) -> Fitted:
    return Fitted(effect, None, (), squares, 1000, free, is_news)


def test_a_parameter_more_must_earn_its_keep() -> None:
    plain = fitted("", 1.0, 4, is_news=False)
    # 1000 log(1/0.99) is 10.05, more than log(1000) = 6.9 for one parameter, less than for two.
    assert fitted("one", 0.99, 5, is_news=True).bic < plain.bic
    assert fitted("two", 0.99, 6, is_news=True).bic > plain.bic


def test_what_lies_within_tolerance_is_counted_as_no_gap() -> None:
    fits = [fitted("", 1.0, 4, is_news=False), fitted("small", 0.9, 5, is_news=False),
            fitted("large", 0.9, 5, is_news=True)]  # fmt: skip
    answers = pooled(softmax({(one.effect,): 0.0 for one in fits}), fits)
    assert [effects for effects, _ in answers] == [(), ("large",)]
    assert [p for _, p in answers] == pytest.approx([2 / 3, 1 / 3])
