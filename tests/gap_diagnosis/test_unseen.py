"""Beside two effects that are seen a third one may be there that is not."""

import pytest
from fake_blocks import PRIOR, FakeBlock, odds, ranked

from gap_diagnosis.ranking import Ranking


def three_of_the_motion(third: float) -> Ranking:
    return ranked(FakeBlock({"gyro_bias": 50.0, "radius_scale": 40.0, "missed_ticks": third}))


SEEN = ["gyro_bias", "radius_scale"]


def test_what_is_too_small_to_be_seen_is_as_likely_beside_two_effects_as_beforehand() -> None:
    """Nobody was asked of two effects and a third one without a trace: of 125 sealed cases that
    were told two, with .92, two were all in .84."""
    beside = 1 / 3  # its stage is one of three
    expected = 3 * beside * PRIOR.chance_of(3) / PRIOR.chance_of(2)
    found = three_of_the_motion(0.0)
    assert odds(found, [*SEEN, "missed_ticks"], SEEN) == pytest.approx(expected)


def test_what_speaks_against_a_third_effect_does_so_beside_two() -> None:
    three = three_of_the_motion(-3.0).of(frozenset({*SEEN, "missed_ticks"}))
    assert three.log_evidence == pytest.approx(87)


def test_what_fits_worse_where_it_was_not_fitted_is_no_less_likely_beside_two() -> None:
    """A straight line beside a large effect lacks hundreds of nats that its own fit does not."""
    pair = frozenset({"gyro_bias", "radius_scale"})
    motion = FakeBlock({"gyro_bias": 800.0, "radius_scale": -1.0}, pairs={pair: 100.0})
    drive = FakeBlock({"drive_gain": 40.0}, name="drive")
    three = ranked(motion, drive).of(pair | {"drive_gain"})
    assert three.log_evidence == pytest.approx(839)


def test_what_cannot_be_beside_one_effect_is_not_beside_it_and_another() -> None:
    pair = frozenset({"gyro_bias", "radius_scale"})
    motion = FakeBlock({"gyro_bias": 50.0, "radius_scale": 0.0}, pairs={pair: -1e6})
    drive = FakeBlock({"drive_gain": 40.0}, name="drive")
    assert ranked(motion, drive).of(pair | {"drive_gain"}).probability < 1e-9
