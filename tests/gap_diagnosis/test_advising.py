"""What to drive next: the manoeuvre that is worth most, as a file and as a sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from full_size import at_full_size
from scipy.stats import norm
from structure_cases import PRIOR, ROBOT, WIRE, analysis_of, drive, motion_of
from typer.testing import CliRunner

from chiplog.cli import app
from gap_diagnosis.advising import Menu, Question, advice_for
from gap_diagnosis.analysis import Analysis
from gap_diagnosis.contest import Contest, Hypothesis, View, bits
from gap_diagnosis.manoeuvres import Described, Equipment, manoeuvres, sights
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import with_library
from gap_diagnosis.result_parts import Advice, Candidate
from gap_diagnosis.structure import structure_of
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import RunConfig, Wire
from hil_harness.effects import EffectSetting
from hil_harness.running import run
from hil_harness.scenarios import load_scenario, scenario
from hil_harness.signal_map import REQUIRED
from hil_harness.signal_roles import Role

LESSON_SPEED_M_S = 0.6
GROUP = ("lateral_slip", "reference_lever_arm", "reference_time_offset")
"""What the lesson's run cannot tell apart."""


def named(effects, *others):
    return Candidate(effects=effects, probability=0.5, group_probability=1.0, ambiguous_with=others)


@cache
def lesson_with_slip() -> Analysis:
    return analysis_of(drive("lesson", EffectSetting("lateral_slip", (("compliance", 0.05),))))


@cache
def with_nothing(name: str, *, heading: bool = True) -> Analysis:
    return analysis_of(drive(name, heading=heading))


@cache
def of_the_log(name: str, *, heading: bool = True) -> tuple[Advice, ...]:
    """Return what is advised after a drive in which nothing is wrong."""
    analysis = with_nothing(name, heading=heading)
    found = advice_for([named(("no_gap",))], ROBOT, WIRE, [analysis], structure_of([analysis]))
    assert {one.about for one in found} == {"log"}
    return found


def driven(advised: Advice, folder: Path, *effects: EffectSetting, heading: bool) -> MotionBlock:
    """Drive what is advised as `chiplog run --scenario` would, with these effects."""
    path = folder / str(advised.scenario_file)
    path.write_text(str(advised.scenario), encoding="utf-8")
    recording = synthetic_recording(
        ROBOT, WIRE, load_scenario(path), effects, 5, reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )  # fmt: skip
    if recording.reference is not None and not heading:
        recording = replace(recording, reference=replace(recording.reference, heading_rad=None))
    return motion_of(recording, *GROUP)


def advice(winner: Candidate, analysis: Analysis, wire: Wire = WIRE) -> tuple[Advice, ...]:
    return advice_for([winner], ROBOT, wire, [analysis])


def with_speeds(wire: Wire) -> Wire:
    """Return a bus whose wheels say how fast they turn: a log has them, a simulated loop not."""
    signals = dict(wire.signal_map.signals)
    for role in REQUIRED:
        signals[role] = replace(signals[role], kind="physical", quantity="speed")
    return replace(wire, signal_map=replace(wire.signal_map, signals=signals))


def at_half_the_beat(wire: Wire) -> Wire:
    """Return a bus on which every message comes half as often."""
    signals = dict(wire.signal_map.signals)
    for role, one in signals.items():
        spec = one.message
        assert spec.cycle_time_us is not None
        slower = replace(
            spec, cycle_time_us=2 * spec.cycle_time_us, start_delay_us=2 * spec.start_delay_us
        )
        signals[role] = replace(one, message=slower)
    return replace(wire, signal_map=replace(wire.signal_map, signals=signals))


def with_cycles(wire: Wire, cycles_us: Mapping[Role, int | None], delay_us: int = 0) -> Wire:
    """Return a bus on which some roles' messages come in these cycles, after this delay."""
    signals = dict(wire.signal_map.signals)
    for role, cycle_us in cycles_us.items():
        spec = replace(signals[role].message, cycle_time_us=cycle_us, start_delay_us=delay_us)
        signals[role] = replace(signals[role], message=spec)
    return replace(wire, signal_map=replace(wire.signal_map, signals=signals))


def test_what_a_drive_would_see_is_of_this_bus_and_not_of_one_asked_about_before() -> None:
    levels = with_nothing("square").motion.levels
    shown = []
    for wire in (WIRE, at_half_the_beat(WIRE)):
        described = Described(ROBOT, wire, PRIOR)
        _, sight = next(sights(described, Equipment(100.0, True, True), levels, frozenset()))
        shown.append(sight.inner)
    assert not np.array_equal(*shown)


