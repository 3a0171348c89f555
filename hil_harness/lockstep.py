"""The loop on simulated time: plant, bus and firmware take turns, and the wall clock is never read.

One tick: the plant advances to t_k and puts its frames on the bus; the firmware node receives them
(after faults), steps once and answers; the answer reaches the plant side before the next tick. The
same nodes and seed give the same bytes on the bus, run after run.

On `virtual` a frame takes no time. On `chiplog` it takes as long as its bits: the firmware steps in
the middle of the tick, on what has arrived by then, and what is late is the next step's input.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Protocol

import can

from can_bus import FaultInjector, LogWriter, Traffic, open_bus
from can_bus.simulated import SimulatedBus
from hil_harness.errors import HarnessError
from hil_harness.meter import BusMeter
from hil_harness.nodes import Node
from hil_harness.stopping import StopRequest

LOCKSTEP_INTERFACES = ("virtual", "chiplog")

_channel_numbers = itertools.count()


class Observer(Protocol):
    """Sees each frame on the bus: simulated time and the frame, after the firmware's faults."""

    def __call__(self, now_us: int, message: can.Message, /) -> None:
        """Take note of one frame."""


def unique_channel() -> str:
    """Return a channel name that no other rig, worker or process uses."""
    return f"chiplog-{os.getpid()}-{next(_channel_numbers)}"


class Lockstep:
    """A plant node and a firmware node on two handles of one bus, stepped in turn.

    `log` receives what the firmware node received and sent, in its order, after faults.
    `faults` act on frames on their way to the firmware, `outgoing_faults` on those it sends, and
    `traffic` on both ways, before the log of what the firmware sent.
    Raises HarnessError for an interface whose clock cannot be simulated, CanBusError if the bus
    goes away.
    """

    def __init__(
        self,
        plant: Node,
        firmware: Node,
        *,
        tick_period_us: int,
        interface: str = "virtual",
        channel: str | None = None,
        bitrate: int | None = None,
        bus_args: Mapping[str, str] | None = None,
        log: LogWriter | None = None,
        faults: FaultInjector | None = None,
        outgoing_faults: FaultInjector | None = None,
        meter: BusMeter | None = None,
        traffic: Traffic | None = None,
    ) -> None:
        if interface not in LOCKSTEP_INTERFACES:
            raise HarnessError(
                f"interface {interface!r} has no simulated clock: lockstep runs on "
                f"{', '.join(LOCKSTEP_INTERFACES)}; use real time here"
            )
        self.plant = plant
        self.firmware = firmware
        self.tick_period_us = tick_period_us
        self.channel = channel if channel is not None else unique_channel()
        self.faults = faults
        self.outgoing_faults = outgoing_faults
        self.observers: list[Observer] = []
        self.ticks = 0
        self._log = log
        self._traffic = traffic
        self._meter = meter
        self._injected: list[can.Message] = []
        self._to_plant: list[can.Message] = []
        arguments = dict(bus_args or {})
        self._plant_bus = open_bus(interface, self.channel, bitrate=bitrate, bus_args=arguments)
        arguments.pop("faults", None)  # of the channel: switched on once
        try:
            self._firmware_bus = open_bus(
                interface, self.channel, bitrate=bitrate, bus_args=arguments
            )
        except BaseException:
            self._plant_bus.shutdown()
            raise
        bus = self._firmware_bus
        self._clock = bus if isinstance(bus, SimulatedBus) else None
        self._answer_us = 0 if self._clock is None else tick_period_us // 2

    @property
    def now_us(self) -> int:
        """Simulated time of the tick that comes next."""
        return self.ticks * self.tick_period_us

    def inject(self, message: can.Message) -> None:
        """Send a frame from the tester's side at the next tick, before the plant's own."""
        self._injected.append(message)

    def step(self) -> None:
        """Run one tick. Raises CanBusError if the bus goes away."""
        now_us, log = self.now_us, self._log
        sent: Sequence[can.Message] = self.plant.step(now_us, self._with_injected(now_us))
        self._observe(now_us, sent)
        self._send(self._plant_bus, sent)

        now_us += self._answer_us
        self._pass_until(now_us)
        arrived: Sequence[can.Message] = self._drain(self._firmware_bus, now_us)
        if self.faults is not None:
            arrived = self.faults.transfer(now_us, arrived)
        if self._traffic is not None:
            arrived = self._traffic.to_ecu(now_us, arrived)
        if log is not None:
            for message in arrived:
                log.write(message, True)
        answered: Sequence[can.Message] = self.firmware.step(now_us, arrived)
        if self._traffic is not None:
            answered = self._traffic.from_ecu(now_us, answered)
        if log is not None:
            for message in answered:
                log.write(message, False)
        if self.outgoing_faults is not None:
            answered = self.outgoing_faults.transfer(now_us, answered)
        self._send(self._firmware_bus, answered)
        # Here come the firmware's frames and those of any other handle on the channel.
        self.ticks += 1
        self._pass_until(self.now_us)
        self._to_plant = self._drain(self._plant_bus, now_us)
        self._observe(now_us, self._to_plant)

    def _pass_until(self, time_us: int) -> None:
        """Let the bus carry frames until then, where that takes time."""
        if self._clock is not None:
            self._clock.pass_until_ns(time_us * 1000)

    def _drain(self, bus: can.BusABC, now_us: int) -> list[can.Message]:
        """Take all that has arrived: now, or, on a bus with a clock, when its stamp says."""
        arrived: list[can.Message] = []
        now_s = now_us * 1e-6
        has_clock = self._clock is not None
        while (message := bus.recv(0)) is not None:
            if not has_clock:
                message.timestamp = now_s  # whatever a stranger's clock stamped
            arrived.append(message)
        return arrived

    def _with_injected(self, now_us: int) -> list[can.Message]:
        """Send what the tester has asked for; the plant hears it with what came before."""
        if not self._injected:
            return self._to_plant
        injected, self._injected = self._injected, []
        for message in injected:
            message.timestamp = now_us * 1e-6
        self._observe(now_us, injected)
        self._send(self._plant_bus, injected)
        return self._to_plant + injected

    def _send(self, bus: can.BusABC, messages: Sequence[can.Message]) -> None:
        if self._meter is not None:
            self._meter.note(messages)
        for message in messages:
            bus.send(message)

    def _observe(self, now_us: int, messages: Sequence[can.Message]) -> None:
        for observer in self.observers:
            for message in messages:
                observer(now_us, message)

    def run(
        self,
        ticks: int,
        progress: Callable[[int], None] | None = None,
        stop: StopRequest | None = None,
    ) -> None:
        """Run so many ticks, or until asked to stop; `progress` hears how far, now and then."""
        every = max(1, ticks // 100)
        for done in range(1, ticks + 1):
            if stop is not None and stop.is_made:
                return
            self.step()
            if progress is not None and (done % every == 0 or done == ticks):
                progress(done)

    def close(self) -> None:
        """Shut both handles down; may be called twice."""
        self._plant_bus.shutdown()
        self._firmware_bus.shutdown()

    def __enter__(self) -> Lockstep:
        """Use as a context manager: the handles are shut down at its end."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Shut the handles down."""
        self.close()
