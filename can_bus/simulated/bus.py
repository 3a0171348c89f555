"""The simulated bus as a python-can interface: `can.Bus("name", interface="chiplog")`."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from contextlib import AbstractContextManager
from functools import cache
from pathlib import Path
from typing import Final

import can
from can.typechecking import AutoDetectedConfig, CanFilters
from can.typechecking import Channel as ChannelName

from can_bus.database import load_database
from can_bus.errors import CanBusError
from can_bus.simulated.channel import NEVER_NS, Channel
from can_bus.simulated.confinement import ErrorState
from can_bus.simulated.controller import Controller
from can_bus.simulated.fault_file import load_faults
from can_bus.simulated.faults import ActiveFault, BusFault
from can_bus.simulated.messages import copy_of
from can_bus.simulated.pace import Pace, is_notifier_stopped
from can_bus.simulated.periodic import SimulatedCyclicTask
from can_bus.simulated.queues import Pending, TransmitOrder, TransmitQueue, arbitration_key
from can_bus.timing import frame_length_bits

_STATES: Final = {
    ErrorState.ACTIVE: can.BusState.ACTIVE,
    ErrorState.PASSIVE: can.BusState.PASSIVE,
    ErrorState.BUS_OFF: can.BusState.ERROR,
}


class _Wire:
    """A channel that is open, shared by its handles."""

    def __init__(self, bitrate: int) -> None:
        self.channel = Channel(bitrate)
        self.pace = Pace(self.channel)
        self.handles = 0
        self.names = 0


_wires: dict[Hashable, _Wire] = {}
_wires_lock: Final = threading.Lock()


class SimulatedBus(can.BusABC):
    """One node on a bus whose time is simulated and right to the bit.

    Handles of one channel name in one process are nodes on one wire with one clock, which starts
    at 0 with the first handle and ends with the last. `send` queues a frame at the current time.
    `recv(timeout)` returns the next completed frame, or moves the clock on by `timeout` and
    returns None; `recv(0)` never moves it. A stamp is the end of the frame. With several threads
    the clock moves only when every thread that reads an open handle is blocked in `recv` (or in
    a `send` that waits for room). The same calls give the same bus, bit for bit.

    Modelled: frame lengths with their stuff bits; arbitration; intermission; transmit queues;
    bit, stuff, form, CRC and acknowledge errors, error and overload flags bit by bit;
    retransmission; the error counters, error-passive, suspend transmission, bus-off and its
    recovery; each node's own clock.

    Not modelled: CAN FD and CAN XL; propagation along the wire and resynchronisation (all nodes
    read a bit at the same time, and a node that is ready within another's first bit does not join
    it); sampling errors from clocks that differ (a skewed clock changes periods, timeouts and
    stamps, not bits); wake-up; transceivers and levels; the controller's own time between
    interrupt and mailbox; a receive FIFO that overruns; requests for overload frames by a slow
    node; a dominant third bit of intermission as a start of frame. An unacknowledged frame that
    an error-passive node repeats is reported once, not at each attempt.

    Args:
        channel: any name.
        can_filters: as for every python-can bus; a frame that does not match is not kept.
        bitrate: in bit/s; None: the channel's, that of the shipped DBC for a new one.
        node: name of the node, as faults name it; None: `node-1` and so on.
        receive_own_messages: also receive what this handle has sent, when it has been sent.
        ignore_rx_error_frames: do not receive error frames.
        tx_order: `priority` or `fifo`; tx_mailboxes: how many frames the controller holds;
            tx_backlog: how many more wait behind. None: no limit. See `TransmitQueue`.
        clock_skew: by how much this node's clock is fast: its stamps, timeouts and periods.
        retransmit: try a frame again that met an error.
        restart: come back from bus-off by itself; else setting `state` to ACTIVE asks for it.
        seed: of faults that this handle injects.
        faults: TOML file of faults, switched on when the handle is opened.

    Further arguments of other interfaces are taken and ignored, as python-can's buses do.
    Raises CanInitializationError for what cannot be, CanOperationError when it is closed.
    """

    def __init__(
        self,
        channel: ChannelName = "chiplog",
        can_filters: CanFilters | None = None,
        *,
        bitrate: int | None = None,
        timing: can.BitTiming | can.BitTimingFd | None = None,
        fd: bool = False,
        node: str | None = None,
        receive_own_messages: bool = False,
        ignore_rx_error_frames: bool = False,
        tx_order: TransmitOrder = "priority",
        tx_mailboxes: int | None = None,
        tx_backlog: int | None = None,
        clock_skew: float = 0.0,
        retransmit: bool = True,
        restart: bool = True,
        seed: int = 0,
        faults: str | Path | None = None,
        **_of_other_interfaces: object,
    ) -> None:
        """Open a handle."""
        if fd or isinstance(timing, can.BitTimingFd):
            raise can.CanInitializationError("the simulated bus carries classic CAN only")
        if isinstance(timing, can.BitTiming):
            bitrate = timing.bitrate
        self._received: deque[can.Message] = deque()
        self._seed = seed
        self._name: Hashable = channel
        self._is_open = False
        self._reader: threading.Thread | None = None
        try:
            planned = [] if faults is None else load_faults(faults)
            self._wire = _open_wire(channel, bitrate)
            self._channel, self._pace = self._wire.channel, self._wire.pace
            try:
                controller = self._controller = Controller(
                    node if node is not None else self._numbered_name(),
                    TransmitQueue(tx_order, tx_mailboxes, tx_backlog),
                    clock_skew=clock_skew,
                    retransmits=retransmit,
                    restarts=restart,
                    take=self._received.append,
                    report=None if ignore_rx_error_frames else self._report,
                    echo=self._filter if receive_own_messages else None,
                )
                self._join(controller)
            except BaseException:
                _close_wire(channel)
                raise
        except CanBusError as error:
            raise can.CanInitializationError(str(error)) from error
        self._is_open = True
        self.channel_info = f"simulated bus {channel} ({self._controller.name})"
        super().__init__(channel, can_filters)
        try:
            for fault in planned:
                self.inject(fault)
        except CanBusError as error:
            self.shutdown()
            raise can.CanInitializationError(str(error)) from error

    # --- python-can's interface ------------------------------------------------------------------

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue a frame at the current time.

        With a full queue, wait up to `timeout` for room (None or 0: not at all). Raises
        CanOperationError if there is none, or if the handle is closed; CanBusError for a frame
        that classic CAN does not have.
        """
        pace = self._pace
        with pace.lock:
            if not self._is_open:
                self._check_open()
            if msg.is_error_frame or msg.is_fd:
                raise CanBusError("the simulated bus sends classic data and remote frames only")
            is_remote = msg.is_remote_frame
            length_bits = frame_length_bits(
                msg.arbitration_id,
                msg.is_extended_id,
                msg.data,
                remote_dlc=msg.dlc if is_remote else None,
            )
            queue = self._controller.queue
            if queue.capacity is not None and queue.is_full:
                self._wait_for_room(timeout)
            key = arbitration_key(msg.arbitration_id, msg.is_extended_id, is_remote)
            message = copy_of(msg, 0.0)
            message.channel = self._name  # type: ignore[assignment]
            self._channel.send(self._controller, Pending(key, message, length_bits))
            if pace.waiters:
                pace.ring()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next completed frame, or let `timeout` pass on the simulated clock."""
        if timeout == 0 and self._is_open and self._reader is threading.current_thread():
            return self._received.popleft() if self._received else None
        return self._recv_internal(timeout)[0]

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        received = self._received
        with self._pace.lock:
            self._note_reader()
            if received:
                return received.popleft(), True
            if timeout is not None and timeout <= 0:
                return None, True
            self._pace.wait_for(received, self._deadline_ns(timeout), self._is_given_up)
            self._check_open()
            return (received.popleft() if received else None), True

    def _send_periodic_internal(
        self,
        msgs: Sequence[can.Message] | can.Message,
        period: float,
        duration: float | None = None,
        autostart: bool = True,
        modifier_callback: Callable[[can.Message], None] | None = None,
    ) -> SimulatedCyclicTask:
        return SimulatedCyclicTask(
            self, msgs, period, duration, modifier_callback, autostart=autostart
        )

    @property
    def state(self) -> can.BusState:
        """ACTIVE, PASSIVE, or ERROR for bus-off."""
        return _STATES[self._controller.confinement.state]

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        if new_state is not can.BusState.ACTIVE:
            raise NotImplementedError("the error counters decide: only ACTIVE can be asked for")
        with self._pace.lock:
            self._channel.recover(self._controller)

    def flush_tx_buffer(self) -> None:
        """Drop what waits to be sent; a frame on the wire is finished."""
        with self._pace.lock:
            self._controller.queue.clear()

    def shutdown(self) -> None:
        """Leave the bus; may be called twice."""
        super().shutdown()
        if self._is_open:
            with self._pace.lock:
                self._is_open = False
                self._channel.remove(self._controller)
                self._pace.forget_reader(id(self))
            _close_wire(self._name)

    def _apply_filters(self, filters: CanFilters | None) -> None:
        """Filter at reception, as a controller does; error frames always pass."""
        self._controller.take = self._filter if filters else self._received.append

    @staticmethod
    def _detect_available_configs() -> Sequence[AutoDetectedConfig]:
        with _wires_lock:
            return [{"interface": "chiplog", "channel": str(name)} for name in _wires]

    # --- what other interfaces do not have -------------------------------------------------------

    @property
    def node(self) -> str:
        """The node's name."""
        return self._controller.name

    @property
    def bitrate(self) -> int:
        """The channel's bit rate, bit/s."""
        return self._channel.bitrate

    @property
    def now_ns(self) -> int:
        """The bus's clock, ns; no node's own."""
        return self._channel.now_ns

    @property
    def now_s(self) -> float:
        """This node's clock, s."""
        return self._controller.local_s(self._channel.now_ns)

    @property
    def busy_bits(self) -> int:
        """Bit times that frames, error frames and intermissions have taken on the channel."""
        return self._channel.busy_bits

    @property
    def error_counters(self) -> tuple[int, int]:
        """Transmit and receive error counter."""
        return self._controller.confinement.tec, self._controller.confinement.rec

    @property
    def waiting_to_send(self) -> int:
        """How many frames are queued, the one on the wire included."""
        return len(self._controller.queue)

    def pass_time(self, duration_s: float) -> None:
        """Let time pass on this node's clock; what arrives is kept for `recv`."""
        with self._pace.lock:
            self._note_reader()
            self._pace.wait_for((), self._deadline_ns(duration_s), self._is_given_up)

    def pass_until_ns(self, time_ns: int) -> None:
        """Let time pass until then on the bus's clock; what arrives is kept for `recv`."""
        with self._pace.lock:
            self._note_reader()
            self._pace.wait_for((), time_ns, self._is_given_up)

    def inject(self, fault: BusFault) -> ActiveFault:
        """Switch a fault of the channel on, from now on or in its window."""
        with self._pace.lock:
            self._check_open()
            return self._channel.inject(fault, self._seed)

    def clear(self, fault: ActiveFault) -> None:
        """Switch a fault off; frames that it delays still come."""
        with self._pace.lock:
            self._channel.faults.remove(fault)

    def to_bus_ns(self, duration_s: float) -> int:
        """Return a duration on this node's clock in nanoseconds of the bus."""
        return self._controller.bus_ns(duration_s)

    @property
    def standing_clock(self) -> AbstractContextManager[object]:
        """A context in which no thread moves the clock on."""
        return self._pace.lock

    def at_ns(self, time_ns: int, action: Callable[[], None]) -> None:
        """Have something done at a time of the bus."""
        with self._pace.lock:
            self._channel.at(time_ns, action)
            self._pace.ring()

    # --- inside ----------------------------------------------------------------------------------

    def _filter(self, message: can.Message) -> None:
        if self._matches_filters(message):
            self._received.append(message)

    def _report(self, message: can.Message) -> None:
        message.channel = self._name  # type: ignore[assignment]
        self._received.append(message)

    def _note_reader(self) -> None:
        self._check_open()
        reader = threading.current_thread()
        if self._reader is not reader:
            self._reader = reader
            self._pace.note_reader(id(self))

    def _deadline_ns(self, timeout: float | None) -> int:
        if timeout is None:
            return NEVER_NS
        return self._channel.now_ns + max(self._controller.bus_ns(timeout), 0)

    def _is_given_up(self) -> bool:
        return not self._is_open or is_notifier_stopped(self)

    def _wait_for_room(self, timeout: float | None) -> None:
        queue = self._controller.queue
        if timeout is not None and timeout > 0:
            deadline_ns = self._deadline_ns(timeout)
            self._pace.wait(lambda: not queue.is_full, deadline_ns, self._is_given_up)
            self._check_open()
        if queue.is_full:
            raise can.CanOperationError(f"the transmit queue of {self.node} is full")

    def _check_open(self) -> None:
        if not self._is_open:
            raise can.CanOperationError("Cannot operate on a closed bus")

    def _numbered_name(self) -> str:
        self._wire.names += 1
        return f"node-{self._wire.names}"

    def _join(self, controller: Controller) -> None:
        with self._pace.lock:
            channel = self._channel
            if any(one.name == controller.name for one in channel.controllers):
                raise CanBusError(f"there is a node {controller.name!r} on this channel already")
            channel.add(controller)


@cache
def _usual_bitrate() -> int:
    """Return the bit rate [bit/s] that the shipped DBC names."""
    usual = load_database().bitrate
    assert usual is not None  # tests/can_bus hold the shipped DBC to it
    return usual


def _open_wire(name: Hashable, bitrate: int | None) -> _Wire:
    with _wires_lock:
        wire = _wires.get(name)
        if wire is None:
            wire = _wires[name] = _Wire(_usual_bitrate() if bitrate is None else int(bitrate))
        elif bitrate is not None and bitrate != wire.channel.bitrate:
            raise CanBusError(
                f"bitrate = {bitrate}: channel {name!r} runs at {wire.channel.bitrate} bit/s"
            )
        wire.handles += 1
        return wire


def _close_wire(name: Hashable) -> None:
    with _wires_lock:
        wire = _wires[name]
        wire.handles -= 1
        if not wire.handles:
            del _wires[name]
