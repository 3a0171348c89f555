"""The fields of frames as machine code: one pass over the frames for each signal."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def gather_words(data, low, step, count, right, words):  # type: ignore[no-untyped-def]
    """Fill `words`, uint64[frames], with the bits of up to nine bytes of each frame.

    Args:
        data: uint8[frames, bytes].
        low, step, count: byte with the lowest bits, +1 or −1 to the next higher one, how many.
        right: bits of the first byte that are left out.
    """
    for i in range(len(words)):
        word = np.uint64(0)
        for k in range(min(count, 8)):
            word |= np.uint64(data[i, low + step * k]) << np.uint64(8 * k)
        word >>= np.uint64(right)
        if count == 9:
            word |= np.uint64(data[i, low + step * 8]) << np.uint64(64 - right)
        words[i] = word


@njit(cache=True, nogil=True)
def read_fields(words, left, right, is_signed, fields):  # type: ignore[no-untyped-def]
    """Fill `fields`, int64[frames] or uint64[frames], with a field of each word.

    Args:
        words: uint64[frames].
        left, right: shifts that leave the field alone: its bits above go first.
    """
    if is_signed:
        for i in range(len(words)):
            fields[i] = np.int64(words[i] << np.uint64(left)) >> np.int64(right)
    else:
        for i in range(len(words)):
            fields[i] = words[i] << np.uint64(left) >> np.uint64(right)


@njit(cache=True, nogil=True)
def scale_fields(words, left, right, is_signed, factor, offset, has_invalid, invalid, scaled):  # type: ignore[no-untyped-def]
    """Fill `scaled`, float64[frames], with field · factor + offset, rounded twice as floats are.

    NaN where `has_invalid` and the field is `invalid`.
    """
    if is_signed:
        for i in range(len(words)):
            signed = np.int64(words[i] << np.uint64(left)) >> np.int64(right)
            value = np.float64(signed) * factor + offset
            scaled[i] = np.nan if has_invalid and signed == invalid else value
    else:
        for i in range(len(words)):
            field = words[i] << np.uint64(left) >> np.uint64(right)
            value = np.float64(field) * factor + offset
            scaled[i] = np.nan if has_invalid and np.int64(field) == invalid else value


@njit(cache=True, nogil=True)
def number_frames(  # type: ignore[no-untyped-def]
    frame_id, is_extended, is_data, length, standard, extended, extended_number, least, number
):
    """Fill `number`, uint16[frames], with each frame's message, 0 for none; return how many each.

    Args:
        frame_id, is_extended, is_data, length: columns of the log.
        standard: uint16[2048], the message of each standard identifier.
        extended, extended_number: uint32[m] ascending and uint16[m], the same for the others.
        least: uint8[messages + 1], the bytes that a message has.
    """
    counts = np.zeros(len(least), dtype=np.int64)
    for i in range(len(number)):
        found = np.uint16(0)
        if not is_extended[i]:
            found = standard[frame_id[i] & np.uint32(0x7FF)]
        elif len(extended):
            at = np.searchsorted(extended, frame_id[i])
            if at < len(extended) and extended[at] == frame_id[i]:
                found = extended_number[at]
        if not is_data[i] or length[i] < least[found]:
            found = np.uint16(0)
        number[i] = found
        counts[found] += 1
    return counts


@njit(cache=True, nogil=True)
def sort_rows(number, starts, rows):  # type: ignore[no-untyped-def]
    """Fill `rows`, intp[frames], with the frames' places ordered by number, stably.

    `starts`, int64[messages + 1], says where each number's rows begin; it is used up.
    """
    for i in range(len(number)):
        rows[starts[number[i]]] = i
        starts[number[i]] += 1
