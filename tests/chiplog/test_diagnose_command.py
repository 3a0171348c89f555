"""`chiplog diagnose`: what it prints, writes and exits with, whatever the diagnosis is."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import diagnosis_samples as samples
import pytest
from command_line import Chiplog

from chiplog.commands import diagnose
from gap_diagnosis.pictures import Report
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import KnownEffect
from hil_harness.effects import load_effects
from hil_harness.robot import load_robot

MEANT = pytest.mark.parametrize(
    "found",
    [samples.diagnosis(), samples.single(), samples.nothing(), samples.unlisted()],
    ids=lambda found: found.verdict,
)


class Asked:
    """Stands in for the diagnosis itself: answers with a report and keeps what it was asked."""

    def __init__(self) -> None:
        self.report = samples.report()
        self.arguments: dict[str, Any] = {}

    def __call__(self, logs: Sequence[Path], **arguments: Any) -> Report:
        self.arguments = {"logs": list(logs), **arguments}
        return self.report


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    asked = Asked()
    monkeypatch.setattr(diagnose, "diagnose_shown", asked)
    return asked


def with_diagnosis(asked: Asked, found: Diagnosis) -> None:
    asked.report = replace(asked.report, diagnosis=found)


def test_the_first_line_is_verdict_probability_and_gap(asked: Asked, chiplog: Chiplog) -> None:
    said = chiplog("diagnose", "run.log")
    assert said.status == 0
    assert said.out.splitlines()[0] == (
        "radius_mismatch + radius_scale or radius_mismatch + ticks_per_rev (93 %): "
        "gap 48.1 mm → 2.30 mm (floor 2.00 mm)"
    )


@MEANT
def test_a_verdict_of_any_kind_is_status_zero(
    asked: Asked, chiplog: Chiplog, found: Diagnosis
) -> None:
    with_diagnosis(asked, found)
    said = chiplog("diagnose", "run.log")
    assert (said.status, said.err) == (0, "")
    assert len(said.out.splitlines()) < 24


def test_a_group_is_never_told_by_its_first_member_alone(asked: Asked, chiplog: Chiplog) -> None:
    lines = chiplog("diagnose", "run.log").out.splitlines()
    assert all("ticks_per_rev" in line for line in lines if "radius_scale" in line and "%)" in line)


def test_what_to_drive_next_and_what_is_ambiguous_are_told(asked: Asked, chiplog: Chiplog) -> None:
    said = chiplog("diagnose", "run.log").out
    assert "drive next    Turn one wheel by hand" in said
    assert "cannot tell   radius_mismatch + radius_scale or radius_mismatch" in said
    assert "note          The log has no odometry frames" in said


def test_where_log_and_description_contradict_each_other_stands_before_the_sentence_of_the_verdict(
    asked: Asked, chiplog: Chiplog
) -> None:
    """As the last of many notes nobody saw it: the terminal shows three."""
    doubt = "run.log: ENCODER.left_count counts to 65535, encoder.counter_bits = 12 to 4095."
    with_diagnosis(asked, samples.diagnosis(doubts=(doubt,)))
    first, _, then = chiplog("diagnose", "run.log").out.partition("\n")
    assert first.startswith("radius_mismatch")
    assert then.lstrip().replace("\n", " ").startswith(doubt)


def test_flags_reach_the_diagnosis(asked: Asked, chiplog: Chiplog, tmp_path: Path) -> None:
    words = "a.log b.log --robot r.toml --dbc d.dbc --signals m.toml --reference a.tum"
    more = "--reference b.tum --holdout c.log --holdout-reference c.tum"
    known = "--effects known.toml --effect-library my.py"
    assert chiplog("diagnose", *words.split(), *more.split(), *known.split()).status == 0
    assert asked.arguments == {
        "logs": [Path("a.log"), Path("b.log")],
        "robot": Path("r.toml"),
        "dbc": Path("d.dbc"),
        "signals": Path("m.toml"),
        "references": [Path("a.tum"), Path("b.tum")],
        "holdout": Path("c.log"),
        "holdout_reference": Path("c.tum"),
        "effects": Path("known.toml"),
        "effect_library": Path("my.py"),
        "every_drive": False,
    }


@pytest.mark.parametrize("flag", ["--json", "--html", "--advice-dir"])
def test_what_to_drive_for_every_group_is_asked_for_where_there_is_room_for_the_answer(
    asked: Asked, chiplog: Chiplog, flag: str
) -> None:
    assert chiplog("diagnose", "run.log", flag, "out").status == 0
    assert asked.arguments["every_drive"] is True


def test_many_drives_leave_the_terminal_short_and_are_all_written(
    asked: Asked, chiplog: Chiplog, tmp_path: Path
) -> None:
    """The verdict's are told there; the others are in OUT.json, on the page and in files."""
    (own,) = samples.diagnosis().advice
    more = [
        own.model_copy(
            update={"scenario_file": f"drive_{n}.toml", "sentence": f"Drive {n}.", "about": "log"}
        )
        for n in range(9)
    ]
    with_diagnosis(asked, samples.diagnosis(advice=(own, *more, more[0])))
    said = chiplog("diagnose", "run.log", "--json", "OUT.json", "--html", "OUT.html")
    lines = said.out.splitlines()
    assert len(lines) < 24
    assert not any("Drive 3." in line for line in lines)
    assert any("and 9 more to drive beside it" in line for line in lines)
    assert all((tmp_path / f"drive_{n}.toml").exists() for n in range(9))
    page = (tmp_path / "OUT.html").read_text(encoding="utf-8")
    assert page.count("Drive 3.") == 1


