"""The guaranteed bound of firmware − float, split by cause.

The position error is Σ s′ₖ·u′ₖ − sₖ·uₖ over the ticks, s the step and u its direction, primes for
the firmware. It splits exactly into Σ s′ₖ·(u′ₖ − uₖ) + Σ (s′ₖ − sₖ)·uₖ:

* |u′ − u| is at most the angle by which the direction is off, plus the error of sine and cosine;
  the first sum is therefore below Σ|s′| times the largest of these;
* a step whose remainder is carried is off by rₖ₋₁ − rₖ, so that the second sum is
  Σ rₖ·(uₖ₊₁ − uₖ) plus its ends: a remainder times (2 + the angle turned), however long the drive.

Carried remainders of a turn telescope to one remainder. What is dropped without being carried adds
up tick by tick. No overflow is assumed: `chiplog ranges` proves that.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_model import KernelConfig
from firmware_model.config import EULER_AFTER, EULER_BEFORE, MODE_BLEND, MODE_WHEEL, TRIG_TABLE
from firmware_model.tables import CORDIC_ANGLE_BITS, CORDIC_GUARD_BITS
from firmware_model.twin import build_twin_config
from precision_study.budget.causes import CAUSES, Share, largest_drop, mean_drop
from precision_study.budget.travel import Travel

_TURN: Final = 2.0 * math.pi
_EPSILON: Final = 2.0**-53
_CORDIC_GAIN: Final = 1.65


def relative_errors(config: KernelConfig) -> tuple[float, float, float]:
    """Return used/described − 1 of the constants: half a tick's distance, a tick's turn, the gyro.

    Right to a few 2^−53.
    """
    twin, one = build_twin_config(config), config.description
    step = math.ldexp(config.half_tick_m_q, -(one.step.frac_bits + config.step_shift))
    wheel = math.ldexp(config.tick_turn_q, -(one.turn_step.frac_bits + config.wheel_turn_shift))
    bits = one.turn_step.frac_bits + config.gyro_turn_shift - config.offset_frac_bits
    gyro = math.ldexp(config.sensitivity_turn_q, -bits)
    return (
        step / twin.half_tick_m - 1.0,
        wheel * _TURN / twin.tick_turn_rad - 1.0,
        gyro * _TURN / twin.sensitivity_rad_per_lsb - 1.0,
    )


def direction_bits(config: KernelConfig) -> int:
    """Return how many fraction bits are dropped where the direction of a step is formed.

    None when neither a remainder nor half a turn is below the heading's unit.
    """
    has_remainder = config.heading_carry == 1 and config.heading_shift > 0
    if config.stale_heading_ticks > 0 or config.integration == EULER_BEFORE:
        return config.heading_shift if has_remainder else 0
    if config.integration == EULER_AFTER:
        return config.heading_shift
    return config.heading_shift + 1


def offset_error_lsb(config: KernelConfig) -> float:
    """Return the largest |offset used − offset of the twin| [LSB], assumed or learnt."""
    nominal = math.ldexp(config.zero_rate_code_q, -config.offset_frac_bits)
    assumed = abs(nominal - config.constants.gyro_zero_rate_code)
    dropped = config.offset_max_log2 - config.offset_frac_bits
    learnt = math.ldexp(largest_drop(config.offset_rounding, dropped), -config.offset_frac_bits)
    return max(assumed, learnt)


def guaranteed_bound(config: KernelConfig, travel: Travel) -> dict[str, Share]:
    """Return for each cause what it contributes to firmware − float at most, at any tick.

    Args:
        config: of the firmware.
        travel: what is driven.
    """
    step_off, wheel_off, gyro_off = (abs(one) + 4.0 * _EPSILON for one in relative_errors(config))
    one, twin = config.description, build_twin_config(config)
    step_unit = math.ldexp(1.0, -one.step.frac_bits)
    turn_unit = _TURN * math.ldexp(1.0, -one.turn_step.frac_bits)
    heading_unit = _TURN * math.ldexp(1.0, -config.heading_frac_bits)
    position_unit = math.ldexp(1.0, -config.position_frac_bits)
    step_drop = largest_drop(config.step_rounding, config.step_shift) * step_unit
    driven = travel.distance_m * (1.0 + step_off) + 2.0 * step_drop * travel.moving_ticks

    by_wheels, by_gyro = _turning(config, travel)
    weight_off = 0.0
    if config.mode == MODE_BLEND:
        used = math.ldexp(config.blend_weight_q, -config.blend_frac_bits)
        weight_off = abs(used - twin.blend_weight) * (by_wheels + by_gyro)
    offset = 0.0
    if config.mode != MODE_WHEEL:
        offset = offset_error_lsb(config) * twin.sensitivity_rad_per_lsb * travel.ticks
    scaled = wheel_off * by_wheels + gyro_off * by_gyro + weight_off + offset * (1.0 + gyro_off)

    rounded = {"rounding_bias": [0.0, 0.0, 0.0], "rounding_noise": [0.0, 0.0, 0.0]}

    def drop(kind: int, rounding: int, bits: int, unit: float, count: float) -> None:
        """Add what *count* roundings drop for good: 0 a turn, 1 a step, 2 a coordinate."""
        mean = mean_drop(rounding, bits)
        rounded["rounding_bias"][kind] += mean * unit * count
        rounded["rounding_noise"][kind] += (largest_drop(rounding, bits) - mean) * unit * count

    turn_bits = max(
        config.wheel_turn_shift if by_wheels else 0, config.gyro_turn_shift if by_gyro else 0
    )
    if config.turn_carry == 0:
        drop(0, config.turn_rounding, turn_bits, turn_unit, travel.ticks)
    if config.mode == MODE_BLEND:
        drop(0, config.turn_rounding, config.blend_frac_bits, turn_unit, travel.ticks)
    if config.heading_carry == 0:
        drop(0, config.heading_rounding, config.heading_shift, heading_unit, travel.ticks)
    if config.step_carry == 0:
        drop(1, config.step_rounding, config.step_shift, step_unit, travel.moving_ticks)
    position_drop = largest_drop(config.position_rounding, config.position_shift) * position_unit
    if config.position_carry == 0:
        drop(
            2,
            config.position_rounding,
            config.position_shift,
            position_unit * math.sqrt(2.0),
            travel.moving_ticks,
        )

    # The turn of a gap is taken back with all its fraction bits.
    bits = config.heading_shift + 1 if travel.interruptions else direction_bits(config)
    quantum = largest_drop(config.heading_rounding, bits) * heading_unit
    reported = 0.0
    if config.heading_carry == 1:
        reported = largest_drop(config.heading_rounding, config.heading_shift) * heading_unit
    waiting = 0.0
    if config.turn_carry == 1:
        sources = (1 if by_wheels else 0) + (1 if by_gyro else 0)
        drop_q = largest_drop(config.turn_rounding, turn_bits)
        waiting = drop_q * turn_unit * sources * (1.0 + 2.0 * travel.interruptions)
    bends = (by_wheels + by_gyro) * (3.0 if travel.interruptions else 1.0)
    step_waiting = step_drop * (2.0 + bends) if config.step_carry == 1 else 0.0
    table, chord = _direction_errors(config)
    turned = max(by_wheels + by_gyro, _TURN)
    twin_heading = (travel.ticks + 8) * _EPSILON * turned
    twin_position = (1.5 * travel.ticks + 16.0) * _EPSILON * travel.distance_m
    shares = {
        "constants": Share(step_off * travel.distance_m + driven * scaled, scaled),
        "heading_quantum": Share(driven * quantum, reported),
        "table_error": Share(driven * table),
        "interpolation": Share(driven * chord),
        "position_quantum": Share(math.sqrt(2.0) * position_drop * config.position_carry),
        "carried_remainder": Share(driven * waiting + step_waiting, waiting),
        "float_twin": Share(
            driven * twin_heading + twin_position + position_unit * _EPSILON, twin_heading
        ),
    }
    for name, (turn, step, coordinate) in rounded.items():
        shares[name] = Share(driven * turn + step + coordinate, turn)
    return {name: shares[name] for name in CAUSES}


def _turning(config: KernelConfig, travel: Travel) -> tuple[float, float]:
    """Return Σ|turn| that the heading takes from the wheels and from the gyro [rad]."""
    if config.mode == MODE_WHEEL:
        return travel.wheel_turning_rad, 0.0
    uses_wheels = config.mode == MODE_BLEND or travel.interruptions > 0
    return (travel.wheel_turning_rad if uses_wheels else 0.0), travel.gyro_turning_rad


def _direction_errors(config: KernelConfig) -> tuple[float, float]:
    """Return the largest error of (cosine, sine) by table or CORDIC, and by interpolation.

    Between nodes h apart a chord is below a sine by at most h²/8 times its largest value in the
    cell; sin² + cos² of a cell are at most 1 + sin h. CORDIC's angle ends within that of its last
    rotation (J. E. Volder, IRE Trans. EC-8, 1959); each rotation floors both coordinates.
    """
    unit = math.ldexp(1.0, -config.trig_frac_bits)
    if config.trig_method != TRIG_TABLE:
        rotations = config.cordic_iterations
        angle = math.atan(2.0 ** -(rotations - 1)) + rotations * math.pi * 2.0**-CORDIC_ANGLE_BITS
        floors = (rotations * math.sqrt(2.0) + 1.0) * _CORDIC_GAIN * 2.0**-CORDIC_GUARD_BITS
        rounded = math.sqrt(2.0) * largest_drop(config.trig_rounding, CORDIC_GUARD_BITS)
        return angle + (floors + rounded) * unit, 0.0
    cell = math.pi / 2.0 / (1 << config.table_index_bits)
    widened = math.sqrt(1.0 + math.sin(cell))
    between = config.heading_frac_bits - 2 > config.table_index_bits
    entry = unit / math.sqrt(2.0)
    if not between:
        return entry, 0.0
    if config.trig_interpolated == 0:
        return entry + cell / 2.0 * widened, 0.0
    dropped = math.sqrt(2.0) * largest_drop(config.trig_rounding, 30 - config.table_index_bits)
    return entry, cell * cell / 8.0 * widened + dropped * unit
