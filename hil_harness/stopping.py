"""Ctrl-C and SIGTERM end a run the same way: after a whole tick, with what was recorded closed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_Handler = Callable[[int, FrameType | None], None]


class StopRequest:
    """Whether somebody has asked the loop to stop; loops look between ticks."""

    def __init__(self) -> None:
        self.is_made = False


@contextmanager
def stoppable() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGINT and SIGTERM inside this context.

    A shell script starts its background jobs with SIGINT ignored, and `kill` sends SIGTERM: without
    this, a node started there could only be killed.
    """
    with _handled_by(_interrupt):
        yield


@contextmanager
def stop_between_ticks() -> Iterator[StopRequest]:
    """Turn the first SIGINT (and SIGTERM, where Python handles it) into a request to stop.

    A second one interrupts at once, as usual.
    """
    request = StopRequest()

    def ask(number: int, frame: FrameType | None) -> None:
        if request.is_made:
            _interrupt(number, frame)
        request.is_made = True

    with _handled_by(ask, only_where_python_does=True):
        yield request


@contextmanager
def _handled_by(handler: _Handler, *, only_where_python_does: bool = False) -> Iterator[None]:
    """Let *handler* have the signals; outside the main thread they are not ours."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if not only_where_python_does or callable(signal.getsignal(number)):
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
