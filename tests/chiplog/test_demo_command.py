"""`chiplog demo`: an effect is drawn and sealed, diagnosed, and the seal is opened."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import diagnosis_samples as samples
import pytest
from command_line import Chiplog

from chiplog.commands import demo
from chiplog.sealed import DRAWN, draw
from gap_diagnosis.pictures import Report
from gap_diagnosis.reading import read_recording
from gap_diagnosis.result import Diagnosis
from hil_harness.effects import apply_effects, catalogue
from hil_harness.robot import load_robot


def test_a_seed_draws_the_same_again_and_none_draws_in_secret() -> None:
    assert draw(7) == draw(7)
    assert len({draw().seal for _ in range(20)}) == 20


def test_every_effect_is_drawn_and_all_lie_in_their_ranges() -> None:
    sizes = {effect: (low, high) for effect, _, low, high, _ in DRAWN}
    seen = set()
    for seed in range(300):
        setting = draw(seed).setting
        ((_, value),) = setting.values
        low, high = sizes[setting.effect]
        assert low * 0.999 <= abs(float(value)) <= high * 1.001
        seen.add(setting.effect)
    assert seen == sizes.keys()


def test_what_can_be_drawn_is_in_the_catalogue_and_beyond_tolerance() -> None:
    tolerance = load_robot().tolerance.model_dump()
    for effect, parameter, low, high, signs in DRAWN:
        assert catalogue()[effect].parameter(parameter).kind == "real"
        assert low > tolerance.get(effect, tolerance.get(f"{effect}_rad_s", 0.0))
        for sign in signs:
            apply_effects([draw(1).setting])
            assert catalogue()[effect].parameter(parameter).minimum <= sign * high


def test_the_seal_is_the_hash_of_what_is_shown_when_it_is_opened() -> None:
    sealed = draw(3)
    assert hashlib.sha256(sealed.line.encode()).hexdigest() == sealed.seal
    assert str(sealed.setting) in sealed.line


class Answer:
    """Stands in for the diagnosis: keeps what it was given, answers what it is told to."""

    def __init__(self, found: Diagnosis) -> None:
        self.found = found
        self.logs: list[Path] = []
        self.references: list[Path] = []

    def __call__(self, logs: Sequence[Path], **arguments: Any) -> Report:
        self.logs, self.references = list(logs), list(arguments.pop("references"))
        assert arguments == {}
        return Report(self.found, samples.pictures())


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "SCENARIO", "stop_and_go")


@pytest.mark.usefixtures("quick")
def test_the_story_is_told_verdict_first_and_the_seal_opened(
    chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sealed = draw(5)
    answer = Answer(samples.single(sealed.setting.effect))
    monkeypatch.setattr(demo, "diagnose_shown", answer)
    said = chiplog("demo", "--out", "story", "--seed", "5")
    assert said.status == 0
    assert said.out.splitlines()[0] == (
        f"{sealed.setting.effect} (98 %): gap 48.1 mm → 2.30 mm (floor 2.00 mm)"
    )
    assert sealed.seal in said.err
    assert str(sealed.setting) not in said.err
    assert f"seal opened     {sealed.line}" in said.out
    assert "told right" in said.out
    story = tmp_path / "story"
    assert json.loads((story / "seal.json").read_text()) == {
        "sealed": sealed.line,
        "sha256": sealed.seal,
    }
    assert sealed.seal in (story / "diagnosis.html").read_text(encoding="utf-8")
    assert (story / "simulated" / "report.html").exists()
    assert {file.name for file in (story / "real").iterdir()} == {"bus.log", "reference.tum"}
    recording = read_recording(
        tmp_path / answer.logs[0], robot=load_robot(), reference=tmp_path / answer.references[0]
    )
    assert recording.reference is not None


@pytest.mark.usefixtures("quick")
def test_a_wrong_verdict_is_called_wrong(chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "diagnose_shown", Answer(samples.nothing()))
    said = chiplog("demo", "--out", "story", "--seed", "5")
    assert said.status == 0
    assert "told wrong      the verdict does NOT name it: no gap" in said.out


def test_a_file_in_the_way_is_told(chiplog: Chiplog, tmp_path: Path) -> None:
    (tmp_path / "story").write_text("mine")
    said = chiplog("demo", "--out", "story")
    assert said.status == 2
    assert said.err == "chiplog: story: is a file: --out expects a folder\n"
