"""Numbers for people keep their value: what is printed reads back within its digits."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chiplog.pages import quantities as q

_FACTORS = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9, "pm": 1e-12}
_FOUR_DIGITS = 5.001e-4  # half a unit of the fourth digit, of a number that starts with 1


@given(st.floats(1e-12, 1e6) | st.floats(-1e6, -1e-12))
def test_a_length_reads_back_to_four_digits(value_m: float) -> None:
    number, unit = q.length(value_m).split()
    read_m = float(number.replace(q.MINUS, "-")) * _FACTORS[unit]
    assert read_m == pytest.approx(value_m, rel=_FOUR_DIGITS)


@given(st.floats(1e-12, 999.0))
def test_a_length_has_one_to_three_digits_before_the_point(value_m: float) -> None:
    number, _ = q.length(value_m).split()
    assert 1 <= float(number) < 1000


@pytest.mark.parametrize(
    ("value_m", "text"),
    [
        (5.280128, "5.280 m"),
        (0.9999999, "1.000 m"),
        (-2.1e-7, "−210.0 nm"),
        (0.0, "0 m"),
        (None, "–"),
        (math.nan, "–"),
    ],
)
def test_lengths_look_like_this(value_m: float | None, text: str) -> None:
    assert q.length(value_m) == text


@pytest.mark.parametrize(
    ("value_rad", "text"),
    [(math.radians(17.215566), "17.22°"), (1.6e-8, "16.00 nrad"), (0.0, "0°"), (None, "–")],
)
def test_angles_look_like_this(value_rad: float | None, text: str) -> None:
    assert q.angle(value_rad) == text


@pytest.mark.parametrize(
    ("value_s", "text"),
    [(60.0, "60 s"), (0.01, "10 ms"), (90.5, "90.5 s"), (3600.0, "60 min"), (125.0, "2 min 5 s")],
)
def test_durations_look_like_this(value_s: float, text: str) -> None:
    assert q.duration(value_s) == text


def test_minus_zero_has_no_sign() -> None:
    assert q.fixed(-1e-9, 3) == "0.000"
