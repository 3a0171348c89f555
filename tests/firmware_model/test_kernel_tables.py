"""Sine tables and CORDIC constants, against values computed independently in decimal."""

from __future__ import annotations

import math
from decimal import ROUND_HALF_EVEN, Decimal, getcontext
from itertools import pairwise

import pytest
from kernel_cases import config_of

from firmware_model import State
from firmware_model.config import KernelConfig
from firmware_model.tables import (
    CORDIC_ANGLE_BITS,
    CORDIC_GUARD_BITS,
    cordic_table,
    pi_scaled,
    quarter_sine_table,
)
from firmware_model.trigonometry import find_direction

getcontext().prec = 70
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")


def decimal_sine(angle: Decimal) -> Decimal:
    term = total = angle
    k = 1
    while abs(term) > Decimal(10) ** -65:
        term *= -angle * angle / ((k + 1) * (k + 2))
        total += term
        k += 2
    return total


def decimal_arctan(x: Decimal) -> Decimal:
    halvings = 0
    while x > Decimal("0.01"):  # atan x = 2 atan(x / (1 + √(1 + x²)))
        x = x / (1 + (1 + x * x).sqrt())
        halvings += 1
    term, total, k = x, x, 1
    while abs(term) > Decimal(10) ** -65:
        term *= -x * x
        k += 2
        total += term / k
    return total * (1 << halvings)


def nearest(value: Decimal) -> int:
    return int(value.quantize(Decimal(1), rounding=ROUND_HALF_EVEN))


def test_pi_is_right_to_the_last_bit() -> None:
    for bits in (1, 8, 53, 160):
        assert pi_scaled(bits) == nearest(PI * (1 << bits))


@pytest.mark.parametrize("entries", [1, 2, 4, 64, 1024])
@pytest.mark.parametrize("frac_bits", [2, 15, 30])
def test_every_table_entry_is_the_sine_correctly_rounded(entries: int, frac_bits: int) -> None:
    table = quarter_sine_table(entries, frac_bits)
    assert len(table) == entries + 1
    step = max(entries // 64, 1)
    for index in [*range(0, entries + 1, step), entries - 1, entries]:
        exact = decimal_sine(PI / 2 * index / entries) * (1 << frac_bits)
        assert table[index] == nearest(exact), index


def test_a_table_rises_from_zero_to_exactly_one() -> None:
    table = quarter_sine_table(65536, 30)
    assert table[0] == 0
    assert table[-1] == 1 << 30
    assert all(one <= two for one, two in pairwise(table))


@pytest.mark.parametrize("iterations", [1, 16, 34])
def test_the_cordic_constants_are_correctly_rounded(iterations: int) -> None:
    start, *angles = cordic_table(iterations, 30)
    gain = Decimal(1)
    for i in range(iterations):
        gain *= (1 + Decimal(4) ** -i).sqrt()
    assert start == nearest((1 << (30 + CORDIC_GUARD_BITS)) / gain)
    for i, angle in enumerate(angles):
        turns = decimal_arctan(Decimal(2) ** -i) / (2 * PI)
        assert angle == nearest(turns * (1 << CORDIC_ANGLE_BITS)), i


def direction(config: KernelConfig, phase_turn_q32: int) -> tuple[float, float]:
    state = State()
    find_direction(state, config, config.table, phase_turn_q32)
    scale = 1 << config.trig_frac_bits
    return state.cosine_q / scale, state.sine_q / scale


PHASES = [*range(0, 1 << 32, 7_654_321), 0, 1 << 30, 1 << 31, 3 << 30, (1 << 32) - 1]
UNIT = 2.0**-30


def bound_of(trig: dict[str, object]) -> float:
    """Return the largest error the method can have, from theory."""
    if trig["method"] == "cordic":
        # the last rotation's angle, what each of 30 floor shifts drops, and the result's rounding
        return math.atan(2.0**-29) + 30 * UNIT / 16 + 2 * UNIT
    step = math.pi / 2 / int(str(trig["entries"]))
    if trig["interpolated"]:
        return step * step / 8 + 1.5 * UNIT  # chord below the arc; two roundings
    return step / 2 + UNIT  # half a step to the nearest entry


@pytest.mark.parametrize(
    "trig",
    [
        {"method": "table", "entries": 1, "interpolated": True},
        {"method": "table", "entries": 64, "interpolated": True},
        {"method": "table", "entries": 1024, "interpolated": True},
        {"method": "table", "entries": 64, "interpolated": False},
        {"method": "table", "entries": 1024, "interpolated": False},
        {"method": "cordic", "iterations": 30},
    ],
    ids=str,
)
def test_sine_and_cosine_stay_within_the_methods_error(trig: dict[str, object]) -> None:
    config = config_of(trig=trig)
    bound = bound_of(trig)
    for phase in PHASES:
        angle = phase * 2.0 * math.pi / (1 << 32)
        cosine, sine = direction(config, phase)
        assert abs(cosine - math.cos(angle)) <= bound, phase
        assert abs(sine - math.sin(angle)) <= bound, phase


def test_the_four_compass_points_are_exact_by_table() -> None:
    config = config_of()
    points = [direction(config, quarter << 30) for quarter in range(4)]
    assert points == [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]


def test_a_half_turn_negates_exactly_and_a_quarter_turn_swaps_exactly() -> None:
    for method in ("table", "cordic"):
        config = config_of(trig={"method": method})
        for phase in PHASES:
            cosine, sine = direction(config, phase)
            half = direction(config, (phase + (1 << 31)) % (1 << 32))
            quarter = direction(config, (phase + (1 << 30)) % (1 << 32))
            assert half == (-cosine, -sine)
            assert quarter == (-sine, cosine)
