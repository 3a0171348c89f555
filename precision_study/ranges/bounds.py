"""Interval arithmetic over the kernel, top to bottom: one line per product, sum and word.

Every bound holds for all inputs of the envelope; it exceeds the largest value that occurs by a few
units at most, because carried remainders are taken at their largest. `reach` has what needs more
than a line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from firmware_model import KernelConfig
from firmware_model.config import MODE_BLEND, MODE_WHEEL, TRIG_TABLE
from firmware_model.tables import CORDIC_GUARD_BITS
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.reach import largest, position_reach, step_bound

Word = Literal["register", "step", "turn_step", "position", "velocity"]
_SIGNED_64: Final = 64


@dataclass(frozen=True)
class Intermediate:
    """A value that the kernel forms.

    Attributes:
        name: what it is.
        field: where its width is chosen, as ``firmware.step.word_bits``; the C type otherwise.
        unit: of 2^frac_bits of it.
        frac_bits: fraction bits.
        word_bits: width, with the sign.
        bound: no input of the envelope makes its magnitude larger [2^-frac_bits unit].
        word: which overflow the kernel would report.
    """

    name: str
    field: str
    unit: str
    frac_bits: int
    word_bits: int
    bound: int
    word: Word = "register"

    @property
    def least_word_bits(self) -> int:
        """The narrowest two's complement word that holds every value up to the bound."""
        return self.bound.bit_length() + 1

    @property
    def is_proved(self) -> bool:
        """Whether overflow is impossible."""
        return self.least_word_bits <= self.word_bits


def intermediates(config: KernelConfig, envelope: Envelope) -> list[Intermediate]:
    """Return every intermediate, in the order in which the kernel forms them."""
    return [
        *_encoder(config, envelope),
        *_turns(config, envelope),
        *_direction(config, envelope),
        *_position(config, envelope),
        *_velocity(config, envelope),
        *_learning(config, envelope),
    ]


def _register(name: str, unit: str, frac_bits: int, bound: int, bits: int = 64) -> Intermediate:
    return Intermediate(name, f"int{bits}_t", unit, frac_bits, bits, bound)


def _word_bits(high: int) -> int:
    return high.bit_length() + 1


