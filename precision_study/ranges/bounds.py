"""Interval arithmetic over the kernel, top to bottom: one line per product, sum and word.

Every bound holds for all inputs of the envelope; it exceeds the largest value that occurs by a few
units at most, because carried remainders are taken at their largest. `reach` has what needs more
than a line, `registers` what C keeps in types of its own.
"""

from __future__ import annotations

from collections.abc import Iterator

from firmware_model import KernelConfig
from firmware_model.build_bounds import largest_turn
from firmware_model.build_scales import Scale
from firmware_model.config import MODE_BLEND, MODE_WHEEL
from firmware_model.counting import least_counter_bits, told_apart
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.intermediate import Intermediate, in_c, kept, register
from precision_study.ranges.reach import extremes, largest_rate_q, position_reach, step_bound
from precision_study.ranges.registers import (
    counters,
    gyro_watch,
    remainders,
    standstill,
    trigonometry,
)


def intermediates(config: KernelConfig, envelope: Envelope) -> list[Intermediate]:
    """Return every intermediate, in the order in which the kernel forms them.

    Where a counter may take one way of a wheel for the other, the rest is of any way.
    """
    counted = _counted(config, envelope)
    if not counted.is_proved:
        envelope = envelope.as_believed()
    return [
        *counters(config, envelope),
        counted,
        *gyro_watch(config, envelope),
        *standstill(config, envelope),
        *_step(config, envelope),
        *_turns(config, envelope),
        *_direction(config, envelope),
        *trigonometry(config),
        *_position(config, envelope),
        *_velocity(config, envelope),
        *remainders(config),
    ]


def _word_bits(high: int) -> int:
    return high.bit_length() + 1


def _counted(config: KernelConfig, envelope: Envelope) -> Intermediate:
    """Return what a counter has to tell apart: a wheel's way, and what is believed backward."""
    rate, noise_ticks = envelope.rate, envelope.noise_ticks
    counts = told_apart(config, rate, noise_ticks, envelope.gap_ticks)
    least = least_counter_bits(config, rate, noise_ticks, envelope.mission_ticks)
    return Intermediate(
        "increments over the longest gap, both ways",
        *("encoder.counter_bits", "ticks", 0, config.counter_bits, 0),
        counts,
        "counter",
        is_signed=False,
        at_least_bits=least if least > config.counter_bits else 0,
    )


