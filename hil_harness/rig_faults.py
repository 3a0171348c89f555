"""Faults that a test switches on and off."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

from can_bus import Fault, FaultInjector


class FaultHandle:
    """A fault that is on until `clear()`, or until the end of a ``with`` block."""

    def __init__(self, fault: Fault, injectors: Sequence[FaultInjector]) -> None:
        """Switch the fault on, in every direction that it can strike."""
        self.fault = fault
        self._injectors = injectors
        for injector in injectors:
            injector.add(fault)

    def clear(self) -> None:
        """Switch the fault off; may be called twice. Delayed frames still come out."""
        for injector in self._injectors:
            injector.remove(self.fault)

    def __enter__(self) -> FaultHandle:
        """Use as a context manager: the fault is off after the block."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Switch the fault off."""
        self.clear()