def test_json_page_and_scenarios_are_written(
    asked: Asked, chiplog: Chiplog, tmp_path: Path
) -> None:
    said = chiplog("diagnose", "run.log", "--json", "OUT.json", "--html", "OUT.html")
    assert said.status == 0
    written = (tmp_path / "OUT.json").read_text(encoding="utf-8")
    assert written == asked.report.diagnosis.to_json()
    assert "<!doctype html>" in (tmp_path / "OUT.html").read_text(encoding="utf-8")
    advice = tmp_path / "radius_scale-or-ticks_per_rev.toml"
    assert advice.read_text(encoding="utf-8") == samples.SCENARIO
    for name in ("OUT.json", "OUT.html", advice.name):
        assert name in said.out


def test_json_on_standard_output_is_json_alone(asked: Asked, chiplog: Chiplog) -> None:
    said = chiplog("diagnose", "run.log", "--json", "-", "--fail-if", "position > 1 m")
    assert json.loads(said.out)["verdict"] == "radius_mismatch+radius_scale"


def test_an_effect_that_cannot_be_written_takes_nothing_of_the_answer_with_it(
    asked: Asked, chiplog: Chiplog, tmp_path: Path
) -> None:
    found = samples.single("sticky_floor", glue=samples.number(1.0, 0.1))
    with_diagnosis(asked, found)
    said = chiplog("diagnose", "run.log", "--json", "OUT.json", "--write-effects", "e.toml")
    assert said.status == 2
    assert len(said.err.splitlines()) == 1
    assert said.out.startswith("sticky_floor (98 %)")
    assert "OUT.json" in said.out
    assert "e.toml" not in said.out
    assert (tmp_path / "OUT.json").read_text(encoding="utf-8") == found.to_json()


def test_without_a_place_to_write_no_scenario_is_written(
    asked: Asked, chiplog: Chiplog, tmp_path: Path
) -> None:
    chiplog("diagnose", "run.log")
    assert list(tmp_path.iterdir()) == []
    chiplog("diagnose", "run.log", "--advice-dir", "next")
    assert [file.suffix for file in (tmp_path / "next").iterdir()] == [".toml"]


def test_an_advised_file_name_stays_in_its_folder(
    asked: Asked, chiplog: Chiplog, tmp_path: Path
) -> None:
    (advice,) = samples.diagnosis().advice
    outside = advice.model_copy(update={"scenario_file": "../../outside.toml"})
    with_diagnosis(asked, samples.diagnosis(advice=(outside,)))
    chiplog("diagnose", "run.log", "--advice-dir", "next")
    assert (tmp_path / "next" / "outside.toml").exists()


