"""When a fault strikes: in a window of time, so often, at exact turns or with a seeded chance."""

from __future__ import annotations

import random
from collections.abc import Collection

from can_bus.errors import CanBusError


class Strikes:
    """Decides, frame by frame, about the frames that a fault could strike.

    Args:
        start, stop: window of time, stop exclusive; None never stops. Any unit.
        count: how many it strikes at most; None means no limit.
        probability: with which it strikes each.
        turns: strikes exactly these of the frames in the window (0 is the first); None: all.
        stream: of its own, so that another fault does not shift its draws.

    `random` is that stream, for whatever else the fault draws.
    """

    __slots__ = ("_probability", "_start", "_stop", "_turn", "_turns", "random", "remaining")

    def __init__(
        self,
        *,
        start: int,
        stop: int | None,
        count: int | None,
        probability: float,
        stream: random.Random,
        turns: Collection[int] | None = None,
    ) -> None:
        """Start with no frame seen."""
        self.remaining = count
        self.random = stream
        self._start = start
        self._stop = stop
        self._probability = probability
        self._turns = None if turns is None else frozenset(turns)
        self._turn = -1

    def is_open(self, now: int) -> bool:
        """Tell whether a time is in the window."""
        return self._start <= now and (self._stop is None or now < self._stop)

    def strike(self, now: int) -> bool:
        """Decide about the next frame that the fault could strike; draws only in its window."""
        if not self.is_open(now) or self.remaining == 0:
            return False
        self._turn += 1
        if self._turns is not None and self._turn not in self._turns:
            return False
        if self._probability < 1.0 and self.random.random() >= self._probability:
            return False
        if self.remaining is not None:
            self.remaining -= 1
        return True


def check_chance(what: str, probability: float, count: int | None) -> None:
    """Raise CanBusError for a probability or a count that makes no sense."""
    if not 0.0 <= probability <= 1.0:
        raise CanBusError(f"{what}: probability = {probability}: expected 0 to 1")
    if count is not None and count < 0:
        raise CanBusError(f"{what}: count = {count}: expected 0 or more")
