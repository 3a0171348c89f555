"""What a robot that has to go its way can still gain by turning: the ticks are shared by both.

A frame of k ticks goes at most k times the way of a tick, along a direction of which the axis sees
the share c, |c| ≤ D. From one frame to the next c changes by d at most, by what the robot turns in
the longer of the two, and each change is worth half a `play` for each unit of it (the sums of
`reach`). A price p for each unit of way leaves of a pair of frames, half of each taken,

½(|c₁| − p)⁺·k₁·pace + ½(|c₂| − p)⁺·k₂·pace + ½·play·|c₂ − c₁|,

which is convex in both c: it is largest at a corner of what they may be, where one is D, and the
other D as well or d less. To be far from the axis for the turn's sake costs way. With p for all the
way there is, any price gives a bound; the least of them is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
        largest = self.largest_share
        high_ticks = self.longest_ticks
        if self.turn_rad * high_ticks > 2.0 * largest:
            high_ticks = int(2.0 * largest / self.turn_rad) + 1
        longer = np.arange(1, high_ticks + 1, dtype=np.float64)
        change = np.minimum(longer * self.turn_rad + self.jump, 2.0 * largest)
        before = np.concatenate([longer, longer, np.ones_like(longer)])
        after = np.concatenate([longer, np.ones_like(longer), longer])
        change = np.tile(change, 3)
        turned_away = np.abs(largest - change)

        def total(price: float) -> float:
            straight = self.way * (largest - price)
            of_a_pair: NDArray[np.float64] = (
                before * straight
                + after * self.way * np.maximum(turned_away - price, 0.0)
                + play * change
            ) / (before + after)
            return ticks * max(straight, float(of_a_pair.max())) + price * way

        low, high = 0.0, largest
        for _ in range(_SEARCHES):  # the total is convex in the price
            first, second = low + (high - low) / 3.0, high - (high - low) / 3.0
            low, high = (low, second) if total(first) <= total(second) else (first, high)
        return min(total(one) for one in (0.0, low, largest)) * _CAREFUL
