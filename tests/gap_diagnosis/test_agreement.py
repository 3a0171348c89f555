"""Logs given together: of one robot they agree, of two they are told to contradict each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fake_blocks import FakeBlock, analysis, ranked
from structure_cases import ROBOT, WIRE
from test_answer import LOG, entry, normal

from gap_diagnosis.agreement import contradiction, disagreements
from gap_diagnosis.answer import candidates, estimates_by_log
from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.hypothesis import Estimate
from gap_diagnosis.priors import default_prior
from gap_diagnosis.result_parts import NumberEstimate
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting, catalogue
from hil_harness.scenarios import scenario

PRIOR = default_prior()
KEY = "radius_mismatch.mismatch"
SIDES = {
    side: Estimate(side, probabilities={"left": odds, "right": 1 - odds})
    for side, odds in (("left", 0.99999), ("right", 0.00001))
}


def split(key: str, *estimates: Estimate) -> list[str]:
    by_log = {key: dict(enumerate(estimates))}
    return [one.parameter for one in disagreements(by_log, PRIOR, catalogue())]


def test_two_robots_contradict_each_other() -> None:
    assert split(KEY, normal(0.012, 1e-4), normal(0.002, 1e-4)) == [KEY]


def test_one_robot_within_its_uncertainty_and_tolerance_does_not() -> None:
    """Two that differ by 2 sd do one time in 22; half a per mille is no news of a mismatch."""
    assert split(KEY, normal(0.012, 1e-3), normal(0.0148, 1e-3)) == []
    tolerance = PRIOR.of("radius_mismatch", "mismatch").tolerance
    assert split(KEY, normal(0.012, 1e-6), normal(0.012 + tolerance, 1e-6)) == []


def test_logs_of_one_robot_hardly_ever_contradict_each_other() -> None:
    """At a chance of one in a thousand, 4 of 1,000 pairs are too many (Poisson, 98 %)."""
    noise = np.random.default_rng(5).standard_normal((1000, 3)) * 0.01
    wrong = [one for one in noise if split(KEY, *(normal(value, 0.01) for value in one))]
    assert len(wrong) <= 4


def test_when_and_where_something_happened_may_differ() -> None:
    for key in ("one_sided_slip.start_s", "wheel_eccentricity.phase", "reference_lever_arm.x"):
        assert split(key, normal(10.0, 0.01), normal(1.0, 0.01)) == []


def test_another_side_is_a_contradiction_unless_a_log_is_unsure() -> None:
    key = "missed_ticks.side"
    assert split(key, SIDES["left"], SIDES["right"]) == [key]
    assert split(key, SIDES["left"], SIDES["left"]) == []
    unsure = Estimate("right", probabilities={"left": 0.4, "right": 0.6})
    assert split(key, SIDES["left"], unsure) == []


def test_the_answer_says_what_differs_between_which_logs_and_spans_both() -> None:
    blocks = [
        FakeBlock({"gyro_bias": 500.0}, parameters={"gyro_bias.bias": normal(value, sd)})
        for value, sd in ((0.010, 1e-4), (0.030, 2e-5))
    ]
    logs = [
        analysis(replace(LOG, name=f"{name}.log"), one)
        for name, one in zip("ab", blocks, strict=True)
    ]
    told = estimates_by_log(frozenset({"gyro_bias"}), logs)
    found = disagreements(told, PRIOR, catalogue())
    (sentence,) = contradiction(found, ["a.log", "b.log"], catalogue())
    assert "gyro_bias.bias is 0.01 rad/s in log 1 (a.log) and 0.03 rad/s in log 2" in sentence
    listed, _ = candidates(ranked(blocks[0], logs=2), logs, split={one.parameter for one in found})
    value = entry(listed, "gyro_bias").parameters["gyro_bias.bias"]
    assert isinstance(value, NumberEstimate)
    assert value.ci95[0] < 0.010
    assert value.ci95[1] > 0.030


def test_logs_that_take_a_slip_for_one_of_two_forms_have_its_size_in_that_of_all() -> None:
    """At half a metre a second 0.03 s at any speed is 0.06 at 1 m/s: a log that goes as fast all
    the time tells neither, and is no other robot."""
    told = [
        FakeBlock(
            {"lateral_slip": 500.0},
            parameters={
                "lateral_slip.compliance": normal(size, 1e-3),
                "lateral_slip.speed": Estimate(form, probabilities={"0": odds, "1": 1.0 - odds}),
            },
        )
        for size, form, odds in ((0.03, 0, 0.999), (0.06, 1, 0.4))
    ]
    logs = [analysis(LOG, one) for one in told]
    by_log = estimates_by_log(frozenset({"lateral_slip"}), logs)
    assert disagreements(by_log, PRIOR, catalogue()) == []
    listed, _ = candidates(ranked(told[0], logs=2), logs)
    value = entry(listed, "lateral_slip").parameters["lateral_slip.compliance"]
    assert isinstance(value, NumberEstimate)
    assert abs(value.estimate - 0.03) < 1e-4


def test_logs_that_agree_say_nothing() -> None:
    assert contradiction([], ["a.log", "b.log"], catalogue()) == ()


def test_where_the_cause_is_not_listed_that_may_be_why() -> None:
    found = disagreements(
        {KEY: {0: normal(0.012, 1e-4), 1: normal(0.002, 1e-4)}}, PRIOR, catalogue()
    )
    (sentence,) = contradiction(found, ["a.log", "b.log"], catalogue(), is_unknown=True)
    assert "a cause that is not listed" in sentence


def test_a_diagnosis_of_two_robots_lists_what_they_contradict_each_other_in() -> None:
    """A note said so, under a verdict of a name or an unlisted cause with certainty."""
    drive = replace(scenario("calibration"), effects=())
    logs = [
        synthetic_recording(
            ROBOT, WIRE, drive, [EffectSetting("wheelbase_scale", (("scale", scale),))], seed,
            reference=ReferenceNoise(), duration_s=30.0,
        )
        for seed, scale in ((3, 0.05), (4, -0.04))
    ]  # fmt: skip
    others = frozenset(catalogue()) - {"wheelbase_scale"}
    told = diagnose_recordings(logs, ROBOT, WIRE, without=others).diagnosis
    assert told.contradicting == ("wheelbase_scale.scale",)
    assert told.notes[0].startswith("The logs contradict each other")
    again = diagnose_recordings(logs[:1], ROBOT, WIRE, without=others).diagnosis
    assert again.contradicting == ()
