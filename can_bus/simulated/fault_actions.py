"""What faults do to frames on their way into a transmit queue, and a node that babbles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from can_bus.simulated.controller import NS_PER_S, Controller
from can_bus.simulated.faults import ActiveFault
from can_bus.simulated.frame_bits import FrameContent
from can_bus.simulated.messages import copy_of, message_of
from can_bus.simulated.queues import Pending, arbitration_key
from can_bus.timing import frame_length_bits


class Clock(Protocol):
    """A time, and a way to have something done at another."""

    now_ns: int

    def at(self, time_ns: int, action: Callable[[], None]) -> object:
        """Have something done at a time."""


def queued(
    faults: list[ActiveFault], controller: Controller, pending: Pending, now_ns: int
) -> list[tuple[int, Pending]]:
    """Return what enters the queue because of this frame, each with its delay in ns."""
    delay_ns, copies = 0, 1
    for active in faults:
        concerned = active.is_on and active.concerns(controller.name, pending.message)
        if concerned and active.strike(now_ns):
            kind = active.fault.kind
            if kind == "duplication":
                copies += 1
            elif kind == "reordering":
                active.held.append((controller, pending))
                return []
            else:
                delay_ns += active.draw_delay_ns()
    batch = [pending, *(_twin(pending) for _ in range(copies - 1))]
    for active in faults:
        batch += active.release(controller, pending)
    return [(delay_ns, one) for one in batch]


def check_babble(active: ActiveFault) -> int:
    """Return the length of a babbled frame in bits; raises CanBusError if there is no such."""
    fault = active.fault
    return frame_length_bits(fault.arbitration_id or 0, fault.is_extended, fault.data)


def babble(active: ActiveFault, controller: Controller, clock: Clock) -> None:
    """Let a node queue a frame again and again, each time the last one has been sent."""
    fault, length_bits = active.fault, check_babble(active)
    frame_id = fault.arbitration_id or 0
    key = arbitration_key(frame_id, fault.is_extended, False)
    content = FrameContent(frame_id, fault.is_extended, False, len(fault.data), fault.data)

    def send() -> None:
        if active.is_on and active.strike(clock.now_ns):
            controller.queue.push(Pending(key, message_of(content, 0.0), length_bits, again))

    def again() -> None:
        clock.at(clock.now_ns + round(fault.delay_s * NS_PER_S), send)

    clock.at(active.start_ns, send)


def _twin(pending: Pending) -> Pending:
    return Pending(pending.key, copy_of(pending.message, 0.0), pending.length_bits)
