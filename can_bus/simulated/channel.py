"""The wire between the nodes of one channel: its clock, arbitration, and what becomes of frames.

Time moves from event to event and only on request (`step`). Frames queued at one time all take
part in the arbitration at that time, since arbitration is held when the clock moves on.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sized
from heapq import heappop, heappush
from typing import Final

import can

from can_bus.errors import CanBusError
from can_bus.simulated.confinement import RECOVERY_SEQUENCE_BITS
from can_bus.simulated.controller import NS_PER_S, Controller
from can_bus.simulated.disturbed_frame import Station, play
from can_bus.simulated.error_frames import error_message, restart_message
from can_bus.simulated.fault_actions import babble, queued
from can_bus.simulated.faults import ActiveFault, BusFault, FaultPlan
from can_bus.simulated.messages import copy_of, message_of
from can_bus.simulated.queues import Pending, TransmitQueue
from can_bus.timing import INTERFRAME_BITS

NEVER_NS: Final = 1 << 80
"""Later than any time."""

SUSPEND_BITS: Final = 8
"""Suspend transmission: an error-passive transmitter waits so much longer."""


class _Event:
    """Something that happens at a time, unless it is cancelled."""

    __slots__ = ("action",)

    def __init__(self, action: Callable[[], None] | None) -> None:
        self.action = action


class _Flight:
    """A frame on the wire; `stations` where its bits were played one by one."""

    __slots__ = ("end_ns", "entrants", "pendings", "present", "stations")

    def __init__(
        self,
        end_ns: int,
        present: list[Controller],
        entrants: list[Controller],
        pendings: list[Pending],
        stations: list[Station] | None,
    ) -> None:
        self.end_ns = end_ns
        self.present = present
        self.entrants = entrants
        self.pendings = pendings
        self.stations = stations


class Channel:
    """All that one wire does.

    Args:
        bitrate: in bit/s.

    Attributes:
        now_ns: simulated time since the channel was opened.
        controllers: the nodes on it.
        faults: the faults that are on.
        busy_bits: bit times that frames, error frames and intermissions have taken.

    Raises CanBusError for a bit rate that classic CAN does not have.
    """

    def __init__(self, bitrate: int) -> None:
        """Start at time 0 with an idle bus and no node."""
        if not 1 <= bitrate <= 1_000_000:
            raise CanBusError(f"bitrate = {bitrate}: expected 1 to 1000000 [bit/s]")
        self.bitrate = bitrate
        self.now_ns = 0
        self.controllers: list[Controller] = []
        self.faults = FaultPlan()
        self.busy_bits = 0
        self._events: list[tuple[int, int, _Event]] = []
        self._numbers = itertools.count()
        self._flight: _Flight | None = None
        self._free_ns = 0
        self._idle_since_ns = 0
        self._bit_ns = 0 if NS_PER_S % bitrate else NS_PER_S // bitrate  # 0: no whole number
        self._carry = 0
        self._is_calm = True  # every error counter is at 0
        self._recovering = 0

    def add(self, controller: Controller) -> None:
        """Put a node on the bus."""
        self.controllers = [*self.controllers, controller]  # a frame on the wire keeps its list

    def remove(self, controller: Controller) -> None:
        """Take a node off the bus; a frame of it that is on the wire is still finished."""
        self.controllers = [one for one in self.controllers if one is not controller]

    def at(self, time_ns: int, action: Callable[[], None]) -> _Event:
        """Have something done at a time; set the event's `action` to None to cancel it."""
        event = _Event(action)
        heappush(self._events, (max(time_ns, self.now_ns), next(self._numbers), event))
        return event

    # --- sending and faults ----------------------------------------------------------------------

    def send(self, controller: Controller, pending: Pending) -> None:
        """Queue a frame at the current time, or as faults have it."""
        if not self.faults.queueing:
            controller.queue.push(pending)
            return
        for delay_ns, one in queued(self.faults.queueing, controller, pending, self.now_ns):
            if delay_ns:
                self.at(self.now_ns + delay_ns, _push_of(controller, one))
            else:
                controller.queue.push(one)
        self.faults.let_go()

    def inject(self, fault: BusFault, seed: int) -> ActiveFault:
        """Switch a fault on."""
        active = self.faults.add(fault, seed)
        for time_ns in (active.start_ns, active.stop_ns):
            if time_ns is not None:  # the wire looks again at who is silent
                self.at(time_ns, _nothing)
        if fault.kind == "babbling":
            node = next((one for one in self.controllers if one.name == fault.node), None)
            if node is None:
                node = Controller(fault.node or "", TransmitQueue("priority"))
                self.add(node)
            babble(active, node, self)
        return active

    # --- the clock -------------------------------------------------------------------------------

    def run(self, limit_ns: int, awaited: Sized, steps: int) -> bool:
        """Let things happen until something is in `awaited` or until then.

        Returns True if so many things have happened that others should be let in before more do.
        """
        while steps:
            if self._is_calm and self.faults.is_empty and self._bit_ns and self._flight is None:
                is_over = self._run_quietly(limit_ns, awaited)
                if is_over or awaited:
                    return False
            if not self.step(limit_ns) or awaited:
                return False
            steps -= 1
        return True

    def _run_quietly(self, limit_ns: int, awaited: Sized) -> bool:
        """Carry whole frames while nothing else happens: `step` in few words, to the same end.

        Returns True if nothing is left to do until then, and it is then.
        """
        event_ns = self._events[0][0] if self._events else NEVER_NS
        end_limit_ns = event_ns if event_ns < limit_ns else limit_ns
        bit_ns, controllers = self._bit_ns, self.controllers
        while not awaited and len(controllers) > 1:
            winner, best = None, NEVER_NS
            for one in controllers:
                held = one.queue.held
                if held:
                    key = held[0][2].key
                    if key < best:
                        winner, best = one, key
                    elif key == best:
                        return False  # two of one identifier: bit by bit
            if winner is None:
                if event_ns <= limit_ns:
                    return False
                self._go(limit_ns)
                return True
            queue = winner.queue
            pending = queue.held[0][2]
            start_ns = self._free_ns if self._free_ns > self.now_ns else self.now_ns
            end_ns = start_ns + pending.length_bits * bit_ns
            if end_ns > end_limit_ns or pending.on_sent is not None:
                return False
            queue.pass_head()
            self.now_ns = end_ns
            self.busy_bits += pending.length_bits + INTERFRAME_BITS
            self._free_ns = self._idle_since_ns = end_ns + INTERFRAME_BITS * bit_ns
            message = pending.message
            if winner.echo is not None:
                self._echo(winner, message)
            self._deliver(controllers, winner, message)
        return False

    def step(self, limit_ns: int) -> bool:
        """Do the next thing that happens until then; if there is none, go there and say so."""
        event_ns = self._events[0][0] if self._events else NEVER_NS
        flight = self._flight
        if flight is not None:
            if flight.end_ns <= event_ns:
                if flight.end_ns > limit_ns:
                    self._go(limit_ns)
                    return False
                self.now_ns = flight.end_ns
                self._flight = None
                self._finish(flight)
                return True
        else:
            start_ns = self._next_start_ns()
            if self._recovering:
                recovery_ns = self._next_recovery_ns()
                if recovery_ns < event_ns and recovery_ns <= min(limit_ns, start_ns):
                    self.now_ns = max(recovery_ns, self.now_ns)
                    self._count_idle(self.now_ns)
                    return True
            if start_ns < event_ns and start_ns < limit_ns:
                self.now_ns = start_ns
                self._start(start_ns, min(limit_ns, event_ns))
                return True
        if event_ns <= limit_ns:
            self._go(event_ns)
            action = heappop(self._events)[2].action
            if action is not None:
                action()
            return True
        self._go(limit_ns)
        return False

    def _go(self, time_ns: int) -> None:
        if self.now_ns < time_ns < NEVER_NS:
            self.now_ns = time_ns

    def _is_present(self, controller: Controller) -> bool:
        return not controller.confinement.is_off and not (
            self.faults.silence and self.faults.is_silent(controller.name, self.now_ns)
        )

    def _present(self) -> list[Controller]:
        """Return the nodes that take part in what happens on the wire."""
        if self._is_calm and not self.faults.silence:
            return self.controllers
        return [one for one in self.controllers if self._is_present(one)]

    def _next_start_ns(self) -> int:
        """Return when the next start of frame can be, if nothing happens before."""
        earliest = NEVER_NS
        for controller in self._present():
            if controller.queue.held and controller.suspended_until_ns < earliest:
                earliest = controller.suspended_until_ns
        if earliest == NEVER_NS:
            return NEVER_NS
        earliest = max(earliest, self._free_ns)
        return earliest if earliest > self.now_ns else self.now_ns

    # --- one frame -------------------------------------------------------------------------------

    def _start(self, start_ns: int, limit_ns: int) -> None:
        """Hold arbitration, and put the winner on the wire."""
        present = self._present()
        entrants = [o for o in present if o.queue.held and o.suspended_until_ns <= start_ns]
        winner = entrants[0]
        is_tie = False
        if len(entrants) > 1:
            keys = [one.queue.held[0][2].key for one in entrants]
            best = min(keys)
            winner = entrants[keys.index(best)]
            is_tie = keys.count(best) > 1
        head = winner.queue.held[0][2]
        inverted = {}
        if self.faults.corruption:
            names = [one.name for one in present]
            inverted = self.faults.inverted(winner.name, head.message, names, start_ns)
        if start_ns > self._free_ns:
            self._carry = 0
            if self._recovering:
                self._count_idle(start_ns)
        if len(present) > 1 and not is_tie and not inverted:
            winner.queue.start()
            end_ns = self._occupy(start_ns, head.length_bits)
            self._flight = _Flight(end_ns, present, [winner], [head], None)
            return
        if winner.stuck_on is head and len(present) == 1 and not inverted:
            start_ns = self._pass_stuck(winner, start_ns, limit_ns)
        pendings = [one.queue.start() for one in entrants]
        contents = {id(o): p.content for o, p in zip(entrants, pendings, strict=True)}
        stations = [Station(one.confinement, contents.get(id(one))) for one in present]
        end_ns = self._occupy(start_ns, play(stations, inverted))
        self._flight = _Flight(end_ns, present, entrants, pendings, stations)

    def _occupy(self, start_ns: int, bits: int) -> int:
        """Take the wire for a frame; return its end. Bits never drift against the clock."""
        taken_bits = bits + INTERFRAME_BITS
        self.busy_bits += taken_bits
        if self._bit_ns:
            self._free_ns = self._idle_since_ns = start_ns + taken_bits * self._bit_ns
            return start_ns + bits * self._bit_ns
        end_ns = start_ns + (bits * NS_PER_S + self._carry) // self.bitrate
        taken_ns, self._carry = divmod(taken_bits * NS_PER_S + self._carry, self.bitrate)
        self._free_ns = self._idle_since_ns = start_ns + taken_ns
        return end_ns

    def _finish(self, flight: _Flight) -> None:
        if flight.stations is not None:
            self._finish_disturbed(flight, flight.stations)
        else:
            sender = flight.entrants[0]
            if not self._is_calm:
                sender.confinement.count_sent()
                for controller in flight.present:
                    if controller is not sender:
                        controller.confinement.count_received()
            self._sent(sender, flight.pendings[0])
            message = flight.pendings[0].message
            if sender.echo is not None:
                self._echo(sender, message)
            self._deliver(flight.present, sender, message)
        if not self._is_calm:
            self._look_at_counters(flight)

    def _look_at_counters(self, flight: _Flight) -> None:
        """After a frame: who has gone off, who comes back, and whether all is well again."""
        if self._recovering:
            self._count_sequences(1)
        for controller in flight.present:
            if controller.restarts:
                controller.start_recovery()
        self._take_stock()

    def _take_stock(self) -> None:
        self._recovering = sum(one.recovery_left is not None for one in self.controllers)
        self._is_calm = all(one.confinement.is_clear for one in self.controllers)

    def recover(self, controller: Controller) -> None:
        """Let a node begin to come back from bus-off."""
        if self._flight is None:
            self._count_idle(self.now_ns)
            self._idle_since_ns = max(self._idle_since_ns, self.now_ns)
        controller.start_recovery()
        self._take_stock()

    def _finish_disturbed(self, flight: _Flight, stations: list[Station]) -> None:
        self._is_calm = False
        waiting = dict(zip(map(id, flight.entrants), flight.pendings, strict=True))
        messages = []
        for controller, station in zip(flight.present, stations, strict=True):
            before = (controller.confinement.tec, controller.confinement.rec)
            controller.confinement = station.confinement
            pending = waiting.get(id(controller))
            if pending is not None:
                self._settle(controller, pending, station, before)
            if station.errors and controller.report is not None and controller.stuck_on is None:
                stamp_s = controller.local_s(self.now_ns)
                messages += [
                    (controller, error_message(error, station.confinement, stamp_s))
                    for error in station.errors
                ]
        sender = next(
            (o for o, s in zip(flight.present, stations, strict=True) if s.has_sent),
            flight.entrants[0],
        )
        for controller, station in zip(flight.present, stations, strict=True):
            if station.received is not None:
                self._deliver([controller], sender, message_of(station.received, 0.0))
            elif station.has_sent:
                self._echo(controller, waiting[id(controller)].message)
        for controller, message in messages:
            if controller.report is not None:
                controller.report(message)

    def _settle(
        self, controller: Controller, pending: Pending, station: Station, before: tuple[int, int]
    ) -> None:
        """Decide what becomes of a frame that a node tried to send."""
        after = (station.confinement.tec, station.confinement.rec)
        if station.has_sent:
            self._sent(controller, pending)
            return
        has_failed = any(error.is_transmitter for error in station.errors)
        if has_failed and not controller.retransmits:
            controller.queue.finish()
            return
        controller.queue.take_back(pending)
        if has_failed:
            self._suspend(controller)
            if before == after and controller.is_passive:
                controller.stuck_on = controller.stuck_on or pending

    def _sent(self, controller: Controller, pending: Pending) -> None:
        controller.queue.finish()
        controller.stuck_on = None
        if not self._is_calm:
            self._suspend(controller)
        if pending.on_sent is not None:
            pending.on_sent()

    def _suspend(self, controller: Controller) -> None:
        if controller.is_passive:
            wait_ns = SUSPEND_BITS * NS_PER_S // self.bitrate
            controller.suspended_until_ns = self._free_ns + wait_ns

    def _pass_stuck(self, controller: Controller, start_ns: int, limit_ns: int) -> int:
        """Skip attempts that change nothing: nobody else is there and no counter moves."""
        head = controller.queue.held[0][2]
        station = Station(controller.confinement, head.content)
        bits = play([station], {}) + INTERFRAME_BITS + SUSPEND_BITS
        attempts = (limit_ns - start_ns) * self.bitrate // (bits * NS_PER_S)
        if limit_ns >= NEVER_NS or attempts < 1:
            return start_ns
        self.busy_bits += (bits - SUSPEND_BITS) * (attempts - 1)
        return start_ns + (attempts - 1) * bits * NS_PER_S // self.bitrate

    # --- receiving -------------------------------------------------------------------------------

    def _deliver(self, present: list[Controller], sender: Controller, message: can.Message) -> None:
        loss, now_ns = self.faults.loss, self.now_ns
        last: Controller | None = None
        for controller in present:
            if controller is sender or controller.take is None:
                continue
            if loss and self.faults.loses(sender.name, controller.name, message, now_ns):
                continue
            if last is not None and last.take is not None:
                last.take(copy_of(message, last.local_s(now_ns)))
            last = controller
        if last is not None and last.take is not None:  # the last one gets the frame itself
            message.timestamp = last.local_s(now_ns)
            last.take(message)

    def _echo(self, sender: Controller, message: can.Message) -> None:
        if sender.echo is not None:
            own = copy_of(message, sender.local_s(self.now_ns))
            own.is_rx = False
            sender.echo(own)

    # --- bus-off recovery ------------------------------------------------------------------------

    def _next_recovery_ns(self) -> int:
        """Return when an idle bus has brought the next node back from bus-off."""
        left = [one.recovery_left for one in self.controllers if one.recovery_left is not None]
        if not left:
            return NEVER_NS
        bits = min(left) * RECOVERY_SEQUENCE_BITS
        return self._idle_since_ns + math.ceil(bits * NS_PER_S / self.bitrate)

    def _count_idle(self, now_ns: int) -> None:
        """Count the recessive sequences of an idle bus."""
        idle_ns = now_ns - self._idle_since_ns
        sequences = idle_ns * self.bitrate // (RECOVERY_SEQUENCE_BITS * NS_PER_S)
        if sequences > 0:
            self._idle_since_ns += math.ceil(
                sequences * RECOVERY_SEQUENCE_BITS * NS_PER_S / self.bitrate
            )
            self._count_sequences(sequences)

    def _count_sequences(self, sequences: int) -> None:
        for controller in self.controllers:
            if controller.count_recessive(sequences) and controller.report is not None:
                controller.report(restart_message(controller.local_s(self.now_ns)))


def _nothing() -> None:
    """Happen."""


def _push_of(controller: Controller, pending: Pending) -> Callable[[], None]:
    return lambda: controller.queue.push(pending)
