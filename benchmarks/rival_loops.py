"""The kernel's plain tick in the fixed-point libraries that a user would otherwise take.

Both loops know only the arithmetic of a good tick in mode gyro with a table: increments, step,
turn, heading, interpolated sine and cosine, position, each with its carried remainder, rounded by
floor. What a firmware does besides (validity, gaps, jumps, standstill, a stuck gyro, velocity) is
left out, in their favour. Both end in the integers of the kernel, or `benchmarks/kernels.py` stops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from apytypes import APyFixed, OverflowMode, QuantizationMode
from fxpmath import Fxp

from firmware_model import KernelConfig

Inputs = npt.NDArray[np.int64]
"""[n, 3]: left counter, right counter, gyro code; the first row is the baseline."""
Pose = tuple[int, int, int]
"""x_m_q, y_m_q, heading_turn_q."""

_QUADRANT_BITS: Final = 30


def apytypes_pose(config: KernelConfig, inputs: Inputs) -> Pose:
    """Return the pose after the inputs, by APyFixed scalars."""
    floor, wrap = QuantizationMode.TO_NEG, OverflowMode.WRAP
    one = config.description
    turn_bits, step_bits = one.turn_step.frac_bits, one.step.frac_bits
    product_bits = step_bits + config.trig_frac_bits

    def whole(value: int, bits: int) -> Any:
        return APyFixed(value, int_bits=bits, frac_bits=0)

    def of(value: int, bits: int, frac_bits: int) -> Any:
        return APyFixed(value, bits=bits, frac_bits=frac_bits)

    half_tick_m = of(config.half_tick_m_q, 64, step_bits + config.step_shift)
    sensitivity = of(
        config.sensitivity_turn_q, 64, turn_bits + config.gyro_turn_shift - config.offset_frac_bits
    )
    offset = of(config.zero_rate_code_q, 34, config.offset_frac_bits)
    table = [of(sine, config.trig_frac_bits + 2, config.trig_frac_bits) for sine in config.table]
    x = y = of(0, 64, config.position_frac_bits)
    heading = of(0, config.heading_frac_bits, config.heading_frac_bits)
    x_rest = y_rest = of(0, 64, product_bits)
    step_rest = of(0, 64, step_bits + config.step_shift)
    gyro_rest = of(0, 64, turn_bits + config.gyro_turn_shift)
    heading_rest = of(0, 64, turn_bits)

    def quarter_sine(angle: int) -> Any:
        index, fraction = _split(config, angle)
        if fraction == 0:
            return table[index]
        fraction_bits = _fraction_bits(config)
        weight = of(fraction, fraction_bits + 1, fraction_bits)
        part = (table[index + 1] - table[index]) * weight
        part = part.cast(bits=32, frac_bits=config.trig_frac_bits, quantization=floor)
        return (table[index] + part).cast(bits=32, frac_bits=config.trig_frac_bits)

    left, right, _ = inputs[0].tolist()
    for new_left, new_right, code in inputs[1:].tolist():
        ticks = _increment(config, new_left, left) + _increment(config, new_right, right)
        left, right = new_left, new_right
        total = whole(ticks, 34) * half_tick_m + step_rest
        step = total.cast(
            bits=32, frac_bits=step_bits, quantization=floor, overflow=OverflowMode.SAT
        )
        step_rest = (total - step).cast(bits=64, frac_bits=step_bits + config.step_shift)

        total = (whole(code, 18) - offset) * sensitivity + gyro_rest
        turn = total.cast(bits=64, frac_bits=turn_bits, quantization=floor, overflow=wrap)
        gyro_rest = (total - turn).cast(bits=64, frac_bits=turn_bits + config.gyro_turn_shift)

        angle, signs, swapped = _quadrant(config, heading.to_bits())
        sine = quarter_sine(angle)
        cosine = quarter_sine((1 << _QUADRANT_BITS) - angle)
        if swapped:
            sine, cosine = cosine, sine
        if signs[0] < 0:
            cosine = -cosine
        if signs[1] < 0:
            sine = -sine

        total = step * cosine + x_rest
        moved = total.cast(bits=64, frac_bits=config.position_frac_bits, quantization=floor)
        x_rest = (total - moved).cast(bits=64, frac_bits=product_bits)
        x = (x + moved).cast(bits=64, frac_bits=config.position_frac_bits, overflow=wrap)
        total = step * sine + y_rest
        moved = total.cast(bits=64, frac_bits=config.position_frac_bits, quantization=floor)
        y_rest = (total - moved).cast(bits=64, frac_bits=product_bits)
        y = (y + moved).cast(bits=64, frac_bits=config.position_frac_bits, overflow=wrap)

        total = turn + heading_rest
        turned = total.cast(bits=64, frac_bits=config.heading_frac_bits, quantization=floor)
        heading_rest = (total - turned).cast(bits=64, frac_bits=turn_bits)
        heading = (heading + turned).cast(
            bits=config.heading_frac_bits, frac_bits=config.heading_frac_bits, overflow=wrap
        )
    return (
        _signed(x.to_bits(), 64),
        _signed(y.to_bits(), 64),
        _signed(heading.to_bits(), config.heading_frac_bits),
    )


def fxpmath_pose(config: KernelConfig, inputs: Inputs) -> Pose:
    """Return the pose after the inputs, by Fxp objects.

    The library brings a value to another format by way of float64: formats whose products take
    more than 53 bits end elsewhere.
    """
    one = config.description
    turn_bits, step_bits = one.turn_step.frac_bits, one.step.frac_bits
    product_bits = step_bits + config.trig_frac_bits

    def of(value: int, bits: int, frac_bits: int) -> Any:
        return Fxp(value, True, bits, frac_bits, raw=True, rounding="floor", overflow="wrap")

    def cast(value: Any, bits: int, frac_bits: int) -> Any:
        return Fxp(value, True, bits, frac_bits, rounding="floor", overflow="wrap")

    half_tick_m = of(config.half_tick_m_q, 32, step_bits + config.step_shift)
    sensitivity = of(
        config.sensitivity_turn_q, 32, turn_bits + config.gyro_turn_shift - config.offset_frac_bits
    )
    offset = of(config.zero_rate_code_q, 18 + config.offset_frac_bits, config.offset_frac_bits)
    table = [of(sine, config.trig_frac_bits + 2, config.trig_frac_bits) for sine in config.table]
    x = y = of(0, 32, config.position_frac_bits)
    heading = of(0, config.heading_frac_bits, config.heading_frac_bits)
    x_rest = y_rest = of(0, 32, product_bits)
    step_rest = of(0, 32, step_bits + config.step_shift)
    gyro_rest = of(0, 32, turn_bits + config.gyro_turn_shift)
    heading_rest = of(0, 32, turn_bits)

    def quarter_sine(angle: int) -> Any:
        index, fraction = _split(config, angle)
        if fraction == 0:
            return table[index]
        weight = of(fraction, _fraction_bits(config) + 1, _fraction_bits(config))
        part = cast((table[index + 1] - table[index]) * weight, 32, config.trig_frac_bits)
        return cast(table[index] + part, config.trig_frac_bits + 2, config.trig_frac_bits)

    left, right, _ = inputs[0].tolist()
    for new_left, new_right, code in inputs[1:].tolist():
        ticks = _increment(config, new_left, left) + _increment(config, new_right, right)
        left, right = new_left, new_right
        total = of(ticks, 18, 0) * half_tick_m + step_rest
        step = cast(total, 24, step_bits)
        step_rest = cast(total - step, 32, step_bits + config.step_shift)

        total = (of(code, 18, 0) - offset) * sensitivity + gyro_rest
        turn = cast(total, 48, turn_bits)
        gyro_rest = cast(total - turn, 32, turn_bits + config.gyro_turn_shift)

        phase = int(heading.val) & ((1 << config.heading_frac_bits) - 1)
        angle, signs, swapped = _quadrant(config, phase)
        sine = quarter_sine(angle)
        cosine = quarter_sine((1 << _QUADRANT_BITS) - angle)
        if swapped:
            sine, cosine = cosine, sine
        if signs[0] < 0:
            cosine = -cosine
        if signs[1] < 0:
            sine = -sine

        total = step * cosine + x_rest
        moved = cast(total, 32, config.position_frac_bits)
        x_rest = cast(total - moved, 32, product_bits)
        x = cast(x + moved, 32, config.position_frac_bits)
        total = step * sine + y_rest
        moved = cast(total, 32, config.position_frac_bits)
        y_rest = cast(total - moved, 32, product_bits)
        y = cast(y + moved, 32, config.position_frac_bits)

        total = turn + heading_rest
        turned = cast(total, 32, config.heading_frac_bits)
        heading_rest = cast(total - turned, 32, turn_bits)
        heading = cast(heading + turned, config.heading_frac_bits, config.heading_frac_bits)
    return int(x.val), int(y.val), int(heading.val)


def _increment(config: KernelConfig, now: int, before: int) -> int:
    return _signed(now - before, config.counter_bits)


def _signed(value: int, bits: int) -> int:
    half = 1 << (bits - 1)
    return ((value + half) & ((1 << bits) - 1)) - half


def _fraction_bits(config: KernelConfig) -> int:
    return _QUADRANT_BITS - config.table_index_bits


def _split(config: KernelConfig, angle: int) -> tuple[int, int]:
    """Return the table's entry below an angle of a quarter turn, and the fraction to the next."""
    return angle >> _fraction_bits(config), angle & ((1 << _fraction_bits(config)) - 1)


def _quadrant(config: KernelConfig, heading: int) -> tuple[int, Sequence[int], bool]:
    """Return the angle within its quadrant, the signs of cosine and sine, and if they swap."""
    phase = heading << (32 - config.heading_frac_bits)
    quadrant = phase >> _QUADRANT_BITS
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))[quadrant]
    return phase & ((1 << _QUADRANT_BITS) - 1), signs, quadrant % 2 == 1
