"""What sits on the bus in a run: the Node protocol that plant, firmware and devices share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import can


class Node(Protocol):
    """Anything that takes part in the loop.

    Called once per tick with the time and the frames that have arrived since the last call, it
    returns the frames it sends. It never reads a clock.
    """

    def step(self, now_us: int, frames: Sequence[can.Message], /) -> Sequence[can.Message]:
        """Take one step at `now_us` (whole microseconds)."""
        ...


class TriggeredNode(Node, Protocol):
    """A node that, in real time, steps when a given set of frames is complete."""

    @property
    def trigger_ids(self) -> frozenset[tuple[int, bool]]:
        """Identifiers (number, is extended) of the frames that make a tick's input complete."""
        ...
