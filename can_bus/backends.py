"""Buses: any python-can interface, opened with plain errors."""

from __future__ import annotations

import errno
import queue
from collections.abc import Mapping
from typing import Any, Final

import can
from can.interfaces.virtual import VirtualBus
from can.util import cast_from_string

from can_bus.errors import BusFullError, CanBusError, one_line, quiet
from can_bus.simulated import SimulatedBus

IN_PROCESS_INTERFACES: Final = frozenset({"virtual", "chiplog"})
"""Interfaces whose frames never leave the process: two processes cannot meet on them."""

CONNECTING_INTERFACES: Final = ("udp_multicast", "socketcan")
"""Interfaces without hardware that connect processes of one host."""

# python-can's buses swallow arguments they do not know; these refuse them.
_ARGUMENTS: Final = {
    "virtual": ("preserve_timestamps", "receive_own_messages", "rx_queue_size"),
    "chiplog": (
        "node",
        "receive_own_messages",
        "ignore_rx_error_frames",
        "tx_order",
        "tx_mailboxes",
        "tx_backlog",
        "clock_skew",
        "retransmit",
        "restart",
        "seed",
        "faults",
    ),
    "udp_multicast": ("port", "interface_ip", "hop_limit"),
}
_NO_DEVICE: Final = frozenset({errno.ENODEV, errno.ENXIO, errno.EADDRNOTAVAIL})
_NO_FAMILY: Final = frozenset({errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT})


class _PlainErrors(can.BusABC):
    """Mixed in front of a python-can bus: a bus that goes away says so in one sentence."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame. Raises BusFullError if no more fits, CanBusError if the bus is gone."""
        try:
            super().send(msg, timeout)  # type: ignore[safe-super]  # the bus behind
        except (can.CanError, OSError, ValueError) as error:
            # select() on a closed socket's descriptor is a ValueError.
            if _is_full(error):
                raise BusFullError(
                    f"the bus {self.channel_info!r} takes no more frames: is there another node "
                    "that acknowledges them?"
                ) from error
            raise _gone(self, "send", error) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            return super()._recv_internal(timeout)
        except (can.CanError, OSError, ValueError) as error:
            raise _gone(self, "receive", error) from error


class _QuickVirtualBus(_PlainErrors, VirtualBus):
    """python-can's virtual bus with a lighter receive queue; other handles see no difference.

    An unbounded `SimpleQueue` in place of `Queue`, copies made without the `copy` module, and polls
    (timeout 0) that read the queue directly take three quarters off the cost of a frame.
    """

    def __init__(self, channel: str, **arguments: Any) -> None:
        super().__init__(channel, **arguments)
        if self.queue.maxsize == 0:
            light: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
            self.channel[self.channel.index(self.queue)] = light  # type: ignore[call-overload]
            self.queue = light  # type: ignore[assignment]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if not self.preserve_timestamps or not self._open:
            super().send(msg, timeout)
            return
        own = self.queue
        is_everywhere = True
        for receiver in self.channel:
            if receiver is own and not self.receive_own_messages:
                continue
            copy = msg.__deepcopy__(None)
            copy.channel = self.channel_id
            copy.is_rx = receiver is not own
            try:
                receiver.put(copy, True, timeout)
            except queue.Full:
                is_everywhere = False
        if not is_everywhere:
            full = can.CanOperationError("Could not send message to one or more recipients")
            raise _gone(self, "send", full)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if timeout != 0 or self._filters is not None or not self._open:
            return super().recv(timeout)
        waiting = self.queue
        if waiting.empty():  # quicker than the exception that says so
            return None
        try:
            return waiting.get_nowait()
        except queue.Empty:  # somebody else was quicker
            return None


