"""Values whose width is a C type and no choice: counters, sums, remainders, excursions.

The widths are those of the C header; machine code and Python hold the same values in 64 bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_model import KernelConfig
from firmware_model.config import TRIG_TABLE
from firmware_model.tables import CORDIC_ANGLE_BITS, CORDIC_GUARD_BITS
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.intermediate import Intermediate, in_c, kept, register

_ANGLE_BITS: Final = 32
_OVERFLOWS_A_TICK: Final = 5
"""Turns by wheels and gyro, the step, x and y."""
_HEADING: Final = ("heading_remainder_q",)


def counters(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    """Yield what counts ticks, samples and overflows, and how a jump is judged."""
    gap = config.gap_limit_ticks + 1
    yield kept("count of ticks", "ticks", 0, 0, envelope.mission_ticks + 1, "tick")
    yield kept("ticks since the last accepted frame", "ticks", 0, 0, gap, "gap_ticks")
    yield kept("ticks since a refused frame", "ticks", 0, 0, gap, "candidate_age_ticks")
    samples = config.jump_confirm_samples
    yield kept("refused frames that agree", "frames", 0, 0, samples, "candidate_samples")
    span = (1 << config.counter_bits) - 1
    counts = ("left_count", "right_count", "candidate_left_count", "candidate_right_count")
    yield kept("counter's reading", "ticks", 0, 0, span, *counts)
    half = 1 << (config.counter_bits - 1)
    yield kept(
        "increment from reading to reading",
        *("ticks", 0, -half, half - 1),
        *("left_step_ticks", "right_step_ticks"),
    )
    believed = config.max_step_ticks * gap
    yield register("largest increment that is believed", "ticks", 0, believed)
    yield kept("repeats of a code", "ticks", 0, 0, config.stuck_ticks, "repeated_ticks")
    overflows = _OVERFLOWS_A_TICK * (envelope.mission_ticks + 1)
    yield kept("overflows", "times", 0, 0, overflows, "overflow_count")


def gyro_watch(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    """Yield what tells a stuck gyro: codes, and the turning of blocks of ticks."""
    codes = ("gyro_code", "repeated_code")  # the latter is -1 at power-on
    yield kept("code, held to the gyro's range", "LSB", 0, -1, config.gyro_max_code, *codes)
    ticks = config.stuck_block_ticks
    # Not those between them: a tick without a gyro's sample is none of a block.
    turning = ticks * envelope.turn_ticks(1)
    sums = ("turn_block_sum", "turn_block_low", "turn_block_high")
    yield kept("turning of a block of ticks", "ticks", 0, -turning, turning, *sums)
    yield register("range of the blocks' turning", "ticks", 0, 2 * turning)
    yield kept("ticks of a block", "ticks", 0, 0, ticks, "turn_block_ticks")


def standstill(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    """Yield what a rest is told by, and the offset that is learnt in it."""
    tolerance = config.still_tolerance_ticks
    excursion = tolerance + envelope.wheel_ticks(envelope.gap_ticks)
    yield register("excursion of a wheel with this increment", "ticks", 0, excursion)
    fields = ("still_left_ticks", "still_right_ticks")
    yield kept("excursion of a wheel at rest", "ticks", 0, -tolerance, tolerance, *fields)
    shift, zero = config.offset_frac_bits, config.zero_rate_code_q
    distance = max((envelope.code_high << shift) - zero, zero - (envelope.code_low << shift), 0)
    yield register("code − nominal zero", "LSB", shift, distance)
    yield kept("ticks at rest", "ticks", 0, 0, config.still_ticks, "still_ticks")
    settle = config.settle_ticks
    yield kept("ticks of settling", "ticks", 0, 0, settle, "rest_ticks", "pending_ticks")
    samples = 1 << config.offset_max_log2
    yield kept("codes of a standstill", "codes", 0, 0, samples, "rest_samples")
    # A first estimate of more codes than the longest is refused by `build_config`.
    total = envelope.code_high * samples
    sums = ("rest_sum", "pending_sum", "offset_sum")
    yield kept("sum of codes at rest", "LSB", 0, 0, total, *sums)
    yield register("that sum, with the offset's fraction", "LSB", shift, total << shift)
    low, high = sorted((envelope.offset_low_q, envelope.offset_high_q))
    yield kept("offset in use", "LSB", shift, min(low, 0), high, "gyro_offset_q")


def remainders(config: KernelConfig) -> Iterator[Intermediate]:
    """Yield what rounding drops and carries: never more than a unit of what is kept."""
    one = config.description
    moved = one.step.frac_bits + config.trig_frac_bits
    step = one.step.frac_bits + config.step_shift
    turn = one.turn_step.frac_bits
    by_wheels, by_gyro = turn + config.wheel_turn_shift, turn + config.gyro_turn_shift
    position, carry = config.position_shift, config.turn_carry
    for name, unit, frac_bits, unit_log2, is_carried, fields in (
        (
            "position",
            "m",
            moved,
            position,
            config.position_carry,
            ("x_remainder_q", "y_remainder_q"),
        ),
        ("step", "m", step, config.step_shift, config.step_carry, ("step_remainder_q",)),
        ("wheels", "turn", by_wheels, config.wheel_turn_shift, carry, ("wheel_turn_remainder_q",)),
        ("gyro", "turn", by_gyro, config.gyro_turn_shift, carry, ("gyro_turn_remainder_q",)),
        ("heading", "turn", turn, config.heading_shift, config.heading_carry, _HEADING),
    ):
        bound = (1 << unit_log2) * is_carried
        yield kept(f"remainder of the {name}", unit, frac_bits, -bound, bound, *fields)


def trigonometry(config: KernelConfig) -> Iterator[Intermediate]:
    """Yield what sine and cosine are formed from."""
    one = 1 << config.trig_frac_bits
    turn = (1 << _ANGLE_BITS) - 1
    yield in_c("phase of a turn", "uint32_t", "turn", _ANGLE_BITS, 0, turn)
    trig_bits = config.trig_frac_bits
    if config.trig_method != TRIG_TABLE:
        length = (165 << (trig_bits + CORDIC_GUARD_BITS)) // 100
        yield register("coordinate of CORDIC's vector", "1", trig_bits + CORDIC_GUARD_BITS, length)
        low, high = _residual(config)
        name = "angle that CORDIC has still to turn"
        yield in_c(name, "int64_t", "turn", CORDIC_ANGLE_BITS, low, high)
    else:
        quarter, nearest = 1 << 30, 1 << max(29 - config.table_index_bits, 0)
        angle = quarter + (0 if config.trig_interpolated else nearest)
        yield in_c("angle in the table", "uint32_t", "turn", _ANGLE_BITS, 0, angle)
        if config.trig_interpolated:
            steps = [b - a for a, b in zip(config.table, config.table[1:], strict=False)]
            yield in_c("step of the table", "int32_t", "1", trig_bits, min(steps), max(steps))
            fraction_bits = 30 - config.table_index_bits
            product = max(map(abs, steps)) << fraction_bits
            yield register("table step times fraction", "1", trig_bits + fraction_bits, product)
    yield kept("sine and cosine", "1", trig_bits, -one, one, "sine_q", "cosine_q")


def _residual(config: KernelConfig) -> tuple[int, int]:
    """Return the least and the largest angle that CORDIC has left, over all of its rotations."""
    low, high = 0, ((1 << 30) - 1) << (CORDIC_ANGLE_BITS - _ANGLE_BITS)
    least, most = low, high
    for angle in config.table[1 : 1 + config.cordic_iterations]:
        pieces = []
        if high >= 0:
            pieces += [max(low, 0) - angle, high - angle]
        if low < 0:
            pieces += [low + angle, min(high, -1) + angle]
        low, high = min(pieces), max(pieces)
        least, most = min(least, low), max(most, high)
    return least, most
