"""How far the wheels can carry x and y, and whether the position's word holds that.

The one word that grows for as long as the robot drives: the longest step says nothing about it, a
mission does. The heading wraps at one turn, which is what an angle does.

What carried remainders and trembling add. A step s of n counts, each h long, takes a remainder r
and leaves r′: s = n·h + r − r′. A counter tells how many edges were passed: its reading is the
wheel's way and an error e, which lies within an interval of one count, and of the noise of a
reading. A wheel that stands on an edge counts to and fro, tick after tick, without any way: n = m +
e′ − e, where m is of the way. Both wheels' e, added or subtracted, lie within `jitter` counts.
Along an axis, of which frame i sees the share c_i (|c_i| ≤ 1), steps add up to the way along it and
to half of what e and r can be together for each of 2 + Σ|c_{i+1} − c_i|: `play` has the proof, and
that it is whole units. A frame without counts has no step and is not looked at. From one of the
others to the next, c changes by the angle between them at most, and by what rounding of angle and
sine adds.

A new baseline of the counters begins e anew: a stretch without frames that is too long to be
bridged is one, and the heading keeps what the wheels had trembled. Rounding without carry does not
know of this: every tick is a frame whose step may be rounded, and each may err by all that rounding
drops. Otherwise each count of a trembling wheel is way: `jitter` more of them in a tick.

A step that leaves its word is cut: it goes no farther than uncut, and both sums begin again after
it. It has so many counts that a mission's way has few of them.

Rounding toward zero keeps no remainder against its step: |s| ≤ |n|·h + |r| − |r′|, so that steps
add up to no more than |n|·h. After a step forward its remainder is forward, and a step back takes a
whole unit of counts back. Where trembling is less than that, each unit takes way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from firmware_model.build_scales import PI, exact
from firmware_model.config import MODE_WHEEL, TRIG_CORDIC, KernelConfig
from firmware_model.errors import FirmwareError
from firmware_model.integers import FLOOR, TOWARD_ZERO
from firmware_model.pace import Pace
from firmware_model.play import Play, priced
from firmware_model.tables import CORDIC_ANGLE_BITS, CORDIC_GUARD_BITS

_WIDEST: Final = 64


@dataclass(frozen=True)
class Demand:
    """What a drive asks of the kernel at most.

    Attributes:
        ticks: how long it lasts.
        counts: Σ|left + right| of the way in each frame [encoder ticks].
        frame_counts: largest |left + right| of a frame, after a gap as well [encoder ticks].
        turn_counts: largest |right − left| of the way of a tick; of so many ticks, so many times
            that.
        rate_q: largest |code − offset| of the gyro, in the offset's fraction bits.
        jitter: by how much the increments' left + right, and right − left, may differ from the way;
            0: `counts` and `turn_counts` are of the increments themselves [encoder ticks].
        baselines: how often the counters may get a new one.
        tick_counts: largest |left + right| of the way of a tick; of so many ticks, so many times
            that. None: nothing is known of it.
    """

    ticks: int
    counts: int
    frame_counts: int
    turn_counts: Fraction
    rate_q: int
    jitter: Fraction = Fraction(0)
    baselines: int = 0
    tick_counts: Fraction | None = None

    @property
    def counted(self) -> Fraction:
        """Σ|left + right| of the increments, however the counters tremble."""
        return self.counts + self.jitter * self.ticks

    @property
    def frames(self) -> int:
        """How many frames have a count: no tick moves without one."""
        return min(self.ticks, math.ceil(self.counted))

    @classmethod
    def believed(cls, config: KernelConfig, ticks: int) -> Demand:
        """Return what the kernel believes in so many ticks: more is refused or held."""
        fastest = 2 * config.max_step_ticks
        rate_q = (config.gyro_max_code + 1) << config.offset_frac_bits
        return cls(
            ticks, fastest * ticks, fastest * config.gap_limit_ticks, Fraction(fastest), rate_q
        )


def rounding_gain(shift: int, rounding: int, carry: int) -> Fraction:
    """Return by how much rounding can lengthen each value on average [units of the result]."""
    if carry or shift == 0 or rounding == TOWARD_ZERO:
        return Fraction(0)
    return Fraction(1) if rounding == FLOOR else Fraction(1, 2)


def rounding_error(shift: int, rounding: int, carry: int) -> Fraction:
    """Return by how much rounding can change each value on average [units of the result]."""
    if carry or shift == 0:
        return Fraction(0)
    return Fraction(1) if rounding in (FLOOR, TOWARD_ZERO) else Fraction(1, 2)


def counts_of(config: KernelConfig, distance_m: float) -> int:
    """Return how many counts of both wheels together a distance is, rounded up."""
    return math.ceil(Fraction(distance_m) / exact(config.constants).half_tick_m)


def is_given_back(config: KernelConfig) -> bool:
    """Return whether a remainder of the step, taken off one way, may be given back another."""
    return config.step_carry == 1 and config.step_shift > 0 and config.step_rounding != TOWARD_ZERO


def _change(config: KernelConfig, asked: Demand) -> Fraction:
    """Return Σ|c_{i+1} − c_i| of the module's text at most."""
    turn, jitter = _turn(config, asked)
    turned = asked.ticks * turn + asked.baselines * jitter
    slack = _direction_slack(config) + 2 * PI * jitter
    return min(Fraction(2 * asked.frames), 2 * PI * turned + asked.frames * slack)