def test_robots_without_effects_of_their_own_share_what_is_known_of_the_drives() -> None:
    """Each diagnosis asks for the prior with its library; models are kept by which prior it is."""
    assert with_library(PRIOR, {}) is PRIOR


@pytest.mark.full_size
def test_slip_is_told_from_a_lever_arm_by_a_drive_at_another_speed_or_on_the_spot():
    winner = named(("lateral_slip",), ("reference_lever_arm",))
    (only,) = advice(winner, lesson_with_slip(), with_speeds(WIRE))
    assert only.separates == (("lateral_slip",), ("reference_lever_arm",))
    assert only.expected_gain > 0.9
    assert only.scenario_file is not None
    assert only.scenario is not None


@pytest.mark.parametrize(
    ("wheels_us", "gyro_us", "delay_us"),
    [
        (50_000, 25_000, 0),
        (20_000, None, 7_000),
        *at_full_size((50_017, 24_994, 0), (10_000, 25_000, 0)),
    ],
    ids=["a faster gyro", "a gyro without a cycle", "cycles as measured", "a slower gyro"],
)
def test_a_drive_is_advised_whatever_the_cycles_of_wheels_and_gyro(wheels_us, gyro_us, delay_us):
    """The finished diagnosis of a car with pulses in every second frame of its gyro was lost."""
    cycles = {"left_count": wheels_us, "right_count": wheels_us, "gyro": gyro_us}
    winner = named(("lateral_slip",), ("reference_lever_arm",))
    (only,) = advice(winner, lesson_with_slip(), with_cycles(WIRE, cycles, delay_us))
    assert only.scenario_file is not None
    assert only.expected_gain > 0.5


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
    block = motion_of(recording, *GROUP)
    slip, lever = (block.fit(frozenset({e})) for e in ("lateral_slip", "reference_lever_arm"))
    assert 2 * (lever.log_likelihood - slip.log_likelihood) > 29


def test_after_a_square_with_pure_spins_the_drive_that_is_advised_shows_lateral_slip(tmp_path):
    """As large as the middle of what is believed: the square shows none of any size."""
    (only,) = (one for one in of_the_log("square") if ("lateral_slip",) in one.separates)
    assert ("no_gap",) in only.separates
    known = PRIOR.of("lateral_slip", "compliance")
    size = math.sqrt(known.tolerance * known.high)
    slip = EffectSetting("lateral_slip", (("compliance", size),))
    block = driven(only, tmp_path, slip, heading=True)
    assert 2 * block.fit(frozenset({"lateral_slip"})).log_likelihood > 29


def test_after_the_lessons_run_the_drive_that_is_advised_tells_slip_lever_arm_and_offset_apart(
    tmp_path,
):
    """Twice as large as the lesson's run shows it, slip is what no other of the group explains."""
    group = set(GROUP)
    (only,) = (
        one
        for one in of_the_log("lesson", heading=False)
        if {(effect,) for effect in group} <= set(one.separates)
    )
    structure = structure_of([with_nothing("lesson", heading=False)])
    limit = structure.detectable["lateral_slip"]
    assert any(group <= set(one) for one in structure.groups)
    assert limit is not None
    slip = EffectSetting("lateral_slip", (("compliance", 2 * limit),))
    block = driven(only, tmp_path, slip, heading=False)
    best = block.fit(frozenset({"lateral_slip"})).log_likelihood
    for rival in group - {"lateral_slip"}:
        assert 2 * (best - block.fit(frozenset({rival})).log_likelihood) > 29


@pytest.mark.parametrize("heading", [False, *at_full_size(True)])
def test_every_group_that_the_log_leaves_open_gets_a_drive_or_a_word(heading):
    structure = structure_of([with_nothing("lesson", heading=heading)])
    advised = of_the_log("lesson", heading=heading)
    for group in structure.groups:
        of_it = [
            one for one in advised if {each for s in one.separates for each in s} <= set(group)
        ]
        assert of_it, group
        assert sum(one.scenario_file is not None for one in of_it) <= 1
        assert all(one.expected_gain > 0.5 for one in of_it if one.scenario_file is not None)


def test_of_what_no_drive_tells_apart_one_stands_for_all_where_a_drive_tells_it_from_others():
    advised = of_the_log("lesson", heading=False)
    hopeless = [one for one in advised if one.scenario_file is None]
    assert 0 < len(hopeless) < len(advised)
    for one in advised:
        if one.scenario_file is not None:
            assert all(len(set(one.separates) & set(each.separates)) <= 1 for each in hopeless)


