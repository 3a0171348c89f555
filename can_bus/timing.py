"""How long a classic CAN frame occupies the bus, to the bit.

Layout and stuffing: ISO 11898-1 / Bosch CAN 2.0. From start of frame to the end of the CRC a
complementary bit follows each run of five equal bits, stuff bits counting for the next run. CRC
delimiter, acknowledge slot and delimiter and the seven bits of end of frame are never stuffed.

Both the CRC and the stuffing go byte by byte through tables built from the rule for one bit.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError

INTERFRAME_BITS: Final = 3
"""Intermission: the least gap before the next frame, no part of the frame itself."""

_CRC_POLYNOMIAL: Final = 0x4599
_CRC_BITS: Final = 15
_CRC_MASK: Final = (1 << _CRC_BITS) - 1
_TAIL_BITS: Final = 10  # CRC delimiter, ACK slot, ACK delimiter, 7 × end of frame
_MAX_RUN: Final = 5
_MAX_BYTES: Final = 8
_STANDARD_STUFFABLE: Final = 34  # start of frame to data length code, and the CRC
_EXTENDED_STUFFABLE: Final = 54
_RTR_FROM_END: Final = 6  # two reserved or format bits and the data length code follow it


def crc15(bits: Iterable[int], start: int = 0) -> int:
    """Return the CRC of a classic frame over its bits from start of frame to the last data bit."""
    crc = start
    for bit in bits:
        feedback = bit ^ crc >> (_CRC_BITS - 1)
        crc = crc << 1 & _CRC_MASK
        if feedback:
            crc ^= _CRC_POLYNOMIAL
    return crc


def _bits(word: int, count: int) -> list[int]:
    return [word >> position & 1 for position in range(count - 1, -1, -1)]


class _Stuffing(NamedTuple):
    """Where the stuffing rule stands: how many bits it has put in, the last bit, its run."""

    inserted: int
    last: int
    run: int

    def feed(self, bits: Iterable[int]) -> _Stuffing:
        """Let bits pass."""
        inserted, last, run = self
        for bit in bits:
            run = run + 1 if bit == last else 1
            last = bit
            if run == _MAX_RUN:
                inserted, last, run = inserted + 1, 1 - bit, 1
        return _Stuffing(inserted, last, run)

    @property
    def state(self) -> int:
        """Return what the next bits depend on as one small number."""
        return _MAX_RUN * self.last + self.run


_unpack_words: Final = struct.Struct(">4H").unpack

_STATES: Final = 2 * _MAX_RUN
_STATE_BITS: Final = 6  # the states of five words add up to less than 2⁶
_STATE_MASK: Final = (1 << _STATE_BITS) - 1
_BEFORE_FRAME: Final = _Stuffing(inserted=0, last=1, run=0)


def _stuffing_tables(width: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return, by state and value of so many bits, the bits put in and the state after."""
    inserted = np.zeros((_STATES, 1 << width), dtype=np.uint8)
    after = np.zeros_like(inserted)
    for state in range(_STATES):
        before = _Stuffing(0, *divmod(state, _MAX_RUN))
        for value in range(1 << width):
            stuffing = before.feed(_bits(value, width))
            inserted[state, value] = stuffing.inserted
            after[state, value] = stuffing.state
    return inserted, after


_CRC_TABLE: Final = np.array([crc15(_bits(byte, 8)) for byte in range(256)], dtype=np.uint16)
_INSERTED_8, _AFTER_8 = _stuffing_tables(8)
_INSERTED_7, _ = _stuffing_tables(7)

# The same for one frame at a time: plain lists are quicker to index than arrays.
_CRC_LIST: Final[list[int]] = _CRC_TABLE.tolist()
_INSERTED_8_LIST: Final[list[list[int]]] = _INSERTED_8.tolist()
_AFTER_8_LIST: Final[list[list[int]]] = _AFTER_8.tolist()
_INSERTED_7_LIST: Final[list[list[int]]] = _INSERTED_7.tolist()


class _Head(NamedTuple):
    """A frame up to its data length code, and the length of all that follows without stuffing."""

    length_bits: int
    crc: int
    inserted: int
    state: int


@lru_cache(maxsize=1)
def _words() -> tuple[list[int], list[list[int]]]:
    """Return the same rules for 16 bits at a time: half the steps for one frame.

    The CRC after a word, by (CRC << 1) ^ word; and by state and word the bits put in, times 64,
    plus the state after: five of them can be added up before they are parted.
    """
    word = np.arange(1 << 16)
    high, low = word >> 8, word & 0xFF
    crc = _CRC_TABLE[high].astype(np.int64)  # the first byte of a register of 0
    crc = (crc << 8 & _CRC_MASK) ^ _CRC_TABLE[crc >> 7 ^ low]
    inserted = _INSERTED_8[:, high].astype(np.int64)
    middle = _AFTER_8[:, high]
    packed = (inserted + _INSERTED_8[middle, low] << _STATE_BITS) + _AFTER_8[middle, low]
    return crc.tolist(), packed.tolist()


