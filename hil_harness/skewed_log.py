"""A log whose clock is not the ECU's."""

from __future__ import annotations

from copy import copy
from types import TracebackType

import can

from can_bus import LogWriter


class SkewedLog:
    """Writes frames stamped by the ECU's clock with the stamps of the log's own.

    Args:
        log: where they go.
        skew: ECU clock rate over log clock rate − 1.
    """

    def __init__(self, log: LogWriter, skew: float) -> None:
        self._log = log
        self._rate = 1.0 + skew

    def write(self, message: can.Message, received: bool) -> None:
        """Append one frame, to the log clock's nearest microsecond."""
        restamped = copy(message)
        restamped.timestamp = round(message.timestamp * 1e6 / self._rate) * 1e-6
        self._log.write(restamped, received)

    def close(self) -> None:
        """Complete the file; may be called twice."""
        self._log.close()

    def __enter__(self) -> SkewedLog:
        """Use as a context manager: the file is complete after it."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()
