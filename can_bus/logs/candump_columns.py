"""Candump logs at array speed: the plain lines, which nearly all lines are, many at a time.

A plain line is ``(seconds.microseconds) channel id#data``, with or without ``R`` or ``T`` behind
it: a classic data frame. A block of lines with any other in it (remote, error and CAN FD frames,
faulty lines) is read line by line instead, so that nothing is understood or refused differently.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]

_BLOCK_BYTES: Final = 1 << 22
_MAX_SECONDS_DIGITS: Final = 12
_MICROSECOND_DIGITS: Final = 6
_DATA_DIGITS: Final = 16
_NO_DIGIT: Final = 255
_EXACT_STAMP_US: Final = 2**32 * 10**6
"""As floats, which is how lines are read, later stamps do not tell microseconds apart."""
_SHORTEST: Final = len("(0.000000) c 123#\n")
_LONGEST: Final = 500


def _hex_values() -> Bytes:
    values = np.full(256, _NO_DIGIT, dtype=np.uint8)
    for digit in b"0123456789abcdefABCDEF":
        values[digit] = int(chr(digit), 16)
    return values


_HEX: Final = _hex_values()


@dataclass(frozen=True)
class PlainBlock:
    """The frames of a block of plain lines, one row each.

    Attributes:
        timestamp_us: int64[lines].
        frame_id: uint32[lines].
        is_extended: bool[lines].
        is_rx: bool[lines].
        length: uint8[lines].
        data: uint8[lines, 8], zero padded.
    """

    timestamp_us: NDArray[np.int64]
    frame_id: NDArray[np.uint32]
    is_extended: NDArray[np.bool_]
    is_rx: NDArray[np.bool_]
    length: Bytes
    data: Bytes


def text_blocks(path: Path) -> Iterator[bytes]:
    """Yield a file in blocks of whole lines; the last may lack its line end."""
    rest = b""
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            block = rest + block
            end = block.rfind(b"\n") + 1
            rest = block[end:]
            if end:
                yield block[:end]
            elif len(rest) > _BLOCK_BYTES:
                yield rest  # a line of this length is none: whoever reads it line by line says so
                rest = b""
    if rest:
        yield rest


def parse_plain(block: bytes) -> PlainBlock | None:
    """Return the frames of a block, None where any line of it is not plain."""
    text = np.frombuffer(block, dtype=np.uint8)
    stops = np.flatnonzero(text == ord("\n"))
    hashes = np.flatnonzero(text == ord("#"))
    dots = np.flatnonzero(text == ord("."))
    if not len(stops) or stops[-1] != len(text) - 1:
        return None
    if len(hashes) != len(stops) or len(dots) != len(stops):
        return None
    starts = np.concatenate(([0], stops[:-1] + 1))
    sizes = stops - starts
    if np.any(sizes < _SHORTEST - 1) or np.any(sizes > _LONGEST):
        return None
    if not (np.all(dots > starts + 1) and np.all(dots + 8 < hashes) and np.all(hashes < stops)):
        return None
    stamps = _stamps(text, starts, dots)
    names = _identifiers(text, dots, hashes)
    frames = _data(text, hashes, stops)
    if stamps is None or names is None or frames is None:
        return None
    identifiers, is_extended = names
    is_rx, length, data = frames
    return PlainBlock(stamps, identifiers, is_extended, is_rx, length, data)


def _stamps(text: Bytes, starts: Places, dots: Places) -> NDArray[np.int64] | None:
    digits = dots - starts - 1
    most = int(digits.max())
    is_framed = (text[starts] == ord("(")) & (text[dots + _MICROSECOND_DIGITS + 1] == ord(")"))
    if most > _MAX_SECONDS_DIGITS or not is_framed.all():
        return None
    stamp = np.zeros(len(starts), dtype=np.int64)
    scale = 10**_MICROSECOND_DIGITS
    for place in range(1, most + 1):
        there = digits >= place
        digit = np.where(there, text[np.where(there, dots - place, starts + 1)] - ord("0"), 0)
        if np.any(digit > 9):
            return None
        stamp += digit.astype(np.int64) * scale
        scale *= 10
    scale = 10 ** (_MICROSECOND_DIGITS - 1)
    for place in range(1, _MICROSECOND_DIGITS + 1):
        digit = text[dots + place] - ord("0")
        if np.any(digit > 9):
            return None
        stamp += digit.astype(np.int64) * scale
        scale //= 10
    return stamp if int(stamp.max()) < _EXACT_STAMP_US else None


def _identifiers(
    text: Bytes, dots: Places, hashes: Places
) -> tuple[NDArray[np.uint32], NDArray[np.bool_]] | None:
    """Return identifiers of three or eight digits, one word of a channel before them."""
    short = text[hashes - 4] == ord(" ")
    is_extended = ~short
    before = hashes - np.where(short, 4, 9)
    channel = dots + _MICROSECOND_DIGITS + 3
    if np.any(before <= channel) or np.any(text[before] != ord(" ")):
        return None
    if np.any(text[channel - 1] != ord(" ")):
        return None
    # Between the two spaces stands the channel: one word, for which there are as many spaces in
    # the block as fields.
    identifier = np.zeros(len(hashes), dtype=np.uint32)
    for place in range(8):
        used = is_extended if place < 5 else np.ones(len(hashes), dtype=np.bool_)
        digit = _HEX[text[np.where(used, hashes - 8 + place, hashes - 1)]]
        if np.any(digit == _NO_DIGIT):
            return None
        identifier = np.where(used, identifier << np.uint32(4) | digit, identifier)
    highest = np.where(is_extended, 0x1FFFFFFF, 0x7FF)
    if np.any(identifier > highest) or not _are_words(text, channel, before):
        return None
    return identifier.astype(np.uint32), is_extended


def _are_words(text: Bytes, starts: Places, stops: Places) -> bool:
    """Tell whether the text between holds printable characters only, without a space."""
    is_plain = (text > ord(" ")) & (text < 127)
    so_far = np.concatenate(([0], np.cumsum(is_plain)))
    return bool(np.all(so_far[stops] - so_far[starts] == stops - starts))


def _data(
    text: Bytes, hashes: Places, stops: Places
) -> tuple[NDArray[np.bool_], Bytes, Bytes] | None:
    """Return direction, length and bytes of frames that end after ``data`` or ``data R|T``."""
    last = text[stops - 1]
    has_direction = (text[stops - 2] == ord(" ")) & ((last == ord("R")) | (last == ord("T")))
    digits = stops - hashes - 1 - np.where(has_direction, 2, 0)
    if np.any(digits < 0) or np.any(digits > _DATA_DIGITS) or np.any(digits % 2):
        return None
    data = np.zeros((len(hashes), _DATA_DIGITS), dtype=np.uint8)
    for place in range(int(digits.max(initial=0))):
        there = digits > place
        digit = _HEX[text[np.where(there, hashes + 1 + place, hashes - 1)]]
        if np.any(digit == _NO_DIGIT):
            return None
        data[:, place] = np.where(there, digit, 0)
    packed: Bytes = (data[:, 0::2] << np.uint8(4) | data[:, 1::2]).astype(np.uint8)
    is_rx = np.asarray(~(has_direction & (last == ord("T"))), dtype=np.bool_)
    return is_rx, (digits // 2).astype(np.uint8), packed
