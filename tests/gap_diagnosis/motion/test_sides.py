"""A size is told with the side that it is of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.explanations.choices import extra_ticks
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def test_where_either_side_may_count_wrongly_both_of_their_rates_are_likely() -> None:
    """The gyro alone hardly tells counts too many on the left from as many too few on the right."""
    stray = EffectSetting("extra_ticks", (("side", "left"), ("rate", 1.5)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), (stray,), 4, reference=None, duration_s=20.0
    )
    model = MotionModel(log, ROBOT, default_prior())
    own = tuple(one for one in model.columns.terms if one.variant.effect == "extra_ticks")
    model.columns = replace(model.columns, terms=own)
    found = MotionBlock(model).detail(frozenset({"extra_ticks"})).parameters
    sides = found["extra_ticks.side"].probabilities
    assert sides is not None
    assert min(sides.values()) > 0.1
    rates = np.asarray(found["extra_ticks.rate"].samples)
    assert np.mean(rates > 0.0) == pytest.approx(sides["left"], abs=0.1)


@pytest.mark.parametrize("settled_on", ["left", "right"])
def test_the_likeliest_side_is_told_whichever_a_search_settled_on(settled_on: str) -> None:
    """Of a Kobuki's play both wheels were told, 0.13, where it was the left one's, 0.87."""
    stray = EffectSetting("extra_ticks", (("side", "left"), ("rate", 4.0)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), (stray,), 4, reference=None, duration_s=20.0
    )
    model = MotionModel(log, ROBOT, default_prior())
    own = {
        str(one.variant.report["side"]): one
        for one in model.columns.terms
        if one.variant.effect == "extra_ticks"
    }
    model.columns = replace(model.columns, terms=tuple(own.values()))
    block = MotionBlock(model)
    (effects,) = (one for one in block.scan.found if one)
    known, terms = block.scan.found[effects], (own[settled_on],)
    fit = model.refit(terms, known.levels)
    block.scan.found[effects] = replace(known, terms=terms, refitted=fit)
    told = block.detail(effects).parameters["extra_ticks.side"]
    assert told.probabilities is not None
    assert told.value == max(told.probabilities, key=lambda side: told.probabilities[side])


def test_no_count_comes_at_a_rate_at_which_one_would_have_come_while_the_wheel_stood() -> None:
    """Without a reference, a gyro's bias of 1 deg/s was 11 counts a second (.99), on a robot that
    stood for nine seconds without one."""
    bias = EffectSetting("gyro_bias", (("bias", 0.0168),))
    drive = replace(scenario("stop_and_go"), seed=3)
    log = synthetic_recording(ROBOT, WIRE, drive, (bias,), 4, reference=None, duration_s=30.0)
    model = MotionModel(log, ROBOT, default_prior())
    most = {
        one.variant.report["side"]: one.variant.most
        for one in model.columns.terms
        if one.variant.effect == "extra_ticks"
    }
    for side, counts in (("left", log.left_ticks), ("right", log.right_ticks)):
        turns = np.flatnonzero(np.diff(counts) != 0.0)
        longest_s = float(np.diff(log.t_s[turns]).max())
        assert most[side] < 20.0 / longest_s
    block = MotionBlock(model)
    assert block.fit(frozenset({"extra_ticks"})).log_evidence < 0.0
    assert block.fit(frozenset({"gyro_bias"})).log_evidence > 50.0


def test_the_rate_at_which_counts_come_is_hardly_ever_out_of_the_question() -> None:
    """Of all the times at which a count may begin to stand, the longest: of 12 drives at 60 counts
    a second one was denied by a million nats where that was not thought of."""
    for rate in (0.5, 5.0, 60.0, 100.0):
        stray = EffectSetting("extra_ticks", (("side", "left"), ("rate", rate)))
        for seed in (3, 10, 11):
            log = synthetic_recording(
                ROBOT, WIRE, scenario("stop_and_go"), (stray,), seed, reference=None
            )
            most = [
                one.most
                for one in extra_ticks(estimate_motion(log, ROBOT))
                if one.report["side"] == "left"
            ]
            assert most[0] > rate
