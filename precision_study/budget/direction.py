"""Errors of sine and cosine along a path, by cause: the kernel's own tables, over arrays."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_model import KernelConfig
from firmware_model.config import TRIG_TABLE
from firmware_model.tables import CORDIC_ANGLE_BITS, CORDIC_GUARD_BITS
from precision_study.budget.causes import rounding_error

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_QUARTER = 1 << 30


def direction_errors(config: KernelConfig, phase_turn_q32: Ints) -> tuple[Floats, Floats]:
    """Return what (cosine, sine) are off, each float64[n, 2].

    Args:
        config: of the firmware.
        phase_turn_q32: int64[n], angles of 0 to 2^32 − 1 [2^−32 turn].

    Returns:
        by the entries of the table (or all of CORDIC), and by interpolation with its rounding.
    """
    quadrant, angle = phase_turn_q32 >> 30, phase_turn_q32 & (_QUARTER - 1)
    if config.trig_method == TRIG_TABLE:
        sine_table, sine_chord = _quarter_sine(config, angle)
        cosine_table, cosine_chord = _quarter_sine(config, _QUARTER - angle)
        table = np.stack([cosine_table, sine_table], axis=1)
        chord = np.stack([cosine_chord, sine_chord], axis=1)
    else:
        table = _cordic(config, angle)
        chord = np.zeros_like(table)
    return _turned(table, quadrant), _turned(chord, quadrant)


def _turned(errors: Floats, quadrant: Ints) -> Floats:
    """Turn vectors of the first quadrant into theirs."""
    x, y = errors[:, 0], errors[:, 1]
    sign = np.where((quadrant == 1) | (quadrant == 2), -1.0, 1.0)
    odd = (quadrant & 1) == 1
    new_x = np.where(odd, np.where(quadrant == 1, -y, y), sign * x)
    new_y = np.where(odd, np.where(quadrant == 1, x, -x), sign * y)
    return np.stack([new_x, new_y], axis=1)


def _quarter_sine(config: KernelConfig, angle: Ints) -> tuple[Floats, Floats]:
    """Return the errors of the sine of angles of 0 to 2^30, by table and by interpolation."""
    table = np.array(config.table, dtype=np.float64)
    nodes = np.sin(np.arange(len(table)) * (math.pi / 2.0 / (len(table) - 1)))
    unit = math.ldexp(1.0, -config.trig_frac_bits)
    true = np.sin(angle * (math.pi / 2.0 / _QUARTER))
    bits = 30 - config.table_index_bits
    if config.trig_interpolated == 0:
        nearest = (angle + (1 << bits >> 1)) >> bits
        return table[nearest] * unit - true, np.zeros_like(true)
    index = angle >> bits
    after = np.minimum(index + 1, len(table) - 1)
    fraction = (angle & ((1 << bits) - 1)) * math.ldexp(1.0, -bits)
    entries = (table[index] + (table[after] - table[index]) * fraction) * unit
    chord = nodes[index] + (nodes[after] - nodes[index]) * fraction
    product = (table[after] - table[index]) * fraction
    rounded = rounding_error(product, config.trig_rounding) * unit
    return entries - chord, chord - true + rounded


def _cordic(config: KernelConfig, angle: Ints) -> Floats:
    """Return the errors of (cosine, sine) of angles of 0 to 2^30 by CORDIC."""
    start, *angles = config.table
    x = np.full(angle.shape, start, dtype=np.int64)
    y = np.zeros_like(x)
    residual = angle << (CORDIC_ANGLE_BITS - 32)
    for i in range(config.cordic_iterations):
        sign = np.where(residual >= 0, 1, -1)
        x, y = x - sign * (y >> i), y + sign * (x >> i)
        residual = residual - sign * angles[i]
    one = 1 << config.trig_frac_bits
    true = angle * (math.pi / 2.0 / _QUARTER)
    errors = []
    for value, exact in ((x, np.cos(true)), (y, np.sin(true))):
        scaled = value * math.ldexp(1.0, -CORDIC_GUARD_BITS)
        whole = np.clip(scaled + rounding_error(scaled, config.trig_rounding), -one, one)
        errors.append(whole / one - exact)
    return np.stack(errors, axis=1)
