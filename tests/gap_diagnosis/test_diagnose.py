"""Whole diagnoses: drives with known effects in, verdict, values and shrink out.

One effect alone and none at all are in tests/chiplog/test_round_trip.py, from the command line.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import NoReturn

import pytest
from diagnosed import CASES, ROBOT, WIRE, diagnose, diagnosed, number, recording
from full_size import at_full_size

from gap_diagnosis.diagnose import diagnose as diagnose_files
from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.result import Diagnosis
from hil_harness.effects import catalogue
from hil_harness.errors import HarnessError

OF_FULL_SIZE = ("three", "play")
"""Drives that take longest."""
OF_ANY_SIZE = [name for name in CASES if name not in OF_FULL_SIZE]


def test_two_effects_at_once_are_named() -> None:
    found = diagnosed("pair")
    assert found.verdict == "gyro_bias+lateral_slip"
    assert found.which[0].probability > 0.8
    assert ("adc_offset", "lateral_slip") in found.which[0].ambiguous_with


@pytest.mark.full_size
def test_three_effects_at_once_are_named() -> None:
    found = diagnosed("three")
    assert found.verdict == "gyro_bias+reference_time_offset+wheelbase_scale"


@pytest.mark.parametrize("name", ["pair", *at_full_size("three")])
def test_values_lie_within_four_standard_deviations(name: str) -> None:
    for key, value in CASES[name].values.items():
        known = number(diagnosed(name), key)
        assert isinstance(value, float)
        assert abs(known.estimate - value) < 4 * known.sd
        assert known.sd < 0.1 * value


@pytest.mark.full_size
def test_play_behind_a_motor_is_the_drives_and_the_odometry_shows_it() -> None:
    found = diagnosed("play")
    assert found.verdict == "backlash"
    assert found.stage == "actuation"
    known = number(found, "backlash.width")
    assert abs(known.estimate - 0.03) < 4 * known.sd
    assert known.sd < 0.003
    assert getattr(found.which[0].parameters["backlash.side"], "estimate", None) == "left"
    assert found.gap is not None
    assert found.gap.metric in ("odometry_position_m", "odometry_heading_rad")


def test_without_a_reference_wheels_and_gyro_are_one_group() -> None:
    found = diagnosed("no reference")
    named = {effects for effects in found.group if len(effects) == 1}
    assert {("wheelbase_scale",), ("gyro_scale",), ("radius_scale",)} <= named
    assert found.which[0].probability < 0.6
    assert found.which[0].group_probability > 0.8
    assert any(note.startswith("No reference") for note in found.notes)


def test_without_a_reference_something_is_driven_next() -> None:
    assert diagnosed("no reference").advice


def test_what_no_drive_can_be_simulated_for_is_diagnosed_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only the advice is missing, and a note says why."""

    def refuse(*_: object) -> NoReturn:
        raise HarnessError("GYRO: cycle 25000 µs: expected a multiple of 50000 µs")

    monkeypatch.setattr("gap_diagnosis.advising.sights", refuse)
    found = diagnose("no reference")
    assert found.verdict == diagnosed("no reference").verdict
    assert found.advice == ()
    (note,) = (one for one in found.notes if "what to drive next" in one)
    assert note == (
        "Nothing is said of what to drive next, as no drive can be simulated with this robot and "
        "bus: GYRO: cycle 25000 µs: expected a multiple of 50000 µs."
    )


def test_a_sign_in_the_setup_explains_better_than_any_effect() -> None:
    found = diagnosed("sign")
    assert found.verdict == "setup_sign"
    assert found.stage == "setup"
    best = found.which[0]
    signal = best.parameters["setup_sign.signal"]
    assert signal.estimate == "gyro"


def test_a_cause_that_is_not_in_the_library_is_unknown_in_its_stage() -> None:
    """Drift down a cross slope goes with the heading; nothing that is left imitates it."""
    found = diagnosed("withheld")
    assert found.verdict == "unknown"
    assert found.stage == "wheel"
    assert found.unknown is not None
    assert found.unknown.depends_on[0].variable == "heading"
    assert all("cross_slope_drift" not in one.effects for one in found.which)


@pytest.mark.parametrize("name", ["pair", "no reference"])
def test_the_gap_closes_on_stretches_that_the_values_never_saw(name: str) -> None:
    gap = diagnosed(name).gap
    assert gap is not None
    assert gap.held_out == "stretches"
    assert gap.after is not None
    assert gap.closed is not None
    assert gap.closed > 0.9
    assert gap.after < 0.3 * gap.before


@pytest.mark.parametrize("name", [*OF_ANY_SIZE, *at_full_size(*OF_FULL_SIZE)])
def test_every_probability_is_accounted_for(name: str) -> None:
    found = diagnosed(name)
    total = math.fsum(one.probability for one in found.which) + found.other
    assert total == pytest.approx(1, abs=1e-6)
    assert math.fsum(found.stage_probabilities.values()) == pytest.approx(1, abs=1e-6)
    listed = [one.effects for one in found.which]
    assert ("no_gap",) in listed
    assert ("unknown",) in listed


@pytest.mark.parametrize("name", [*OF_ANY_SIZE, *at_full_size(*OF_FULL_SIZE)])
def test_what_is_written_is_what_is_read(name: str) -> None:
    text = diagnosed(name).to_json()
    assert Diagnosis.from_json(text).to_json() == text


def test_the_same_input_gives_the_same_bytes_but_for_seconds() -> None:
    first, second = (
        json.loads(one.to_json()) for one in (diagnosed("no reference"), diagnose("no reference"))
    )
    first.pop("seconds"), second.pop("seconds")
    assert json.dumps(first) == json.dumps(second)


def test_a_log_with_nothing_to_compare_the_wheels_with_is_refused() -> None:
    bare = replace(
        recording("no reference"),
        reference=None,
        gyro_code=None,
        gyro_rate_rad_s=None,
        v_command_m_s=None,
        w_command_rad_s=None,
        odometry_x_m=None,
        odometry_y_m=None,
        odometry_heading_rad=None,
        frames={},
    )
    with pytest.raises(DiagnosisError, match="nothing to compare the wheels with"):
        diagnose_recordings([bare], ROBOT, WIRE)


def test_an_effect_of_a_library_that_does_not_explain_it_is_noted_as_not_looked_for() -> None:
    sag = replace(catalogue()["gyro_scale"], name="battery_sag", explain=None)
    known = {**catalogue(), "battery_sag": sag}
    found = diagnose_recordings([recording("no reference")], ROBOT, WIRE, library=known).diagnosis
    (note,) = (one for one in found.notes if "looked for" in one)
    assert note == "The effect library does not explain battery_sag, which was not looked for."
    assert not any("looked for" in one for one in diagnosed("no reference").notes)


def test_how_far_a_model_of_an_unlisted_cause_closes_the_gap_was_measured() -> None:
    found = diagnosed("withheld").unknown
    assert found is not None
    model = found.modelled
    assert model is not None
    assert model.variable == found.depends_on[0].variable
    assert found.closes == model.closed
    assert found.closes is not None
    assert found.closes > 0.5
    assert found.why_not is None


def test_no_log_at_all_is_refused_in_a_sentence() -> None:
    with pytest.raises(DiagnosisError, match="no log: expected one or more"):
        diagnose_files([])
