"""Interfaces, channels and what becomes of them."""

from __future__ import annotations

from error_tables.row import Row

_NO_VCAN = "as root: modprobe vcan; ip link add dev vcan7 type vcan; ip link set up vcan7"
_IN_PROCESS = (
    "--interface virtual lives inside one process, where no other node could hear this one: use "
    "udp_multicast (this host), socketcan (vcan0, can0) or your adapter's"
)

BUS: tuple[Row, ...] = (
    Row(
        "an interface without a channel",
        "chiplog run --interface socketcan",
        "--interface socketcan needs a channel: expected --channel vcan0",
    ),
    Row(
        "a CAN interface that is not there",
        "chiplog run --interface socketcan --channel vcan7",
        f"socketcan: this kernel has no SocketCAN; {_NO_VCAN}",
        or_line=f"socketcan: there is no network interface 'vcan7'; {_NO_VCAN}",
    ),
    Row(
        "a multicast group that is none",
        "chiplog run --interface udp_multicast --channel 10.0.0.1",
        "udp_multicast channel '10.0.0.1': expected an IPv4 multicast group, for example "
        "239.74.163.2",
    ),
    Row(
        "simulated time on a real bus",
        "chiplog run --interface udp_multicast --time lockstep",
        "--time lockstep --interface udp_multicast: that bus has no simulated clock; expected "
        "--interface virtual or chiplog, or --time real",
    ),
    Row(
        "a bus argument that is none",
        "chiplog run --bus-arg interface_ip",
        "--bus-arg 'interface_ip': expected KEY=VALUE, for example interface_ip=127.0.0.1",
    ),
    Row(
        "a node alone on an in-process bus",
        "chiplog node plant --interface virtual",
        _IN_PROCESS,
    ),
    Row(
        "a bus that goes away under way",
        "chiplog run --channel bench",
        "the bus 'Virtual bus channel bench' went away: cannot send: adapter unplugged",
        breaks_after_frames=500,
    ),
    Row(
        "an interface that does not exist",
        "chiplog run --interface banana --channel 0",
        "no interface 'banana': python-can knows canalystii, cantact, chiplog, etas, "
        "gs_usb, iscan, ixxat, kvaser, neousys, neovi, nican, nixnet, pcan, "
        "robotell, seeedstudio, serial, slcan, socketcan, socketcand, systec, "
        "udp_multicast, usb2can, vector, virtual",
    ),
    Row(
        "an argument that the interface has not",
        "chiplog run --interface udp_multicast --bus-arg colour=red",
        "udp_multicast has no argument 'colour': it has port, interface_ip, hop_limit",
    ),
    Row(
        "an adapter that cannot be opened",
        "chiplog run --interface slcan --channel /dev/none",
        "cannot open slcan channel '/dev/none': The serial module is not installed",
    ),
    Row(
        "a port that does not exist",
        "chiplog run --interface udp_multicast --bus-arg port=99999",
        "udp_multicast port 99999: expected 1 to 65535",
    ),
    Row(
        "an address that is none",
        "chiplog run --interface udp_multicast --bus-arg interface_ip=here",
        "udp_multicast interface_ip 'here': expected an IPv4 address of this host",
    ),
)

BUS += (
    Row(
        "an address that is not of this host",
        "chiplog run --interface udp_multicast --bus-arg interface_ip=192.0.2.1",
        "udp_multicast 239.74.163.2:43113 on 192.0.2.1: [Errno 99] Cannot assign "
        "requested address; interface_ip must be an address of this host with multicast",
    ),
    Row(
        "a hop limit that is none",
        "chiplog run --interface udp_multicast --bus-arg hop_limit=far",
        "udp_multicast hop_limit 'far': expected 0 to 255",
    ),
    Row(
        "CAN hardware that is not there",
        "chiplog run --interface socketcan --channel can7",
        "socketcan: this kernel has no SocketCAN; "
        "as root: ip link set can7 up type can bitrate BITRATE restart-ms 100",
        or_line="socketcan: there is no network interface 'can7'; "
        "as root: ip link set can7 up type can bitrate BITRATE restart-ms 100",
    ),
)
