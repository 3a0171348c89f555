"""What to drive next: the manoeuvre that is worth most, as a file and as a sentence."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import norm
from structure_cases import PRIOR, ROBOT, WIRE, analysis_of, drive
from typer.testing import CliRunner

from chiplog.cli import app
from gap_diagnosis.advising import advice_for
from gap_diagnosis.analysis import Analysis
from gap_diagnosis.contest import bits
from gap_diagnosis.manoeuvres import manoeuvres
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.result_parts import Advice, Candidate
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import Wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import load_scenario
from hil_harness.signal_map import REQUIRED

LESSON_SPEED_M_S = 0.6


def named(effects, *others):
    return Candidate(effects=effects, probability=0.5, group_probability=1.0, ambiguous_with=others)


@cache
def lesson_with_slip() -> Analysis:
    return analysis_of(drive("lesson", EffectSetting("lateral_slip", (("compliance", 0.05),))))


def advice(winner: Candidate, analysis: Analysis, wire: Wire = WIRE) -> tuple[Advice, ...]:
    return advice_for(winner, ROBOT, wire, [analysis])


def with_speeds(wire: Wire) -> Wire:
    """Return a bus whose wheels say how fast they turn: a log has them, a simulated loop not."""
    signals = dict(wire.signal_map.signals)
    for role in REQUIRED:
        signals[role] = replace(signals[role], kind="physical", quantity="speed")
    return replace(wire, signal_map=replace(wire.signal_map, signals=signals))


def test_slip_is_told_from_a_lever_arm_by_a_drive_at_another_speed_or_on_the_spot():
    winner = named(("lateral_slip",), ("reference_lever_arm",))
    (only,) = advice(winner, lesson_with_slip(), with_speeds(WIRE))
    assert only.separates == (("lateral_slip",), ("reference_lever_arm",))
    assert only.expected_gain > 0.9
    assert only.scenario_file is not None
    assert only.scenario is not None


def test_the_drive_that_is_proposed_does_tell_them_apart(tmp_path):
    """With the lever arm that looked like the slip so far, slip explains the new drive no more."""
    winner = named(("lateral_slip",), ("reference_lever_arm",))
    (only,) = advice(winner, lesson_with_slip())
    path = tmp_path / str(only.scenario_file)
    path.write_text(str(only.scenario), encoding="utf-8")
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        load_scenario(path),
        [EffectSetting("reference_lever_arm", (("x", -0.05 * LESSON_SPEED_M_S),))],
        5,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    block = MotionBlock(MotionModel(recording, ROBOT, PRIOR))
    slip, lever = (block.fit(frozenset({e})) for e in ("lateral_slip", "reference_lever_arm"))
    assert 2 * (lever.log_likelihood - slip.log_likelihood) > 29


def test_twins_are_named_as_what_no_drive_tells_apart():
    winner = named(("lateral_slip", "radius_scale"), ("lateral_slip", "ticks_per_rev"))
    (only,) = advice(winner, lesson_with_slip())
    assert only.scenario_file is None
    assert only.scenario is None
    assert only.expected_gain == 0.0
    assert "No manoeuvre" in only.sentence


def test_without_a_reference_the_advice_is_to_have_one():
    winner = named(("gyro_scale",), ("wheelbase_scale",))
    analysis = analysis_of(
        drive("spin", EffectSetting("gyro_scale", (("scale", 0.03),)), reference=False)
    )
    (only,) = advice(winner, analysis)
    assert only.sentence.startswith("With a reference")
    assert only.expected_gain > 0.9


def test_nothing_is_advised_where_nothing_is_ambiguous():
    assert advice(named(("lateral_slip",)), lesson_with_slip()) == ()
    assert advice(named(("no_gap",)), lesson_with_slip()) == ()
    assert advice(named(("unknown",)), lesson_with_slip()) == ()


@pytest.mark.parametrize(
    ("winner", "rival", "look"),
    [
        (("drive_lag",), ("drive_delay",), "time the drive's answer"),
        (("fixed_tick_period",), ("firmware_constant",), "read the firmware's constants"),
        (("drive_lag", "frame_latency"), ("drive_delay", "frame_latency"), "time the drive's"),
        (("encoder_wrap", "reception_stamp"), ("encoder_wrap", "frame_jitter"), "stamp frames"),
        (("lateral_slip",), ("drive_lag", "lateral_slip"), "time the drive's answer"),
    ],
)
def test_what_the_motion_does_not_tell_apart_gets_no_drive_and_is_said(winner, rival, look):
    (only,) = advice(named(winner, rival), lesson_with_slip())
    assert only.separates == (winner, rival)
    assert only.scenario_file is None
    assert only.expected_gain == 0.0
    assert only.sentence.startswith("No manoeuvre")
    assert look in only.sentence


def test_what_the_motion_shows_is_told_apart_whatever_acts_beside_it_elsewhere():
    winner = named(("drive_lag", "lateral_slip"), ("drive_lag", "reference_lever_arm"))
    (only,) = advice(winner, lesson_with_slip())
    assert only.scenario_file is not None
    assert only.expected_gain > 0.9


def test_without_any_motion_it_is_said_as_well():
    winner = named(("drive_lag",), ("drive_delay",))
    (only,) = advice(winner, replace(lesson_with_slip(), motion=None))
    assert only.sentence.startswith("No manoeuvre")


@pytest.mark.parametrize("separation", [0.0, 1.0, 9.0, 29.0, 400.0])
def test_the_gain_is_one_bit_less_what_the_answer_leaves_open(separation):
    wrong = norm.cdf(-math.sqrt(separation) / 2)
    open_bits = 0.0
    for share in (wrong, 1 - wrong):
        if share > 0:
            open_bits -= share * math.log2(share)
    assert bits(separation) == pytest.approx(1 - open_bits, abs=1e-12)


def test_more_separation_is_never_worth_less():
    gains = [bits(one) for one in np.linspace(0, 60, 100)]
    assert gains == sorted(gains)
    assert gains[0] == 0.0


@pytest.mark.parametrize("manoeuvre", manoeuvres(), ids=lambda one: one.file)
def test_every_manoeuvre_is_a_sentence_and_a_drive_of_at_most_two_minutes(manoeuvre):
    assert manoeuvre.scenario.duration_s <= 120
    assert manoeuvre.file == f"{manoeuvre.scenario.name}.toml"
    assert manoeuvre.scenario.description.endswith(".")
    assert (
        manoeuvre.scenario.description.count(".")
        - manoeuvre.scenario.description.count("0.")
        - manoeuvre.scenario.description.count("1.")
        == 1
    )
    times = np.linspace(0, manoeuvre.scenario.duration_s, 2000)
    rates = manoeuvre.scenario.profile.rates(times)
    half_axle_m = 0.5 * ROBOT.plant.wheels.wheelbase_m
    assert np.abs(np.abs(rates[:, 0]) + half_axle_m * np.abs(rates[:, 1])).max() <= 1.0


@pytest.mark.parametrize("manoeuvre", manoeuvres(), ids=lambda one: one.file)
def test_chiplog_run_drives_it(manoeuvre, tmp_path):
    path = tmp_path / manoeuvre.file
    path.write_text(manoeuvre.text, encoding="utf-8")
    done = CliRunner().invoke(app, ["run", "--scenario", str(path), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output


def test_rocking_by_a_hands_breadth_shows_a_reference_that_stretches_the_room() -> None:
    """Advice sends people to rock where that is in question: it is no place on the spot."""
    (dithers,) = (one for one in manoeuvres() if one.file == "dithers.toml")
    log = synthetic_recording(ROBOT, WIRE, dithers.scenario, (), 1, reference=ReferenceNoise())
    model = MotionModel(log, ROBOT, PRIOR)
    assert "reference_scale" in {term.variant.effect for term in model.columns.terms}


def test_every_manoeuvre_goes_somewhere() -> None:
    """A log of standing still would be refused: it shows no wheel, and turns of noise alone."""
    for one in manoeuvres():
        time_s = np.arange(0, one.scenario.duration_s, 0.01)
        way_m, turned_rad = np.abs(one.scenario.profile.rates(time_s)).sum(axis=0) * 0.01
        assert way_m > 1.0 or turned_rad > 3.0, one.file
