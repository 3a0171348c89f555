"""Sums over the ticks of a drive that comes some at a time: the same bits as all at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_model.integers import TOWARD_ZERO
from precision_study.budget.causes import mean_errors, rounding_error

Floats = NDArray[np.float64]


class Delay:
    """Values some ticks late; zero at first."""

    def __init__(self, ticks: int) -> None:
        """Begin; 0 ticks hand on what comes."""
        self._late = np.zeros(ticks)

    def through(self, values: Floats) -> Floats:
        """Return the values of the next ticks, late."""
        both = np.concatenate([self._late, values])
        self._late = both[len(values) :].copy()
        return both[: len(values)]


class Sum:
    """A running sum."""

    def __init__(self) -> None:
        """Begin at zero."""
        self._total = 0.0

    def add(self, values: NDArray[np.floating[Any]]) -> Floats:
        """Return the sum after each of the next values."""
        sums = np.cumsum(np.concatenate([[self._total], values]))
        self._total = float(sums[-1])
        return sums[1:]


class RoundedSum:
    """A sum of values in units of its rounding, of which whole ones are kept."""

    def __init__(self, rounding: int, *, carry: bool = True) -> None:
        """Begin at zero; with *carry* what is left over goes to the next value."""
        self._rounding, self._carry = rounding, carry
        self._sum = Sum()
        self._remainder = 0.0

    def left_over(self, values: NDArray[np.floating[Any]]) -> Floats:
        """Return rounded − exact sum after each of the next values, remainders carried."""
        if self._rounding != TOWARD_ZERO:
            return rounding_error(self._sum.add(values), self._rounding)
        errors, remainder = np.empty(len(values)), self._remainder
        for tick, value in enumerate(values.tolist()):
            remainder = math.fmod(remainder + value, 1.0)  # of the sign that the total has
            errors[tick] = -remainder
        self._remainder = remainder
        return errors

    def add(self, values: NDArray[np.floating[Any]]) -> Floats:
        """Return the rounded sum after each of the next values."""
        if not self._carry:
            return self._sum.add(np.rint(values + rounding_error(values, self._rounding)))
        if self._rounding != TOWARD_ZERO:
            exact = self._sum.add(values)
            return np.rint(exact + rounding_error(exact, self._rounding))
        left_over = self.left_over(values)
        return np.rint(self._sum.add(values) + left_over)


class MeanLeftOver:
    """The mean of what a carried sum leaves over, for evenly spread fractions."""

    def __init__(self, rounding: int, bits: int) -> None:
        """Begin; *bits* fraction bits are left over."""
        self._rounding, self._bits = rounding, bits
        self._left_over = RoundedSum(rounding)
        self._moved = False

    def add(self, values: NDArray[np.floating[Any]]) -> Floats:
        """Return the mean after each of the next values; 0 before the first that is not 0."""
        if self._rounding == TOWARD_ZERO:
            left_over = self._left_over.left_over(values)
            return mean_errors(-left_over, self._rounding, self._bits)
        moved = np.logical_or.accumulate(values != 0.0) | self._moved
        self._moved = bool(moved[-1])
        return np.where(moved, mean_errors(values, self._rounding, self._bits), 0.0)