def open_bus(
    interface: str,
    channel: str,
    *,
    bitrate: int | None = None,
    bus_args: Mapping[str, str] | None = None,
) -> can.BusABC:
    """Open a bus.

    Args:
        interface: `virtual` (one process; stamps are the sender's), `chiplog` (one process,
            simulated time), `socketcan` (vcan0, can0), `udp_multicast` (processes of this host;
            `interface_ip` opens it to a network), or any other interface that python-can knows.
        channel: for `virtual` and `chiplog` any name, for `socketcan` the network interface, for
            `udp_multicast` an IPv4 multicast group.
        bitrate: in bit/s, for interfaces that set it.
        bus_args: more arguments of the interface, as text (`--bus-arg K=V`).

    Sending and receiving raise CanBusError when the bus goes away.

    Raises CanBusError, on one line with what to do, when the bus cannot be opened.
    """
    arguments: dict[str, Any] = {k: cast_from_string(v) for k, v in (bus_args or {}).items()}
    try:
        with quiet("can"):
            return _open(interface, channel, bitrate, arguments)
    except CanBusError:
        raise
    except Exception as error:  # drivers raise whatever they like
        raise _cannot_open(interface, channel, bitrate, error) from error


def _open(
    interface: str, channel: str, bitrate: int | None, arguments: dict[str, Any]
) -> can.BusABC:
    known = _ARGUMENTS.get(interface)
    for name in arguments:
        if known is not None and name not in known:
            raise CanBusError(f"{interface} has no argument {name!r}: it has {', '.join(known)}")
    if interface == "virtual":
        return _QuickVirtualBus(channel, **{"preserve_timestamps": True, **arguments})
    if interface == "chiplog":
        return plain(SimulatedBus(channel, bitrate=bitrate, **arguments))
    if interface == "udp_multicast":
        # Needs msgpack, which no other interface does.
        from can_bus.multicast import HostMulticastBus  # noqa: PLC0415

        return plain(HostMulticastBus(channel, **arguments))
    if bitrate is not None and interface != "socketcan":
        arguments = {"bitrate": bitrate, **arguments}
    return plain(can.Bus(channel, interface=interface, ignore_config=True, **arguments))


def check_interface(interface: str) -> None:
    """Raise CanBusError, with the names there are, for an interface that python-can has not."""
    known = sorted(can.VALID_INTERFACES)
    if interface not in known:
        raise CanBusError(f"no interface {interface!r}: python-can knows {', '.join(known)}")


def vcan_commands(channel: str) -> str:
    """Return the three commands, for root, that make a virtual CAN interface."""
    return f"modprobe vcan; ip link add dev {channel} type vcan; ip link set up {channel}"


def plain(bus: can.BusABC) -> can.BusABC:
    """Return the same bus, its errors from now on CanBusError in one sentence."""
    kind = type(bus)
    bus.__class__ = type(kind.__name__, (_PlainErrors, kind), {"__doc__": kind.__doc__})
    return bus


def _is_full(error: BaseException) -> bool:
    """Tell whether a SocketCAN interface's transmit queue is full, which passes."""
    number = error.errno if isinstance(error, OSError) else getattr(error, "error_code", None)
    return number == errno.ENOBUFS or str(error) == "Transmit buffer full"


def _gone(bus: can.BusABC, action: str, error: BaseException) -> CanBusError:
    cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
    return CanBusError(
        f"the bus {bus.channel_info!r} went away: cannot {action}: {one_line(cause)}"
    )


def _cannot_open(
    interface: str, channel: str, bitrate: int | None, error: Exception
) -> CanBusError:
    if interface == "socketcan":
        return _cannot_open_socketcan(channel, bitrate, error)
    try:
        check_interface(interface)
    except CanBusError as unknown:
        return unknown
    return CanBusError(f"cannot open {interface} channel {channel!r}: {one_line(error)}")


def _cannot_open_socketcan(channel: str, bitrate: int | None, error: Exception) -> CanBusError:
    number = error.errno if isinstance(error, OSError) else None
    if number in _NO_FAMILY or isinstance(error, AttributeError):
        problem = "this kernel has no SocketCAN"
    elif number in _NO_DEVICE:
        problem = f"there is no network interface {channel!r}"
    else:
        problem = f"cannot open {channel!r}: {one_line(error)}"
    if channel.startswith("vcan"):
        remedy = f"as root: {vcan_commands(channel)}"
    else:
        rate = bitrate if bitrate is not None else "BITRATE"
        remedy = f"as root: ip link set {channel} up type can bitrate {rate} restart-ms 100"
    return CanBusError(f"socketcan: {problem}; {remedy}")
