"""Narrowing: rounding, wrapping, saturating, against exact arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.integers import (
    FLOOR,
    HALF_EVEN,
    HALF_UP,
    INTERMEDIATE_LIMIT,
    SATURATE,
    TOWARD_ZERO,
    WRAP,
    add_limited,
    limit,
    shift_round,
    sum_exceeds,
    wrap_signed,
)

EXACT = {
    FLOOR: math.floor,
    HALF_UP: lambda value: math.floor(value + Fraction(1, 2)),
    HALF_EVEN: round,
    TOWARD_ZERO: math.trunc,
}
INTERMEDIATE = st.integers(-INTERMEDIATE_LIMIT, INTERMEDIATE_LIMIT)


@pytest.mark.parametrize("rounding", EXACT)
def test_every_small_value_rounds_as_exact_arithmetic_says(rounding: int) -> None:
    for bits in range(6):
        for value in range(-200, 201):
            exact = EXACT[rounding](Fraction(value, 1 << bits))
            assert shift_round(value, bits, rounding) == exact, (value, bits)


@given(INTERMEDIATE, st.integers(0, 61), st.sampled_from(sorted(EXACT)))
def test_any_value_rounds_as_exact_arithmetic_says(value: int, bits: int, rounding: int) -> None:
    assert shift_round(value, bits, rounding) == EXACT[rounding](Fraction(value, 1 << bits))


def test_the_roundings_disagree_where_the_manual_says_they_do() -> None:
    by_mode = {
        mode: [shift_round(value, 1, mode) for value in (-3, -1, 1, 3)]
        for mode in (FLOOR, HALF_UP, HALF_EVEN, TOWARD_ZERO)
    }
    assert by_mode == {
        FLOOR: [-2, -1, 0, 1],
        HALF_UP: [-1, 0, 1, 2],
        HALF_EVEN: [-2, 0, 0, 2],
        TOWARD_ZERO: [-1, 0, 0, 1],
    }


@given(INTERMEDIATE, st.integers(1, 62))
def test_wrapping_keeps_the_value_modulo_the_word_and_lands_in_it(value: int, bits: int) -> None:
    wrapped = wrap_signed(value, bits)
    assert (wrapped - value) % (1 << bits) == 0
    assert -(1 << (bits - 1)) <= wrapped < 1 << (bits - 1)


def words(low: int = 1, high: int = 64) -> st.SearchStrategy[tuple[int, int]]:
    return st.integers(low, high).map(lambda bits: (-(1 << (bits - 1)), (1 << (bits - 1)) - 1))


@given(INTERMEDIATE.filter(lambda value: abs(value) < INTERMEDIATE_LIMIT), words(2))
def test_a_limited_value_wraps_or_stays_at_the_end_of_its_word(
    value: int, word: tuple[int, int]
) -> None:
    low, high = word
    assert limit(value, low, high, SATURATE) == min(max(value, low), high)
    wrapped = limit(value, low, high, WRAP)
    assert low <= wrapped <= high
    assert (wrapped - value) % (high - low + 1) == 0


@given(st.data(), words(2), INTERMEDIATE.filter(lambda value: abs(value) < INTERMEDIATE_LIMIT))
def test_a_limited_sum_is_the_exact_sum_wrapped_or_saturated(
    data: st.DataObject, word: tuple[int, int], increment: int
) -> None:
    low, high = word
    accumulator = data.draw(st.integers(low, high) | st.sampled_from([low, high, 0, -1]))
    exact = accumulator + increment
    assert sum_exceeds(accumulator, increment, low, high) == (not low <= exact <= high)
    assert add_limited(accumulator, increment, low, high, SATURATE) == min(max(exact, low), high)
    span = high - low + 1
    assert add_limited(accumulator, increment, low, high, WRAP) == (exact - low) % span + low
