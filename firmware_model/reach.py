"""How far the wheels can carry x and y, and whether the position's word holds that.

The one word that grows for as long as the robot drives: the longest step says nothing about it, a
mission does. The heading wraps at one turn, which is what an angle does.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

from firmware_model.build_scales import exact
from firmware_model.config import KernelConfig
from firmware_model.errors import FirmwareError
from firmware_model.integers import FLOOR, TOWARD_ZERO

_WIDEST: Final = 64


def rounding_gain(shift: int, rounding: int, carry: int) -> Fraction:
    """Return by how much rounding can lengthen each value on average [units of the result]."""
    if carry or shift == 0 or rounding == TOWARD_ZERO:
        return Fraction(0)
    return Fraction(1) if rounding == FLOOR else Fraction(1, 2)


def counts_of(config: KernelConfig, distance_m: float) -> int:
    """Return how many counts of both wheels together a distance is, rounded up."""
    return math.ceil(Fraction(distance_m) / exact(config.constants).half_tick_m)


def position_reach(config: KernelConfig, counts: int, ticks: int) -> int:
    """Return a bound of |x| and |y| [2^-P m], whatever way the robot turns.

    Args:
        config: from `build_config`.
        counts: Σ|left + right| of the increments on the way [encoder ticks].
        ticks: in how many of them it moves at most.
    """
    ticks = min(ticks, counts)  # no tick moves it without a count
    step_gain = rounding_gain(config.step_shift, config.step_rounding, config.step_carry)
    steps = Fraction(counts * config.half_tick_m_q, 1 << config.step_shift) + ticks * step_gain
    # Sine and cosine are held to 1. A remainder that is carried is taken off one way and may be
    # given back another, after a turn: it adds up to a unit in each tick.
    steps += config.step_carry * ticks
    moved = steps * (1 << config.trig_frac_bits) / (1 << config.position_shift)
    shift, rounding, carry = (
        config.position_shift,
        config.position_rounding,
        config.position_carry,
    )
    return math.ceil(moved + ticks * rounding_gain(shift, rounding, carry)) + carry


def require_position_holds(config: KernelConfig, reach_q: int, way: str) -> None:
    """Refuse a position whose word is narrower than a reach.

    Args:
        config: from `build_config`.
        reach_q: bound of |x| and |y| [2^-P m].
        way: what goes so far, in words, as in ``100 m``.

    Raises:
        FirmwareError: field, value and what would be right.
    """
    if reach_q <= config.position_high_q:
        return
    one = config.description.position
    least = reach_q.bit_length() + 1
    right = f"at least {least} bits"
    if least > _WIDEST:
        right = f"at most {one.frac_bits - (least - _WIDEST)} fraction bits"
    raise FirmwareError(
        f"firmware.position.word_bits = {one.word_bits}: {way} do not fit with {one.frac_bits} "
        f"fraction bits: expected {right}"
    )
