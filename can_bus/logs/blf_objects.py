"""The objects of a BLF container as machine code: one walk to count them, one to read them.

Layouts as in Lorenz, "Vector BLF" (the library that documents the format), little endian:

    object header   0 "LOBJ"  4 header bytes u16  6 version u16  8 object bytes u32  12 type u32
    version 1       16 flags u32                24 stamp u64    (32 bytes in all)
    version 2       16 flags u32                24 stamp u64    (40 bytes in all)
    CAN_MESSAGE(2)  0 channel u16  2 flags  3 dlc  4 id u32  8 data[8]
    CAN_FD_MESSAGE  0 channel u16  2 flags  3 dlc  4 id u32  13 FD flags  14 valid  20 data[64]
    ..._MESSAGE_64  0 channel  1 dlc  2 valid  4 id u32  12 flags u32  34 direction  35 offset of
                    what follows the data  40 data
    CAN_ERROR_EXT   0 channel u16  10 dlc  16 id u32  24 data[8]
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from can_bus.logs.frame_block import (
    BITRATE_SWITCH,
    CLASSIC_BYTES,
    ERROR,
    ERROR_STATE,
    EXTENDED,
    FD,
    FD_BYTES,
    FD_LENGTHS,
    REMOTE,
    SENT,
)

HEADER_BYTES: Final = 16
MAX_OBJECT_BYTES: Final = 1 << 20
"""A CAN FD frame takes some 100 bytes: no object that matters here comes near this."""

COMPLETE: Final = 0
"""What follows is the beginning of an object that goes on in the next container."""
NO_OBJECT: Final = 1
BAD_SIZE: Final = 2
TOO_SMALL: Final = 3

_CAN_MESSAGE: Final = 1
_CAN_ERROR_EXT: Final = 73
_CAN_MESSAGE2: Final = 86
_CAN_FD_MESSAGE: Final = 100
_CAN_FD_MESSAGE_64: Final = 101
_HEADER_V1_BYTES: Final = 32
_HEADER_V2_BYTES: Final = 40
_FD_64_BYTES: Final = 40
_PADDING: Final = 4
_SIGNATURE: Final = 0x4A424F4C  # LOBJ
_TEN_MICROSECONDS: Final = 1
_REMOTE_FLAG: Final = 0x80
_LENGTHS: Final = np.array(FD_LENGTHS, dtype=np.uint8)


@njit(inline="always")
def _u16(text, at):  # type: ignore[no-untyped-def]
    return np.uint32(text[at]) | np.uint32(text[at + 1]) << np.uint32(8)


@njit(inline="always")
def _u32(text, at):  # type: ignore[no-untyped-def]
    return _u16(text, at) | _u16(text, at + 2) << np.uint32(16)


@njit(inline="always")
def _least_bytes(kind):  # type: ignore[no-untyped-def]
    """Return how many bytes of its own a frame's object has at least, 0 for no frame."""
    if kind in (_CAN_MESSAGE, _CAN_MESSAGE2):
        return 16
    if kind == _CAN_FD_MESSAGE:
        return 84
    if kind == _CAN_FD_MESSAGE_64:
        return _FD_64_BYTES
    if kind == _CAN_ERROR_EXT:
        return 32
    return 0


@njit(inline="always")
def _next_object(text, at):  # type: ignore[no-untyped-def]
    """Return where the next object begins, up to four bytes of padding on; -1 where none does."""
    for start in range(at, min(at + _PADDING, len(text) - 4) + 1):
        if _u32(text, start) == _SIGNATURE:
            return start
    return -1


@njit(cache=True, nogil=True)
def count_objects(text):  # type: ignore[no-untyped-def]
    """Walk over the objects in `text`, uint8[bytes].

    Returns frames, where the first object begins that is not complete (or is wrong), whether
    any frame can have more than eight bytes, what is wrong there, and the size stated there (if
    nothing is wrong: the bytes that must be there to get further).
    """
    at, frames, is_wide = 0, 0, False
    while True:
        start = _next_object(text, at)
        if start < 0:
            state = NO_OBJECT if at + 2 * _PADDING <= len(text) else COMPLETE
            return frames, at, is_wide, state, 2 * _PADDING
        if start + HEADER_BYTES > len(text):
            return frames, at, is_wide, COMPLETE, start + HEADER_BYTES - at
        size = np.int64(_u32(text, start + 8))
        if size < HEADER_BYTES or size > MAX_OBJECT_BYTES:
            return frames, at, is_wide, BAD_SIZE, size
        if start + size > len(text):
            return frames, at, is_wide, COMPLETE, start + size - at
        version, kind = _u16(text, start + 6), _u32(text, start + 12)
        least = _least_bytes(kind)
        if least > 0 and version in (1, 2):
            if size < least + (_HEADER_V1_BYTES if version == 1 else _HEADER_V2_BYTES):
                return frames, at, is_wide, TOO_SMALL, size
            frames += 1
            is_wide |= kind in (_CAN_FD_MESSAGE, _CAN_FD_MESSAGE_64)
        at = start + size


