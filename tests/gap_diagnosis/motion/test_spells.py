"""What begins and ends without a name is found with its stage and its window."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE, model_of, moved_only, some_of

from gap_diagnosis.analysis import _for_a_while as for_a_while
from gap_diagnosis.analysis import analyse
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.facts import notes_on
from gap_diagnosis.motion import spells as module
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.components import gains
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.model import MotionModel, is_far
from gap_diagnosis.motion.onset import windowed
from gap_diagnosis.motion.spells import Spell, lay_out_ways, levels_of_spell, spells
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.slopes import Weighed
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

SLIP = frozenset({"one_sided_slip"})


def drive(*effects: EffectSetting, seed: int = 3, lasts_s: float | None = None) -> Recording:
    return synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        effects,
        seed,
        reference=ReferenceNoise(),
        duration_s=lasts_s,
    )


def slip(start_s: float, stop_s: float, ratio: float = 0.02) -> EffectSetting:
    window = (("start_s", start_s), ("stop_s", stop_s))
    return EffectSetting("one_sided_slip", (("side", "right"), ("ratio", ratio), *window))


FEW = frozenset(EXPLAINED) - {
    "gyro_bias",
    "gyro_scale",
    "missed_ticks",
    "payload",
    "radius_mismatch",
    "turn_scrub",
    "wheelbase_scale",
}
"""What a library lacks of which these alone are asked: what a slip without its name passed for."""


LISTED = ("radius_mismatch", "radius_scale", "wheelbase_scale")
"""What else is listed of what may act for a while: a cause without a name is none of these."""


def without_slip(log: Recording) -> MotionModel:
    return model_of(log, *LISTED)


@cache
def of_a_slip(start_s: float, stop_s: float, ratio: float = 0.02) -> MotionModel:
    """Return the log of a slip without its name; made once."""
    return without_slip(drive(slip(start_s, stop_s, ratio)))


def with_slip(log: Recording) -> MotionModel:
    return model_of(log, *LISTED, *SLIP)


def test_a_slip_without_its_name_is_one_wheel_for_a_while() -> None:
    """A slip of 20 s was missed ticks, a load and a wider track, > 0.999."""
    model = of_a_slip(21.0, 38.0)
    found = spells(model, model.no_effect_levels, lay_out_ways(model))
    ((start_s, stop_s),) = found["wheel"].cause.windows
    assert (start_s, stop_s) == pytest.approx((21.0, 38.0), abs=0.3)
    assert found["wheel"].cause.log_evidence > 50
    evidence = {stage: one.cause.log_evidence for stage, one in found.items()}
    assert max(evidence, key=lambda stage: evidence[stage]) == "wheel"


def test_a_strong_one_is_weighed_in_the_window_in_which_it_acts() -> None:
    """On a grid of 24 parts, a slip of 4 % lacked 700 nats of what its window explains, and counts
    lost at some speed for a while were .99."""
    model = of_a_slip(21.8, 28.5, 0.04)
    levels = model.no_effect_levels
    found = spells(model, levels, lay_out_ways(model))["wheel"].cause
    assert found.windows[0] == pytest.approx((21.8, 28.5), abs=0.05)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "ratio"),
    [(21.8, 28.5, 0.04), *at_full_size((21.8, 28.5, 0.004), (30.0, 44.0, 0.002))],
    ids=["sharp", "broad", "broader"],
)
def test_a_finer_grid_about_the_likeliest_window_is_worth_a_finer_grid_everywhere(
    monkeypatch: pytest.MonkeyPatch, start_s: float, stop_s: float, ratio: float
) -> None:
    """So is what so little of it explains that it is no gap: with that a healthy robot competes."""
    model = of_a_slip(start_s, stop_s, ratio)
    levels = model.no_effect_levels
    monkeypatch.setattr(module, "_STRONG", 0.0)
    monkeypatch.setattr(module, "_TIMES", 1)
    refined = spells(model, levels, lay_out_ways(model))["wheel"].cause
    monkeypatch.setattr(module, "_PARTS", 24 * 6)
    monkeypatch.setattr(module, "_TIMES", 0)
    fine = spells(model, levels, lay_out_ways(model))["wheel"].cause
    part_s = (model.nodes.smooth.t_s[-1] - model.nodes.smooth.t_s[0]) / 144
    assert refined.windows[0] == pytest.approx(fine.windows[0], abs=part_s)
    assert refined.log_evidence == pytest.approx(fine.log_evidence, abs=0.05)
    if fine.within > 0.5 * fine.log_evidence:
        assert refined.within == pytest.approx(fine.within, abs=0.05)


def test_it_is_likelier_than_listed_effects_together() -> None:
    log = moved_only(drive(slip(21.0, 38.0), lasts_s=60.0))
    analysis = analyse(log, ROBOT, WIRE, default_prior(), without=FEW)
    assert analysis.motion is not None
    assert analysis.unknown["wheel"] > analysis.motion.explained + 20
    best = analysis.alternatives[0]
    assert (best.stage, best.variable) == ("wheel", "time")
    (note,) = notes_on([analysis], (), unlisted_in="wheel")[:1]
    told = re.search(
        r"from about (\d+) s to (\d+) s, and not before or after, "
        r"the right wheel goes about ([\d.]+)% less far than it counts\.",
        note,
    )
    assert told is not None
    start_s, stop_s, share = (float(one) for one in told.groups())
    assert (start_s, stop_s) == pytest.approx((21, 38), abs=5.0)
    assert share == pytest.approx(2.0, abs=0.6)


def test_what_a_listed_effect_does_for_a_while_is_not_weighed_again() -> None:
    model = with_slip(drive(slip(21.0, 38.0)))
    laid = lay_out_ways(model)
    for way, admitted in zip(laid.ways, laid.admitted, strict=True):
        lasting = admitted[0].any() or admitted[:, -1].any()
        assert lasting == (way.for_a_while not in {*LISTED, "one_sided_slip"})
        assert admitted.any() == (way.for_a_while != "one_sided_slip")


@pytest.mark.parametrize(("lasts_s", "is_weighed"), [(10.0, False), (1.0, True)])
def test_a_listed_effect_of_a_moment_stands_for_no_window(lasts_s: float, is_weighed: bool) -> None:
    """Tyres that scrubbed for 16 s, without their name, turned the robot in 2.4 s of it: a track of
    that moment is believed of none, no cause without a name was asked, and a wheel slipped (.995).
    """
    model = model_of(drive(lasts_s=40.0), *LISTED)
    term = next(one for one in model.columns.terms if one.variant.effect == "wheelbase_scale")
    model.add(windowed(term.variant, 20.0, 20.0 + lasts_s), term)
    laid = lay_out_ways(model)
    admitted = dict(zip((way.for_a_while for way in laid.ways), laid.admitted, strict=True))
    assert admitted["wheelbase_scale"].any() == is_weighed


@pytest.mark.parametrize("reference", [None, ReferenceNoise()])
@pytest.mark.parametrize("name", ["calibration", "straight", "square", "figure8", "stop_and_go"])
def test_nothing_is_told_of_a_healthy_robot(
    name: str, reference: ReferenceNoise | None, size: str
) -> None:
    for seed in some_of(size, (0, 1)):
        log = synthetic_recording(ROBOT, WIRE, scenario(name), (), seed, reference=reference)
        model = without_slip(log)
        found = spells(model, model.no_effect_levels, lay_out_ways(model))
        assert all(one.cause.log_evidence < 2.0 for one in found.values())


def test_a_stage_that_shows_at_some_levels_of_noise_only_is_told_of_by_those(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At the levels that suit the likeliest of all, another left no trace: a crash in 1 of 532
    sealed cases."""
    block = MotionBlock(without_slip(drive(slip(21.0, 38.0), lasts_s=60.0)))
    asked: list[int] = []

    def seldom(*known: Any) -> dict[str, Spell]:
        found = spells(*known)
        asked.append(len(asked))
        return found if len(asked) == 1 else {"wheel": found["wheel"]}

    monkeypatch.setattr("gap_diagnosis.analysis.spells", seldom)
    told = [one.stage for one in for_a_while(block)]
    assert len(asked) == 2
    assert sorted(told) == ["gyro", "wheel"]


