"""Fault confinement of ISO 11898-1: two counters that decide how loudly a node may complain."""

from __future__ import annotations

from enum import Enum, unique
from typing import Final

PASSIVE_LIMIT: Final = 128
BUS_OFF_LIMIT: Final = 256
WARNING_LIMIT: Final = 96
"""Where controllers warn; no state of its own."""

RECOVERY_SEQUENCES: Final = 128
"""So many times 11 recessive bits bring a node back from bus-off."""
RECOVERY_SEQUENCE_BITS: Final = 11

_RECOVERED_REC: Final = 127  # the standard leaves 119 to 127 to the controller
_MAX_REC: Final = 255


@unique
class ErrorState(Enum):
    """What a node may do when it sees an error."""

    ACTIVE = "error-active"
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"


class Confinement:
    """Transmit and receive error counter of one node (TEC, REC)."""

    __slots__ = ("is_off", "rec", "tec")

    def __init__(self, tec: int = 0, rec: int = 0, is_off: bool = False) -> None:
        """Start error-active."""
        self.tec = tec
        self.rec = rec
        self.is_off = is_off

    @property
    def state(self) -> ErrorState:
        """The state that the counters mean."""
        if self.is_off:
            return ErrorState.BUS_OFF
        if self.tec >= PASSIVE_LIMIT or self.rec >= PASSIVE_LIMIT:
            return ErrorState.PASSIVE
        return ErrorState.ACTIVE

    @property
    def is_clear(self) -> bool:
        """Tell whether nothing has gone wrong, or all of it is forgiven."""
        return not (self.tec or self.rec or self.is_off)

    def copy(self) -> Confinement:
        """Return counters of their own, equal to these."""
        return Confinement(self.tec, self.rec, self.is_off)

    def count_transmit_error(self) -> None:
        """Add 8 to the transmit error counter; from 256 on the node is off."""
        self.tec += 8
        if self.tec >= BUS_OFF_LIMIT:
            self.is_off = True

    def count_receive_error(self, amount: int) -> None:
        """Add 1 or 8 to the receive error counter."""
        self.rec = min(self.rec + amount, _MAX_REC)

    def count_sent(self) -> None:
        """Note a frame that was sent and acknowledged."""
        if self.tec:
            self.tec -= 1

    def count_received(self) -> None:
        """Note a frame that was received without error."""
        if self.rec >= PASSIVE_LIMIT:
            self.rec = _RECOVERED_REC
        elif self.rec:
            self.rec -= 1

    def recover(self) -> None:
        """Come back from bus-off, error-active, with both counters at zero."""
        self.tec = self.rec = 0
        self.is_off = False
