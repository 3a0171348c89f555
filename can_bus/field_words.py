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


@njit(cache=True, nogil=True, error_model="numpy")
def scale_fields(words, left, right, is_signed, factor, offset, scaled):  # type: ignore[no-untyped-def]
    """Fill `scaled`, float64[frames], with field · factor + offset, rounded twice as floats are."""
    if is_signed:
        for i in range(len(words)):
            signed = np.int64(words[i] << np.uint64(left)) >> np.int64(right)
            scaled[i] = np.float64(signed) * factor + offset
    else:
        for i in range(len(words)):
            field = words[i] << np.uint64(left) >> np.uint64(right)
            scaled[i] = np.float64(field) * factor + offset