@pytest.mark.parametrize(
    ("bound", "status", "said"),
    [
        ("position > 5 mm per 10 m", 1, "96.2 mm per 10 m, more than the 5.00 mm per 10 m allowed"),
        ("position > 10 cm per 10 m", 0, "within the 100 mm per 10 m allowed"),
        ("heading > 2 deg", 0, "1.15°, within the 2.00° allowed."),
    ],
)
def test_fail_if_decides_the_status(
    asked: Asked, chiplog: Chiplog, bound: str, status: int, said: str
) -> None:
    done = chiplog("diagnose", "run.log", "--fail-if", bound)
    assert done.status == status
    assert said in done.out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--fail-if", "position > five"], "chiplog: 'five': expected NUMBER UNIT"),
        (["--fail-if", "firmware > 1 m"], "chiplog: this data has no gap in firmware: it has"),
        (["--holdout-reference", "a.tum"], "chiplog: --holdout-reference without --holdout"),
        (["--json", "nowhere/OUT.json"], "chiplog: nowhere/OUT.json: there is no folder nowhere"),
        (["--html", "."], "chiplog: .: is a folder: expected the name of a file"),
    ],
)
def test_bad_usage_is_one_line_and_status_two(
    asked: Asked, chiplog: Chiplog, words: list[str], line: str
) -> None:
    said = chiplog("diagnose", "run.log", *words)
    assert said.status == 2
    assert said.err.startswith(line)
    assert said.err.count("\n") == 1


def test_a_wrong_bound_is_told_before_the_work(asked: Asked, chiplog: Chiplog) -> None:
    assert chiplog("diagnose", "run.log", "--fail-if", "nonsense").status == 2
    assert asked.arguments == {}


def test_what_was_found_is_taken_home(asked: Asked, chiplog: Chiplog, tmp_path: Path) -> None:
    chiplog("diagnose", "run.log", "--write-effects", "all.toml")
    assert {one.effect for one in load_effects(tmp_path / "all.toml")} == {
        "radius_mismatch",
        "radius_scale",
    }


def test_robot_and_effects_together_say_each_thing_once(
    asked: Asked, chiplog: Chiplog, tmp_path: Path
) -> None:
    chiplog("diagnose", "run.log", "--write-robot", "new.toml", "--write-effects", "rest.toml")
    assert load_robot(tmp_path / "new.toml").plant.wheels.radius_m == pytest.approx(0.04999875)
    assert [one.effect for one in load_effects(tmp_path / "rest.toml")] == ["radius_mismatch"]


def test_what_is_known_already_is_asked_for_and_told(asked: Asked, chiplog: Chiplog) -> None:
    known = KnownEffect(effect="lateral_slip", values={"compliance": 0.03}, file="known.toml")
    with_diagnosis(asked, samples.diagnosis(granted=(known,)))
    said = chiplog("diagnose", "run.log", "--effects", "known.toml")
    assert asked.arguments["effects"] == Path("known.toml")
    assert "known already" in said.out
    assert "lateral_slip (known.toml)" in said.out
    with_diagnosis(asked, samples.diagnosis())
    assert "known already" not in chiplog("diagnose", "run.log").out


def test_the_schema_of_the_diagnosis_is_printed(chiplog: Chiplog) -> None:
    schema = json.loads(chiplog("schema", "diagnosis").out)
    assert {"verdict", "which", "where", "gap"} <= schema["properties"].keys()


def test_how_far_a_model_of_an_unlisted_cause_would_go_is_told_or_why_not(
    asked: Asked, chiplog: Chiplog
) -> None:
    found = samples.unlisted()
    with_diagnosis(asked, found)
    said = " ".join(chiplog("diagnose", "run.log").out.split())
    assert (
        "Modelling it as a function of wheel angle left would take the position of the odometry on "
        "held-out stretches from 48.0 mm to 6.60 mm: 90 % closed (95 %: 80 to 95 %)." in said
    )
    assert found.unknown is not None
    lost = found.unknown.model_copy(
        update={"closes": None, "modelled": None, "why_not": "it goes with no variable"}
    )
    with_diagnosis(asked, found.model_copy(update={"unknown": lost}))
    said = " ".join(chiplog("diagnose", "run.log").out.split())
    assert (
        "How far a model of it would close the gap is not measured: it goes with no variable."
        in said
    )
