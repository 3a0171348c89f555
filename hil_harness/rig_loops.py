"""What a rig runs on: simulated time in turns, or real time in a thread of its own.

Both do the same for the rig: they advance time until it is up or the rig has seen enough, carry the
frames that the rig sends, and show it every frame on the bus.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

import can

from can_bus import FaultInjector, LogWriter, Traffic, open_bus
from hil_harness.devices import Device
from hil_harness.errors import HarnessError
from hil_harness.lockstep import Lockstep
from hil_harness.nodes import Node
from hil_harness.realtime import Link, Pacer, WallClock

Seen = Callable[[int, can.Message], None]
"""Called with each frame on the bus: bus time in microseconds since the start, and the frame."""

Source = Callable[[int], Iterable[can.Message]]
"""Asked once a tick, with the bus time, for the frames that the tester sends in it."""

_NEVER = frozenset({(-1, False)})
"""An identifier that no frame has: waiting for it is waiting until the deadline."""


class RigLoop(Protocol):
    """Time and transport of a rig."""

    @property
    def now_us(self) -> int:
        """Bus time since the start: in lockstep that of the tick that comes next."""
        ...

    @property
    def channel(self) -> str:
        """The python-can channel that all handles are on."""
        ...

    def advance(self, duration_us: int, enough: Callable[[], bool]) -> None:
        """Let so much bus time pass, or less if `enough()` becomes true."""
        ...

    def close(self) -> None:
        """Stop, and shut every handle down; may be called twice."""
        ...


class LockstepLoop:
    """Plant and device take turns on simulated time; the wall clock is never read."""

    def __init__(
        self,
        plant: Node,
        device: Node,
        *,
        tick_period_us: int,
        interface: str,
        channel: str,
        bitrate: int | None,
        bus_args: Mapping[str, str],
        log: LogWriter | None,
        faults: FaultInjector,
        outgoing_faults: FaultInjector,
        traffic: Traffic | None,
        seen: Seen,
        source: Source,
    ) -> None:
        """Open the two handles."""
        self._lockstep = Lockstep(
            plant,
            device,
            tick_period_us=tick_period_us,
            interface=interface,
            channel=channel,
            bitrate=bitrate,
            bus_args=bus_args,
            log=log,
            faults=faults,
            outgoing_faults=outgoing_faults,
            traffic=traffic,
        )
        self._lockstep.observers.append(seen)
        self._source = source

    @property
    def now_us(self) -> int:
        """Simulated time of the tick that comes next."""
        return self._lockstep.now_us

    @property
    def channel(self) -> str:
        """The python-can channel."""
        return self._lockstep.channel

    def advance(self, duration_us: int, enough: Callable[[], bool]) -> None:
        """Run the ticks that begin within the next *duration_us*."""
        stop_us = self.now_us + duration_us
        while self.now_us < stop_us and not enough():
            for message in self._source(self.now_us):
                self._lockstep.inject(message)
            self._lockstep.step()

    def close(self) -> None:
        """Shut the handles down."""
        self._lockstep.close()


class RealTimeLoop:
    """Plant and device are paced on the monotonic clock by a thread; the device may be outside.

    What goes wrong in the thread is raised from the next call.
    """

    def __init__(
        self,
        plant: Node,
        device: Device,
        *,
        tick_period_us: int,
        interface: str,
        channel: str,
        bitrate: int | None,
        bus_args: Mapping[str, str],
        log: LogWriter | None,
        faults: FaultInjector,
        outgoing_faults: FaultInjector,
        traffic: Traffic | None,
        seen: Seen,
        source: Source,
    ) -> None:
        """Open the handles and start the thread; traffic needs simulated time."""
        del traffic
        self.channel = channel
        self._plant = plant
        self._device = device
        self._tick_period_us = tick_period_us
        self._faults = faults
        self._outgoing_faults = outgoing_faults
        self._seen = seen
        self._source = source
        self._news = threading.Condition()
        self._failure: BaseException | None = None
        self._stopping = False
        self._clock = WallClock()
        self._start_us = self._clock.now_us()
        self._buses = [open_bus(interface, channel, bitrate=bitrate, bus_args=bus_args)]
        try:
            if device.in_loop:
                self._buses.append(open_bus(interface, channel, bitrate=bitrate, bus_args=bus_args))
        except BaseException:
            self._shut_down_buses()
            raise
        # The log holds what the device received and sent, or all that passed if it is outside.
        self._tester = Link(self._buses[0], self._clock, None if device.in_loop else log)
        self._ecu = Link(self._buses[1], self._clock, log) if device.in_loop else None
        self._thread = threading.Thread(target=self._run, name="chiplog-rig", daemon=True)
        self._thread.start()

    @property
    def now_us(self) -> int:
        """Wall time since the start."""
        return self._clock.now_us() - self._start_us

    def advance(self, duration_us: int, enough: Callable[[], bool]) -> None:
        """Wait, while the thread works."""
        stop_s = time.monotonic() + duration_us * 1e-6
        with self._news:
            while not enough():
                self._raise_failure()
                left_s = stop_s - time.monotonic()
                if left_s <= 0:
                    return
                self._news.wait(left_s)

    def close(self) -> None:
        """Stop the thread and shut the handles down."""
        self._stopping = True
        self._thread.join()
        self._shut_down_buses()

    def _run(self) -> None:
        pacer = Pacer(self._tick_period_us)
        answers: list[can.Message] = []
        tick = 0
        try:
            while not self._stopping:
                pacer.wait_for(tick)
                answers = self._tick(answers)
                tick += 1
        except BaseException as error:  # handed to the test's own thread
            with self._news:
                self._failure = error
                self._news.notify_all()

    def _tick(self, answers: list[can.Message]) -> list[can.Message]:
        """Plant and tester send, a device in the loop answers, and its frames come back."""
        now_us = self.now_us
        injected = list(self._source(now_us))
        # Everybody's clock here is the wall clock, by which the driver stamps what arrives.
        wall_us = self._clock.now_us()
        for message in injected:
            message.timestamp = wall_us * 1e-6
        sent = injected + list(self._plant.step(wall_us, answers + injected))
        self._note(sent)
        delivered = list(self._faults.transfer(now_us, sent))
        self._tester.send(delivered)
        if self._ecu is not None:
            arrived = self._ecu.receive(self._soon(0.4), _identifiers(delivered))
            answer = list(
                self._outgoing_faults.transfer(
                    now_us, self._device.step(self._clock.now_us(), arrived)
                )
            )
            self._ecu.send(answer)
            came = self._tester.receive(self._soon(0.4), _identifiers(answer))
        else:
            self._device.check()
            # Wait in the driver until the next tick is near: frames are stamped as they come.
            came = self._tester.receive(self._soon(0.8), _NEVER)
            came = list(self._outgoing_faults.transfer(now_us, came))
        self._note(came)
        return came

    def _soon(self, share: float) -> int:
        """Return the monotonic time in so much of a tick period."""
        return time.monotonic_ns() + int(share * self._tick_period_us * 1000)

    def _note(self, messages: Iterable[can.Message]) -> None:
        with self._news:
            for message in messages:
                self._seen(self.now_us, message)
            self._news.notify_all()

    def _raise_failure(self) -> None:
        failure = self._failure
        if failure is not None:
            if not isinstance(failure, ValueError | OSError):
                raise HarnessError(f"the rig's thread failed: {failure!r}") from failure
            raise failure

    def _shut_down_buses(self) -> None:
        for bus in self._buses:
            bus.shutdown()


def _identifiers(messages: Iterable[can.Message]) -> frozenset[tuple[int, bool]]:
    return frozenset((frame.arbitration_id, frame.is_extended_id) for frame in messages)
