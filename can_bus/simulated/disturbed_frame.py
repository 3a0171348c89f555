"""What happens on the wire, bit by bit, when a frame is damaged, collides or is not acknowledged.

Every node drives a bit, the wire is dominant if one of them is, every node reads it (a bit that a
fault inverts reads wrong) and goes on by the rules of ISO 11898-1: arbitration, stuff, form, CRC,
bit and acknowledge errors; active, passive and overload flags and their delimiters; the counters
with their exceptions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from enum import Enum, auto, unique
from typing import Final, NamedTuple

from can_bus.simulated.confinement import Confinement, ErrorState
from can_bus.simulated.frame_bits import (
    DOMINANT,
    RECESSIVE,
    ErrorKind,
    FrameContent,
    Receiver,
    WireFrame,
    wire_frame,
)

_FLAG_BITS: Final = 6
_DELIMITER_BITS: Final = 8
_DOMINANT_RUN: Final = 8
_INTERMISSION_OVERLOAD_BITS: Final = 2
_END_OF_TIME: Final = 100_000  # no finite list of faults keeps the wire busy so long


@unique
class _Mode(Enum):
    FRAME = auto()
    ACTIVE_FLAG = auto()
    PASSIVE_FLAG = auto()
    OVERLOAD_FLAG = auto()
    AFTER_FLAG = auto()
    DELIMITER = auto()
    IDLE = auto()
    OFF = auto()


class SeenError(NamedTuple):
    """An error as one node saw it: kind, place in bits from start of frame, and its own part."""

    kind: ErrorKind
    place: int
    is_transmitter: bool


class Station:
    """One node on the wire for the length of one disturbed frame.

    Attributes:
        confinement: its counters, of its own.
        errors: the errors that it saw.
        has_sent: its frame went out and was acknowledged.
        received: the frame it took in as valid, None if it took none.
    """

    def __init__(self, confinement: Confinement, content: FrameContent | None) -> None:
        """Start at a start of frame: to transmit `content`, or to receive (None)."""
        self.confinement = confinement.copy()
        self.errors: list[SeenError] = []
        self.has_sent = False
        self.received: FrameContent | None = None
        self._wire: WireFrame | None = None if content is None else wire_frame(content)
        self._transmits = content is not None
        self._receiver = Receiver()
        self._mode = _Mode.FRAME
        self._count = 0
        self._dominant_run = 0
        self._passive_bit: int | None = None
        self._is_unacknowledged = False
        self._is_error_flag = False

    @property
    def is_done(self) -> bool:
        """Tell whether the wire may fall silent as far as this node is concerned."""
        if self._mode is _Mode.FRAME:
            return not self._transmits and self._receiver.is_waiting
        return self._mode in (_Mode.IDLE, _Mode.OFF)

    @property
    def error_state(self) -> ErrorState:
        """What its counters mean."""
        return self.confinement.state

    def drive(self, place: int) -> int:
        """Return the bit that this node puts on the wire."""
        if self._mode is _Mode.FRAME:
            if self._transmits and self._wire is not None:
                return self._wire.bits[place]
            return DOMINANT if self._receiver.acknowledges else RECESSIVE
        if self._mode in (_Mode.ACTIVE_FLAG, _Mode.OVERLOAD_FLAG):
            return DOMINANT
        return RECESSIVE

    def see(self, place: int, bit: int) -> None:
        """Read the wire."""
        if self._mode is _Mode.FRAME:
            if self._transmits:
                self._see_own_frame(place, bit)
            else:
                self._see_frame(place, bit)
        elif self._mode in (_Mode.ACTIVE_FLAG, _Mode.OVERLOAD_FLAG):
            self._see_active_flag(bit)
        elif self._mode is _Mode.PASSIVE_FLAG:
            self._see_passive_flag(bit)
        elif self._mode is _Mode.AFTER_FLAG:
            self._see_after_flag(bit)
        elif self._mode is _Mode.DELIMITER:
            self._see_delimiter(place, bit)
        elif self._mode is _Mode.IDLE:
            self._count += 1
            if bit == DOMINANT and self._count <= _INTERMISSION_OVERLOAD_BITS:
                self._enter(_Mode.OVERLOAD_FLAG)

    def _see_own_frame(self, place: int, bit: int) -> None:
        wire = self._wire
        assert wire is not None
        sent = wire.bits[place]
        self._receiver.feed(bit)
        if place == wire.ack_slot:
            if bit == RECESSIVE:
                self._fail("ack", place)
        elif bit != sent:
            if place < wire.arbitration_end and sent == RECESSIVE:
                if place in wire.stuff_places:
                    self._fail("stuff", place, is_counted=False)
                else:
                    self._transmits = False  # lost arbitration: a receiver from here on
            else:
                self._fail("bit", place)
        elif place == len(wire.bits) - 1:
            self.has_sent = True
            self.confinement.count_sent()
            self._enter(_Mode.IDLE)

    def _see_frame(self, place: int, bit: int) -> None:
        reading = self._receiver.feed(bit)
        if reading is None:
            return
        if reading == "accepted":
            self.received = self._receiver.content
            self.confinement.count_received()
        elif reading == "end":
            self._enter(_Mode.IDLE)
        elif reading == "overload":
            self._enter(_Mode.OVERLOAD_FLAG)
        else:
            self._fail(reading, place)

    def _see_active_flag(self, bit: int) -> None:
        if bit == RECESSIVE:
            if self._mode is _Mode.ACTIVE_FLAG:
                self._count_eight()
            self._count = 0
            return
        self._count += 1
        if self._count == _FLAG_BITS:
            self._enter(_Mode.AFTER_FLAG)

    def _see_passive_flag(self, bit: int) -> None:
        if bit == DOMINANT and self._is_unacknowledged:
            self._is_unacknowledged = False
            self._count_eight()
        self._count = self._count + 1 if bit == self._passive_bit else 1
        self._passive_bit = bit
        if self._count == _FLAG_BITS:
            self._enter(_Mode.AFTER_FLAG)

    def _see_after_flag(self, bit: int) -> None:
        if bit == RECESSIVE:
            self._enter(_Mode.DELIMITER)
            self._count = 1
            return
        self._dominant_run += 1
        if self._dominant_run == 1 and not self._transmits and self._is_error_flag:
            self.confinement.count_receive_error(8)
        if self._dominant_run % _DOMINANT_RUN == 0:
            self._count_eight()

    def _see_delimiter(self, place: int, bit: int) -> None:
        self._count += 1
        if bit == RECESSIVE:
            if self._count == _DELIMITER_BITS:
                self._enter(_Mode.IDLE)
        elif self._count == _DELIMITER_BITS:
            self._enter(_Mode.OVERLOAD_FLAG)
        else:
            self._fail("form", place)

    def _fail(self, kind: ErrorKind, place: int, *, is_counted: bool = True) -> None:
        """Note an error and raise the flag that the state before it allows."""
        self.errors.append(SeenError(kind, place, self._transmits))
        is_passive = self.error_state is ErrorState.PASSIVE
        self._is_unacknowledged = False
        if not self._transmits:
            self.confinement.count_receive_error(1)
        elif kind == "ack" and is_passive:
            self._is_unacknowledged = True  # counted only if a dominant bit shows another node
        elif is_counted:
            self.confinement.count_transmit_error()
        self._enter(_Mode.PASSIVE_FLAG if is_passive else _Mode.ACTIVE_FLAG)

    def _count_eight(self) -> None:
        if self._transmits:
            self.confinement.count_transmit_error()
            if self.error_state is ErrorState.BUS_OFF:
                self._enter(_Mode.OFF)
        else:
            self.confinement.count_receive_error(8)

    def _enter(self, mode: _Mode) -> None:
        if self.error_state is ErrorState.BUS_OFF:
            mode = _Mode.OFF
        if mode in (_Mode.ACTIVE_FLAG, _Mode.PASSIVE_FLAG, _Mode.OVERLOAD_FLAG):
            self._is_error_flag = mode is not _Mode.OVERLOAD_FLAG
        self._mode = mode
        self._count = 0
        self._dominant_run = 0
        self._passive_bit = None


def play(stations: Sequence[Station], inverted: Mapping[int, Collection[int]]) -> int:
    """Let a frame pass with all that follows; return the bits until the wire is idle.

    Args:
        stations: all nodes that are on the bus, at a start of frame.
        inverted: by place in bits from start of frame, which stations read the bit inverted.

    The length is up to the last bit of the end of frame or of the error delimiter; intermission
    is not in it.
    """
    for place in range(_END_OF_TIME):
        wire = min(station.drive(place) for station in stations)
        wrong = inverted.get(place, ())
        for number, station in enumerate(stations):
            station.see(place, 1 - wire if number in wrong else wire)
        if all(station.is_done for station in stations):
            return place + 1
    raise AssertionError("a finite list of faults kept the wire busy for ever")
