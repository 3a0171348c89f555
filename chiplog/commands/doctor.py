"""`chiplog doctor`: what this machine has for Chiplog, and what to do about what is missing."""

from __future__ import annotations

import os
import platform
import re
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Final

import typer

_NETWORK_CLASS: Final = Path("/sys/class/net")
_ARPHRD_CAN: Final = "280"  # linux/if_arp.h
_PACING_TICKS: Final = 40
_PACING_PERIOD_US: Final = 5_000


@dataclass(frozen=True)
class Finding:
    """One line: what was looked at, whether it is there, what it is or what to do."""

    subject: str
    is_ok: bool
    text: str
    is_needed: bool = False


def command() -> None:
    """Say what this machine has: Python, libraries, CAN interfaces, caches, clocks.

    Exit status 1 if something is missing that lockstep runs need.
    """
    from chiplog.terminal import show_table

    findings = list(examine())
    show_table(
        ["", "", ""],
        [["ok" if f.is_ok else "missing", f.subject, f.text] for f in findings],
        words=3,
    )
    if any(finding.is_needed and not finding.is_ok for finding in findings):
        raise typer.Exit(1)


def examine() -> Iterator[Finding]:
    """Look at everything, the indispensable first."""
    yield _python()
    yield from _libraries()
    yield _loop("virtual bus", "virtual", "chiplog-doctor", is_needed=True)
    yield _kernel_cache()
    yield _socketcan()
    yield _can_interfaces()
    yield _loop("UDP multicast on this host", "udp_multicast", "239.74.163.2", is_needed=False)
    yield _compiler()
    yield _clock()
    yield _pacing()


def _python() -> Finding:
    text = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    return Finding("Python", sys.version_info >= (3, 11), text, is_needed=True)


def _libraries() -> Iterator[Finding]:
    """One line for all that is there, one for each that is not."""
    present = []
    for requirement in requires("chiplog") or ():
        if "extra ==" in requirement:
            continue
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            present.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            yield Finding(name, False, f"pip install '{requirement}'", is_needed=True)
    yield Finding("libraries", True, ", ".join(present), is_needed=True)


def _loop(subject: str, interface: str, channel: str, *, is_needed: bool) -> Finding:
    """Send one frame from one handle to another."""
    import can

    from can_bus import CanBusError, open_bus

    sent = can.Message(arbitration_id=0x7FF, data=os.urandom(8), is_extended_id=False)
    try:
        with open_bus(interface, channel) as here, open_bus(interface, channel) as there:
            here.send(sent)
            deadline_s = time.monotonic() + 1.0
            while (left_s := deadline_s - time.monotonic()) > 0:
                received = there.recv(left_s)
                if received is not None and received.data == sent.data:
                    return Finding(subject, True, "a frame went round", is_needed)
    except (CanBusError, can.CanError, OSError) as error:
        return Finding(subject, False, " ".join(str(error).split()), is_needed)
    return Finding(subject, False, "no frame came back within 1 s: is a firewall on?", is_needed)


def _kernel_cache() -> Finding:
    """Where numba may keep machine code decides whether the second run starts fast."""
    import firmware_model

    chosen = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(firmware_model.__file__ or ".").parent / "__pycache__"
    folder = Path(chosen) if chosen else beside
    existing = folder if folder.exists() else folder.parent
    if os.access(existing, os.W_OK):
        return Finding("compiled kernel cache", True, str(folder))
    return Finding(
        "compiled kernel cache",
        False,
        f"{folder} cannot be written, so every run compiles anew: set NUMBA_CACHE_DIR",
    )


def _socketcan() -> Finding:
    subject = "SocketCAN"
    if not hasattr(socket, "AF_CAN"):
        return Finding(subject, False, "this system has none: use udp_multicast between processes")
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        text = f"{reason}: sudo modprobe can_raw, or use udp_multicast"
        return Finding(subject, False, text)
    return Finding(subject, True, "the kernel speaks CAN")


def _can_interfaces() -> Finding:
    subject = "CAN interfaces"
    found = [
        f"{folder.name} ({_read(folder / 'operstate')})"
        for folder in sorted(_NETWORK_CLASS.glob("*"))
        if _read(folder / "type") == _ARPHRD_CAN
    ]
    if found:
        return Finding(subject, True, ", ".join(found))
    from can_bus import vcan_commands

    return Finding(subject, False, f"for a virtual one, as root: {vcan_commands('vcan0')}")


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _compiler() -> Finding:
    found = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if found:
        return Finding("C compiler", True, found)
    return Finding("C compiler", False, "only for firmware in C: sudo apt-get install gcc")


def _clock() -> Finding:
    info = time.get_clock_info("monotonic")
    return Finding(
        "monotonic clock",
        info.resolution <= 1e-6,
        f"resolution {info.resolution * 1e9:.0f} ns ({info.implementation})",
    )


def _pacing() -> Finding:
    """Pace a short loop as a real-time run would, and see how late its ticks start."""
    from hil_harness.realtime import Pacer

    pacer = Pacer(_PACING_PERIOD_US)
    wait: Callable[[int], None] = pacer.wait_for
    for tick in range(_PACING_TICKS):
        wait(tick)
    timing = pacer.timing()
    text = (
        f"ticks of {_PACING_PERIOD_US / 1000:g} ms start {timing.jitter_p50_us:.0f} µs late "
        f"(median), {timing.jitter_max_us:.0f} µs at most"
    )
    if timing.missed_deadlines:
        text += ": for real-time runs, free a core or use `chrt -f 50 chiplog run …`"
    return Finding("pacing", timing.missed_deadlines == 0, text)
