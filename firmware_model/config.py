"""The kernel's configuration: integers only, ready to be typed into a C header."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

from firmware_model.constants import FirmwareConstants
from firmware_model.description import FirmwareDescription
from firmware_model.errors import FirmwareError

MODE_WHEEL: Final = 0
MODE_GYRO: Final = 1
MODE_BLEND: Final = 2

# Which heading a step is taken along, in half turns-of-the-tick after the old one.
EULER_BEFORE: Final = 0
MIDPOINT: Final = 1
EULER_AFTER: Final = 2

TRIG_TABLE: Final = 0
TRIG_CORDIC: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelConfig:
    """Everything the kernel needs besides its inputs; made by `build_config`, proved there.

    A name with ``_q`` is a scaled integer. The fraction bits of each follow from the formats:
    position P, step S, heading F, turn step K, trig T, gyro offset O.
    """

    mode: int
    integration: int
    blend_weight_q: int
    blend_frac_bits: int
    # 0: the heading that `integration` names; n: the one of n ticks ago.
    stale_heading_ticks: int

    # Encoder.
    counter_bits: int
    max_step_ticks: int
    gap_limit_ticks: int
    jump_confirm_samples: int

    # Step: counts (left + right) · half_tick_m_q, narrowed by step_shift to S fraction bits.
    half_tick_m_q: int
    step_shift: int
    step_rounding: int
    step_low_q: int
    step_high_q: int
    step_overflow: int
    step_carry: int

    # Turn step: counts (right − left) · tick_turn_q, or (code − offset) · sensitivity_turn_q.
    tick_turn_q: int
    wheel_turn_shift: int
    sensitivity_turn_q: int
    gyro_turn_shift: int
    turn_rounding: int
    turn_low_q: int
    turn_high_q: int
    turn_overflow: int
    turn_carry: int

    # Heading: the turn step, narrowed by heading_shift to F fraction bits of a turn.
    heading_frac_bits: int
    heading_shift: int
    heading_rounding: int
    heading_carry: int

    # Sine and cosine.
    trig_method: int
    trig_frac_bits: int
    trig_rounding: int
    trig_interpolated: int
    table_start: int
    table_index_bits: int
    cordic_iterations: int

    # Position: step · cosine, narrowed by position_shift to P fraction bits.
    position_shift: int
    position_rounding: int
    position_low_q: int
    position_high_q: int
    position_overflow: int
    position_carry: int
    position_frac_bits: int

    # Gyro.
    gyro_min_code: int
    gyro_max_code: int
    zero_rate_code_q: int
    offset_frac_bits: int
    offset_rounding: int
    auto_zero_rate_q: int
    stuck_ticks: int
    stuck_block_ticks: int
    stuck_span_ticks: int

    # Standstill.
    still_ticks: int
    still_tolerance_ticks: int
    rest_max_rate_q: int
    settle_ticks: int
    offset_block_log2: int
    offset_max_log2: int

    # Velocity.
    tick_rate_hz_q: int
    v_shift: int
    tick_rate_rad_q: int
    w_pre_shift: int
    w_shift: int
    velocity_low_q: int
    velocity_high_q: int
    velocity_frac_bits: int
    velocity_filter_log2: int

    # Not part of the record: the table, and what the float twin and messages need.
    table: tuple[int, ...] = field(repr=False)
    description: FirmwareDescription = field(repr=False)
    constants: FirmwareConstants = field(repr=False)
    # Why C cannot hold this, with field, value and what would be right; empty where it can. Then
    # only the kernel in Python runs it, whose integers have no width but that of their word.
    beyond_c: str = field(default="", repr=False)


CONFIG_FIELDS: Final[tuple[str, ...]] = tuple(
    one.name
    for one in fields(KernelConfig)
    if one.name not in ("table", "description", "constants", "beyond_c")
)
"""Names of the integer fields, in the order of the compiled record."""

CONFIG_DTYPE: Final = np.dtype([(name, np.int64) for name in CONFIG_FIELDS])
"""The same configuration as a NumPy record, for compiled code."""


def require_c(config: KernelConfig) -> None:
    """Refuse a configuration that C cannot hold, nor machine code with integers of 64 bits.

    Raises:
        FirmwareError: field, value and what would be right.
    """
    if config.beyond_c:
        raise FirmwareError(config.beyond_c)
