"""A trace in frames or codes is seen without a name: then its cause is unlisted, in its stage."""

from __future__ import annotations

from fake_blocks import FakeBlock, ranked

from gap_diagnosis.traces import traces

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


def test_more_noise_than_described_is_a_trace_of_its_stage() -> None:
    noisy = FakeBlock({"gyro_noise": 30.0, "reference_noise": 20.0, "gyro_bias": 50.0})
    assert evidence(noisy) == {"gyro": 24.0, "reference": 14.0}