@njit(cache=True, nogil=True)
def read_objects(text, start_s, stamp_s, frame_id, flags, dlc, length, channel, data):  # type: ignore[no-untyped-def]
    """Fill the columns of a block with the frames that `count_objects` has counted."""
    at, row = 0, 0
    while row < len(stamp_s):
        start = _next_object(text, at)
        size = np.int64(_u32(text, start + 8))
        at = start + size
        version, kind = _u16(text, start + 6), _u32(text, start + 12)
        if _least_bytes(kind) == 0 or version not in (1, 2):
            continue
        ticks = np.uint64(_u32(text, start + 28)) << np.uint64(32) | np.uint64(
            _u32(text, start + 24)
        )
        per_s = 1e5 if _u32(text, start + 16) == _TEN_MICROSECONDS else 1e9
        stamp_s[row] = np.float64(ticks) / per_s + start_s
        body = start + (_HEADER_V1_BYTES if version == 1 else _HEADER_V2_BYTES)
        valid, known, bits = np.int64(0), np.int64(0), 0
        if kind == _CAN_FD_MESSAGE_64:
            channel[row] = np.int32(text[body]) - 1
            identifier = _u32(text, body + 4)
            state = _u32(text, body + 12)
            valid, place = np.int64(text[body + 2]), body + _FD_64_BYTES
            end = np.int64(text[body + 35])
            known = (end if end > 0 else size) - np.int64(_u16(text, start + 4)) - _FD_64_BYTES
            bits |= REMOTE if state & 0x10 else 0
            bits |= FD if state & 0x1000 else 0
            bits |= BITRATE_SWITCH if state & 0x2000 else 0
            bits |= ERROR_STATE if state & 0x4000 else 0
            bits |= SENT if text[body + 34] else 0
            dlc[row] = _LENGTHS[min(text[body + 1], 15)]
        elif kind == _CAN_FD_MESSAGE:
            channel[row] = np.int32(_u16(text, body)) - 1
            identifier = _u32(text, body + 4)
            valid, known, place = np.int64(text[body + 14]), np.int64(FD_BYTES), body + 20
            bits |= FD if text[body + 13] & 1 else 0
            bits |= BITRATE_SWITCH if text[body + 13] & 2 else 0
            bits |= ERROR_STATE if text[body + 13] & 4 else 0
            bits |= REMOTE if text[body + 2] & _REMOTE_FLAG else 0
            bits |= SENT if text[body + 2] & 1 else 0
            dlc[row] = _LENGTHS[min(text[body + 3], 15)]
        elif kind == _CAN_ERROR_EXT:
            channel[row] = np.int32(_u16(text, body)) - 1
            identifier = _u32(text, body + 16)
            valid, place = np.int64(text[body + 10]), body + 24
            known = np.int64(CLASSIC_BYTES)
            bits |= ERROR
            dlc[row] = text[body + 10]
        else:
            channel[row] = np.int32(_u16(text, body)) - 1
            identifier = _u32(text, body + 4)
            valid, place = np.int64(text[body + 3]), body + 8
            known = np.int64(CLASSIC_BYTES)
            bits |= REMOTE if text[body + 2] & _REMOTE_FLAG else 0
            bits |= SENT if text[body + 2] & 1 else 0
            dlc[row] = text[body + 3]
        if identifier & np.uint32(0x80000000):
            bits |= EXTENDED
        frame_id[row] = identifier & np.uint32(0x1FFFFFFF)
        flags[row] = bits
        # Data that the file leaves out at an object's end are zeros, as Vector's tools read them.
        present = valid if kind == _CAN_FD_MESSAGE_64 else min(valid, known)
        length[row] = 0 if bits & REMOTE else min(present, 255)
        for k in range(min(valid, known, np.int64(data.shape[1]), at - place)):
            data[row, k] = text[place + k]
        row += 1


def as_bytes(content: bytes) -> NDArray[np.uint8]:
    """Return bytes as the array that the walks take."""
    return np.frombuffer(content, dtype=np.uint8)
