"""Who moves the clock: the last thread that has nothing left to do but wait for the bus.

With one thread that is simply the one that waits. With several, the clock stands until every
thread that reads an open handle is blocked in it; then the last one moves it on, to the first
frame or deadline that somebody waits for. A thread that has ended holds nobody up.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sized
from typing import Final

import can

from can_bus.simulated.channel import NEVER_NS, Channel

_LOOK_AGAIN_S: Final = 0.02
_STEPS_IN_A_GO: Final = 256


class _Waiter:
    """A thread that is blocked until something is ready or a time has come."""

    __slots__ = ("deadline_ns", "is_ready", "thread")

    def __init__(self, is_ready: Callable[[], bool], deadline_ns: int) -> None:
        self.thread = threading.current_thread()
        self.is_ready = is_ready
        self.deadline_ns = deadline_ns

    def is_over(self, now_ns: int) -> bool:
        return now_ns >= self.deadline_ns or self.is_ready()


class Pace:
    """Moves the clock of one channel for the threads that wait on it.

    Attributes:
        lock: of everything on the channel.
        changed: the bell, with that lock, that says it has changed.
        waiters: the threads that are blocked; without one nobody hears the bell.
    """

    def __init__(self, channel: Channel) -> None:
        """Start with nobody waiting."""
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self._channel = channel
        self._readers: dict[int, threading.Thread] = {}
        self.waiters: list[_Waiter] = []
        self._only_reader: threading.Thread | None = None

    def note_reader(self, handle: int) -> None:
        """Note that this thread is the one that reads a handle."""
        self._readers[handle] = threading.current_thread()
        self._count_readers()

    def forget_reader(self, handle: int) -> None:
        """Note that a handle is closed."""
        self._readers.pop(handle, None)
        self._count_readers()
        self.changed.notify_all()

    def _count_readers(self) -> None:
        threads = set(self._readers.values())
        self._only_reader = threads.pop() if len(threads) == 1 else None

    def wait_for(self, received: Sized, deadline_ns: int, is_given_up: Callable[[], bool]) -> None:
        """Block until something is received, the deadline, or, now and then, `is_given_up`.

        The lock is held by the caller, who is a reader.
        """
        while self._only_reader is threading.current_thread() and not self.waiters:
            if not self._channel.run(deadline_ns, received, _STEPS_IN_A_GO):
                if received or deadline_ns < NEVER_NS:
                    return
                break
            self.changed.wait(0)  # others may send in between
            if is_given_up():
                return
        self.wait(lambda: bool(received), deadline_ns, is_given_up)

    def ring(self) -> None:
        """Say that something has changed."""
        if self.waiters:
            self.changed.notify_all()

    def wait(
        self, is_ready: Callable[[], bool], deadline_ns: int, is_given_up: Callable[[], bool]
    ) -> None:
        """Block until `is_ready`, the deadline, or, looked at now and then, `is_given_up`.

        The lock is held by the caller.
        """
        channel = self._channel
        waiter = _Waiter(is_ready, deadline_ns)
        self.waiters.append(waiter)
        try:
            while not waiter.is_over(channel.now_ns):
                if self._is_everyone_waiting():
                    if not self._move():
                        self.changed.wait(_LOOK_AGAIN_S)
                else:
                    self.changed.wait(_LOOK_AGAIN_S)
                if is_given_up():
                    return
        finally:
            self.waiters.remove(waiter)

    def _is_everyone_waiting(self) -> bool:
        waiters = self.waiters
        if len(waiters) > 1 and any(one.is_over(self._channel.now_ns) for one in waiters):
            return False
        blocked = {one.thread for one in waiters}
        return all(reader in blocked or not reader.is_alive() for reader in self._readers.values())

    def _move(self) -> bool:
        """Move the clock until somebody's wait is over; return whether anything happened."""
        channel, waiters = self._channel, self.waiters
        limit_ns = min(one.deadline_ns for one in waiters)
        for _ in range(_STEPS_IN_A_GO):
            if not channel.step(limit_ns):
                if len(waiters) > 1:
                    self.changed.notify_all()
                return limit_ns < NEVER_NS
            for one in waiters:
                if one.is_ready():
                    if len(waiters) > 1:
                        self.changed.notify_all()
                    return True
        self.changed.wait(0)  # others may send in between
        return True


def is_notifier_stopped(bus: can.BusABC) -> bool:
    """Tell whether a notifier of this bus was stopped: its thread is being waited for."""
    return any(one.stopped for one in can.Notifier.find_instances(bus))
