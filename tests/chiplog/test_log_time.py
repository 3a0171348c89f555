"""People are told seconds from the log's start, whatever clock stamped the log."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import diagnosis_samples as samples
import numpy as np
import pytest

from chiplog.diagnosis_table import show_diagnosis
from chiplog.pages.diagnosis import diagnosis_page
from chiplog.pages.diagnosis_words import candidate_facts
from chiplog.pages.log_time import from_log_start
from gap_diagnosis.pictures import Report
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import Candidate, NumberEstimate

NOON_S = 1_717_400_000.0


def at_noon(value: Any, key: str = "") -> Any:
    """Return a part of a diagnosis's JSON with all its moments on a wall clock."""
    if isinstance(value, dict) and key.endswith(("slip.start_s", "slip.stop_s")):
        moved = {name: at_noon(value[name], "windows") for name in ("ci50", "ci80", "ci95")}
        return value | moved | {"estimate": value["estimate"] + NOON_S}
    if isinstance(value, dict):
        return {name: at_noon(one, name) for name, one in value.items()}
    if isinstance(value, list):
        return [at_noon(one, key) for one in value]
    is_moment = key in ("windows", "start_s", "stop_s") and isinstance(value, float)  # no count
    return value + NOON_S if is_moment else value


def by_wall_clock(found: Diagnosis) -> Diagnosis:
    content = json.loads(found.model_dump_json())
    gaps = {name: content[name] for name in ("gap", "waterfall")}  # count their windows
    return Diagnosis.model_validate_json(json.dumps(at_noon(content) | gaps))


def without_values(one: Candidate) -> Candidate:
    return one.model_copy(update={"parameters": {}})


def slipping() -> Diagnosis:
    """Return a diagnosis with a candidate that slips from 12 to 20.5 s."""
    found = samples.diagnosis()
    which = [one if one.windows else without_values(one) for one in found.which]
    place = next(k for k, one in enumerate(which) if one.windows)
    moments = {
        f"one_sided_slip.{name}": NumberEstimate(
            estimate=at, unit="s", sd=0.1, ci50=(at, at), ci80=(at, at), ci95=(at - 0.5, at + 0.5)
        )
        for name, at in (("start_s", 12.0), ("stop_s", 20.5))
    }
    parameters = {**which[place].parameters, **moments}
    which[place] = which[place].model_copy(update={"parameters": parameters})
    return found.model_copy(update={"which": tuple(which)})


@pytest.mark.parametrize("found", [slipping(), samples.unlisted()], ids=["slip", "unknown"])
def test_the_terminal_says_the_same_of_a_log_by_wall_clock_as_of_one_from_zero(
    found: Diagnosis, capsys: pytest.CaptureFixture[str]
) -> None:
    said = []
    for one in (found, by_wall_clock(found)):
        show_diagnosis(one)
        said.append(capsys.readouterr().out)
    assert "20.50 s" in said[0] or "from 10 to 30 s" in said[0]
    assert said[1] == said[0]


def test_the_page_says_and_draws_it_from_the_start_too() -> None:
    """Eight digits of 1717400000, as drawings have, were steps of ten seconds."""
    pictures = samples.report().pictures
    assert pictures.residual_map is not None
    drawn = pictures.residual_map
    pictures = replace(  # with moments that a wall clock says exactly
        pictures,
        residuals=tuple(
            replace(one, t_s=np.arange(len(one.t_s)) * 0.125) for one in pictures.residuals
        ),
        residual_map=replace(drawn, edges_s=np.arange(len(drawn.edges_s)) * 2.5),
    )
    late = replace(
        pictures,
        residuals=tuple(replace(one, t_s=one.t_s + NOON_S) for one in pictures.residuals),
        residual_map=replace(drawn, edges_s=NOON_S + np.arange(len(drawn.edges_s)) * 2.5),
    )
    pages = [
        diagnosis_page(Report(slipping(), pictures)),
        diagnosis_page(Report(by_wall_clock(slipping()), late)),
    ]
    assert "acts from 12.0 to 20.5 s" in pages[0]
    assert pages[1] == pages[0]


def test_each_window_counts_from_the_start_of_its_own_log() -> None:
    found = slipping()
    (log,) = found.logs
    later = log.model_copy(update={"start_s": NOON_S})
    candidate = next(one for one in found.which if one.windows)
    both = candidate.model_copy(update={"windows": ((12.0, 20.5), (NOON_S + 1, NOON_S + 3))})
    told = from_log_start(found.model_copy(update={"logs": (log, later), "which": (both,)}))
    assert candidate_facts(told.which[0]).startswith("acts from 12.0 to 20.5 s, 1.0 to 3.0 s")


def test_a_moment_that_lies_in_no_log_is_left_as_it_is() -> None:
    found = slipping()
    (log,) = found.logs
    told = from_log_start(
        found.model_copy(update={"logs": (log.model_copy(update={"start_s": NOON_S}),)})
    )
    assert told.which == found.which