@lru_cache(maxsize=1024)
def _head(frame_id: int, is_extended: bool, dlc: int, is_remote: bool) -> _Head:
    _require_classic(frame_id, is_extended, dlc)
    if is_extended:
        # SOF 0, base identifier 11, SRR 1, IDE 1, extension 18, RTR, r1 0, r0 0, DLC 4
        base, extension = frame_id >> 18, frame_id & (1 << 18) - 1
        word, count = base << 27 | 0b11 << 25 | extension << 7 | dlc, 39
    else:
        # SOF 0, identifier 11, RTR, IDE 0, r0 0, DLC 4
        word, count = frame_id << 7 | dlc, 19
    bits = _bits(word | is_remote << _RTR_FROM_END, count)
    stuffing = _BEFORE_FRAME.feed(bits)
    length_bits = count + (0 if is_remote else 8 * dlc) + _CRC_BITS + _TAIL_BITS
    return _Head(length_bits, crc15(bits), stuffing.inserted, stuffing.state)


def frame_length_bits(
    frame_id: int, is_extended: bool, data: bytes | bytearray, *, remote_dlc: int | None = None
) -> int:
    """Return the length in bits of a classic frame, stuff bits included, intermission not.

    Args:
        frame_id: 11 bits, or 29 bits where `is_extended`.
        data: 0 to 8 bytes; empty for a remote frame.
        remote_dlc: data length code of a remote frame, None for a data frame.

    Raises CanBusError for an identifier or data that no classic frame carries.
    """
    is_remote = remote_dlc is not None
    dlc = len(data) if remote_dlc is None else remote_dlc
    if is_remote and data:
        raise CanBusError(f"{len(data)} bytes: a remote frame has none")
    length, crc, inserted, state = _head(frame_id, is_extended, dlc, is_remote)
    if len(data) == _MAX_BYTES:
        crcs, stuffing = _words()
        words: tuple[int, int, int, int] = _unpack_words(data)
        a, b, c, d = words
        crc = crcs[crcs[crcs[crcs[crc << 1 ^ a] << 1 ^ b] << 1 ^ c] << 1 ^ d]
        after_a = stuffing[state][a]
        after_b = stuffing[after_a & _STATE_MASK][b]
        after_c = stuffing[after_b & _STATE_MASK][c]
        after_d = stuffing[after_c & _STATE_MASK][d]
        # One more bit that differs from the last puts nothing in: 15 bits go as a word.
        last = stuffing[after_d & _STATE_MASK][crc << 1 | ~crc & 1]
        return length + inserted + (after_a + after_b + after_c + after_d + last >> _STATE_BITS)
    for byte in data:
        crc = (crc << 8 & _CRC_MASK) ^ _CRC_LIST[crc >> 7 ^ byte]
        inserted += _INSERTED_8_LIST[state][byte]
        state = _AFTER_8_LIST[state][byte]
    inserted += _INSERTED_8_LIST[state][crc >> 7]
    state = _AFTER_8_LIST[state][crc >> 7]
    return length + inserted + _INSERTED_7_LIST[state][crc & 0x7F]


def frame_length_bits_array(
    frame_id: int, is_extended: bool, data: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """Return the length in bits of each data frame of one identifier: int64[frames].

    `data` is uint8[frames, bytes] with 0 to 8 bytes. Same rule and errors as `frame_length_bits`.
    """
    frames, size = data.shape
    head = _head(frame_id, is_extended, size, False)
    crc = np.full(frames, head.crc, dtype=np.uint16)
    state = np.full(frames, head.state, dtype=np.uint8)
    inserted = np.full(frames, head.inserted, dtype=np.uint8)
    for byte in data.T:
        crc = (crc << np.uint16(8) & np.uint16(_CRC_MASK)) ^ _CRC_TABLE[crc >> np.uint16(7) ^ byte]
        inserted += _INSERTED_8[state, byte]
        state = _AFTER_8[state, byte]
    high, low = crc >> np.uint16(7), crc & np.uint16(0x7F)
    inserted += _INSERTED_8[state, high]
    inserted += _INSERTED_7[_AFTER_8[state, high], low]
    return inserted.astype(np.int64) + head.length_bits


def worst_length_bits(is_extended: bool, size_bytes: int) -> int:
    """Return the length of the longest data frame of so many bytes, intermission not included.

    Davis, Burns, Bril, Lukkien (2007), equation 1: as many stuff bits as bits can force.

    Raises CanBusError for data that no classic frame carries.
    """
    _require_classic(0, is_extended, size_bytes)
    stuffable = (_EXTENDED_STUFFABLE if is_extended else _STANDARD_STUFFABLE) + 8 * size_bytes
    return stuffable + _TAIL_BITS + (stuffable - 1) // (_MAX_RUN - 1)


def _require_classic(frame_id: int, is_extended: bool, dlc: int) -> None:
    width = 29 if is_extended else 11
    if not 0 <= frame_id < 1 << width:
        raise CanBusError(f"identifier {frame_id:#x} does not fit {width} bits")
    if not 0 <= dlc <= _MAX_BYTES:
        raise CanBusError(f"{dlc} bytes: a classic data frame has 0 to 8")
