"""How long a classic CAN frame occupies the bus, to the bit.

Layout and stuffing: ISO 11898-1 / Bosch CAN 2.0. From start of frame to the end of the CRC a
complementary bit follows each run of five equal bits, stuff bits counting for the next run. CRC
delimiter, acknowledge slot and delimiter and the seven bits of end of frame are never stuffed.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError

INTERFRAME_BITS: Final = 3
"""Intermission: the least gap before the next frame, no part of the frame itself."""

_CRC_POLYNOMIAL: Final = 0x4599
_CRC_BITS: Final = 15
_TAIL_BITS: Final = 10  # CRC delimiter, ACK slot, ACK delimiter, 7 × end of frame
_RUN: Final = 5
_MAX_BYTES: Final = 8
_RTR_FROM_END: Final = 6  # two reserved or format bits and the data length code follow it


def crc15(bits: Iterable[int]) -> int:
    """Return the CRC of a classic frame over its bits from start of frame to the last data bit."""
    crc = 0
    for bit in bits:
        feedback = bit ^ crc >> (_CRC_BITS - 1)
        crc = crc << 1 & (1 << _CRC_BITS) - 1
        if feedback:
            crc ^= _CRC_POLYNOMIAL
    return crc


@lru_cache(maxsize=4096)
def _frame_length_bits(frame_id: int, is_extended: bool, data: bytes, remote_dlc: int) -> int:
    head, count = _head(frame_id, is_extended, len(data) if remote_dlc < 0 else remote_dlc)
    if remote_dlc >= 0:
        head |= 1 << _RTR_FROM_END
    word = head << 8 * len(data) | int.from_bytes(data, "big")
    count += 8 * len(data)
    bits = [word >> position & 1 for position in range(count - 1, -1, -1)]
    crc = crc15(bits)
    bits += [crc >> position & 1 for position in range(_CRC_BITS - 1, -1, -1)]
    stuffed, run, previous = 0, 0, -1
    for bit in bits:
        run = run + 1 if bit == previous else 1
        previous = bit
        if run == _RUN:
            stuffed += 1
            previous = 1 - bit
            run = 1
    return len(bits) + stuffed + _TAIL_BITS


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
    if not 0 <= frame_id < 1 << (29 if is_extended else 11):
        raise CanBusError(f"identifier {frame_id:#x} does not fit {29 if is_extended else 11} bits")
    if len(data) > _MAX_BYTES or (remote_dlc is not None and len(data) > 0):
        raise CanBusError(f"{len(data)} bytes: a classic data frame has 0 to 8, a remote frame 0")
    return _frame_length_bits(
        frame_id, is_extended, bytes(data), -1 if remote_dlc is None else remote_dlc
    )


def frame_length_bits_array(
    frame_id: int, is_extended: bool, data: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """Return the length in bits of each data frame of one identifier: int64[frames].

    `data` is uint8[frames, bytes] with 0 to 8 bytes. Same rule as `frame_length_bits`.
    """
    frames, size = data.shape
    head, head_bits = _head(frame_id, is_extended, size)
    bits = np.empty((head_bits + 8 * size + _CRC_BITS, frames), dtype=np.uint8)
    for position in range(head_bits):
        bits[position] = head >> (head_bits - 1 - position) & 1
    bits[head_bits : head_bits + 8 * size] = np.unpackbits(data, axis=1).T
    crc = np.zeros(frames, dtype=np.uint16)
    for row in bits[:-_CRC_BITS]:
        feedback = row ^ (crc >> np.uint16(_CRC_BITS - 1)).astype(np.uint8)
        crc = crc << np.uint16(1) & np.uint16((1 << _CRC_BITS) - 1)
        crc ^= feedback.astype(np.uint16) * np.uint16(_CRC_POLYNOMIAL)
    for position in range(_CRC_BITS):
        bits[-_CRC_BITS + position] = crc >> np.uint16(_CRC_BITS - 1 - position) & np.uint16(1)
    stuffed = np.zeros(frames, dtype=np.int64)
    run = np.zeros(frames, dtype=np.uint8)
    previous = np.full(frames, 2, dtype=np.uint8)
    for row in bits:
        run = np.where(row == previous, run + np.uint8(1), np.uint8(1))
        is_full = run == _RUN
        stuffed += is_full
        run[is_full] = 1
        previous = np.where(is_full, np.uint8(1) - row, row)
    return stuffed + (len(bits) + _TAIL_BITS)


def _head(frame_id: int, is_extended: bool, dlc: int) -> tuple[int, int]:
    """Return the bits from start of frame to the data length code, and how many they are."""
    if not is_extended:
        # SOF 0, identifier 11, RTR 0, IDE 0, r0 0, DLC 4
        return frame_id << 7 | dlc, 19
    # SOF 0, base identifier 11, SRR 1, IDE 1, identifier extension 18, RTR 0, r1 0, r0 0, DLC 4
    base, extension = frame_id >> 18, frame_id & (1 << 18) - 1
    return base << 27 | 0b11 << 25 | extension << 7 | dlc, 39
