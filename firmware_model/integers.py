"""The only places where an integer gets narrower: rounding shifts, word limits, wrapping.

Every function here takes and returns what C99 calls ``int64_t``. "Scaling and overflow" says why
no intermediate leaves that type, so that Python's unbounded integers, numba's wrapping ones and
C's undefined ones agree. Python's ``>>`` of a negative number is the floor shift; C99 leaves it
to the implementation, so `floor_shift` is the one place that uses it on signed values.
"""

from __future__ import annotations

from typing import Final

from firmware_model._source import kernel_function, rare_kernel_function

FLOOR: Final = 0
"""Round toward −∞: what a bare arithmetic shift does."""
HALF_UP: Final = 1
"""Round to nearest, ties toward +∞: add half, then shift."""
HALF_EVEN: Final = 2
"""Round to nearest, ties to the even neighbour."""
TOWARD_ZERO: Final = 3
"""Drop the fraction of the magnitude: what C's division does."""

WRAP: Final = 0
"""Modulo 2^word, as two's complement hardware does."""
SATURATE: Final = 1
"""Stay at the word's limit."""

INTERMEDIATE_LIMIT: Final = 1 << 62
"""Every product and sum that is narrowed is smaller than this in magnitude: half of int64, so
that adding half a quantum before a shift cannot overflow. `build_config` proves it."""


@kernel_function
def floor_shift(value: int, bits: int) -> int:
    """Return ⌊value / 2^bits⌋, for *bits* of 0 to 62."""
    return value >> bits


@kernel_function
def shift_round(value: int, bits: int, rounding: int) -> int:
    """Return value / 2^bits rounded as *rounding* says.

    Scaling and overflow: drops *bits* (0 to 61) fraction bits. |value| ≤ 2^62; what is added is
    below a quantum (2^61), so the sum stays inside 64 bits.
    """
    # FLOOR is 0 and HALF_UP is 1: nothing or half a quantum, for 0 bits too.
    added = (rounding << bits) >> 1
    if rounding == HALF_EVEN:
        # Half a quantum to an odd quotient, one unit less than that to an even one.
        added = ((1 << bits) - 1 + (floor_shift(value, bits) & 1)) >> 1
    elif rounding == TOWARD_ZERO:
        added = 0
        if value < 0:
            added = (1 << bits) - 1
    return floor_shift(value + added, bits)


@kernel_function
def wrap_signed(value: int, bits: int) -> int:
    """Return *value* modulo 2^bits in [−2^(bits−1), 2^(bits−1)).

    Scaling and overflow: bits is 1 to 62 and |value| ≤ 2^62, so adding half the span fits. In
    C the sum and the mask are unsigned.
    """
    half = 1 << (bits - 1)
    return ((value + half) & ((1 << bits) - 1)) - half


@kernel_function
def exceeds(value: int, low: int, high: int) -> int:
    """Return 1 when *value* lies outside [low, high], else 0."""
    if value < low or value > high:
        return 1
    return 0


@rare_kernel_function
def limit(value: int, low: int, high: int, overflow: int) -> int:
    """Return *value* brought into a two's complement word [low, high] by WRAP or SATURATE.

    Scaling and overflow: low is −high − 1. |value| ≤ 2^62. A word of 64 bits contains every such
    value, so the subtraction below happens only for words of at most 62 bits and fits.
    """
    if value < low:
        if overflow == SATURATE:
            return low
    elif value > high:
        if overflow == SATURATE:
            return high
    else:
        return value
    return ((value - low) & (high - low)) + low


@kernel_function
def sum_exceeds(accumulator: int, increment: int, low: int, high: int) -> int:
    """Return 1 when accumulator + increment lies outside [low, high], else 0; never overflows.

    Scaling and overflow: the accumulator is inside the word and |increment| ≤ 2^62; the limit is
    compared with the *difference*, which fits even for a word of 64 bits.
    """
    if increment > 0:
        if accumulator > high - increment:
            return 1
    elif accumulator < low - increment:
        return 1
    return 0


@rare_kernel_function
def add_limited(accumulator: int, increment: int, low: int, high: int, overflow: int) -> int:
    """Return accumulator + increment in the word [low, high] by WRAP or SATURATE.

    Scaling and overflow: words of up to 64 bits. The plain sum is formed only when it fits. When
    it does not, both terms have the same sign after *increment* is wrapped into the word, so each
    is first moved by half the word's span and their sum is the wrapped one.
    """
    if sum_exceeds(accumulator, increment, low, high) == 0:
        return accumulator + increment
    if overflow == SATURATE:
        if increment > 0:
            return high
        return low
    step = limit(increment, low, high, WRAP)
    if sum_exceeds(accumulator, step, low, high) == 0:
        return accumulator + step
    if step > 0:
        return (accumulator + low) + (step + low)
    return (accumulator - low) + (step - low)