def _turn(config: KernelConfig, asked: Demand) -> tuple[Fraction, Fraction]:
    """Return how far the heading that steps are taken along turns in a tick, and for each frame.

    In a gap the turn by the wheels is that of its ticks, which replaces the gyro's. A heading of
    some ticks ago has seen the gyro's turn, and how it was taken back. The jitter of the wheels'
    counts is undone by the next, unless the gyro turns in between. A turn that leaves its word is
    none longer than that. All in turns.
    """
    unit = 1 << (config.heading_frac_bits + config.heading_shift)
    tick_turn, word = Fraction(config.tick_turn_q, 1 << config.wheel_turn_shift), -config.turn_low_q
    by_wheels, jitter = asked.turn_counts * tick_turn + 1, asked.jitter * tick_turn
    turn = by_wheels = min(by_wheels, Fraction(word))
    if config.mode != MODE_WHEEL:
        by_wheels, jitter = min(by_wheels + jitter, Fraction(word)), Fraction(0)
        by_gyro = (asked.rate_q * config.sensitivity_turn_q >> config.gyro_turn_shift) + 2
        by_gyro = min(by_gyro, word)
        turn = max(by_wheels, Fraction(by_gyro)) + 1  # one for rounding the blend
        if config.stale_heading_ticks > 0:
            turn = by_wheels + 2 * by_gyro
    if not config.heading_carry:
        turn += 1 << config.heading_shift
    return turn / unit, jitter / unit


def _direction_slack(config: KernelConfig) -> Fraction:
    """Return by how much sine or cosine of two angles may differ beyond the angle between them.

    Both angles are rounded to the heading's bits, or lack its remainder. A chord of the sine is no
    steeper than the sine: interpolation adds rounding alone, of the entry and of the product.
    """
    heading = 2 * 2 * PI / (1 << config.heading_frac_bits)
    unit = Fraction(1, 1 << config.trig_frac_bits)
    if config.trig_method == TRIG_CORDIC:
        rotations = config.cordic_iterations
        angle = Fraction(2, 1 << rotations) + rotations * PI / (1 << CORDIC_ANGLE_BITS)
        # Each rotation floors both coordinates, by up to √2 together; the rest lengthens that.
        floors = (Fraction(3, 2) * rotations + 1) * Fraction(165, 100 << CORDIC_GUARD_BITS)
        return heading + 2 * (angle + (floors + 1) * unit)
    if config.trig_interpolated:
        return heading + 3 * unit
    return heading + PI / 2 / (1 << config.table_index_bits) + unit


def position_reach(config: KernelConfig, asked: Demand) -> int:
    """Return a bound of |x| and |y| [2^-P m], whatever way the robot turns."""
    return math.ceil(moved(config, asked, 1 << config.trig_frac_bits)) + config.position_carry