def test_another_candidate_of_five_percent_is_told_from_the_winner_and_from_its_group():
    winner = named(("gyro_scale",))
    other = Candidate(
        effects=("lateral_slip",),
        probability=0.05,
        group_probability=0.06,
        ambiguous_with=(("reference_lever_arm",),),
    )
    analysis = lesson_with_slip()
    (only,) = (
        one
        for one in advice_for([winner, other], ROBOT, WIRE, [analysis], structure_of([analysis]))
        if one.about == "candidate"
    )
    sets = {("gyro_scale",), ("lateral_slip",), ("reference_lever_arm",)}
    assert set(only.separates) <= sets
    assert ("reference_lever_arm",) in only.separates
    rare = other.model_copy(update={"group_probability": 0.04})
    less = advice_for([winner, rare], ROBOT, WIRE, [analysis], structure_of([analysis]))
    assert {one.about for one in less} == {"log"}


def test_a_larger_set_is_not_probable_for_the_smaller_ones_in_its_group():
    """The winner with an idle effect beside it explains as well: its group is the winner's."""
    winner = named(("lateral_slip",))
    idle = Candidate(
        effects=("gyro_lag", "lateral_slip"),
        probability=0.01,
        group_probability=0.51,
        ambiguous_with=(("lateral_slip",),),
    )
    analysis = lesson_with_slip()
    found = advice_for([winner, idle], ROBOT, WIRE, [analysis], structure_of([analysis]))
    assert "candidate" not in {one.about for one in found}


def test_a_drive_that_tells_apart_what_is_alike_to_a_third_is_not_advised():
    """Of a, b and c one stands for all: told from itself is nothing told."""
    nothing = View(0.0, np.zeros(0), np.zeros((0, 0)))
    one = Contest(("a",), Hypothesis(()), ("b",), Hypothesis(()), nothing, np.zeros(0))
    menu = Menu((manoeuvres()[0],), (one,), np.array([[0.9]]))
    question = Question("log", (one,), is_ranked=False)
    assert [each.separates for each in menu.answers(question, {})] == [(("a",), ("b",))]
    assert not list(menu.answers(question, {("b",): ("a",)}))


def test_twins_are_named_as_what_no_drive_tells_apart():
    winner = named(("lateral_slip", "radius_scale"), ("lateral_slip", "ticks_per_rev"))
    (only,) = advice(winner, lesson_with_slip())
    assert only.scenario_file is None
    assert only.scenario is None
    assert only.expected_gain == 0.0
    assert "No manoeuvre" in only.sentence


@pytest.mark.parametrize(
    ("winner", "rival", "what"),
    [
        ("gyro_scale", "supply_ratio", "a full battery"),
        ("gyro_temperature_bias", "gyro_bias", "from cold to warm"),
        ("gyro_scale", "gyro_temperature_scale", "from cold to warm"),
    ],
)
def test_what_a_varying_supply_or_temperature_would_tell_is_said(winner, rival, what):
    """No manoeuvre did, it was said, and to measure the part."""
    (only,) = advice(named((winner,), (rival,)), lesson_with_slip())
    assert only.scenario_file is None
    assert what in only.sentence
    assert "recorded" in only.sentence


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


def test_of_many_sets_it_is_said_how_many_and_in_what_they_differ():
    """Of a recorded Kobuki 41 were written out, over twenty lines of a terminal."""
    sets = [
        ("drive_lag", "encoder_wrap"),
        ("drive_delay", "encoder_wrap"),
        ("drive_saturation", "encoder_wrap"),
        ("drive_deadband", "encoder_wrap"),
        ("drive_gain", "encoder_wrap"),
    ]
    (only,) = advice(named(*sets), lesson_with_slip())
    assert (
        "drive_lag+encoder_wrap from 4 other sets, which differ in "
        "drive_delay, drive_lag, drive_saturation, drive_deadband, drive_gain:"
    ) in only.sentence
    assert set(only.separates) == set(sets)


def test_what_all_sets_have_is_named_once_beside_what_parts_them():
    """Of a Kobuki four sets of seven effects were written out, three lines of a terminal."""
    sets = [
        ("clock_skew", "drive_lag", "encoder_wrap"),
        ("clock_skew", "drive_delay", "encoder_wrap"),
    ]
    (only,) = advice(named(*sets), lesson_with_slip())
    assert "tell drive_lag from drive_delay beside clock_skew+encoder_wrap:" in only.sentence


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
def test_chiplog_run_drives_it(manoeuvre, tmp_path, size):
    """At small size without the pictures of its report, which cost most, but for the first."""
    path = tmp_path / manoeuvre.file
    path.write_text(manoeuvre.text, encoding="utf-8")
    if size == "small" and manoeuvre.file != manoeuvres()[0].file:
        found = run(RunConfig(scenario=scenario(str(path)), robot=ROBOT))
        assert found.duration_s == pytest.approx(manoeuvre.scenario.duration_s, abs=0.01)  # a tick
        assert not found.interrupted
        return
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
