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
_EXACT_FLOATS = 2.0**53
_SURE_OF_INT64 = 2.0**62
_FLOAT_TYPES: dict[int, Any] = {16: np.float16, 32: np.float32, 64: np.float64}


def decode_columns(spec: MessageSpec, data: NDArray[np.uint8]) -> dict[str, Column]:
    """Return the raw value of each signal in each frame of a message.

    Args:
        spec: the message; little and big endian, signed, float, up to 64 bytes.
        data: uint8[frames, bytes]; columns beyond the message's length are ignored.

    Of a multiplexed message every signal is decoded in every frame; `present_columns` tells where
    it means something. Raises CanBusError for fewer columns than the message has bytes.
    """
    words = _Words(spec, data)
    return {signal.name: _raw(signal, words) for signal in spec.signals.values()}


def decode_columns_scaled(spec: MessageSpec, data: NDArray[np.uint8]) -> dict[str, Column]:
    """Return the scaled value of each signal in each frame as float64.

    NaN where the value is not available (SNA) or the signal is not in the frame. Whole numbers
    beyond 2^53 are the nearest float64. Raises as `decode_columns`.
    """
    words = _Words(spec, data)
    scaled: dict[str, Column] = {}
    # In one piece: large pages make it cheap to get.
    block = np.empty((len(spec.signals), len(data)))
    for signal, values in zip(spec.signals.values(), block, strict=True):
        _scale(signal, words, values)
        scaled[signal.name] = values
    selectors = {s.multiplexer for s in spec.signals.values() if s.multiplexer is not None}
    if selectors:
        raw = {name: _raw(spec.signals[name], words) for name in selectors}
        for name, is_there in _presence(spec, raw, len(data)).items():
            scaled[name][~is_there] = np.nan
    return scaled


def present_columns(spec: MessageSpec, raw: dict[str, Column]) -> dict[str, NDArray[np.bool_]]:
    """Return where each signal is in the frame: everywhere unless it is multiplexed."""
    return _presence(spec, raw, len(next(iter(raw.values()), ())))


def _presence(
    spec: MessageSpec, raw: dict[str, Column], frames: int
) -> dict[str, NDArray[np.bool_]]:
    present: dict[str, NDArray[np.bool_]] = {}

    def of(signal: SignalSpec) -> NDArray[np.bool_]:
        if signal.name not in present:
            if signal.multiplexer is None:
                present[signal.name] = np.ones(frames, dtype=np.bool_)
            else:
                selected = np.isin(raw[signal.multiplexer], sorted(signal.multiplexer_values))
                present[signal.name] = selected & of(spec.signals[signal.multiplexer])
        return present[signal.name]

    for signal in spec.signals.values():
        of(signal)
    return present


class _Words:
    """Each frame of a message as integers in which its signals lie.

    Up to eight bytes that is one word for each byte order; of longer frames each signal has its
    own.
    """

    def __init__(self, spec: MessageSpec, data: NDArray[np.uint8]) -> None:
        length = spec.length_bytes
        if data.ndim != 2 or data.dtype != np.uint8 or data.shape[1] < length:
            raise CanBusError(
                f"{spec.name}: frames of shape {data.shape} {data.dtype}: expected "
                f"uint8[frames, at least {length}]"
            )
        self._length, self._data = length, data
        self._by_order: dict[str, NDArray[np.uint64]] = {}

    def of(self, signal: SignalSpec) -> tuple[NDArray[np.uint64], int, int]:
        """Return words, and the shifts to the left and to the right that leave the signal."""
        shift, right = signal.shift_in(self._length), _WORD_BITS - signal.length_bits
        if self._length > _WORD_BYTES:
            return self._gathered(signal, shift), right, right
        order = signal.byte_order
        if order not in self._by_order:
            self._by_order[order] = self._whole(order)
        return self._by_order[order], right - shift, right

    def _whole(self, order: str) -> NDArray[np.uint64]:
        if order == "big_endian":
            unused = np.uint64(_WORD_BITS - 8 * self._length)
            swapped: NDArray[np.uint64] = self.of_little().byteswap() >> unused
            return swapped
        if self._length == _WORD_BYTES == self._data.shape[1]:
            padded = np.ascontiguousarray(self._data)
        else:
            padded = np.zeros((len(self._data), _WORD_BYTES), dtype=np.uint8)
            padded[:, : self._length] = self._data[:, : self._length]
        return padded.view("<u8")[:, 0]

    def of_little(self) -> NDArray[np.uint64]:
        """Return the words of little-endian signals."""
        if "little_endian" not in self._by_order:
            self._by_order["little_endian"] = self._whole("little_endian")
        return self._by_order["little_endian"]

    def _gathered(self, signal: SignalSpec, shift: int) -> NDArray[np.uint64]:
        # numba takes a quarter of a second to import: only who decodes whole logs pays for it.
        from can_bus.field_words import gather_words  # noqa: PLC0415

        first, last = shift // 8, (shift + signal.length_bits - 1) // 8
        low, step = (first, 1)
        if signal.byte_order == "big_endian":
            low, step = self._length - 1 - first, -1
        words = np.empty(len(self._data), dtype=np.uint64)
        gather_words(self._data, low, step, last - first + 1, shift % 8, words)
        return words


def _raw(signal: SignalSpec, words: _Words) -> Column:
    from can_bus.field_words import read_fields  # noqa: PLC0415

    source, left, right = words.of(signal)
    is_signed = signal.is_signed and not signal.is_float
    fields: Any = np.empty(len(source), dtype=np.int64 if is_signed else np.uint64)
    read_fields(source, left, right, is_signed, fields)
    if signal.is_float:
        floats: Column = (
            fields.astype(f"<u{signal.length_bits // 8}")
            .view(_FLOAT_TYPES[signal.length_bits])
            .astype(np.float64)
        )
        return floats
    if is_signed or signal.length_bits == _WORD_BITS:
        whole: Column = fields
        return whole
    return fields.view(np.int64)  # type: ignore[no-any-return]


def _scale(signal: SignalSpec, words: _Words, scaled: NDArray[np.float64]) -> None:
    """Fill `scaled` with the signal's scaled values, NaN where it is not available."""
    from can_bus.field_words import scale_fields  # noqa: PLC0415

    factor, offset, invalid = signal.factor, signal.offset, signal.invalid_raw
    ends = [signal.low_code * factor + offset, signal.high_code * factor + offset]
    is_whole = factor.is_integer() and offset.is_integer()
    if not signal.is_float and (not is_whole or max(map(abs, ends)) <= _EXACT_FLOATS):
        source, left, right = words.of(signal)
        fields = (source, left, right, signal.is_signed, factor, offset)
        scale_fields(*fields, invalid is not None, invalid or 0, scaled)
        return
    raw = _raw(signal, words)
    if signal.is_float:
        # What needs no scaling stays as it is, −0.0 as well.
        scaled[:] = raw if factor == 1 and offset == 0 else raw * factor + offset
    else:
        # Whole numbers that a float may not hold: exact first, then rounded once.
        kind: Any = np.int64 if max(map(abs, ends)) < _SURE_OF_INT64 else object
        scaled[:] = raw.astype(kind) * int(factor) + int(offset)
    if invalid is not None:
        scaled[raw == invalid] = np.nan
