"""The same nodes in real time: paced on the monotonic clock, overruns counted.

Stamps are the wall clock of reception in whole microseconds, taken once from the system and carried
on by the monotonic clock, so that a stepped system clock neither reorders frames nor ages them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import can
import numpy as np

from can_bus import BusFullError, FaultInjector, LogWriter
from hil_harness.meter import BusMeter
from hil_harness.nodes import Node, TriggeredNode
from hil_harness.peers import Outages, PeerWatch
from hil_harness.results import Timing
from hil_harness.stopping import StopRequest

_MOST_LATENESS_US = 100_000
_NO_KEY = (-1, False)
_SPIN_NS = 200_000  # sleep() oversleeps by about this much on a stock kernel: spin for the rest


class WallClock:
    """Microseconds since the epoch that never step back."""

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_us(self) -> int:
        """Return the wall clock, whole microseconds."""
        return (time.monotonic_ns() + self._offset_ns) // 1000


class LatenessCount:
    """How late ticks started, counted by the microsecond: memory does not grow with the run."""

    def __init__(self) -> None:
        self._ticks_by_us = np.zeros(_MOST_LATENESS_US + 1, dtype=np.int64)
        self._most_us = 0.0

    def add(self, lateness_us: float) -> None:
        """Count one tick; beyond a tenth of a second only the largest is told apart."""
        self._ticks_by_us[min(max(int(lateness_us), 0), _MOST_LATENESS_US)] += 1
        self._most_us = max(self._most_us, lateness_us)

    def timing(self, missed_deadlines: int) -> Timing:
        """Return median, 99th percentile (to the microsecond below) and largest lateness."""
        up_to = np.cumsum(self._ticks_by_us)
        if up_to[-1] == 0:
            return Timing(missed_deadlines)
        p50_us, p99_us = np.searchsorted(up_to, np.array([0.5, 0.99]) * up_to[-1]).tolist()
        return Timing(missed_deadlines, float(p50_us), float(p99_us), self._most_us)


class Pacer:
    """Releases ticks at multiples of the period, and remembers how late each one started.

    `monotonic_ns` and `sleep` are the machine's, unless a test brings its own.
    """

    def __init__(
        self,
        tick_period_us: int,
        *,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._sleep = sleep
        self.tick_period_us = tick_period_us
        self._period_ns = tick_period_us * 1000
        self._start_ns = monotonic_ns()
        self._lateness = LatenessCount()
        self.missed_deadlines = 0

    def wait_for(self, tick: int) -> None:
        """Sleep until the tick is due; a tick that is due already has missed its deadline."""
        due_ns = self._start_ns + tick * self._period_ns
        while (left_ns := due_ns - self._monotonic_ns()) > 0:
            if left_ns > _SPIN_NS:
                self._sleep((left_ns - _SPIN_NS) * 1e-9)
        lateness_ns = self._monotonic_ns() - due_ns
        if lateness_ns > self._period_ns:
            self.missed_deadlines += 1
        self._lateness.add(lateness_ns * 1e-3)

    def timing(self) -> Timing:
        """Return lateness percentiles and the number of missed deadlines."""
        return self._lateness.timing(self.missed_deadlines)


class CycleMeter:
    """How even the steps of a node are that is released by what arrives, not by the clock.

    The jitter of a step is how far its distance from the step before is from the period; a step
    that comes more than a period late has missed its deadline.
    """

    def __init__(self, tick_period_us: int) -> None:
        self._period_ns = tick_period_us * 1000
        self._last_ns: int | None = None
        self._jitter = LatenessCount()
        self._missed_deadlines = 0

    def step(self, now_ns: int) -> None:
        """Count a step that begins now."""
        if self._last_ns is not None:
            lateness_ns = now_ns - self._last_ns - self._period_ns
            self._missed_deadlines += lateness_ns > self._period_ns
            self._jitter.add(abs(lateness_ns) * 1e-3)
        self._last_ns = now_ns

    def timing(self) -> Timing:
        """Return jitter percentiles and the number of missed deadlines."""
        return self._jitter.timing(self._missed_deadlines)


class Link:
    """One node's handle: stamps what arrives by our clock, logs it, applies faults.

    A bus that takes no more frames (nobody there to acknowledge) is an outage, not the end: what is
    due is left out, as a sensor's next value comes with the next tick anyway.
    """

    def __init__(
        self,
        bus: can.BusABC,
        clock: WallClock,
        log: LogWriter | None = None,
        faults: FaultInjector | None = None,
        meter: BusMeter | None = None,
        outages: Outages | None = None,
    ) -> None:
        self._bus = bus
        self._outages = outages or Outages()
        self._clock = clock
        self._log = log
        self._faults = faults
        self._meter = meter
        self._kept: can.Message | None = None

    def receive(
        self, deadline_ns: int, until: frozenset[tuple[int, bool]] = frozenset()
    ) -> list[can.Message]:
        """Collect frames until one of each of `until` is there, or the deadline has passed.

        A second frame of an identifier in `until` belongs to the next tick and is kept for the next
        call: after a hiccup the ticks are caught up with one by one and no sample is lost. With an
        empty `until`, whatever is waiting is taken and nothing is waited for.
        Raises CanBusError if the bus goes away.
        """
        missing = set(until)
        arrived: list[can.Message] = []
        while True:
            left_ns = deadline_ns - time.monotonic_ns()
            waiting = bool(missing) and left_ns > 0
            message, self._kept = self._kept, None
            if message is None:
                message = self._bus.recv(left_ns * 1e-9 if waiting else 0)
            if message is not None:
                key = (message.arbitration_id, message.is_extended_id)
                if message.is_error_frame:  # its number is a kind of error, not an identifier
                    key = _NO_KEY
                if key in until and key not in missing:
                    self._kept = message
                    break
                message.timestamp = self._clock.now_us() * 1e-6
                missing.discard(key)
                arrived.append(message)
            elif not waiting:
                break
        if self._faults is not None:
            arrived = list(self._faults.transfer(self._clock.now_us(), arrived))
        self._write(arrived, received=True)
        return arrived

    def send(self, messages: Sequence[can.Message]) -> None:
        """Put the frames on the bus. Raises CanBusError if it goes away."""
        sent = []
        for message in messages:
            try:
                self._bus.send(message)
            except BusFullError:
                self._outages.unsent_frames += 1
                self._outages.begin("bus", self._clock.now_us(), "takes no frame")
            else:
                sent.append(message)
        if sent:
            self._outages.end("bus", self._clock.now_us())
        if self._meter is not None:
            self._meter.note(sent)
        self._write(sent, received=False)

    def _write(self, messages: Sequence[can.Message], *, received: bool) -> None:
        if self._log is not None:
            for message in messages:
                self._log.write(message, received)


def run_paced(
    plant: Node,
    firmware: TriggeredNode | None,
    *,
    plant_bus: can.BusABC,
    firmware_bus: can.BusABC | None,
    tick_period_us: int,
    ticks: int,
    log: LogWriter | None = None,
    faults: FaultInjector | None = None,
    meter: BusMeter | None = None,
    pacer: Pacer | None = None,
    progress: Callable[[int], None] | None = None,
    stop: StopRequest | None = None,
    watch: PeerWatch | None = None,
    outages: Outages | None = None,
) -> Timing:
    """Run plant and firmware in one process, paced; return the timing.

    With `firmware=None` the ECU is somebody else's (hardware, another process): `firmware_bus` is
    not used, its frames are taken from the plant's handle, `log` holds what passed there, and
    `watch` notices when it falls silent.
    Ends early, after a whole tick, when asked to `stop`.
    """
    clock = WallClock()
    outages = outages or Outages()
    outages.start(clock.now_us())
    plant_log = log if firmware is None else None
    plant_link = Link(plant_bus, clock, plant_log, meter=meter, outages=outages)
    firmware_link = (
        None
        if firmware is None or firmware_bus is None
        else Link(firmware_bus, clock, log, faults, meter, outages)
    )
    pacer = pacer or Pacer(tick_period_us)
    answers: list[can.Message] = []
    every = max(1, ticks // 100)
    for tick in range(ticks):
        if stop is not None and stop.is_made:
            break
        pacer.wait_for(tick)
        started_ns = time.monotonic_ns()
        plant_link.send(_stamped(plant.step(clock.now_us(), answers), clock))
        if firmware is not None and firmware_link is not None:
            half_period_ns = tick_period_us * 500
            frames = firmware_link.receive(started_ns + half_period_ns, firmware.trigger_ids)
            firmware_link.send(firmware.step(clock.now_us(), frames))
        answers = plant_link.receive(0)
        if watch is not None:
            watch.see(clock.now_us(), answers)
        if progress is not None and ((tick + 1) % every == 0 or tick + 1 == ticks):
            progress(tick + 1)
    return pacer.timing()


def run_plant_node(
    plant: Node,
    bus: can.BusABC,
    *,
    pacer: Pacer,
    ticks: int,
    stop: StopRequest,
    log: LogWriter | None = None,
    watch: PeerWatch | None = None,
    outages: Outages | None = None,
) -> None:
    """Run the plant alone on a real-time bus, for so many ticks or until asked to stop."""
    clock = WallClock()
    outages = outages or Outages()
    outages.start(clock.now_us())
    link = Link(bus, clock, log, outages=outages)
    tick = 0
    arrived: list[can.Message] = []
    while tick < ticks and not stop.is_made:
        pacer.wait_for(tick)
        link.send(_stamped(plant.step(clock.now_us(), arrived), clock))
        arrived = link.receive(0)
        if watch is not None:
            watch.see(clock.now_us(), arrived)
        tick += 1


def run_firmware_node(
    firmware: TriggeredNode,
    bus: can.BusABC,
    *,
    tick_period_us: int,
    ticks: int | None,
    stop: StopRequest,
    log: LogWriter | None = None,
    watch: PeerWatch | None = None,
    outages: Outages | None = None,
    cycle: CycleMeter | None = None,
) -> Iterator[bool]:
    """Run the firmware alone on a real-time bus; yield after each step whether its input was whole.

    It steps as soon as the tick's sensor frames are complete, or one and a half periods after the
    last step: then with what there is, which the kernel treats as stale. Before the first sensor
    frame it waits. `cycle` is told of each step, `watch` of what arrived.
    """
    clock = WallClock()
    outages = outages or Outages()
    link = Link(bus, clock, log, outages=outages)
    one_and_a_half_periods_ns = tick_period_us * 1500
    done = 0
    started = False
    while (ticks is None or done < ticks) and not stop.is_made:
        frames = link.receive(time.monotonic_ns() + one_and_a_half_periods_ns, firmware.trigger_ids)
        identifiers = {
            (frame.arbitration_id, frame.is_extended_id)
            for frame in frames
            if not frame.is_error_frame
        }
        now_us = clock.now_us()
        if not started and identifiers & firmware.trigger_ids:
            started = True
            outages.start(now_us)
        if started:
            if cycle is not None:
                cycle.step(time.monotonic_ns())
            if watch is not None:
                watch.see(now_us, frames)
            link.send(firmware.step(now_us, frames))
            done += 1
            yield firmware.trigger_ids <= identifiers


def _stamped(messages: Sequence[can.Message], clock: WallClock) -> Sequence[can.Message]:
    """Give frames that python-can's virtual bus hands on as they are a wall-clock stamp."""
    now_s = clock.now_us() * 1e-6
    for message in messages:
        message.timestamp = now_s
    return messages
