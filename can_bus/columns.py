"""Whole logs at array speed: the codec over columns of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError
from can_bus.signals import SignalSpec
from can_bus.specs import MessageSpec

Column = NDArray[np.int64] | NDArray[np.uint64] | NDArray[np.float64]
"""Raw values of one signal: int64; uint64 for unsigned signals of 64 bits; float64 for floats."""

_WORD_BITS = 64
_WORD_BYTES = 8
_FLOAT_TYPES: dict[int, Any] = {16: np.float16, 32: np.float32, 64: np.float64}


def decode_columns(spec: MessageSpec, data: NDArray[np.uint8]) -> dict[str, Column]:
    """Return the raw value of each signal in each frame of a message.

    Args:
        spec: the message; little and big endian, signed, float, up to 64 bytes.
        data: uint8[frames, bytes]; columns beyond the message's length are ignored.

    Of a multiplexed message every signal is decoded in every frame; `present_columns` tells where
    it means something. Raises CanBusError for fewer columns than the message has bytes.
    """
    _require_columns(spec, data)
    if spec.length_bytes > _WORD_BYTES:
        return {s.name: _gather(s, spec.length_bytes, data) for s in spec.signals.values()}
    little = _words(spec.length_bytes, data)
    big = little.byteswap() >> np.uint64(_WORD_BITS - 8 * spec.length_bytes)
    return {
        s.name: _finish(
            s,
            (little if s.byte_order == "little_endian" else big)
            >> np.uint64(s.shift_in(spec.length_bytes)),
        )
        for s in spec.signals.values()
    }


def decode_columns_scaled(spec: MessageSpec, data: NDArray[np.uint8]) -> dict[str, Column]:
    """Return the scaled value of each signal in each frame as float64.

    NaN where the value is not available (SNA) or the signal is not in the frame. Raises as
    `decode_columns`.
    """
    raw = decode_columns(spec, data)
    present = present_columns(spec, raw)
    scaled: dict[str, Column] = {}
    for name, column in raw.items():
        signal = spec.signals[name]
        values = column.astype(np.float64) * signal.factor + signal.offset
        if signal.invalid_raw is not None:
            values[column == signal.invalid_raw] = np.nan
        values[~present[name]] = np.nan
        scaled[name] = values
    return scaled


def present_columns(spec: MessageSpec, raw: dict[str, Column]) -> dict[str, NDArray[np.bool_]]:
    """Return where each signal is in the frame: everywhere unless it is multiplexed."""
    present: dict[str, NDArray[np.bool_]] = {}

    def of(signal: SignalSpec) -> NDArray[np.bool_]:
        if signal.name not in present:
            if signal.multiplexer is None:
                present[signal.name] = np.ones(len(raw[signal.name]), dtype=np.bool_)
            else:
                selected = np.isin(raw[signal.multiplexer], sorted(signal.multiplexer_values))
                present[signal.name] = selected & of(spec.signals[signal.multiplexer])
        return present[signal.name]

    for signal in spec.signals.values():
        of(signal)
    return present


def _require_columns(spec: MessageSpec, data: NDArray[np.uint8]) -> None:
    if data.ndim != 2 or data.dtype != np.uint8 or data.shape[1] < spec.length_bytes:
        raise CanBusError(
            f"{spec.name}: frames of shape {data.shape} {data.dtype}: expected "
            f"uint8[frames, at least {spec.length_bytes}]"
        )


def _words(length_bytes: int, data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Return each frame of up to eight bytes as one little-endian integer."""
    if length_bytes == _WORD_BYTES == data.shape[1]:
        padded = np.ascontiguousarray(data)
    else:
        padded = np.zeros((len(data), _WORD_BYTES), dtype=np.uint8)
        padded[:, :length_bytes] = data[:, :length_bytes]
    return padded.view("<u8")[:, 0]


def _gather(signal: SignalSpec, length_bytes: int, data: NDArray[np.uint8]) -> Column:
    """Take the bytes that a signal covers, least significant first, and shift them together."""
    shift = signal.shift_in(length_bytes)
    first, last = shift // 8, (shift + signal.length_bits - 1) // 8
    word = np.zeros(len(data), dtype=np.uint64)
    for position in range(first, last + 1):
        index = position if signal.byte_order == "little_endian" else length_bytes - 1 - position
        byte = data[:, index].astype(np.uint64)
        left = 8 * position - shift
        word |= byte << np.uint64(left) if left >= 0 else byte >> np.uint64(-left)
    return _finish(signal, word)


def _finish(signal: SignalSpec, word: NDArray[np.uint64]) -> Column:
    """Return the raw values in the low bits of words; the bits above belong to other signals."""
    if signal.is_float:
        floats: Column = (
            word.astype(f"<u{signal.length_bits // 8}")
            .view(_FLOAT_TYPES[signal.length_bits])
            .astype(np.float64)
        )
        return floats
    unused = np.uint64(_WORD_BITS - signal.length_bits)
    if signal.is_signed:
        return (word << unused).view(np.int64) >> np.int64(unused)
    value = word & np.uint64((1 << signal.length_bits) - 1)
    return value if signal.length_bits == _WORD_BITS else value.view(np.int64)
