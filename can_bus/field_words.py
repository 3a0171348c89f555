"""The fields of frames as machine code: one pass over the rows for each signal."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(inline="always")
def _word(data, row, low, step, count, right):  # type: ignore[no-untyped-def]
    """Return the bits from `right` on of up to nine bytes, the least significant first."""
    word = np.uint64(0)
    for k in range(min(count, 8)):
        word |= np.uint64(data[row, low + step * k]) << np.uint64(8 * k)
    word >>= np.uint64(right)
    if count == 9:
        word |= np.uint64(data[row, low + step * 8]) << np.uint64(64 - right)
    return word


@njit(cache=True, nogil=True)
def gather_words(data, rows, low, step, count, right, bits, is_signed, words):  # type: ignore[no-untyped-def]
    """Fill `words`, uint64[rows], with one field; a signed one is extended to 64 bits.

    Args:
        data: uint8[frames, bytes].
        rows: intp[rows], which frames.
        low, step, count: byte with the field's least significant bit, +1 or −1 to the next more
            significant one, and how many there are (up to nine).
        right: bits of the first byte below the field.
        bits: of the field, 1 to 64.
    """
    unused = np.uint64(64 - bits)
    for i in range(len(rows)):
        word = _word(data, rows[i], low, step, count, right) << unused
        if is_signed:
            words[i] = np.uint64(np.int64(word) >> np.int64(unused))
        else:
            words[i] = word >> unused


@njit(cache=True, nogil=True)
def scale_integers(raw, factor, offset, scaled):  # type: ignore[no-untyped-def]
    """Fill `scaled`, float64[rows], with raw · factor + offset, rounded twice as floats are."""
    for i in range(len(raw)):
        scaled[i] = np.float64(raw[i]) * factor + offset
