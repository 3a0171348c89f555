"""Data frames of candump text as machine code: one pass over the bytes.

A line read here is ``(seconds.microseconds) channel id#data``, classic, or ``id##flagsdata``, CAN
FD, with or without ``R`` or ``T`` behind it, with six decimals and single spaces: what candump -L
and python-can write. At any other line the pass stops, and whoever called reads that line by
itself, so that nothing is understood or refused differently.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from can_bus.logs.frame_block import EXTENDED_IDS, FD_LENGTHS, STANDARD_IDS
from can_bus.logs.log_columns import BUS_PRIME, BUS_START

_NO_DIGIT: Final = 255
_MAX_SECONDS: Final = 2**32
"""As floats, which is how lines are read, later stamps do not tell microseconds apart."""
_MAX_SECONDS_DIGITS: Final = 12
_DECIMALS: Final = 6
_MAX_LINE: Final = 500
_LINE_END: Final = ord("\n")
_SPACE: Final = ord(" ")
_ZERO: Final = ord("0")
_BUS_START: Final = np.uint32(BUS_START)
_BUS_PRIME: Final = np.uint32(BUS_PRIME)


def _hex_values() -> NDArray[np.uint8]:
    values = np.full(256, _NO_DIGIT, dtype=np.uint8)
    for digit in b"0123456789abcdefABCDEF":
        values[digit] = int(chr(digit), 16)
    return values


def _data_lengths() -> NDArray[np.bool_]:
    is_length = np.zeros(65, dtype=np.bool_)
    is_length[list(FD_LENGTHS)] = True
    return is_length


_HEX: Final = _hex_values()
_IS_LENGTH: Final = _data_lengths()


@njit(cache=True, nogil=True)
def read_lines(  # type: ignore[no-untyped-def]
    text, at, row, stamp_us, frame_id, is_extended, data, length, is_rx, bus
):
    """Read lines from `at` on into the columns, from `row` on.

    Args:
        text: uint8[bytes], whole lines.
        data: uint8[rows, width], zeros; a frame of more than `width` bytes ends the pass.

    Returns:
        Where the first line begins that is none of these, `len(text)` at the end, and its row.
    """
    width = data.shape[1]
    while at < len(text):
        start = at
        last = min(len(text), start + _MAX_LINE) - 1
        if text[at] != 40:  # (
            return start, row
        at += 1
        stamp, digits = np.int64(0), 0
        while at < last and text[at] >= _ZERO and text[at] <= _ZERO + 9:
            stamp = stamp * 10 + np.int64(text[at] - _ZERO)
            digits += 1
            at += 1
            if digits > _MAX_SECONDS_DIGITS:
                return start, row
        # What follows has at least ".000000) c 123#" and a line end.
        if digits == 0 or stamp >= _MAX_SECONDS or text[at] != 46 or at + 16 > last:
            return start, row
        for _ in range(_DECIMALS):
            at += 1
            digit = text[at] - _ZERO
            if digit < 0 or digit > 9:
                return start, row
            stamp = stamp * 10 + np.int64(digit)
        if text[at + 1] != 41 or text[at + 2] != _SPACE:  # )
            return start, row
        at += 3
        channel = at
        number = np.uint32(_BUS_START)
        while at < last and text[at] > _SPACE and text[at] < 127:
            number = np.uint32((number ^ np.uint32(text[at])) * _BUS_PRIME)
            at += 1
        if at == channel or text[at] != _SPACE or at + 5 > last:
            return start, row
        identifier, digits = np.uint32(0), 0
        at += 1
        while at < last and _HEX[text[at]] != _NO_DIGIT and digits < 9:
            identifier = identifier << np.uint32(4) | np.uint32(_HEX[text[at]])
            digits += 1
            at += 1
        if text[at] != 35 or digits not in (3, 8):  # number sign
            return start, row
        if identifier >= (EXTENDED_IDS if digits == 8 else STANDARD_IDS):
            return start, row
        at += 1
        limit = 8
        if at < last and text[at] == 35:
            if at + 1 > last or _HEX[text[at + 1]] == _NO_DIGIT:
                return start, row
            at += 2
            limit = 64
        count = 0
        while at < last and _HEX[text[at]] != _NO_DIGIT:
            low = _HEX[text[at + 1]]
            if low == _NO_DIGIT or count in (limit, width):
                break
            data[row, count] = _HEX[text[at]] << np.uint8(4) | low
            count += 1
            at += 2
        received = True
        if at + 1 < last and text[at] == _SPACE and (text[at + 1] == 82 or text[at + 1] == 84):
            received = text[at + 1] == 82
            at += 2
        if at > last or text[at] != _LINE_END or not _IS_LENGTH[count]:
            data[row] = 0
            return start, row
        stamp_us[row] = stamp
        frame_id[row] = identifier
        is_extended[row] = digits == 8
        length[row] = count
        is_rx[row] = received
        bus[row] = number
        row += 1
        at += 1
    return at, row