def _encoder(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    counts = envelope.step_ticks * envelope.gap_ticks
    yield Intermediate(
        "increment of a wheel over the longest gap",
        "encoder.counter_bits",
        "ticks",
        0,
        config.counter_bits,
        counts,
    )
    frac_bits = config.description.step.frac_bits
    product = 2 * counts * config.half_tick_m_q
    yield _register(
        "left + right times half a tick's distance, with remainder",
        "m",
        frac_bits + config.step_shift,
        product + (1 << config.step_shift),
    )
    bound = step_bound(config, envelope, envelope.gap_ticks)
    bits = _word_bits(config.step_high_q)
    name = "step of a tick or of the longest gap"
    yield Intermediate(name, "firmware.step.word_bits", "m", frac_bits, bits, bound, "step")


def _turn_bounds(config: KernelConfig, envelope: Envelope) -> tuple[int, int, int, int]:
    """Return product and narrowed turn of the wheels over the longest gap, then of the gyro."""
    counts = 2 * envelope.step_ticks * envelope.gap_ticks
    wheel_product = counts * config.tick_turn_q
    shift = config.offset_frac_bits
    rate_q = max(
        (envelope.code_high << shift) - envelope.offset_low_q,
        envelope.offset_high_q - (envelope.code_low << shift),
    )
    if rate_q < config.auto_zero_rate_q:  # all of it is taken for rest
        rate_q = 0
    gyro_product = rate_q * config.sensitivity_turn_q
    rounding, carry = config.turn_rounding, config.turn_carry
    wheel = largest(wheel_product, config.wheel_turn_shift, rounding, carry)
    gyro = largest(gyro_product, config.gyro_turn_shift, rounding, carry)
    return wheel_product, wheel, gyro_product, gyro


def _limited(config: KernelConfig, turn: int) -> int:
    """Return the bound of a turn after the word has wrapped or saturated it."""
    return min(turn, -config.turn_low_q)


def _turns(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    frac_bits = config.description.turn_step.frac_bits
    wheel_product, wheel, gyro_product, gyro = _turn_bounds(config, envelope)
    bits = _word_bits(config.turn_high_q)
    field = "firmware.turn_step.word_bits"
    yield _register(
        "right − left times a tick's turn, with remainder",
        "turn",
        frac_bits + config.wheel_turn_shift,
        wheel_product + (1 << config.wheel_turn_shift),
    )
    name = "turn by the wheels in a tick or in the longest gap"
    yield Intermediate(name, field, "turn", frac_bits, bits, wheel, "turn_step")
    if config.mode == MODE_WHEEL:
        return
    yield _register(
        "code − offset times the sensitivity, with remainder",
        "turn",
        frac_bits + config.gyro_turn_shift,
        gyro_product + (1 << config.gyro_turn_shift),
    )
    name = "turn by the gyro in a tick"
    yield Intermediate(name, field, "turn", frac_bits, bits, gyro, "turn_step")
    gap = envelope.gap_ticks * _limited(config, gyro)
    yield _register("turn of the longest gap", "turn", frac_bits, gap)
    if config.mode == MODE_BLEND:
        one_tick = 2 * envelope.step_ticks * config.tick_turn_q
        rounding, carry = config.turn_rounding, config.turn_carry
        by_wheels = largest(one_tick, config.wheel_turn_shift, rounding, carry)
        difference = _limited(config, by_wheels) + _limited(config, gyro)
        yield _register(
            "gyro − wheels times the weight",
            "turn",
            frac_bits + config.blend_frac_bits,
            difference * config.blend_weight_q,
        )


def _direction(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    frac_bits = config.description.turn_step.frac_bits
    _, wheel, _, gyro = _turn_bounds(config, envelope)
    turn = max(_limited(config, wheel), 0 if config.mode == MODE_WHEEL else _limited(config, gyro))
    gap = 0 if config.mode == MODE_WHEEL else envelope.gap_ticks * _limited(config, gyro)
    half_turn = (1 << (frac_bits - 1)) + (1 << config.heading_shift)
    angle = 2 * (half_turn + gap) + 2 * (2 * gap + turn)
    yield _register("angle that a step is taken along", "turn", frac_bits + 1, angle)
    total = turn + gap + (1 << config.heading_shift)
    yield _register("turn with the heading's remainder", "turn", frac_bits, total)
    trig_bits = config.trig_frac_bits
    if config.trig_method != TRIG_TABLE:
        length = (165 << (trig_bits + CORDIC_GUARD_BITS)) // 100
        yield _register("coordinate of CORDIC's vector", "1", trig_bits + CORDIC_GUARD_BITS, length)
    elif config.trig_interpolated:
        steps = [abs(b - a) for a, b in zip(config.table, config.table[1:], strict=False)]
        fraction_bits = 30 - config.table_index_bits
        product = max(steps) << fraction_bits
        yield _register("table step times fraction", "1", trig_bits + fraction_bits, product)


def _position(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    one = config.description
    frac_bits = one.step.frac_bits + config.trig_frac_bits
    step = min(step_bound(config, envelope, envelope.gap_ticks), -config.step_low_q)
    product = step << config.trig_frac_bits
    yield _register(
        "step times cosine, with remainder", "m", frac_bits, product + (1 << config.position_shift)
    )
    reach = position_reach(config, envelope)
    bits = _word_bits(config.position_high_q)
    field = "firmware.position.word_bits"
    yield Intermediate(
        "x and y at the mission's end", field, "m", one.position.frac_bits, bits, reach, "position"
    )


def _velocity(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    one = config.description
    filter_bits = config.velocity_filter_log2
    counts = 2 * envelope.step_ticks
    step = min(step_bound(config, envelope, 1), -config.step_low_q)
    yield _register("filter of the step", "m", one.step.frac_bits, (step + 1) << filter_bits)
    speed = (step + 1) * config.tick_rate_hz_q
    yield _register("step times tick rate", "m/s", one.step.frac_bits + 16, speed)
    field, frac_bits = "int32_t", config.velocity_frac_bits
    bound = (speed >> config.v_shift) + 1
    yield Intermediate("speed", field, "m/s", frac_bits, 32, bound, "velocity")
    _, _, _, gyro = _turn_bounds(config, envelope)
    product, rounding = counts * config.tick_turn_q, config.turn_rounding
    by_wheels = largest(product, config.wheel_turn_shift, rounding, config.turn_carry)
    turn = _limited(config, by_wheels)
    if config.mode != MODE_WHEEL:
        turn = max(turn, _limited(config, gyro)) + 1
    turn_bits = one.turn_step.frac_bits
    yield _register("filter of the turn", "turn", turn_bits, (turn + 1) << filter_bits)
    rate = ((turn + 1 >> config.w_pre_shift) + 1) * config.tick_rate_rad_q
    name = "turn times tick rate"
    yield _register(name, "rad/s", turn_bits - config.w_pre_shift + 16, rate)
    bound = (rate >> config.w_shift) + 1
    yield Intermediate("turn rate", field, "rad/s", frac_bits, 32, bound, "velocity")


def _learning(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    codes = envelope.code_high << config.offset_max_log2
    yield _register("sum of codes at rest", "LSB", 0, codes, bits=64)
    frac_bits = config.offset_frac_bits
    yield _register("that sum, with the offset's fraction", "LSB", frac_bits, codes << frac_bits)
    block = 2 * envelope.step_ticks * config.stuck_block_ticks
    yield _register("turning of a block of ticks", "ticks", 0, block)
    yield _register("count of ticks", "ticks", 0, envelope.mission_ticks)
