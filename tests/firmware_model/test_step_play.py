"""What steps carry to and fro is bounded at any price of a unit of way: the sums of `play`."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT

from firmware_model import FirmwareDescription, KernelConfig, build_config
from firmware_model.integers import shift_round
from firmware_model.play import Play


def coarse(rounding: str, frac_bits: int) -> KernelConfig:
    """Return a kernel whose steps are carried and as coarse as a few counts."""
    step = {"frac_bits": frac_bits, "rounding": rounding, "carry_remainder": True}
    return build_config(FirmwareDescription.from_table({"mode": "wheel", "step": step}), ROBOT)


def jitters(rng: np.random.Generator, shares: list[float], counts: int) -> list[tuple[int, int]]:
    """Return (way, counts) of frames in which trembling is ahead where the axis is faced.

    The way is of whole counts, to and fro at times; of `counts` trembling gives as many at most.
    """
    frames, ahead = [], 0
    busy = rng.random()
    for share in shares:
        way = int(rng.integers(-2, 3)) if rng.random() < busy else 0
        wanted = counts if share > 0 else 0
        now = wanted if rng.random() < 0.9 else int(rng.integers(0, counts + 1))
        frames.append((way, way + now - ahead))
        ahead = now
    return frames


@given(
    st.sampled_from(["floor", "half_up", "half_even", "toward_zero"]),
    st.integers(6, 14),
    st.integers(1, 6),
    st.integers(0, 2**32),
)
@settings(max_examples=100)
def test_no_price_of_way_is_beaten_by_steps_taken_to_and_fro(
    rounding: str, frac_bits: int, jitter: int, seed: int
) -> None:
    config, rng = coarse(rounding, frac_bits), np.random.default_rng(seed)
    shares = [float(one) for one in rng.uniform(-1, 1, 200) ** rng.choice([1, 3])]
    if rng.random() < 0.5:
        shares = [abs(one) * (-1) ** place for place, one in enumerate(shares)]
    frames, remainder, summed, along, way = jitters(rng, shares, jitter), 0, 0.0, 0.0, 0
    faced = []
    for share, (went, counts) in zip(shares, frames, strict=True):
        total = counts * config.half_tick_m_q + remainder
        step = shift_round(total, config.step_shift, config.step_rounding)
        remainder = total - (step << config.step_shift)
        summed, way, along = summed + share * step, way + abs(went), along + share * went
        if counts:
            faced.append(share)
    changed = 2.0 + float(np.abs(np.diff(faced)).sum())
    for play in Play.of(config, Fraction(jitter)):
        count = float(play.count)
        for price in play.prices():
            each, dear = float(play.each(price)), float(price)
            runs = each * changed / 2 + play.once
            assert summed <= dear * way * count + runs + 1e-9
            if not play.is_one_way:
                assert summed <= along * count + (dear - 1) * way * count + runs + 1e-9


def test_two_counts_of_a_third_of_a_unit_take_one_unit_and_no_more() -> None:
    """Their way and a remainder were taken for five thirds of one."""
    config = coarse("floor", 12)
    h = Fraction(config.half_tick_m_q, 1 << config.step_shift)
    assert Fraction(3, 10) < h < Fraction(1, 3)
    (play,) = Play.of(config, Fraction(2))
    assert play.each(Fraction(1)) > Fraction(8, 5)
    assert min(play.each(price) for price in play.prices()) == 1
