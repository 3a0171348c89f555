"""The causes of firmware − float, and what each contributes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from firmware_model.integers import FLOOR, HALF_EVEN, HALF_UP, TOWARD_ZERO

Floats = NDArray[np.float64]
Growth = Literal["bounded", "distance", "ticks", "√ticks"]

CAUSES: Final[dict[str, tuple[Growth, str]]] = {
    "constants": ("distance", "scale constants, rounded once"),
    "heading_quantum": ("distance", "the direction of a step has the heading's fraction bits"),
    "table_error": ("distance", "entries of the sine table, or CORDIC's last angle"),
    "interpolation": ("distance", "the chord lies below the sine; its rounding"),
    "rounding_bias": ("ticks", "the mean of what is dropped each tick"),
    "rounding_noise": ("√ticks", "the rest of what is dropped each tick"),
    "position_quantum": ("bounded", "the part of x and y below one unit"),
    "carried_remainder": ("bounded", "remainders of step and turn that wait for the next tick"),
    "float_twin": ("√ticks", "the float64 arithmetic that the firmware is held against"),
}
"""Name of each cause: how it grows, and what it is."""


@dataclass(frozen=True)
class Share:
    """What one cause contributes to firmware − float at the end of a drive.

    Attributes:
        position_m, heading_rad: in magnitude.
    """

    position_m: float = 0.0
    heading_rad: float = 0.0


def largest_drop(rounding: int, bits: int) -> float:
    """Return the largest |rounded − value| when *bits* fraction bits are dropped [units].

    A value has 2^bits equally spaced fractions: floor and toward zero err by at most 1 − 2^−bits,
    half-up and half-even by at most one half.
    """
    if bits <= 0:
        return 0.0
    return 0.5 if rounding in (HALF_UP, HALF_EVEN) else 1.0 - 2.0**-bits


def mean_drop(rounding: int, bits: int) -> float:
    """Return |mean| of rounded − value for evenly spread fractions [units].

    floor: ½ − 2^−(bits+1); toward zero the same, toward zero on either side; half-up 2^−(bits+1),
    by its ties; half-even 0. (B. Widrow and I. Kollár, Quantization Noise, Cambridge, 2008, ch. 4.)
    """
    if bits <= 0 or rounding == HALF_EVEN:
        return 0.0
    tie = 2.0 ** -(bits + 1)
    return tie if rounding == HALF_UP else 0.5 - tie


def mean_errors(values: NDArray[np.floating[Any]], rounding: int, bits: int) -> Floats:
    """Return the mean of rounded − value for evenly spread fractions, with the sign it has there.

    Only toward zero asks the value for its sign.
    """
    mean = mean_drop(rounding, bits)
    if rounding == TOWARD_ZERO:
        return np.asarray(-mean * np.sign(values), dtype=np.float64)
    return np.full(values.shape, mean if rounding == HALF_UP else -mean)


SPREAD: Final = 12.0**-0.5
"""Standard deviation of rounded − value for evenly spread fractions [units]."""


def rounding_error(values: NDArray[np.floating[Any]], rounding: int) -> Floats:
    """Return rounded − value of each value, in its own unit."""
    if rounding == FLOOR:
        rounded = np.floor(values)
    elif rounding == HALF_UP:
        rounded = np.floor(values + 0.5)
    elif rounding == HALF_EVEN:
        rounded = np.rint(values)
    else:
        rounded = np.trunc(values)
    return np.asarray(rounded - values, dtype=np.float64)