def test_no_note_tells_what_is_not_believed() -> None:
    """A healthy robot without a gyro went aside by 101 % of its way for two seconds."""
    log = synthetic_recording(ROBOT, WIRE, scenario("figure8"), (), 1, reference=ReferenceNoise())
    blind = replace(moved_only(log), gyro_code=None, gyro_rate_rad_s=None)
    analysis = analyse(blind, ROBOT, WIRE, default_prior(), without=FEW)
    assert "and not" not in " ".join(notes_on([analysis], (), unlisted_in="wheel"))


def test_a_gyro_that_says_too_little_for_a_while_is_told_with_its_sense() -> None:
    log = drive()
    assert log.gyro_code is not None
    t_s = log.t_s
    less = np.where((t_s > 20.0) & (t_s < 35.0), 40.0, 0.0)
    log = replace(log, gyro_code=log.gyro_code - less, gyro_rate_rad_s=rate_less(log, less))
    model = with_slip(log)
    found = spells(model, model.no_effect_levels, lay_out_ways(model))["gyro"].cause
    assert found.log_evidence > 50
    per_rad_s = ROBOT.plant.gyro.sensitivity_lsb_per_rad_s
    told = re.fullmatch(r"the gyro says about ([\d.]+) rad/s too little", found.acts)
    assert told is not None
    assert float(told[1]) == pytest.approx(40.0 / per_rad_s, rel=0.2)