def moved(config: KernelConfig, asked: Demand, direction_q: int) -> Fraction:
    """Return a bound of what is added to x and y in all, before a remainder of theirs [2^-P m].

    Args:
        config: from `build_config`.
        asked: what the drive asks.
        direction_q: sine and cosine are no larger [2^-T].
    """
    unit = Fraction(direction_q, 1 << config.position_shift)  # what one of the step moves them by
    frames, steps = asked.frames, asked.counted * _count_steps(config)
    step = config.step_shift, config.step_rounding, config.step_carry
    position = config.position_shift, config.position_rounding, config.position_carry
    if config.step_carry and not is_given_back(config):
        trembling = asked.jitter * _count_steps(config)
        if config.step_shift > 0 and trembling < 1:
            way = asked.counts * _count_steps(config) + asked.baselines * trembling
            steps = min(steps, way / (1 - trembling))
        steps = Fraction(math.floor(steps))  # whole ones, and no frame moves by less than one
        frames = min(frames, int(steps))
    gain = frames * (rounding_gain(*step) * unit + rounding_gain(*position))
    if is_given_back(config):
        gain += frames * unit
    bound = steps * unit + gain
    cuts = _cuts(config, asked)
    if cuts is not None:
        bound = min(bound, _summed(config, asked, unit, cuts))
    return bound


def _summed(config: KernelConfig, asked: Demand, unit: Fraction, cuts: int) -> Fraction:
    """Return that bound by the sums of the module's text; so many steps may leave their word."""
    one = Fraction(1 << config.trig_frac_bits, 1 << config.position_shift)
    change, frames = _change(config, asked), asked.frames
    way = asked.counts * _count_steps(config)
    # What the turns of new baselines change is not in the pace.
    turned = 2 * PI * asked.baselines * _turn(config, asked)[1]
    pace, trembling = _pace(config, asked, unit), asked.jitter * _count_steps(config)
    sums = []
    for play in Play.of(config, asked.jitter):
        for price, units in priced(play):
            each = units * one
            both = price * way * unit + change / 2 * each
            if pace is not None and not play.is_one_way:
                paced = Fraction(pace.bound(float(way * one), asked.ticks, float(each)))
                both = min(both, paced + (price - 1) * way * unit + turned / 2 * each)
            # The runs that are not of a change, and those that new baselines part.
            parted = min(each, trembling * one) if price == 1 and not play.once else each
            both += (1 + 2 * cuts) * each + asked.baselines * parted
            sums.append(both + (1 + 2 * cuts + asked.baselines) * play.once * one)
    error = frames * rounding_error(config.step_shift, config.step_rounding, config.step_carry)
    gain = frames * rounding_error(
        config.position_shift, config.position_rounding, config.position_carry
    )
    return min(sums) + error * unit + gain


def _pace(config: KernelConfig, asked: Demand, unit: Fraction) -> Pace | None:
    """Return what the robot does in a tick [2^-P m], None where it is not known.

    A heading of some ticks ago is not that of the frame's own ticks.
    """
    if asked.tick_counts is None or config.stale_heading_ticks > 0:
        return None
    one = Fraction(1 << config.trig_frac_bits, 1 << config.position_shift)
    turn, jitter = _turn(config, asked)
    return Pace(
        way=float(asked.tick_counts * _count_steps(config) * one),
        turn_rad=float(2 * PI * turn),
        jump=float(_direction_slack(config) + 2 * PI * jitter),
        longest_ticks=config.gap_limit_ticks,
        largest_share=float(unit / one),
    )


def _cuts(config: KernelConfig, asked: Demand) -> int | None:
    """Return how many steps may leave their word, None where trembling alone takes them there."""
    if _longest_step(config, asked) <= config.step_high_q:
        return 0
    # A step of n counts is shorter than n of theirs and one unit.
    least = config.step_high_q / _count_steps(config) - asked.jitter
    return math.floor(asked.counts / least) if least > 0 else None


def _count_steps(config: KernelConfig) -> Fraction:
    """Return how many units of the step a count of one wheel is."""
    return Fraction(config.half_tick_m_q, 1 << config.step_shift)


def _longest_step(config: KernelConfig, asked: Demand) -> int:
    return (asked.frame_counts * config.half_tick_m_q >> config.step_shift) + 2


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
