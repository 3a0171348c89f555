"""Sine tables and CORDIC constants, correctly rounded by integer arithmetic.

``math.sin`` changes its last bit with the processor; these values are the same everywhere and
could be typed into a C array.
"""

from __future__ import annotations

from functools import lru_cache
from math import isqrt
from typing import Final

CORDIC_ANGLE_BITS: Final = 40
"""CORDIC's residual angle is an integer in units of 2^−40 turn."""
CORDIC_GUARD_BITS: Final = 4
"""CORDIC's vector carries this many more fraction bits than its result."""

_WORK_BITS: Final = 160  # fraction bits of the work: far beyond the hardest tie of any table here


def _arctan_inverse(n: int, bits: int) -> int:
    """Return atan(1/n) in 2^−bits rad, a few units low or high (Gregory's series)."""
    term = (1 << bits) // n
    total, k, sign = 0, 1, 1
    while term:
        total += sign * (term // k)
        term //= n * n
        k, sign = k + 2, -sign
    return total


@lru_cache(maxsize=4)
def pi_scaled(bits: int) -> int:
    """Return round(π · 2^bits) (Machin: π = 16 atan(1/5) − 4 atan(1/239))."""
    guard = 32
    work = bits + guard
    return _round_shift(16 * _arctan_inverse(5, work) - 4 * _arctan_inverse(239, work), guard)


def _round_shift(value: int, bits: int) -> int:
    """Return value / 2^bits to nearest; refuse a value too near a tie to be decided."""
    half = 1 << (bits - 1)
    fraction = (value + half) & ((1 << bits) - 1)
    slack = 1 << (bits // 2)  # far above the few units by which the series may be off
    if not slack < fraction < (1 << bits) - slack:
        raise AssertionError("table value too near a tie for the work precision")
    return (value + half) >> bits


def _sine_cosine_scaled(angle: int) -> tuple[int, int]:
    """Return (sin, cos) of angle · 2^−_WORK_BITS rad in the same scale, by Taylor's series."""
    sine = cosine = 0
    term, k = 1 << _WORK_BITS, 0
    while term:
        if k % 2 == 0:
            cosine += -term if k % 4 == 2 else term
        else:
            sine += -term if k % 4 == 3 else term
        k += 1
        term = (term * angle >> _WORK_BITS) // k
    return sine, cosine


@lru_cache(maxsize=64)
def quarter_sine_table(entries: int, frac_bits: int) -> tuple[int, ...]:
    """Return sin(i/entries · 90°) · 2^frac_bits for i = 0…entries, each correctly rounded.

    The last value is exactly 2^frac_bits. Values above 45° are the cosines below it.
    """
    one = 1 << frac_bits
    if entries == 1:
        return (0, one)
    quarter_turn = pi_scaled(_WORK_BITS) // 2
    low: list[int] = []
    high: list[int] = []
    drop = _WORK_BITS - frac_bits
    for index in range(1, entries // 2 + 1):
        sine, cosine = _sine_cosine_scaled(quarter_turn * index // entries)
        low.append(_round_shift(sine, drop))
        high.append(_round_shift(cosine, drop))
    if entries % 2 == 0:
        high.pop()  # 45° is both
    return (0, *low, *reversed(high), one)


@lru_cache(maxsize=64)
def cordic_table(iterations: int, frac_bits: int) -> tuple[int, ...]:
    """Return [K, atan(2^0), atan(2^−1), …]: start length and the angle of each iteration.

    K = Π 1/√(1 + 2^−2i) over the iterations, in 2^−(frac_bits + CORDIC_GUARD_BITS); angles in
    2^−CORDIC_ANGLE_BITS turn; all correctly rounded (Volder 1959; Walther 1971).
    """
    gain_squared = 1 << _WORK_BITS
    for i in range(iterations):
        gain_squared += gain_squared >> (2 * i)
    # K · 2^W = 2^W / √(gain² / 2^W)
    gain = isqrt(gain_squared << _WORK_BITS)
    start_length = (1 << (2 * _WORK_BITS)) // gain
    drop = _WORK_BITS - frac_bits - CORDIC_GUARD_BITS
    two_pi = 2 * pi_scaled(_WORK_BITS)
    angles = [1 << (CORDIC_ANGLE_BITS - 3)]  # atan(1) is an eighth of a turn, exactly
    for i in range(1, iterations):
        radians = _arctan_inverse(1 << i, _WORK_BITS)
        turns = (radians << _WORK_BITS) // two_pi
        angles.append(_round_shift(turns, _WORK_BITS - CORDIC_ANGLE_BITS))
    return (_round_shift(start_length, drop), *angles)
