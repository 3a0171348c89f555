"""Sums over the ticks of a drive that comes some at a time: the same bits as all at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from firmware_model.integers import FLOOR, HALF_UP, TOWARD_ZERO
from precision_study.budget.causes import rounding_error

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


@dataclass(frozen=True)
class Narrowed:
    """Values that are rounded tick by tick, in units of what is kept of them.

    Attributes:
        values: before rounding.
        whole: what is kept of each.
        error: kept − exact: of the sum so far where remainders are carried, else of each value.
    """

    values: Floats
    whole: Floats
    error: Floats


class Rounding:
    """Rounds values that come tick by tick."""

    def __init__(self, rounding: int, *, carry: bool) -> None:
        """Begin; with *carry* what is left over goes to the next value."""
        self._rounding, self._carry = rounding, carry
        self._sum = Sum()
        self._error = 0.0

    def add(self, values: Floats) -> Narrowed:
        """Round the next values."""
        if not self._carry:
            error = rounding_error(values, self._rounding)
            return Narrowed(values, np.rint(values + error), error)
        before = self._error
        error = self._left_over(values)
        self._error = float(error[-1])
        return Narrowed(values, np.rint(values + np.diff(error, prepend=before)), error)

    def _left_over(self, values: Floats) -> Floats:
        """Return rounded − exact sum after each of the next values."""
        if self._rounding in (FLOOR, HALF_UP):
            return rounding_error(self._sum.add(values), self._rounding)
        errors: Floats = _tick_by_tick(values, self._error, self._rounding == TOWARD_ZERO)
        return errors


@njit(cache=True, nogil=True)
def _tick_by_tick(values: Floats, error: float, toward_zero: bool) -> Floats:
    """Return rounded − exact sum where a tick's total decides: by its sign or by being even."""
    errors, rest = np.empty(len(values)), -error
    for tick in range(len(values)):
        total = rest + values[tick]
        rest = total - (np.trunc(total) if toward_zero else np.rint(total))
        errors[tick] = -rest
    return errors
