"""A trace in frames or codes is seen without a name: then its cause is unlisted, in its stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_blocks import FakeBlock, analysis, ranked
from structure_cases import ROBOT, WIRE, analysis_of, drive, model_of

from gap_diagnosis.answer import unknown_part
from gap_diagnosis.bus import bus_block
from gap_diagnosis.how_far import shrink
from gap_diagnosis.modelled import modelled_on
from gap_diagnosis.traces import traces
from hil_harness.effects import EffectSetting

MOTION = FakeBlock({"gyro_bias": -2.0})
BUS = FakeBlock({"frame_loss": 60.0}, name="bus")


def evidence(*blocks: FakeBlock) -> dict[str, float]:
    return {stage: one.log_evidence for stage, one in traces(blocks).items()}


def test_lost_frames_without_a_name_for_it_are_an_unlisted_cause_of_the_bus() -> None:
    nameless = FakeBlock({}, name="bus")
    ranking = ranked(MOTION, nameless, unknown=evidence(MOTION, BUS))
    assert ranking.unknown["bus"] > 0.9


def test_a_name_that_leaves_the_trace_is_believed_before_an_unlisted_cause() -> None:
    ranking = ranked(MOTION, BUS, unknown=evidence(MOTION, BUS))
    assert ranking.best.effects == {"frame_loss"}
    assert ranking.unknown["bus"] < 0.01 * ranking.best.probability


def test_a_trace_that_a_name_only_half_explains_has_an_unlisted_cause() -> None:
    whole = FakeBlock({"frame_loss": 20.0, "bus_gap": 60.0}, name="bus")
    ranking = ranked(MOTION, FakeBlock({"frame_loss": 20.0}, name="bus"), unknown=evidence(whole))
    assert ranking.unknown["bus"] > 0.9


def test_codes_that_never_come_are_a_trace_of_the_gyro_and_the_motion_is_none() -> None:
    codes = FakeBlock({"adc_stuck_bit": 40.0}, name="codes")
    assert evidence(FakeBlock({"gyro_bias": 90.0}), codes).keys() == {"gyro"}


def test_what_codes_show_adds_to_what_the_motion_does_of_the_same_gyro() -> None:
    """A held bit without its name was a bent converter, 0.94: that explained the motion as well,
    and what codes showed stood for all of an unlisted cause, not beside it."""
    block = FakeBlock({"adc_stuck_bit": 140.0}, name="codes")
    codes = traces([block], {"adc_stuck_bit"})["gyro"]
    assert codes.beside(760.0) == 760.0 + 134.0
    assert codes.beside(-3.0) == 134.0
    weak = traces([FakeBlock({"adc_stuck_bit": -2.0}, name="codes")], {"adc_stuck_bit"})["gyro"]
    assert weak.beside(760.0) == 760.0
    assert traces([block])["gyro"].beside(760.0) == 760.0


def test_noise_is_told_by_the_motion_and_adds_nothing_to_it() -> None:
    noise = traces([FakeBlock({"gyro_noise": 30.0})])["gyro"]
    assert noise.beside(50.0) == 50.0
    assert noise.beside(10.0) == 24.0


def test_more_noise_than_described_is_a_trace_of_its_stage() -> None:
    noisy = FakeBlock({"gyro_noise": 30.0, "reference_noise": 20.0, "gyro_bias": 50.0})
    assert evidence(noisy) == {"gyro": 24.0, "reference": 14.0}


def test_lost_frames_without_a_name_are_told_when_they_were_lost_and_which() -> None:
    """It was the whole log, and nothing but that nothing stands in for it."""
    values = (("frame", "IMU"), ("probability", 0.1), ("start_s", 20.0), ("stop_s", 30.0))
    log = drive("calibration", EffectSetting("frame_loss", values))
    block = bus_block(log, ROBOT, WIRE)
    assert block is not None
    made = replace(analysis(log, block), traces=traces([block]))
    found = unknown_part([made], "bus")
    assert found.windows == (pytest.approx((20.0, 30.0), abs=1.0),)
    assert [one.variable for one in found.depends_on] == ["time"]
    assert found.depends_on[0].share > 0.8
    every = np.ones(len(log.t_s), np.bool_)
    model, why_not = modelled_on(model_of("calibration"), made, "bus", WIRE, every)
    assert model is None
    assert why_not == "it shows in frames IMU, and nothing stands in for what frames do"


def test_a_clock_without_a_name_goes_with_time_and_its_rate_stands_in_for_it() -> None:
    """It was said to go with nothing, and that nothing stands in for it."""
    log = drive("calibration", EffectSetting("clock_skew", (("skew", 8e-4),)))
    block = bus_block(log, ROBOT, WIRE)
    assert block is not None
    told = analysis_of(log, "wheelbase_scale")
    told = replace(told, blocks=(*told.blocks, block), traces=traces([block], {"clock_skew"}))
    found = unknown_part([told], "bus")
    assert [one.variable for one in found.depends_on] == ["time"]
    assert found.depends_on[0].share > 0.99
    shrunk = shrink(told, frozenset(), "bus", ROBOT, WIRE)
    assert shrunk.why_not is None
    assert shrunk.modelled is not None
    assert (shrunk.modelled.variable, shrunk.modelled.metric) == ("time", "timing_s")
    assert shrunk.modelled.closed is not None
    assert shrunk.modelled.closed > 0.99
