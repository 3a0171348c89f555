"""Sine and cosine of a binary angle, from integers."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_model._source import kernel_function, rare_kernel_function
from firmware_model.config import TRIG_CORDIC, KernelConfig
from firmware_model.integers import floor_shift, shift_round
from firmware_model.state import State
from firmware_model.tables import CORDIC_ANGLE_BITS, CORDIC_GUARD_BITS

_QUARTER = 1 << 30  # a quarter turn, in 2^−32 turn
_ANGLE_SCALE = 1 << (CORDIC_ANGLE_BITS - 32)


@kernel_function
def find_direction(
    state: State, config: KernelConfig, table: Sequence[int], phase_turn_q32: int
) -> None:
    """Set state.cosine_q and state.sine_q to those of the angle, in trig_frac_bits.

    Scaling and overflow: the angle is 0 to 2^32 − 1 in 2^−32 turn. Its two top bits are the
    quadrant, the rest an angle of the first quadrant; results lie in [−2^T, 2^T], T ≤ 30.
    """
    quadrant = phase_turn_q32 >> 30
    angle = phase_turn_q32 & (_QUARTER - 1)
    if config.trig_method == TRIG_CORDIC:
        rotate(state, config, table, angle)
    else:
        state.sine_q = quarter_sine(config, table, angle)
        state.cosine_q = quarter_sine(config, table, _QUARTER - angle)
    # A quarter turn takes (cos, sin) to (−sin, cos).
    if quadrant == 1:
        sine = state.cosine_q
        state.cosine_q = -state.sine_q
        state.sine_q = sine
    elif quadrant == 2:
        state.cosine_q = -state.cosine_q
        state.sine_q = -state.sine_q
    elif quadrant == 3:
        sine = -state.cosine_q
        state.cosine_q = state.sine_q
        state.sine_q = sine


@kernel_function
def quarter_sine(config: KernelConfig, table: Sequence[int], angle_turn_q32: int) -> int:
    """Return the sine of an angle of 0 to 2^30 (both included) in 2^−32 turn, by table.

    Scaling and overflow: the top bits of the angle index the table, the lower ones interpolate.
    Table steps are at most 2^30 and the fraction at most 30 bits: the product is below 2^60.
    """
    fraction_bits = 30 - config.table_index_bits
    if config.trig_interpolated == 0:
        if fraction_bits > 0:
            angle_turn_q32 = angle_turn_q32 + (1 << (fraction_bits - 1))  # the nearest entry
        return table[config.table_start + (angle_turn_q32 >> fraction_bits)]
    index = config.table_start + (angle_turn_q32 >> fraction_bits)
    fraction = angle_turn_q32 & ((1 << fraction_bits) - 1)
    if fraction == 0:
        return table[index]  # also the last entry, which has no successor
    step = table[index + 1] - table[index]
    return table[index] + shift_round(step * fraction, fraction_bits, config.trig_rounding)


@rare_kernel_function
def rotate(state: State, config: KernelConfig, table: Sequence[int], angle_turn_q32: int) -> None:
    """Set sine and cosine of an angle of 0 to 2^30 in 2^−32 turn, by CORDIC rotations.

    Scaling and overflow: the vector has 4 guard bits and stays below 1.65 in length, so below
    2^35; the residual angle is below 2^39 in 2^−40 turn.
    Results are held to ±2^T: CORDIC may end a few units beyond.
    """
    x = table[config.table_start]
    y = 0
    residual = angle_turn_q32 * _ANGLE_SCALE
    for i in range(config.cordic_iterations):
        x_part = floor_shift(x, i)
        y_part = floor_shift(y, i)
        if residual >= 0:
            x = x - y_part
            y = y + x_part
            residual = residual - table[config.table_start + 1 + i]
        else:
            x = x + y_part
            y = y - x_part
            residual = residual + table[config.table_start + 1 + i]
    one = 1 << config.trig_frac_bits
    state.cosine_q = min(max(shift_round(x, CORDIC_GUARD_BITS, config.trig_rounding), -one), one)
    state.sine_q = min(max(shift_round(y, CORDIC_GUARD_BITS, config.trig_rounding), -one), one)
