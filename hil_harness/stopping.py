"""Ctrl-C between ticks: a run cut short ends with a whole tick, in its log as in its result."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """Whether somebody has asked the loop to stop; loops look between ticks."""

    def __init__(self) -> None:
        self.is_made = False


@contextmanager
def stop_between_ticks() -> Iterator[StopRequest]:
    """Turn the first SIGINT (and SIGTERM, where Python handles it) into a request to stop.

    A second one interrupts at once, as usual. Outside the main thread signals are not ours.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def ask(number: int, frame: FrameType | None) -> None:
        if request.is_made:
            raise KeyboardInterrupt
        request.is_made = True

    before = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        if callable(signal.getsignal(number)):
            before[number] = signal.signal(number, ask)
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
