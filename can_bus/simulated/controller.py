"""One CAN controller on a simulated bus: what it sends, what it counts, and its own clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import can

from can_bus.errors import CanBusError
from can_bus.simulated.confinement import (
    RECOVERY_SEQUENCES,
    Confinement,
    ErrorState,
)
from can_bus.simulated.queues import Pending, TransmitQueue

NS_PER_S: Final = 1_000_000_000


class Controller:
    """A node's controller.

    Args:
        name: of the node, as faults name it.
        queue: its frames on their way out.
        clock_skew: by how much its clock is fast (1e-4: 100 µs in a second).
        retransmits: a frame that met an error is tried again.
        restarts: it comes back from bus-off by itself.
        take: called with each message for this node; None: nobody reads.
        report: called with each error frame for this node; None: nobody reads.
        echo: called with each of its own frames that was sent; None: it does not hear itself.

    Attributes:
        confinement: its error counters.
        suspended_until_ns: an error-passive transmitter lets the others go first until then.
        stuck_on: the frame that nobody acknowledges and that changes no counter any more.

    Raises CanBusError for a clock that makes no sense.
    """

    __slots__ = (
        "confinement",
        "echo",
        "name",
        "queue",
        "rate",
        "recovery_left",
        "report",
        "restarts",
        "retransmits",
        "stuck_on",
        "suspended_until_ns",
        "take",
    )

    def __init__(
        self,
        name: str,
        queue: TransmitQueue,
        *,
        clock_skew: float = 0.0,
        retransmits: bool = True,
        restarts: bool = True,
        take: Callable[[can.Message], None] | None = None,
        report: Callable[[can.Message], None] | None = None,
        echo: Callable[[can.Message], None] | None = None,
    ) -> None:
        """Start error-active with nothing to send."""
        if not -0.5 <= clock_skew <= 0.5:
            raise CanBusError(f"clock_skew = {clock_skew}: expected -0.5 to 0.5")
        self.name = name
        self.queue = queue
        self.rate = 1.0 + clock_skew
        self.retransmits = retransmits
        self.restarts = restarts
        self.take = take
        self.report = report
        self.echo = echo
        self.confinement = Confinement()
        self.suspended_until_ns = 0
        self.recovery_left: int | None = None
        self.stuck_on: Pending | None = None

    @property
    def is_off(self) -> bool:
        """Tell whether it is bus-off."""
        return self.confinement.is_off

    @property
    def is_passive(self) -> bool:
        """Tell whether it is error-passive."""
        return self.confinement.state is ErrorState.PASSIVE

    def local_s(self, time_ns: int) -> float:
        """Return a time of the bus on this node's clock."""
        return time_ns / NS_PER_S if self.rate == 1.0 else time_ns * self.rate / NS_PER_S

    def bus_ns(self, duration_s: float) -> int:
        """Return a duration on this node's clock in nanoseconds of the bus."""
        return round(duration_s * NS_PER_S / self.rate)

    def start_recovery(self) -> None:
        """Begin to count the recessive sequences that end bus-off."""
        if self.is_off and self.recovery_left is None:
            self.recovery_left = RECOVERY_SEQUENCES

    def count_recessive(self, sequences: int) -> bool:
        """Count sequences of 11 recessive bits; return whether they have brought it back."""
        if self.recovery_left is None:
            return False
        self.recovery_left -= sequences
        if self.recovery_left > 0:
            return False
        self.recovery_left = None
        self.confinement.recover()
        return True
