"""CAN over UDP multicast, confined to this host.

python-can's `udp_multicast` binds to all addresses, hears every group on its port and its own
frames, and reaches the network. This bus speaks the same datagrams, but joins and sends on the
loopback interface with time-to-live 0, binds to its group, and drops its own echo.
`interface_ip` opens it to the network of that address on purpose.
"""

from __future__ import annotations

import ipaddress
import logging
import socket
import struct
import sys
from time import monotonic
from typing import Final

import can
import msgpack
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.bus import GeneralPurposeUdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message

from can_bus.errors import CanBusError

LOOPBACK_IP: Final = "127.0.0.1"

_IP_MULTICAST_ALL: Final = 49  # Linux: 0 = deliver only groups joined by this very socket
_SO_TIMESTAMPNS: Final = 35
_MAX_PORT: Final = (1 << 16) - 1
_MAX_HOPS: Final = 255
_FLAGS: Final = ("is_extended_id", "is_remote_frame", "is_error_frame", "is_fd")

_log = logging.getLogger(__name__)


class _ConfinedSocket(GeneralPurposeUdpMulticastBus):
    """python-can's multicast socket, on one interface, with a sender socket of its own.

    All members of a group share its port; what a bus sends leaves from another port that only it
    has, so its echo can be told from the frames of others.
    """

    def __init__(self, group: str, port: int, hop_limit: int, interface_ip: str) -> None:
        self._interface = socket.inet_aton(interface_ip)
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._sender.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, struct.pack("@I", hop_limit)
            )
            self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, self._interface)
            self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            self._sender.bind((interface_ip, 0))
            super().__init__(group, port, hop_limit)
        except BaseException:
            self._sender.close()
            raise
        self.own_address = self._sender.getsockname()

    def _create_socket(self, address_family: socket.AddressFamily) -> socket.socket:
        receiver = socket.socket(address_family, socket.SOCK_DGRAM)
        try:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "SO_REUSEPORT"):
                receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            if sys.platform == "linux":
                receiver.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
                receiver.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
                self.timestamp_nanosecond = True
            # Bound to the group, the socket hears no unicast and no other group; Windows cannot.
            receiver.bind(("" if sys.platform == "win32" else self.group, self.port))
            request = socket.inet_aton(self.group) + self._interface
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
        except OSError:
            receiver.close()
            raise
        return receiver

    def send(self, data: bytes, timeout: float | None = None) -> None:
        self._sender.settimeout(timeout)
        self._sender.sendto(data, (self.group, self.port))

    def shutdown(self) -> None:
        super().shutdown()
        self._sender.close()


class HostMulticastBus(UdpMulticastBus):
    """A CAN bus between the processes of this host, classic frames only.

    Datagrams that are no CAN frame are dropped and counted in `malformed`.

    Raises CanBusError for a channel that is no IPv4 multicast group or an address that this host
    does not have.
    """

    def __init__(
        self,
        channel: str = UdpMulticastBus.DEFAULT_GROUP_IPv4,
        port: int = 43113,  # python-can's own default: its programs meet ours on it
        interface_ip: str = LOOPBACK_IP,
        hop_limit: int | None = None,
    ) -> None:
        """Join the group on the interface that has `interface_ip`."""
        self._is_shutdown = True  # for python-can's destructor, should opening fail
        if not _is_ipv4_group(channel):
            raise CanBusError(
                f"udp_multicast channel {channel!r}: expected an IPv4 multicast group, for example "
                f"{UdpMulticastBus.DEFAULT_GROUP_IPv4}"
            )
        if not (isinstance(port, int) and 0 < port <= _MAX_PORT):
            raise CanBusError(f"udp_multicast port {port!r}: expected 1 to {_MAX_PORT}")
        if not (hop_limit is None or (isinstance(hop_limit, int) and 0 <= hop_limit <= _MAX_HOPS)):
            raise CanBusError(f"udp_multicast hop_limit {hop_limit!r}: expected 0 to {_MAX_HOPS}")
        is_confined = ipaddress.ip_address(_known_ip(interface_ip)).is_loopback
        can.BusABC.__init__(self, channel)
        hops = (0 if is_confined else 1) if hop_limit is None else hop_limit
        try:
            multicast = _ConfinedSocket(channel, port, hops, interface_ip)
        except (OSError, can.CanError) as error:
            self._is_shutdown = True
            cause = error if isinstance(error, OSError) else error.__context__ or error
            raise CanBusError(
                f"udp_multicast {channel}:{port} on {interface_ip}: {cause}; interface_ip must be "
                "an address of this host with multicast"
            ) from error
        self._multicast = multicast
        self._own_address = multicast.own_address
        self._can_protocol = can.CanProtocol.CAN_20
        self.channel_info = f"udp_multicast {channel}:{port} on {interface_ip}"
        self.malformed = 0

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline = None if timeout is None else monotonic() + timeout
        while True:
            remaining = None if deadline is None else max(0.0, deadline - monotonic())
            received = self._multicast.recv(remaining)
            if received is None:
                return None, False
            datagram, sender, stamp = received
            if sender == self._own_address:
                continue
            message = _parse(datagram, stamp)
            if message is not None:
                return message, False
            self.malformed += 1
            _log.debug("dropped %d bytes from %s: not a CAN frame", len(datagram), sender)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a classic CAN frame to all other members of the group on this host."""
        if msg.is_fd:
            raise can.CanOperationError("this bus carries classic CAN frames only")
        self._multicast.send(pack_message(msg), timeout)


def _parse(datagram: bytes, stamp: float) -> can.Message | None:
    """Return the classic CAN frame in a datagram, None for anything else."""
    try:
        fields = msgpack.unpackb(datagram, raw=False)  # its size bounds what it allocates
        identifier, data, dlc = fields["arbitration_id"], fields["data"], fields["dlc"]
        flags = [fields[name] for name in _FLAGS]
        # Types first: what can.Message accepts as data includes a number of bytes to allocate.
        if type(identifier) is not int or type(dlc) is not int or type(data) is not bytes:
            return None
        if any(type(flag) is not bool for flag in flags):
            return None
        is_extended, is_remote, is_error, is_fd = flags
        if is_fd:
            return None
        return can.Message(
            timestamp=stamp,
            arbitration_id=identifier,
            is_extended_id=is_extended,
            is_remote_frame=is_remote,
            is_error_frame=is_error,
            dlc=dlc,
            data=data,
            check=True,
        )
    except (ValueError, KeyError, TypeError, msgpack.UnpackException):
        return None


def _is_ipv4_group(channel: str) -> bool:
    try:
        return ipaddress.IPv4Address(channel).is_multicast
    except ValueError:
        return False


def _known_ip(text: str) -> str:
    try:
        return str(ipaddress.IPv4Address(text))
    except ValueError as error:
        raise CanBusError(
            f"udp_multicast interface_ip {text!r}: expected an IPv4 address of this host"
        ) from error
