"""From description and constants to the kernel's integers, with every bound proved on the way.

Nothing that the kernel computes may leave 64 bits, and no word may overflow in normal use; a
configuration for which that cannot be shown is refused, with the field, its value and what would
be right, unless it is asked for by force. `build_scales` turns the robot's constants into integers,
`build_bounds` proves what follows from them.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

from firmware_model import build_bounds as bounds
from firmware_model import build_scales as scales
from firmware_model.build_scales import Asked
from firmware_model.config import (
    EULER_AFTER,
    EULER_BEFORE,
    MIDPOINT,
    MODE_BLEND,
    MODE_GYRO,
    MODE_WHEEL,
    TRIG_CORDIC,
    TRIG_TABLE,
    KernelConfig,
)
from firmware_model.constants import FirmwareConstants
from firmware_model.description import FirmwareDescription
from firmware_model.integers import (
    FLOOR,
    HALF_EVEN,
    HALF_UP,
    SATURATE,
    TOWARD_ZERO,
    WRAP,
)
from firmware_model.tables import cordic_table, quarter_sine_table

_MODES: Final = {"wheel": MODE_WHEEL, "gyro": MODE_GYRO, "blend": MODE_BLEND}
_RULES: Final = {"euler_before": EULER_BEFORE, "midpoint": MIDPOINT, "euler_after": EULER_AFTER}
_ROUNDINGS: Final = {
    "floor": FLOOR,
    "half_up": HALF_UP,
    "half_even": HALF_EVEN,
    "toward_zero": TOWARD_ZERO,
}
_OVERFLOWS: Final = {"wrap": WRAP, "saturate": SATURATE}

_VELOCITY_WORD_BITS: Final = 32


def build_config(
    description: FirmwareDescription,
    constants: FirmwareConstants,
    *,
    allow_overflow: bool = False,
) -> KernelConfig:
    """Return the kernel's integer configuration.

    Args:
        description: the table [firmware] of `robot.toml`.
        constants: the described robot.
        allow_overflow: accept words that normal use overflows; the kernel then wraps or
            saturates as configured and counts. Accept constants that round to zero: what they
            scale then stands still. Accept what C cannot hold, a word wider than its integer there
            or an intermediate that could leave 64 bits: `KernelConfig.beyond_c` then says what.

    Raises:
        FirmwareError: a scale that rounds to zero, a format whose step does not fit or that C
            cannot hold; one line with field, value and what is right. Formats that do not belong
            together, always.
    """
    asked = Asked(description, constants, allow_overflow)
    one, known = description, constants
    bounds.require_widths_of_c(asked)
    max_step_ticks = scales.max_step_ticks(asked)
    half_tick, count_limit = scales.half_tick(asked, max_step_ticks)
    position_low, position_high = scales.word(one.position.word_bits)
    position_shift = bounds.position_shift(asked)
    held = bounds.position_count_limit(
        asked, half_tick, max_step_ticks, position_shift, position_high
    )
    count_limit = min(count_limit, held)

    step_low, step_high = scales.word(one.step.word_bits)
    step_bound = min(half_tick.bound(2 * count_limit), -step_low)

    turn_low, turn_high = scales.word(one.turn_step.word_bits)
    tick_turn = scales.tick_turn(asked, count_limit)
    rate_bound_q = scales.rate_bound_q(asked)
    sensitivity = scales.sensitivity(asked, rate_bound_q)
    longest = count_limit // max_step_ticks * max_step_ticks
    bounds.require_turns_fit(
        asked, bounds.largest_turn(tick_turn, longest, sensitivity, rate_bound_q), turn_high
    )
    wheel_turn = min(tick_turn.bound(2 * count_limit), -turn_low)
    gyro_turn = min(sensitivity.bound(rate_bound_q), -turn_low)
    one_tick_turn = 1 + max(min(tick_turn.bound(2 * max_step_ticks), -turn_low), gyro_turn)
    gap_limit_ticks = min(
        count_limit // max_step_ticks,
        bounds.gap_limit_ticks(asked, gyro_turn, max(wheel_turn, one_tick_turn)),
    )
    blend_frac_bits = bounds.blend_frac_bits(asked, one_tick_turn)

    table, index_bits = _table(asked)
    v_rate = scales.rounded(asked.exact.tick_rate_hz, bounds.TICK_RATE_FRAC_BITS)
    v_shift = one.step.frac_bits + bounds.TICK_RATE_FRAC_BITS - one.velocity.frac_bits
    bounds.require_v_fits(asked, step_bound, v_rate, v_shift)
    w_rate = scales.rounded(asked.exact.tick_rate_rad, bounds.TICK_RATE_FRAC_BITS)
    w_narrowing = one.turn_step.frac_bits + bounds.TICK_RATE_FRAC_BITS - one.velocity.frac_bits
    w_pre_shift = max((one_tick_turn * w_rate).bit_length() - 61, w_narrowing - 60, 0)
    w_shift = w_narrowing - w_pre_shift
    bounds.require_w_fits(asked, w_shift, one_tick_turn)
    velocity_low, velocity_high = scales.word(_VELOCITY_WORD_BITS)
    longest_step = min(half_tick.bound(2 * max_step_ticks), -step_low)
    fastest_turn = min(tick_turn.bound(2 * max_step_ticks), -turn_low)
    bounds.require_velocity_fits(
        asked,
        speed=(longest_step * v_rate >> v_shift) + 1,
        turn_rate=(((fastest_turn >> w_pre_shift) + 1) * w_rate >> w_shift) + 1,
        velocity_high=velocity_high,
    )

    return KernelConfig(
        mode=_MODES[one.mode],
        integration=_RULES[one.integration],
        blend_weight_q=scales.rounded(Fraction(one.blend_weight), blend_frac_bits),
        blend_frac_bits=blend_frac_bits,
        stale_heading_ticks=one.stale_heading_ticks,
        counter_bits=known.counter_bits,
        max_step_ticks=max_step_ticks,
        gap_limit_ticks=gap_limit_ticks,
        jump_confirm_samples=one.plausibility.jump_confirm_samples,
        half_tick_m_q=half_tick.value_q,
        step_shift=half_tick.shift,
        step_rounding=_ROUNDINGS[one.step.rounding],
        step_low_q=step_low,
        step_high_q=step_high,
        step_overflow=_OVERFLOWS[one.step.overflow],
        step_carry=int(one.step.carry_remainder),
        tick_turn_q=tick_turn.value_q,
        wheel_turn_shift=tick_turn.shift,
        sensitivity_turn_q=sensitivity.value_q,
        gyro_turn_shift=sensitivity.shift,
        turn_rounding=_ROUNDINGS[one.turn_step.rounding],
        turn_low_q=turn_low,
        turn_high_q=turn_high,
        turn_overflow=_OVERFLOWS[one.turn_step.overflow],
        turn_carry=int(one.turn_step.carry_remainder),
        heading_frac_bits=one.heading.frac_bits,
        heading_shift=one.turn_step.frac_bits - one.heading.frac_bits,
        heading_rounding=_ROUNDINGS[one.heading.rounding],
        heading_carry=int(one.heading.carry_remainder),
        trig_method=TRIG_CORDIC if one.trig.method == "cordic" else TRIG_TABLE,
        trig_frac_bits=one.trig.frac_bits,
        trig_rounding=_ROUNDINGS[one.trig.rounding],
        trig_interpolated=int(one.trig.interpolated),
        table_start=0,
        table_index_bits=index_bits,
        cordic_iterations=one.trig.iterations,
        position_shift=position_shift,
        position_rounding=_ROUNDINGS[one.position.rounding],
        position_low_q=position_low,
        position_high_q=position_high,
        position_overflow=_OVERFLOWS[one.position.overflow],
        position_carry=int(one.position.carry_remainder),
        position_frac_bits=one.position.frac_bits,
        gyro_min_code=known.gyro_min_code,
        gyro_max_code=known.gyro_max_code,
        zero_rate_code_q=scales.rounded(
            Fraction(known.gyro_zero_rate_code), one.gyro.offset_frac_bits
        ),
        offset_frac_bits=one.gyro.offset_frac_bits,
        offset_rounding=_ROUNDINGS[one.gyro.rounding],
        auto_zero_rate_q=bounds.rate_q(asked, one.gyro.auto_zero_rad_s),
        stuck_ticks=one.stuck.ticks,
        stuck_block_ticks=1 << one.stuck.block_log2,
        stuck_span_ticks=bounds.stuck_span_ticks(asked),
        still_ticks=one.standstill.ticks,
        still_tolerance_ticks=one.standstill.tolerance_ticks,
        rest_max_rate_q=bounds.rate_q(asked, one.standstill.max_rate_rad_s),
        settle_ticks=one.standstill.settle_ticks,
        offset_block_log2=one.standstill.block_log2,
        offset_max_log2=bounds.offset_max_log2(asked),
        tick_rate_hz_q=v_rate,
        v_shift=v_shift,
        tick_rate_rad_q=w_rate,
        w_pre_shift=w_pre_shift,
        w_shift=w_shift,
        velocity_low_q=velocity_low,
        velocity_high_q=velocity_high,
        velocity_frac_bits=one.velocity.frac_bits,
        velocity_filter_log2=one.velocity.filter_log2,
        table=table,
        description=one,
        constants=known,
        beyond_c=asked.beyond_c[0] if asked.beyond_c else "",
    )


def _table(asked: Asked) -> tuple[tuple[int, ...], int]:
    """Return the table of sines, or of CORDIC, and log2 of its steps."""
    trig = asked.description.trig
    if trig.method == "cordic":
        return cordic_table(trig.iterations, trig.frac_bits), 0
    return quarter_sine_table(trig.entries, trig.frac_bits), trig.entries.bit_length() - 1
