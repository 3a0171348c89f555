"""What steps can carry x or y to and fro with little way: whole units, of a few counts.

An axis sees the share c_i of step s_i. It is half the sum, over all θ of −1 to 1, of the signs of
c_i − θ. So Σ c_i·s_i is the mean over θ of sums Σ ±s_i whose sign changes as often as c crosses θ;
those crossings add up to Σ|c_{i+1} − c_i| over all θ. Between two changes lies a run, of one sign:
it adds up to S, the difference of the step's whole units at its ends, and Σ c_i·s_i ≤ most for a
run · (2 + Σ|c_{i+1} − c_i|) / 2.

In a run the counters gain n counts, h units each, of which trembling may be J and the rest is way
x: n ≤ x + J. Units are whole: n counts are at most D(n) of them, ⌊n·h + ψ⌋ with what a remainder
can add, ψ. To have one more than D(J) takes whole counts of way. With a price p ≥ 1 for a unit of
way,

D(n) ≤ x·h + (p − 1)·|x|·h + each(p), each(p) = max over n, x ≥ n − J of D(n) − x·h − (p − 1)·|x|·h:

the first sums up to the way along the axis, the second to p − 1 times the way, and each run has
each(p). Any price gives a bound. At p = 1, each is J·h + ψ at most.

Rounding toward zero has play of its own: after a step forward its remainder is forward. The sum is
largest with changes of sign where a step forward is the last and one back the next; then n counts
are ⌊n·h⌋ units, but for the first run, which a remainder may have helped. What such a run has of
way is all counted as p times its length, x·h + (p − 1)·|x|·h ≤ p·|x|·h, because changes of sign are
not those of c any more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from firmware_model.integers import FLOOR, HALF_EVEN, HALF_UP, TOWARD_ZERO

if TYPE_CHECKING:
    from firmware_model.config import KernelConfig

_SPANS: Final = {
    FLOOR: lambda unit: unit - 1,
    HALF_UP: lambda unit: unit - 1,
    HALF_EVEN: lambda unit: unit,
    TOWARD_ZERO: lambda unit: 2 * (unit - 1),
}
"""From the least remainder to the largest."""
_BEYOND: Final = 32
"""So many units more than those of trembling are looked at one by one."""
_MOST: Final = 1024
"""Where trembling alone is more units than that, whole ones make no difference."""


@dataclass(frozen=True)
class Play:
    """What a run of steps can have.

    Attributes:
        count_q: h [2^-shift units].
        shift: fraction bits of `count_q`.
        span_q: ψ [2^-shift units].
        jitter: J [encoder ticks].
        is_whole: steps are whole units of all counts so far; False: each is rounded for itself.
        is_one_way: runs are those that rounding toward zero ends where they are longest.
    """

    count_q: int
    shift: int
    span_q: int
    jitter: Fraction
    is_whole: bool
    is_one_way: bool = False

    @classmethod
    def of(cls, config: KernelConfig, jitter: Fraction) -> tuple[Play, ...]:
        """Return what bounds a configuration whose counters tremble by so many counts."""
        unit, is_carried = 1 << config.step_shift, bool(config.step_carry and config.step_shift)
        span_q = 0
        if is_carried:
            span_q = {
                FLOOR: unit - 1,
                HALF_UP: unit - 1,
                HALF_EVEN: unit,
                TOWARD_ZERO: 2 * unit - 2,
            }[config.step_rounding]
        is_whole = is_carried or config.step_shift == 0
        plain = cls(config.half_tick_m_q, config.step_shift, span_q, jitter, is_whole)
        if is_carried and config.step_rounding == TOWARD_ZERO:
            return plain, replace(plain, span_q=0, is_one_way=True)
        return (plain,)

    @property
    def count(self) -> Fraction:
        """How many units a count is: h."""
        return Fraction(self.count_q, 1 << self.shift)

    @property
    def once(self) -> int:
        """How many units the first run may have more."""
        return int(self.is_one_way)

    def prices(self) -> Iterator[Fraction]:
        """Yield prices of a unit of way, of which the least bound may be taken."""
        yield Fraction(1)
        if not self.is_whole or self.count_q == 0 or self._units(self._still) > _MOST:
            return
        least = self._units(self._still)
        dearest = Fraction(1)
        for units in range(least + 1, least + _BEYOND):
            way = self._counts(units) - self.jitter
            dearest = max(dearest, (units - least) / (way * self.count))
        if dearest > 1:
            yield from (1 + (dearest - 1) * Fraction(part, 4) for part in (1, 2, 3, 4))
        if dearest < 2:
            yield Fraction(2)  # from which on way back is worth nothing

    def each(self, price: Fraction) -> Fraction:
        """Return what each run can have at most beside its way at that price [units]."""
        plain = self.jitter * self.count + Fraction(self.span_q, 1 << self.shift)
        if price == 1 or self.count_q == 0:
            return plain
        least, most = -_BEYOND, self._units(self._still) + _BEYOND
        if self.is_one_way:
            least = 0
        found = [self._left(units, price) for units in range(least, most + 1)]
        # Beyond those D(n) ≤ n·h + ψ: worth less the farther they are.
        span = Fraction(self.span_q, 1 << self.shift)
        ends = []
        for counts in (self._counts(least), self._counts(most + 1)):
            way = counts - self.jitter
            ends.append(counts * self.count + span - self._cost(way, price))
        return min(max(*found, *ends), plain)

    @property
    def _still(self) -> int:
        return math.floor(self.jitter)

    def _units(self, counts: int) -> int:
        """Return D(counts)."""
        return (counts * self.count_q + self.span_q) >> self.shift

    def _counts(self, units: int) -> int:
        """Return the fewest counts that are so many units."""
        return -(-((units << self.shift) - self.span_q) // self.count_q)

    def _cost(self, way: Fraction, price: Fraction) -> Fraction:
        """Return what so many counts of way cost [units]."""
        if way < 0 and (price >= 2 or self.is_one_way):
            return Fraction(0)  # to go back costs more than it gives
        return (way + (price - 1) * abs(way)) * self.count

    def _left(self, units: int, price: Fraction) -> Fraction:
        """Return what is left of so many units after the way that they take at least."""
        way = self._counts(units) - self.jitter
        return units - self._cost(way, price)


@lru_cache(maxsize=256)
def priced(play: Play) -> tuple[tuple[Fraction, Fraction], ...]:
    """Return each price with what a run can have at it [units], however long a drive is."""
    return tuple((price, play.each(price)) for price in play.prices())
