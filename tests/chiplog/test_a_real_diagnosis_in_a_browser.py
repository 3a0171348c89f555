"""A drive, its log, its diagnosis, its page: as a person has it before them, in a real browser.

Pages of diagnoses made by hand are in test_diagnosis_page_in_a_browser.py.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import pytest
from browser import Browser, Tab

from chiplog.cli import main
from chiplog.pages.diagnosis_words import probability
from gap_diagnosis.result import Diagnosis

CAUSE = "radius_mismatch"
DRIVE = f"run --scenario calibration --duration-s 30 --effect {CAUSE}.mismatch=0.004 --seed 3"
IN_VIEW = """
[...document.querySelectorAll(%s)].map((drawn) => {
  const own = drawn.getBoundingClientRect(), svg = drawn.closest("svg").getBoundingClientRect();
  return own.left >= svg.left - 1 && own.right <= svg.right + 1 &&
    own.top >= svg.top - 1 && own.bottom <= svg.bottom + 1 && own.width > 0;
})
"""


@dataclass(frozen=True)
class Real:
    """A diagnosis as OUT.json has it, and its page as the browser shows it."""

    found: Diagnosis
    shown: Tab

    @property
    def data(self) -> Any:
        """Return what the page draws from."""
        return json.loads(self.shown.texts("#data")[0])


@pytest.fixture(scope="module")
def real(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Real:
    folder = tmp_path_factory.mktemp("real")
    names = ("bus.log", "reference.tum", "OUT.json", "OUT.html")
    log, reference, answer, page = (str(folder / name) for name in names)
    assert main([*DRIVE.split(), "--out", str(folder)]) == 0
    asked = [log, "--reference", reference, "--json", answer, "--html", page]
    assert main(["diagnose", *asked]) == 0
    found = Diagnosis.from_json((folder / "OUT.json").read_text(encoding="utf-8"))
    return Real(found, browser.open(folder / "OUT.html"))


def test_it_opens_without_complaint_and_asks_no_network(real: Real) -> None:
    assert real.shown.complaints == []
    assert real.shown.asked_for == {real.shown.page.as_uri()}


def test_the_verdict_is_what_was_found_with_its_probability(real: Real) -> None:
    assert real.found.verdict == CAUSE
    (answer,) = real.shown.texts("p.answer")
    assert CAUSE in answer
    assert probability(real.found.which[0].group_probability) in answer


def test_the_waterfall_falls_from_described_over_the_cause_to_explained(real: Real) -> None:
    fall = real.found.waterfall
    assert fall is not None
    assert real.shown.texts(".bars .label")[1:-1] == [step.effect for step in fall.steps] == [CAUSE]
    before, step, after = real.shown.run(
        "[...document.querySelectorAll('.bars .bar')].map((b) => b.getBoundingClientRect().width)"
    )
    assert after / before == pytest.approx(fall.after / fall.before, abs=0.01)
    assert step / before == pytest.approx(fall.steps[0].reduction / fall.before, abs=0.01)


def test_the_map_has_a_cell_for_each_residual_and_while_and_a_piece_for_each_manoeuvre(
    real: Real,
) -> None:
    times = real.found.where.residuals
    assert times is not None
    assert len(times.rows) >= 4
    cells = len(times.rows) * (len(times.edges_s) - 1) + len(real.found.where.segments)
    drawn = real.shown.run(IN_VIEW % "'#map g[clip-path] rect'")
    assert drawn == [True] * cells


def test_the_ways_before_and_after_are_drawn_beside_the_measured_one(real: Real) -> None:
    path = real.data["paths"][real.data["path"]]
    assert all(len(path[way][0]) > 100 for way in ("reference", "before", "after"))
    assert real.shown.run(IN_VIEW % "'#path path.line'") == [True] * 3
    ways = real.shown.run(
        "[...document.querySelectorAll('#path path.line')].map((w) => w.getAttribute('d'))"
    )
    assert len(set(ways)) == 3


def test_every_residual_has_its_line_and_one_once_explained(real: Real) -> None:
    lines = [1 + (one["explained"] is not None) for one in real.data["residuals"]]
    assert max(lines) == 2
    assert [
        real.shown.count(f"#residual-{place} path.line") for place in range(len(lines))
    ] == lines
