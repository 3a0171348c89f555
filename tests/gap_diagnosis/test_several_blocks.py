"""Of robots with much that is off at once: sets over motion, bus and codes."""

from __future__ import annotations

import math

import pytest
from fake_blocks import PRIOR, STAGE, FakeBlock, ranked

from gap_diagnosis.hypothesis import Fit
from gap_diagnosis.ranking import rank

THREE = frozenset({"radius_scale", "wheelbase_scale", "gyro_bias"})
STAGES = {**STAGE, "adc_stuck_bit": "gyro", "adc_inl": "gyro", "clock_skew": "bus"}
GAINS = {"radius_scale": 60.0, "wheelbase_scale": 60.0, "gyro_bias": 60.0}


def test_clocks_frames_and_codes_stand_together_beside_what_the_wheels_do() -> None:
    """One of them at a time took the others' place."""
    motion = FakeBlock(GAINS)
    bus = FakeBlock({"clock_skew": 190.0, "frame_loss": 80.0}, name="bus")
    codes = FakeBlock({"adc_missing_code": 50.0}, name="codes")
    ranking = rank([[motion, bus, codes]], PRIOR, STAGES, {}, [THREE])
    assert ranking.best.effects == THREE | {"clock_skew", "frame_loss", "adc_missing_code"}
    assert ranking.best.probability > 0.99


def test_three_of_the_bus_need_no_fault_of_the_motion() -> None:
    bus = FakeBlock({"clock_skew": 190.0, "frame_loss": 80.0, "frame_jitter": 90.0}, name="bus")
    stages = {**STAGES, "frame_jitter": "bus"}
    ranking = rank([[FakeBlock({"gyro_bias": -2.0}), bus]], PRIOR, stages, {})
    assert ranking.best.effects == {"clock_skew", "frame_loss", "frame_jitter"}


def test_nor_do_they_push_out_a_drive_that_does_not_do_as_it_is_told() -> None:
    motion = FakeBlock({"gyro_bias": 60.0})
    drive = FakeBlock({"drive_gain": 100.0, "drive_lag": 5.0}, name="drive")
    bus = FakeBlock({"clock_skew": 190.0, "frame_loss": 80.0}, name="bus")
    ranking = rank([[motion, drive, bus]], PRIOR, STAGES, {})
    assert ranking.best.effects == {"gyro_bias", "drive_gain", "clock_skew", "frame_loss"}


class TwoAtMost(FakeBlock):
    """A replay, which tells of no more than two effects of the firmware together."""

    def fit(self, effects: frozenset[str]) -> Fit:
        if len(effects) > 2:
            raise ValueError(f"expected up to two effects, not {sorted(effects)}")
        return super().fit(effects)


def test_a_replay_is_asked_of_no_more_than_two_of_its_effects() -> None:
    """Two cases of the sealed trial crashed in which three gained something alone."""
    names = ("blend_weight", "firmware_constant", "fixed_tick_period")
    block = TwoAtMost(dict.fromkeys(names, 90.0), name="firmware")
    stages = {**STAGES, **dict.fromkeys(names, "firmware")}
    ranking = rank([[FakeBlock({"gyro_bias": -2.0}), block]], PRIOR, stages, {})
    assert len(ranking.best.effects) == 2


@pytest.mark.parametrize(("codes", "held"), [(160.0, True), (10.0, False)])
def test_a_bit_that_the_codes_show_is_tried_where_the_motion_takes_a_bend_for_it(
    codes: float, held: bool
) -> None:
    """On a real gyro's codes with one bit held, the codes said 160 nats and the motion, which did
    not know how its samples tremble, spoke of a bend: adc_inl, .98."""
    three = frozenset({"radius_scale", "wheelbase_scale", "adc_inl"})
    gains = {**GAINS, "gyro_bias": -2.0, "adc_inl": 45.0, "adc_stuck_bit": -150.0}
    block = FakeBlock({"adc_stuck_bit": codes}, name="codes")
    bit = three - {"adc_inl"} | {"adc_stuck_bit", "gyro_bias"}
    motion = FakeBlock(gains, pairs={bit: 120.0})
    ranking = rank([[motion, block]], PRIOR, STAGES, {}, [three])
    assert ranking.best.effects == (bit if held else three)


def test_sizes_that_no_effect_has_are_not_among_equally_good_explanations() -> None:
    """Of a gyro read with the wrong sign, wheels of minus their size were."""
    block = FakeBlock({"radius_scale": 500.0, "gyro_scale": -1e6}, likelihood={"gyro_scale": 505.0})
    ranking = ranked(block)
    assert ranking.best.effects == {"radius_scale"}
    assert not any("gyro_scale" in one.effects for one in ranking.group(ranking.best.effects))
    assert math.isclose(ranking.of(frozenset({"gyro_scale"})).probability, 0.0)


def test_a_library_without_a_bias_has_none_beside_a_bit() -> None:
    """As in a trial that withholds it: a name that has no prior was asked for its own."""
    three = frozenset({"radius_scale", "wheelbase_scale", "adc_inl"})
    gains = {
        "radius_scale": 60.0,
        "wheelbase_scale": 60.0,
        "adc_inl": 45.0,
        "adc_stuck_bit": -150.0,
    }
    codes = FakeBlock({"adc_stuck_bit": 160.0}, name="codes")
    ranking = rank([[FakeBlock(gains), codes]], PRIOR, STAGES, {}, [three])
    assert not any("gyro_bias" in one.effects for one in ranking.sets)