def rate_less(log: Recording, codes: Floats) -> Floats:
    assert log.gyro_rate_rad_s is not None
    return np.asarray(log.gyro_rate_rad_s - codes / ROBOT.plant.gyro.sensitivity_lsb_per_rad_s)


def test_a_windows_evidence_is_that_of_one_column_which_acts_in_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Equal to the digits, though no window has a column of its own."""
    monkeypatch.setattr(module, "_TIMES", 0)
    model = of_a_slip(21.0, 38.0)
    levels, laid = model.no_effect_levels, lay_out_ways(model)
    first, last = 5, 13
    for place, way in enumerate(laid.ways):
        only = np.zeros_like(laid.admitted)
        only[place, first, last] = True
        told = spells(model, levels, replace(laid, admitted=only))[way.stage].cause
        begin = 1 + len(laid.nuisances)
        own = laid.values[..., begin + 24 * place + np.arange(first, last)].sum(axis=-1)
        values = np.concatenate([laid.values[..., :begin], own[..., np.newaxis]], axis=-1)
        white = whiten(np.ascontiguousarray(values), model.course, levels, model.nodes.ticks)
        gram = gram_of(*white, laid.nuisances, levels)
        usual = np.geomspace(way.low, way.high, 4)[:, np.newaxis]
        parts = gains(gram.inner[-1:, -1:], gram.data[-1:], usual)[0]
        expected = float(np.logaddexp.reduce(parts)) - math.log(4)
        assert told.log_evidence == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert told.windows == ((float(laid.ends_s[first]), float(laid.ends_s[last])),)


def test_what_is_over_in_a_moment_is_no_effect_that_acts_all_the_time() -> None:
    """In another engine, ice under one wheel for half a second was counts lost in that window
    (missed_ticks, .99): they vary by chance, and so does a wheel on ice. Lost all the time, one in
    1,500, they are 8 of 1,163 nats."""
    log = drive(lasts_s=60.0)
    inside = (log.t_s > 21.0) & (log.t_s <= 21.5)
    share = np.random.default_rng(1).uniform(0.0, 0.2, len(inside)) * inside
    lost = np.cumsum(share * np.diff(log.right_ticks, prepend=log.right_ticks[0]))
    log = replace(log, right_ticks=np.rint(log.right_ticks - lost))
    block = MotionBlock(model_of(log, "missed_ticks", "one_sided_slip"))
    slips, loses = (
        block.fit(frozenset({one})).log_evidence for one in ("one_sided_slip", "missed_ticks")
    )
    assert slips > 20
    assert loses < 0.02 * slips


def test_levels_far_too_low_beside_a_spell_are_left_for_those_of_no_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A listed effect that explains nearly all leaves hardly any noise, and another cause is far
    from that: from there the way up took 200 looks."""
    model = model_of(drive(slip(40.0, 50.0)), *SLIP)
    nothing = model.no_effect_levels
    found = spells(model, nothing, lay_out_ways(model))
    looks: list[Floats] = []
    look = Weighing.__call__

    def counted(self: Weighing, levels: Floats) -> Weighed:
        looks.append(levels)
        return look(self, levels)

    monkeypatch.setattr(Weighing, "__call__", counted)
    low = np.maximum(0.05 * nothing, model.level_prior.low)
    slowly = levels_of_spell(model, found, low)
    alone = len(looks)
    quickly = levels_of_spell(model, found, low, elsewhere=[nothing])
    assert slowly is not None
    assert quickly is not None
    assert len(looks) - alone < 0.8 * alone
    assert not is_far(slowly, quickly)
