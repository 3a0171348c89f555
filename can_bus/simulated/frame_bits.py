"""A classic CAN frame bit by bit: as its transmitter sends it, and as a receiver reads it.

Layout, stuffing and the places of errors: ISO 11898-1 / Bosch CAN 2.0. A dominant bit is 0. Only
frames that something went wrong with pass through here; `can_bus.timing` measures all others.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from can_bus.timing import crc15

DOMINANT: Final = 0
RECESSIVE: Final = 1

END_OF_FRAME_BITS: Final = 7

ErrorKind = Literal["bit", "stuff", "form", "crc", "ack"]
"""The five errors of ISO 11898-1."""

_MAX_RUN: Final = 5
_CRC_BITS: Final = 15
_STANDARD_HEAD: Final = 19
_EXTENDED_HEAD: Final = 39
_IDE_PLACE: Final = 13
_RTR_BEFORE_END: Final = 7  # with an 11-bit identifier IDE and r0, else r1 and r0; then the DLC
_TAIL: Final = (RECESSIVE,) * (3 + END_OF_FRAME_BITS)  # CRC delimiter, ACK slot and delimiter, EOF


class FrameContent(NamedTuple):
    """What a classic frame says."""

    arbitration_id: int
    is_extended: bool
    is_remote: bool
    dlc: int
    data: bytes


class WireFrame(NamedTuple):
    """A frame as its transmitter sends it.

    Attributes:
        bits: from start of frame to the last bit of end of frame, stuff bits included.
        stuff_places: which of them are stuff bits.
        arbitration_end: place of the first bit after the arbitration field.
        ack_slot: place of the acknowledge slot.
    """

    bits: tuple[int, ...]
    stuff_places: frozenset[int]
    arbitration_end: int
    ack_slot: int


def head_bits(content: FrameContent) -> list[int]:
    """Return a frame's bits from start of frame to the data length code, without stuffing."""
    identifier, is_extended, is_remote, dlc, _ = content
    if is_extended:
        base, extension = identifier >> 18, identifier & (1 << 18) - 1
        word = base << 27 | 0b11 << 25 | extension << 7 | is_remote << 6 | dlc
        return _bits(word, _EXTENDED_HEAD)
    return _bits(identifier << 7 | is_remote << 6 | dlc, _STANDARD_HEAD)


def wire_frame(content: FrameContent) -> WireFrame:
    """Return the bits that a transmitter sends for a frame."""
    head = head_bits(content)
    # SOF and the identifier with all that decides arbitration: up to RTR, and IDE where standard.
    arbitration = 33 if content.is_extended else 14
    body = head + [bit for byte in content.data for bit in _bits(byte, 8)]
    body += _bits(crc15(body), _CRC_BITS)
    sent: list[int] = []
    stuff_places: list[int] = []
    arbitration_end = run = 0
    last = RECESSIVE
    for place, bit in enumerate(body):
        if place == arbitration:
            arbitration_end = len(sent)
        sent.append(bit)
        run = run + 1 if bit == last else 1
        last = bit
        if run == _MAX_RUN:
            stuff_places.append(len(sent))
            last, run = 1 - bit, 1
            sent.append(last)
    return WireFrame(
        (*sent, *_TAIL), frozenset(stuff_places), arbitration_end, ack_slot=len(sent) + 1
    )


def _bits(word: int, count: int) -> list[int]:
    return [word >> place & 1 for place in range(count - 1, -1, -1)]


def _word(bits: list[int]) -> int:
    word = 0
    for bit in bits:
        word = word << 1 | bit
    return word


Reading = Literal["stuff", "form", "crc", "accepted", "overload", "end"]
"""What a receiver knows after a bit: an error, a valid frame, its end, or a need for a pause."""


class Receiver:
    """One node's reading of a frame, bit by bit, whatever the bits.

    `content` is what it has read once the frame is valid, that is after the last bit but one of
    the end of frame.
    """

    def __init__(self) -> None:
        """Wait for a start of frame."""
        self.content: FrameContent | None = None
        self._read: list[int] = []
        self._last = RECESSIVE
        self._run = 0
        self._total: int | None = None
        self._tail: int | None = None
        self._is_crc_right = False

    @property
    def is_waiting(self) -> bool:
        """Tell whether no start of frame has been seen."""
        return not self._read

    @property
    def acknowledges(self) -> bool:
        """Tell whether the next bit is the acknowledge slot of a frame whose CRC is right."""
        return self._tail == 1 and self._is_crc_right

    def feed(self, bit: int) -> Reading | None:
        """Take one bit in; return what it decides, if anything."""
        if self._tail is not None:
            return self._feed_tail(bit)
        if not self._read and bit == RECESSIVE:
            return None
        if self._run == _MAX_RUN:
            if bit == self._last:
                return "stuff"
            self._last, self._run = bit, 1
            if len(self._read) == self._total:
                self._finish_body()
            return None
        self._run = self._run + 1 if bit == self._last and self._read else 1
        self._last = bit
        self._read.append(bit)
        self._measure()
        if len(self._read) == self._total and self._run < _MAX_RUN:
            self._finish_body()
        return None

    def _measure(self) -> None:
        """Find the length of the frame as soon as its data length code is read."""
        read = self._read
        if self._total is None and len(read) > _IDE_PLACE:
            head = _EXTENDED_HEAD if read[_IDE_PLACE] else _STANDARD_HEAD
            if len(read) == head:
                self._total = head + 8 * self._data_bytes(head) + _CRC_BITS

    def _data_bytes(self, head: int) -> int:
        is_remote = self._read[head - _RTR_BEFORE_END]
        return 0 if is_remote else min(_word(self._read[head - 4 : head]), 8)

    def _finish_body(self) -> None:
        body, crc = self._read[:-_CRC_BITS], self._read[-_CRC_BITS:]
        self._is_crc_right = crc15(body) == _word(crc)
        self._tail = 0

    def _feed_tail(self, bit: int) -> Reading | None:
        assert self._tail is not None
        place = self._tail
        self._tail += 1
        if place == 1:  # acknowledge slot
            return None
        if place == len(_TAIL) - 1:
            return "overload" if bit == DOMINANT else "end"
        if bit == DOMINANT:
            return "form"
        if place == 2 and not self._is_crc_right:
            return "crc"
        if place == len(_TAIL) - 2:
            self.content = self._parse()
            return "accepted"
        return None

    def _parse(self) -> FrameContent:
        read = self._read[:-_CRC_BITS]
        is_extended = bool(read[_IDE_PLACE])
        head = _EXTENDED_HEAD if is_extended else _STANDARD_HEAD
        identifier = _word(read[1:12])
        if is_extended:
            identifier = identifier << 18 | _word(read[14:32])
        payload = read[head:]
        data = bytes(_word(payload[place : place + 8]) for place in range(0, len(payload), 8))
        is_remote = bool(read[head - _RTR_BEFORE_END])
        return FrameContent(
            identifier, is_extended, is_remote, min(_word(read[head - 4 : head]), 8), data
        )
