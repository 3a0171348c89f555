"""The page of a diagnosis in a real browser: offline, nothing refused, drawn, and it answers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import diagnosis_samples as samples
import numpy as np
import pytest
from browser import Browser, Tab

from chiplog.pages.diagnosis import diagnosis_page
from gap_diagnosis.pictures import Report, ResidualSeries
from gap_diagnosis.result import Diagnosis

EVERY = [samples.diagnosis(), samples.single(), samples.nothing(), samples.unlisted()]
TIME_TICKS = "#residual-0 text[text-anchor=middle]"
AFTER = '#path path.line[style*="--green"]'


def opened(browser: Browser, folder: Path, page: str, width: int = 1000) -> Tab:
    file = folder / "diagnosis.html"
    file.write_text(page, encoding="utf-8")
    return browser.open(file, width)


@pytest.fixture
def shown(browser: Browser, tmp_path: Path) -> Tab:
    return opened(browser, tmp_path, diagnosis_page(samples.report()))


@pytest.mark.parametrize("found", EVERY, ids=lambda found: found.verdict)
def test_every_verdict_opens_without_complaint_and_asks_for_nothing_else(
    browser: Browser, tmp_path: Path, found: Diagnosis
) -> None:
    shown = opened(browser, tmp_path, diagnosis_page(Report(found, samples.pictures())))
    assert shown.complaints == []
    assert shown.asked_for == {shown.page.as_uri()}


def test_all_charts_are_drawn_from_the_pages_data(shown: Tab) -> None:
    windows, stages, segments = 6, 2, 2
    assert shown.count("#map g[clip-path] rect") == windows * stages + segments
    described, explained = 2, 1
    assert shown.count("[id^=residual-] path.line") == described + explained
    assert shown.count("#path path.line") == 3
    drawn = shown.run(
        "[...document.querySelectorAll('svg')].map((svg) => svg.getBoundingClientRect().width)"
    )
    assert all(width > 500 for width in drawn)


def test_a_drag_over_the_map_zooms_all_charts_over_time_and_a_double_click_undoes_it(
    shown: Tab,
) -> None:
    whole = shown.texts(TIME_TICKS)
    assert whole[0] == "0"
    assert whole[-1] == "60"
    shown.drag("#map", 0.4, 0.6)
    ticks = [float(text) for text in shown.texts(TIME_TICKS)]
    assert 60 * 0.2 < min(ticks) < max(ticks) < 60 * 0.6
    shown.click("#map", times=2)
    assert shown.texts(TIME_TICKS) == whole
    assert shown.complaints == []


def test_what_is_off_by_a_rounding_only_is_drawn_flat_on_an_axis_that_can_be_read(
    browser: Browser, tmp_path: Path
) -> None:
    """Labels of 15 decimals ran out of the chart, and frames were counted in n1."""
    time_s = np.linspace(0.0, 60.0, 50)
    residue = 1e-15 * np.sin(time_s)
    kinds = ("heading", "rad"), ("along x", "m"), ("stamps", "s"), ("frames missing", "1")
    rows = tuple(ResidualSeries("bus", name, unit, time_s, residue) for name, unit in kinds)
    pictures = replace(samples.pictures(), residuals=rows)
    shown = opened(browser, tmp_path, diagnosis_page(Report(samples.diagnosis(), pictures)))
    labels = [shown.texts(f"#residual-{k} text") for k in range(len(kinds))]
    assert max(len(label) for chart in labels for label in chart if label[-1].isdigit()) <= 6
    assert ["frames missing" in chart for chart in labels] == [False, False, False, True]
    paths = "[...document.querySelectorAll('[id^=residual-] path.line')]"
    assert max(shown.run(f"{paths}.map((path) => path.getBBox().height)")) < 1


def test_pointing_at_a_cell_of_the_map_tells_its_share(shown: Tab) -> None:
    shown.mouse("mouseMoved", "#map g[clip-path] rect:nth-of-type(4)", 0.5)
    shown.settle()
    assert "wheel, 10.0 to 20.0 s: 20.0 % of this residual's energy" in " ".join(
        shown.texts(".readout")
    )


def test_a_path_is_hidden_and_shown_by_its_button(shown: Tab) -> None:
    after = ".controls button:last-of-type"
    assert shown.texts(after) == ["with what was found"]
    shown.click(after)
    assert shown.count(AFTER) == 0
    shown.click(after)
    assert shown.count(AFTER) == 1


@pytest.mark.parametrize("width", [320, 700])
def test_a_narrow_screen_scrolls_one_way_only(browser: Browser, tmp_path: Path, width: int) -> None:
    shown = opened(browser, tmp_path, diagnosis_page(samples.report()), width)
    assert shown.run("document.documentElement.scrollWidth") <= width


def test_a_script_that_the_policy_does_not_name_would_be_seen(
    browser: Browser, tmp_path: Path
) -> None:
    page = diagnosis_page(samples.report()).replace("NS = ", "NS  = ")
    shown = opened(browser, tmp_path, page)
    assert any("Content Security Policy" in text for text in shown.complaints)
    assert shown.count("#map svg") == 0


def test_a_script_that_fails_and_a_request_would_be_seen(browser: Browser, tmp_path: Path) -> None:
    shown = opened(
        browser,
        tmp_path,
        "<script>fetch('https://example.org/x').catch(() => 0); nothing.at.all();</script>",
    )
    assert any("nothing is not defined" in text for text in shown.complaints)
    assert "https://example.org/x" in shown.asked_for
