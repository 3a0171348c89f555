"""What stands on the terminal: aligned, and never cut."""

from __future__ import annotations

import sys

import diagnosis_samples as samples
import pytest
from rich.console import Console

from chiplog import terminal
from chiplog.diagnosis_table import show_diagnosis


@pytest.fixture(params=[20, 80])
def narrow(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    width: int = request.param
    monkeypatch.setattr(
        terminal, "_console", lambda: Console(file=sys.stdout, width=width, highlight=False)
    )
    return width


@pytest.mark.usefixtures("narrow")
def test_cells_of_several_words_are_whole_on_a_narrow_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    row = ["a name of words", "1.25 m per 10 m", "−3.5 ° a minute"]
    terminal.show_table(["what it is called", "before", "after"], [row])
    shown = capsys.readouterr().out
    assert all(cell in shown for cell in row)


@pytest.mark.usefixtures("narrow")
def test_names_and_numbers_of_a_diagnosis_are_whole(capsys: pytest.CaptureFixture[str]) -> None:
    show_diagnosis(samples.diagnosis())
    shown = capsys.readouterr().out
    for whole in (
        "radius_mismatch + ticks_per_rev",
        "radius_mismatch.mismatch",
        "0.461 to 0.539 %",
    ):
        assert whole in shown


def test_that_logs_contradict_each_other_is_said_first(capsys: pytest.CaptureFixture[str]) -> None:
    """Two robots' logs were an unlisted cause, or a name, with certainty; a note said the rest."""
    show_diagnosis(samples.diagnosis(contradicting=("wheelbase_scale.scale",)))
    shown = capsys.readouterr().out
    assert shown.startswith("the logs contradict each other; as of one robot ")
    assert "The logs contradict each other (the notes say in what): diagnose" in shown