def _step(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    counts = envelope.wheel_ticks(envelope.gap_ticks)
    frac_bits = config.description.step.frac_bits
    product = 2 * counts * config.half_tick_m_q
    yield register(
        "left + right times half a tick's distance, with remainder",
        "m",
        frac_bits + config.step_shift,
        product + (1 << config.step_shift),
    )
    low, high = extremes(product, config.step_shift, config.step_rounding, config.step_carry)
    bits = _word_bits(config.step_high_q)
    name = "step of a tick or of the longest gap"
    yield Intermediate(name, "firmware.step.word_bits", "m", frac_bits, bits, low, high, "step")


def _wheel_turn(config: KernelConfig, envelope: Envelope, ticks: int) -> tuple[int, int]:
    """Return the extreme turns by the wheels over so many ticks [2^-K turn]."""
    product = envelope.turn_ticks(ticks) * config.tick_turn_q
    rounding, carry = config.turn_rounding, config.turn_carry
    return extremes(product, config.wheel_turn_shift, rounding, carry)


def _gyro_turn(config: KernelConfig, envelope: Envelope) -> tuple[int, int]:
    """Return the extreme turns by the gyro in a tick [2^-K turn]."""
    product = largest_rate_q(config, envelope) * config.sensitivity_turn_q
    return extremes(product, config.gyro_turn_shift, config.turn_rounding, config.turn_carry)


def _limited(config: KernelConfig, turn: tuple[int, int]) -> int:
    """Return the magnitude of a turn after the word has wrapped or saturated it."""
    return min(max(turn[1], -turn[0]), -config.turn_low_q)


def _least_turn_bits(config: KernelConfig) -> int:
    """Return how wide a turn's word is at least: a kernel is built for whatever it believes."""
    largest = largest_turn(
        Scale(config.tick_turn_q, config.wheel_turn_shift),
        config.max_step_ticks * config.gap_limit_ticks,
        Scale(config.sensitivity_turn_q, config.gyro_turn_shift),
        (config.gyro_max_code + 1) << config.offset_frac_bits,
    )
    return _word_bits(largest)


def _turns(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    frac_bits = config.description.turn_step.frac_bits
    bits = _word_bits(config.turn_high_q)
    field, least = "firmware.turn_step.word_bits", _least_turn_bits(config)
    product = envelope.turn_ticks(envelope.gap_ticks) * config.tick_turn_q
    yield register(
        "right − left times a tick's turn, with remainder",
        "turn",
        frac_bits + config.wheel_turn_shift,
        product + (1 << config.wheel_turn_shift),
    )
    name = "turn by the wheels in a tick or in the longest gap"
    wheel = _wheel_turn(config, envelope, envelope.gap_ticks)
    yield Intermediate(
        name, field, "turn", frac_bits, bits, *wheel, "turn_step", at_least_bits=least
    )
    if config.mode == MODE_WHEEL:
        return
    rate_q = largest_rate_q(config, envelope)
    yield register("code − offset", "LSB", config.offset_frac_bits, rate_q)
    yield register(
        "code − offset times the sensitivity, with remainder",
        "turn",
        frac_bits + config.gyro_turn_shift,
        rate_q * config.sensitivity_turn_q + (1 << config.gyro_turn_shift),
    )
    gyro = _gyro_turn(config, envelope)
    name = "turn by the gyro in a tick"
    yield Intermediate(
        name, field, "turn", frac_bits, bits, *gyro, "turn_step", at_least_bits=least
    )
    if config.mode == MODE_BLEND:
        by_wheels = _wheel_turn(config, envelope, 1)
        difference = _limited(config, by_wheels) + _limited(config, gyro)
        yield register(
            "gyro − wheels times the weight",
            "turn",
            frac_bits + config.blend_frac_bits,
            difference * config.blend_weight_q,
        )


def _direction(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    frac_bits = config.description.turn_step.frac_bits
    turn = _limited(config, _wheel_turn(config, envelope, envelope.gap_ticks))
    gap = 0
    if config.mode != MODE_WHEEL:
        by_gyro = _limited(config, _gyro_turn(config, envelope))
        turn, gap = max(turn, by_gyro), envelope.gap_ticks * by_gyro
    yield kept("turn of the longest gap", "turn", frac_bits, -gap, gap, "gap_turn_q")
    half_turn = (1 << (frac_bits - 1)) + (1 << config.heading_shift)
    angle = 2 * (half_turn + gap) + 2 * (2 * gap + turn)
    yield register("angle that a step is taken along", "turn", frac_bits + 1, angle)
    total = turn + gap + (1 << config.heading_shift)
    yield register("turn with the heading's remainder", "turn", frac_bits, total)
    heading_bits = config.heading_frac_bits
    half = 1 << (heading_bits - 1)
    ahead = half + (total >> config.heading_shift) + 1
    yield register("heading and turn, before it wraps", "turn", heading_bits, ahead)
    headings = ("heading_turn_q", "past_1_turn_q", "past_2_turn_q", "past_3_turn_q")
    yield kept("heading", "turn", heading_bits, -half, half - 1, *headings)


def _position(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    one = config.description
    frac_bits = one.step.frac_bits + config.trig_frac_bits
    step = min(step_bound(config, envelope, envelope.gap_ticks), -config.step_low_q)
    high = min(step, config.step_high_q)
    yield in_c("step in its word", "int32_t", "m", one.step.frac_bits, -step, high)
    product = (step << config.trig_frac_bits) + (1 << config.position_shift)
    yield register("step times cosine, with remainder", "m", frac_bits, product)
    reach = position_reach(config, envelope)
    bits, frac_bits = _word_bits(config.position_high_q), one.position.frac_bits
    move = (product >> config.position_shift) + 1
    low, high = config.position_low_q, config.position_high_q
    # The limit that a move goes towards: high − move for one forward, low − move for one back.
    spare = (min(low, high - move), max(high, low + move))
    name = "word's limit less a move"
    yield in_c(name, "int64_t", "m", frac_bits, *spare)
    field, name = "firmware.position.word_bits", "x and y at the mission's end"
    yield Intermediate(
        name, field, "m", frac_bits, bits, reach.low, reach.high, "position", ("x_m_q", "y_m_q")
    )


def _velocity(config: KernelConfig, envelope: Envelope) -> Iterator[Intermediate]:
    one = config.description
    filter_bits = config.velocity_filter_log2
    step = min(step_bound(config, envelope, 1), -config.step_low_q)
    name, bound = "filter of the step", (step + 1) << filter_bits
    yield kept(name, "m", one.step.frac_bits, -bound, bound, "v_filter_q")
    speed = (step + 1) * config.tick_rate_hz_q
    yield register("step times tick rate", "m/s", one.step.frac_bits + 16, speed)
    field, frac_bits = "firmware.velocity.frac_bits", config.velocity_frac_bits
    bound = (speed >> config.v_shift) + 1
    yield Intermediate("speed", field, "m/s", frac_bits, 32, -bound, bound, "velocity")
    turn = _limited(config, _wheel_turn(config, envelope, 1))
    if config.mode != MODE_WHEEL:
        turn = max(turn, _limited(config, _gyro_turn(config, envelope))) + 1
    turn_bits = one.turn_step.frac_bits
    name, bound = "filter of the turn", (turn + 1) << filter_bits
    yield kept(name, "turn", turn_bits, -bound, bound, "w_filter_q")
    rate = ((turn + 1 >> config.w_pre_shift) + 1) * config.tick_rate_rad_q
    name = "turn times tick rate"
    yield register(name, "rad/s", turn_bits - config.w_pre_shift + 16, rate)
    bound = (rate >> config.w_shift) + 1
    yield Intermediate("turn rate", field, "rad/s", frac_bits, 32, -bound, bound, "velocity")
