"""The other side of a real-time bus: it falls silent, it is back, and it is said when.

A node that was killed, an ECU without power and a bus that takes no frame end no run: the loop goes
on, the outage is told at once and listed at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple

import can

from can_bus import MessageSpec

SILENT_CYCLES: Final = 10
"""So many of its cycles without a frame, and a node that was there has fallen silent."""

_LEAST_SILENCE_US: Final = 100_000  # a busy machine wakes a process up that late
_MOST_KEPT: Final = 1000  # a node that flaps for a day: the rest is only counted

Tell = Callable[[str], None]
"""Hears a line when an outage begins and when it ends."""


class Outage(NamedTuple):
    """When a node was silent, or the bus took no frame: seconds since the run began.

    `start_s` is the last sign of life before it; `stop_s` is None where it lasted to the end.
    """

    node: str
    start_s: float
    stop_s: float | None


class Outages:
    """All outages of a run, in the order in which they began."""

    def __init__(self, tell: Tell | None = None) -> None:
        self.count = 0
        self.unsent_frames = 0
        self._tell: Tell = tell or (lambda line: None)
        self._kept: list[Outage] = []
        self._open: dict[str, int] = {}
        self._origin_us = 0

    def start(self, now_us: int) -> None:
        """Let the run begin now."""
        self._origin_us = now_us

    def begin(self, node: str, since_us: int, what: str) -> None:
        """Note that *node* is out since then, unless that is known already."""
        if node in self._open:
            return
        self._open[node] = since_us
        self.count += 1
        self._tell(f"{node}: {what} since {self._seconds(since_us):.2f} s")

    def end(self, node: str, now_us: int) -> None:
        """Note that *node* is back, if it was out."""
        since_us = self._open.pop(node, None)
        if since_us is None:
            return
        outage = Outage(node, self._seconds(since_us), self._seconds(now_us))
        if len(self._kept) < _MOST_KEPT:
            self._kept.append(outage)
        self._tell(f"{node}: back at {outage.stop_s:.2f} s")

    def all(self) -> list[Outage]:
        """Return the outages so far, those that last still with no end; the first 1000 of them."""
        lasting = [Outage(node, self._seconds(since), None) for node, since in self._open.items()]
        return sorted([*self._kept, *lasting], key=lambda outage: outage.start_s)

    def _seconds(self, at_us: int) -> float:
        return (at_us - self._origin_us) / 1e6


class PeerWatch:
    """Watches for the frames of one other node. Before its first frame it is not missed."""

    def __init__(
        self, node: str, keys: Iterable[tuple[int, bool]], cycle_us: int, outages: Outages
    ) -> None:
        self._node = node
        self._keys = frozenset(keys)
        self._silence_us = max(SILENT_CYCLES * cycle_us, _LEAST_SILENCE_US)
        self._outages = outages
        self._last_us: int | None = None

    @classmethod
    def of(
        cls, node: str, specs: Sequence[MessageSpec], tick_period_us: int, outages: Outages
    ) -> PeerWatch:
        """Watch for messages by their description; the quickest one says what silence is."""
        cycle_us = min((spec.cycle_time_us or tick_period_us for spec in specs), default=0)
        keys = [(spec.frame_id, spec.is_extended) for spec in specs]
        return cls(node, keys, cycle_us, outages)

    def see(self, now_us: int, frames: Sequence[can.Message]) -> None:
        """Take note of what has arrived by now; called once a tick."""
        if any(
            (frame.arbitration_id, frame.is_extended_id) in self._keys and not frame.is_error_frame
            for frame in frames
        ):
            self._outages.end(self._node, now_us)
            self._last_us = now_us
        elif self._last_us is not None and now_us - self._last_us > self._silence_us:
            self._outages.begin(self._node, self._last_us, "silent")


def outages_as_json(outages: Sequence[Outage]) -> list[dict[str, Any]]:
    """Return the outages as a summary lists them."""
    return [outage._asdict() for outage in outages]
