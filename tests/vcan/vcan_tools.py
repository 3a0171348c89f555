"""Waiting for others on a SocketCAN bus."""

from __future__ import annotations

import time
from pathlib import Path

from can_bus import make_message
from can_bus.database import Database

GENEROUS_S = 60.0
"""Not a deadline: only a broken bus waits so long."""

_LISTENERS = Path("/proc/net/can")


def listeners(channel: str) -> int:
    """Return how many receive filters are set on an interface (an open socket has one or more)."""
    lists = (path.read_text() for path in _LISTENERS.glob("rcvlist_*"))
    return sum(line.split()[:1] == [channel] for text in lists for line in text.splitlines())


def wait_for_listener(channel: str, before: int) -> None:
    """Wait until more filters are set than *before*: a client that was just started listens."""
    end_s = time.monotonic() + GENEROUS_S
    while listeners(channel) <= before:
        assert time.monotonic() < end_s, "nobody began to listen"
        time.sleep(0.02)


def encoder_frames(database: Database, count: int) -> list[bytes]:
    """Return valid ENCODER frames' data: so many ticks of wheels that turn."""
    spec = database.message("ENCODER")
    return [
        bytes(make_message(spec, spec.pack((7 * tick, 5 * tick), tick % 15), 0).data)
        for tick in range(count)
    ]
