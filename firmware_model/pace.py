"""What a robot that has to go its way can still gain by turning: the ticks are shared by both.

A frame of k ticks goes at most k times the way of a tick, along a direction of which the axis sees
the share c, |c| ≤ D. From one frame to the next c changes by d at most, by what the robot turns in
the longer of the two, and each change is worth half of what a run of `play` has, for each unit of
it. A price p for each unit of way leaves of a pair of frames, half of each taken,

½(|c₁| − p)⁺·k₁·pace + ½(|c₂| − p)⁺·k₂·pace + ½·play·|c₂ − c₁|,

which is convex in both c: it is largest at a corner of what they may be, where one is D, and the
other D as well or d less. To be far from the axis for the turn's sake costs way. With p for all the
way there is, any price gives a bound; the least of them is taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_SEARCHES: Final = 60
_CAREFUL: Final = 1.0 + 1e-9
"""Far more than floats are off."""


@dataclass(frozen=True)
class Pace:
    """What a robot can do in a tick.

    Attributes:
        way: it goes at most so far in a tick; in so many ticks, so many times that.
        turn_rad: it turns at most so far in a tick.
        jump: by so much the share c of two frames may differ beyond that.
        longest_ticks: of a frame.
        largest_share: D, at most 1.
    """

    way: float
    turn_rad: float
    jump: float
    longest_ticks: int
    largest_share: float

    def bound(self, way: float, ticks: int, play: float) -> float:
        """Return a bound of way and half of *play* for each change of c, together.

        Args:
            way: all of it, in the unit of the result.
            ticks: that there are.
            play: what a change of c by 2 is worth, in the unit of the result.
        """
        largest, turn_rad = self.largest_share, self.turn_rad
        most_ticks = self.longest_ticks
        if turn_rad * most_ticks > 2.0 * largest:
            most_ticks = int(2.0 * largest / turn_rad) + 1

        def of_a_pair(price: float, before: int, after: int) -> float:
            change = min(max(before, after) * turn_rad + self.jump, 2.0 * largest)
            straight = before * self.way * (largest - price)
            turned_away = after * self.way * max(abs(largest - change) - price, 0.0)
            return (straight + turned_away + play * change) / (before + after)

        def total(price: float) -> float:
            longer = dict.fromkeys(self._corners(price, play, most_ticks))
            pairs = (pair for one in longer for pair in ((one, one), (one, 1), (1, one)))
            most = max(of_a_pair(price, *pair) for pair in pairs)
            return ticks * max(self.way * (largest - price), most) + price * way

        low, high = 0.0, largest
        for _ in range(_SEARCHES):  # the total is convex in the price
            first, second = low + (high - low) / 3.0, high - (high - low) / 3.0
            low, high = (low, second) if total(first) <= total(second) else (first, high)
        return min(total(one) for one in (0.0, low, largest)) * _CAREFUL

    def _corners(self, price: float, play: float, most_ticks: int) -> Iterator[int]:
        """Yield the ticks of a pair's longer frame that can be worth most, of 1 to *most_ticks*.

        What a pair leaves for each of its ticks is a convex function of k over a line, and so
        largest at an end of a stretch; but for the second frame's way, k·(D − change − p), while
        there is any: a concave one over a line has one top, where its slope is zero.
        """
        largest, turn_rad, jump = self.largest_share, self.turn_rad, self.jump
        found = [1.0, float(most_ticks)]
        if turn_rad > 0.0:
            ends = largest - price, largest + price, 2.0 * largest
            found += [(one - jump) / turn_rad for one in ends]
        steep = self.way * turn_rad
        if steep > 0.0:
            linear = self.way * (largest - price - jump) + play * turn_rad
            constant = self.way * (largest - price) + play * jump
            square = 1.0 + (linear - constant) / steep
            found.append(math.sqrt(max(square, 0.0)) - 1.0)
        for one in found:
            least = math.floor(min(max(one, 1.0), most_ticks))
            yield least
            yield min(least + 1, most_ticks)
