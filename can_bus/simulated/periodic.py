"""Cyclic sending on the simulated clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import can
from can.broadcastmanager import (
    LimitedDurationCyclicSendTaskABC,
    ModifiableCyclicTaskABC,
    RestartableCyclicTaskABC,
)

if TYPE_CHECKING:
    from can_bus.simulated.bus import SimulatedBus


class SimulatedCyclicTask(
    LimitedDurationCyclicSendTaskABC, ModifiableCyclicTaskABC, RestartableCyclicTaskABC
):
    """Sends its messages in turn, the first one at once, one every `period` of its node's clock.

    A frame that finds the transmit queue full is left out and counted in `dropped`.
    """

    def __init__(
        self,
        bus: SimulatedBus,
        messages: Sequence[can.Message] | can.Message,
        period: float,
        duration: float | None,
        modifier_callback: Callable[[can.Message], None] | None,
        *,
        autostart: bool,
    ) -> None:
        """Raise ValueError for a period that is not positive."""
        super().__init__(messages, period, duration)
        if not 0.0 < period < float("inf"):
            raise ValueError(f"period = {period}: expected more than 0 s")
        self.dropped = 0
        self._bus = bus
        self._modify = modifier_callback
        self._run = 0
        self._is_running = False
        if autostart:
            self.start()

    def start(self) -> None:
        """Start, or start again after `stop`."""
        if not self._is_running:
            self._is_running = True
            self._run += 1
            # Another thread that reads the bus may move its clock on: what is scheduled then lies
            # in the past, and all turns up to now would come at once.
            with self._bus.standing_clock:
                self._schedule(self._run, self._bus.now_ns, 0)

    def stop(self) -> None:
        """Stop; may be called twice."""
        self._is_running = False

    def _schedule(self, run: int, start_ns: int, turn: int) -> None:
        bus = self._bus
        if self.duration is not None and turn * self.period >= self.duration:
            self._is_running = False
            return
        time_ns = start_ns + bus.to_bus_ns(turn * self.period)
        bus.at_ns(time_ns, lambda: self._send(run, start_ns, turn))

    def _send(self, run: int, start_ns: int, turn: int) -> None:
        if not self._is_running or run != self._run:
            return
        message = self.messages[turn % len(self.messages)]
        if self._modify is not None:
            self._modify(message)
        try:
            self._bus.send(message, 0)
        except can.CanOperationError:
            self.dropped += 1
        self._schedule(run, start_ns, turn + 1)
